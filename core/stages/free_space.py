"""The free-range profile: which space in front of the camera was observed to be free, and why each free range ends.

Planes alone cannot answer "is it free?": the space between a pole and the wall behind it is unknown. For each direction
and layer of height the profile walks outward in rings; a ring is free when `free_share` of the cells that look at the
layer there see farther. Unknown pixels, cells outside the source and ground that comes too early never count as seen. No
column may be unknown over most of the layer: pixels that drop out here and there hide nothing, a column of them hides a
pole or the end of a wall.

The camera's range is an optical depth Z, while rings are forward distances X in the level frame. A ring is free only where
the whole of its layer lies within the range, so that a tilted camera calls nothing free that it cannot measure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, kernel, record
from ..params import Params
from ..types import FreeEnd, Ground
from .free_cells import DARK_ROWS, count_codes, count_dark_blocks, look_at, looked_at
from .level import seen_rows
from .view_geometry import Q_FAR, ViewGeometry

_MAX_RINGS = 250
"""Rings are counted in one byte; beyond so many nothing is called free."""
_NOT_SEEN, _OBSTACLE, _UNKNOWN, _VIEW, _RANGE = (
    int(FreeEnd.NOT_SEEN),
    int(FreeEnd.OBSTACLE),
    int(FreeEnd.UNKNOWN),
    int(FreeEnd.FIELD_OF_VIEW),
    int(FreeEnd.MAX_RANGE),
)
WALK_SETTINGS = record(
    ("f_px", np.float64),
    ("horizon_row", np.float64),
    ("rows", np.int64),
    ("block_rows", np.int64),
    ("height_m", np.float64),
    ("slope_x", np.float64),
    ("slope_y", np.float64),
    ("tolerance_m", np.float64),
    ("spread", np.float64),
    ("blind_beyond_m", np.float64),
    ("free_share", np.float64),
    ("least_m", np.float64),
    ("ahead", np.float64),
    ("right", np.float64),
    ("down", np.float64),
    ("clear_m", np.float64),
    ("gain", np.float64),
    ("ring_noise", np.float64),
    ("ring_noise_cap", np.float64),
    ("ring_m", np.float64),
    ("step_rad", np.float64),
)
"""f_px, horizon_row, rows: of the view; block_rows: rows that are counted together, even. height_m to blind_beyond_m: the
ground, its tolerance and the noise of its height over range; without a ground its height is infinite. free_share,
least_m: what counts as free, and the least height of a layer above the ground. The optical depth of a point of level_cam is
ahead x + right y + down z; clear_m: up to where it counts as measured. gain: f_px * lsb_per_px. ring_noise: noise of
distance over its square, ring_noise_cap: its greatest share of the distance. ring_m, step_rad: steps of range and
direction."""


class Sampled(NamedTuple):
    """The cells of one direction: cells, begin and unknown of `look_at`, the rows (first, last) of `rows_in_source`, and
    dark_blocks of `count_dark_blocks`, of the columns that have any."""

    cells: Any
    begin: Any
    unknown: Any
    in_source: Any
    dark_blocks: Any


class FreeRanges(NamedTuple):
    """D directions and L layers: free_from, free_to (D, L) float32 forward distances, end (D, L) uint8."""

    free_from: Any
    free_to: Any
    end: Any


def walk_settings(g: ViewGeometry, ground: Ground, clear_m: float, ke_per_m: float, p: Params) -> NDArray[Any]:
    """(1,) WALK_SETTINGS of a view and the ground found in it."""
    out = np.zeros(1, WALK_SETTINGS)
    right, down = float(g.H[2, 0]) * g.f_px / float(g.lateral[0]), float(g.H[2, 1]) * g.f_px
    out[0] = (
        g.f_px,
        g.cv,
        g.rows,
        p.profile_block_px + p.profile_block_px % 2,
        ground.height_m if ground.seen else math.inf,
        ground.slope_x,
        ground.slope_y,
        p.ground_tolerance_m,
        p.ground_sigmas * ke_per_m * ground.height_m if ground.seen else 0.0,
        ground.blind_beyond_m,
        p.free_share,
        p.profile_least_m,
        float(g.H[2, 0]) * g.cu + float(g.H[2, 1]) * g.cv + float(g.H[2, 2]),
        right,
        down,
        clear_m,
        g.f_px * g.lsb_per_px,
        p.profile_sigmas * ke_per_m,
        p.profile_noise_cap,
        p.profile_ring_m,
        math.radians(p.profile_step_deg),
    )
    return out


@inner
def optical_depth(x, t0, t1, top, bottom, w):
    """Greatest optical depth Z at forward distance x between the directions t0, t1 (y/x) and the heights z = top, bottom.

    Z is linear in the place: the greatest is that of a corner. w: a record of WALK_SETTINGS."""
    return x * (w.ahead + max(w.right * t0, w.right * t1)) + max(w.down * top, w.down * bottom)


@inner
def code_behind(gain, spread, cap, x):
    """The least code that does not see through distance x: it measures no more than x when it is brought nearer by its
    noise, min(spread X, cap) X. 2..65536.

    gain: f_px * lsb_per_px. Distance less noise rises with distance (cap <= 0.5), so there is one such code. Unknown sees
    through nothing; what is far sees through all within the range, which `walk_rings` keeps to."""
    first, last = Q_FAR + 1, 65536
    for _ in range(17):
        if first >= last:
            break
        q = (first + last) // 2
        measured = gain / q
        if measured - min(spread * measured * measured, cap * measured) >= x:
            first = q + 1
        else:
            last = q
    return first


@inner
def codes_behind(ring_m, edges_t, layers, w, behind):
    """behind: (L, R) int32 out, `code_behind` of each layer at each ring.

    ring_noise holds where a ray's optical depth is its forward distance; elsewhere it is Z/X times as much, since
    sigma_X = ke Z X. The greatest of the layer is taken. ring_m: (R,) float32. w: a record of WALK_SETTINGS."""
    last = len(edges_t) - 1
    for layer in range(len(layers) - 1):
        for r in range(len(ring_m)):
            x = np.float64(ring_m[r])  # else a comparison without the JIT is in float32
            per_forward = optical_depth(x, edges_t[0], edges_t[last], layers[layer], layers[layer + 1], w) / x
            behind[layer, r] = code_behind(w.gain, w.ring_noise * max(per_forward, 0.0), w.ring_noise_cap, x)


@inner
def lowest_clear(t, x, w):
    """z down to which free space can be distinguished from ground in direction t (y/x) at distance x. w: a record of WALK_SETTINGS.

    What is lower than the ground's tolerance or its noise at that distance was taken for ground: nothing is known
    about it."""
    return w.height_m + (w.slope_x + w.slope_y * t) * x - max(w.tolerance_m, w.spread * x)


@inner_inline
def rows_between(x, top, lower, w):
    """(first, last) of the rows from z = top down to lower at distance x; -1, -1 where the view does not hold all of them.

    w: a record of WALK_SETTINGS."""
    v0, v1 = math.floor(w.horizon_row + w.f_px * top / x + 0.5), math.ceil(w.horizon_row + w.f_px * lower / x - 0.5)
    if v0 < 0 or v1 >= w.rows:
        return -1, -1
    return int(v0), int(v1)


@inner
def rows_of_rings(ring_m, layers, w, rows):
    """rows: (L, R, 2) int64 out, `rows_between` of each whole layer at each ring: the same in all directions."""
    for layer in range(len(layers) - 1):
        for r in range(len(ring_m)):
            first, last = rows_between(ring_m[r], layers[layer], layers[layer + 1], w)
            rows[layer, r, 0], rows[layer, r, 1] = first, last


@inner
def rows_in_source(H, u0, u1, src_cols, src_rows, rows):
    """(first, last) of the rows that lie in the source image in each of the columns u0..u1 - 1; first > last: none.

    What lies outside is unknown in one piece and would hide a thing there, unlike pixels that drop out here and there."""
    first, last = 0, rows - 1
    for u in range(u0, u1):
        begin, end = seen_rows(H, u, src_cols, src_rows, rows)
        first, last = max(first, begin), min(last, end - 1)
    return first, last


@inner
def hides_column(dark_blocks, v0, v1):
    """Whether a column is dark in more than half of the blocks in the rows v0..v1, rounded outwards. dark_blocks: of
    `count_dark_blocks`."""
    b0, b1 = v0 // DARK_ROWS, min(v1 // DARK_ROWS + 1, dark_blocks.shape[1] - 1)
    most = 0
    for u in range(dark_blocks.shape[0]):
        most = max(most, dark_blocks[u, b1] - dark_blocks[u, b0])
    return 2 * most > b1 - b0


@inner
def walk_rings(sampled, t0, t1, ring_m, behind, rows, top, bottom, w):
    """(first, last, end) of the rings that are free in one direction and layer, walking outward; -1, -1: none.

    sampled: Sampled of the direction between t0 and t1; behind: (R,) of `codes_behind`; rows: (R, 2) of `rows_of_rings`. The layer reaches from z = top down to bottom, or to `lowest_clear`; where that may
    hide an obstacle of the least height, none of it is free. Nothing is free beyond the range. w: a record of WALK_SETTINGS."""
    t, block = 0.5 * (t0 + t1), w.block_rows
    begin, unknown, in_source = sampled.begin, sampled.unknown, sampled.in_source
    first, last, why = -1, -1, _NOT_SEEN
    for r in range(len(ring_m)):
        x, v0, v1 = ring_m[r], rows[r, 0], rows[r, 1]
        lower = min(bottom, lowest_clear(t, x, w))
        if lower < bottom and x > w.blind_beyond_m:
            why = _UNKNOWN
            break
        if lower - top < w.least_m:
            why = _NOT_SEEN if first < 0 else _VIEW
            if first >= 0:
                break
            continue
        if optical_depth(x, t0, t1, top, lower, w) > w.clear_m:
            if first >= 0:
                why = _RANGE
            break
        if lower < bottom:
            v0, v1 = rows_between(x, top, lower, w)
        if v0 < in_source[0] or v1 > in_source[1]:
            if first >= 0:
                why = _VIEW
                break
            continue
        b0, b1 = v0 // block, v1 // block + 1
        from_cell, to_cell = begin[b0], begin[b1]
        total, dark = to_cell - from_cell, unknown[b1] - unknown[b0]
        known, enough, near_enough = total - dark, w.free_share * total, (1.0 - w.free_share) * total
        if first < 0 and known < enough and known <= near_enough:
            why = _UNKNOWN  # whatever these cells measure, they neither make the ring free nor end the walk
            continue
        seen = count_codes(sampled.cells, from_cell, to_cell, Q_FAR, behind[r] - 1)
        if total > 0 and seen >= enough and not hides_column(sampled.dark_blocks, v0, v1):
            if first < 0:
                first = r
            last = r
            why = _RANGE
            continue
        near = known - seen
        if first >= 0 or near > near_enough:
            why = _OBSTACLE if near >= dark else _UNKNOWN
            break
        why = _UNKNOWN
    return first, last, why


@kernel
def walk_view(codes, view, image, edges_t, behind, ring_m, layers, w, out):
    """Every direction and layer of a levelled view.

    codes: (cols, rows) uint16 of the view, not pooled. image: a record of SOURCE. edges_t: (D + 1,) float64; behind: (L, R) of
    `codes_behind`. out: FreeRanges."""
    cols, rows = codes.shape
    block, cu, f_u = w.block_rows, view.cu, view.f_px / np.float64(view.lateral[0])
    cells, begin = np.empty(cols * (rows + 1) + 2, np.uint16), np.empty((rows + block - 1) // block + 1, np.int64)
    dark, unknown = np.empty(begin.shape[0], np.int64), np.empty(rows, np.uint16)
    looked, layer_rows = np.empty((2, rows), np.uint16), np.empty((len(layers) - 1, len(ring_m), 2), np.int64)
    dark_blocks = np.empty((cols, rows // DARK_ROWS + 1), np.int16)
    looked_at(rows, looked)
    rows_of_rings(ring_m, layers, w, layer_rows)
    H = view.H
    u1 = 0
    for d in range(len(edges_t) - 1):
        u0 = u1
        while u1 < cols and (d == len(edges_t) - 2 or (u1 - cu) / f_u < edges_t[d + 1]):
            u1 += 1
        look_at(codes, u0, u1, block, looked, unknown, cells, begin, dark)
        in_source = rows_in_source(H, u0, u1, image.width_px, image.height_px, rows)
        spotted = count_dark_blocks(codes, u0, u1, dark_blocks)
        sampled = Sampled(cells, begin, dark, in_source, dark_blocks[:spotted])
        for layer in range(len(layers) - 1):
            first, last, why = walk_rings(
                sampled,
                edges_t[d],
                edges_t[d + 1],
                ring_m,
                behind[layer],
                layer_rows[layer],
                layers[layer],
                layers[layer + 1],
                w,
            )
            out.end[d, layer] = why
            out.free_from[d, layer] = ring_m[first] if first >= 0 else 0.0
            out.free_to[d, layer] = ring_m[last] if first >= 0 else 0.0


def layer_edges(params: Params) -> NDArray[np.float32]:
    """(L + 1,) float32 edges of the profile's layers in z, metres, increasing; read-only.

    Inner layers lie around the height of the camera, outer ones above and below them up to profile_reach_m. There are no
    outer layers where the inner ones reach as far."""
    p = params
    return _layer_edges(p.profile_layers, p.profile_layer_m, p.profile_outer_layers, p.profile_reach_m)


@lru_cache(maxsize=16)
def _layer_edges(inner: int, inner_m: float, outer: int, reach_m: float) -> NDArray[np.float32]:
    edges = inner_m * (np.arange(inner + 1) - 0.5 * inner)
    if outer and reach_m > edges[-1]:
        beyond = np.linspace(edges[-1], reach_m, outer + 1)[1:]
        edges = np.concatenate((-beyond[::-1], edges, beyond))
    edges = edges.astype(np.float32)
    edges.setflags(write=False)
    return edges


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeObservation:
    """Free ranges by pixels alone, before any plane: forward distances. edges_rad, edges_t: (D + 1,) float64 azimuths and
    their tangents; pixel_t, row_t: tangent of a column and of a row of the view; layers_m: (L + 1,) float32; free_from_m, free_to_m: (D, L) float32; end: (D, L) uint8."""

    edges_rad: NDArray[np.float64]
    edges_t: NDArray[np.float64]
    pixel_t: float
    row_t: float
    layers_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]


def observe_free(
    codes: NDArray[np.uint16], view: ViewGeometry, source: NDArray[Any], ground: Ground, ke_per_m: float, params: Params
) -> FreeObservation:
    """Free ranges by the pixels of a levelled view that is not pooled. source: (1,) SOURCE."""
    layers = layer_edges(params)
    settings = walk_settings(view, ground, float(source["clear_m"][0]), ke_per_m, params)
    edges, edges_t, free_from, free_to, end = see_free(codes, view, source, layers, settings)
    return FreeObservation(
        edges_rad=edges,
        edges_t=edges_t,
        pixel_t=float(view.lateral[0]) / view.f_px,
        row_t=1.0 / view.f_px,
        layers_m=layers,
        free_from_m=free_from,
        free_to_m=free_to,
        end=end,
    )


@kernel
def see_free(codes, view, source, layers, settings):
    """(edges_rad, edges_t, free_from_m, free_to_m, end) of FreeObservation by `codes_behind` and `walk_view`.

    Directions are step_rad wide but for the last one; rings of ring_m up to clear_m. layers: `layer_edges`; settings: (1,)
    WALK_SETTINGS."""
    w, image = settings[0], source[0]
    cu, f_u, step_rad, ring, clear_m = view.cu, view.f_px / np.float64(view.lateral[0]), w.step_rad, w.ring_m, w.clear_m
    first, last = math.atan((-0.5 - cu) / f_u), math.atan((codes.shape[0] - 0.5 - cu) / f_u)
    n = max(1, int(math.ceil((last - first) / step_rad)))
    edges, edges_t = np.empty(n + 1), np.empty(n + 1)
    for d in range(n + 1):
        edges[d] = first + step_rad * d if d < n else last
        edges_t[d] = math.tan(edges[d])
    rings = min(max(0, int(math.ceil((clear_m - ring) / ring))), _MAX_RINGS)
    ring_m, behind = np.empty(rings, np.float32), np.empty((layers.shape[0] - 1, rings), np.int32)
    for r in range(rings):
        ring_m[r] = ring + ring * r
    codes_behind(ring_m, edges_t, layers, w, behind)
    shape = (n, layers.shape[0] - 1)
    free_from, free_to, end = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.uint8)
    walk_view(codes, view, image, edges_t, behind, ring_m, layers, w, FreeRanges(free_from, free_to, end))
    return edges, edges_t, free_from, free_to, end
