"""Observed free space: for each direction and layer of height, the range that was measured to be free, and why it
ends.

Input: quantised disparity of the exact view, without pooling, and the ground. Output: `FreeObservation`, which
free_profile.py limits by the planes. The paper has no free space: its rectangles have a free side, but the space
between a pole and the wall behind it is unknown.

The search walks outward in rings of equal forward distance. A ring is free if `free_share` of the cells that cover
the layer there measure a greater distance. Unknown cells, cells outside of the source and ground that is too near are
not free. No column may be unknown over most of the layer: single missing pixels hide nothing, a column of them may
hide a pole or the end of a wall.

The range of the camera is an optical depth Z, while rings are forward distances X in level_cam. A ring is free only
if its whole layer lies within the range."""

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
"""Greatest number of rings; their index fits one byte. Space beyond them is not free."""
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
    ("block_rows", np.int64),  # rows that are counted together, an even number
    ("height_m", np.float64),  # of the ground; infinite if there is none
    ("slope_x", np.float64),
    ("slope_y", np.float64),
    ("tolerance_m", np.float64),  # of the ground
    ("spread", np.float64),  # noise of the ground's height per metre of distance
    ("blind_beyond_m", np.float64),  # beyond it low obstacles cannot be distinguished from the ground
    ("free_share", np.float64),  # share of the cells that makes a ring free
    ("least_m", np.float64),  # least height of a layer above the ground
    ("ahead", np.float64),  # the optical depth of a point of level_cam is ahead x + right y + down z
    ("right", np.float64),
    ("down", np.float64),
    ("clear_m", np.float64),  # greatest optical depth that counts as measured
    ("gain", np.float64),  # f_px * lsb_per_px
    ("ring_noise", np.float64),  # noise of distance over the square of the distance, 1/m
    ("ring_noise_cap", np.float64),  # its greatest share of the distance
    ("ring_m", np.float64),  # step of range
    ("step_rad", np.float64),  # step of direction
)
"""Settings of the walk for one view and ground."""


class Sampled(NamedTuple):
    """Samples of one direction.

    Attributes:
        cells: (N,) uint16 of `look_at`.
        begin: (B + 1,) int64 of `look_at`.
        unknown: (B + 1,) int64, `dark` of `look_at`.
        in_source: (first, last) row, see `rows_in_source`.
        dark_blocks: (K, blocks + 1) int16 of `count_dark_blocks`, the columns that have any."""

    cells: Any
    begin: Any
    unknown: Any
    in_source: Any
    dark_blocks: Any


class FreeRanges(NamedTuple):
    """Free ranges of D directions and L layers.

    Attributes:
        free_from: (D, L) float32 forward distance, m.
        free_to: (D, L) float32 forward distance, m.
        end: (D, L) uint8 FreeEnd."""

    free_from: Any
    free_to: Any
    end: Any


def walk_settings(g: ViewGeometry, ground: Ground, clear_m: float, ke_per_m: float, p: Params) -> NDArray[Any]:
    """Returns (1,) WALK_SETTINGS of a view and the ground found in it."""
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
    """Returns the greatest optical depth Z at forward distance x between two directions and two heights.

    Z is a linear function of the place, so its maximum is at a corner.

    Args:
        x: forward distance, m.
        t0, t1: tangents y/x of the directions.
        top, bottom: heights z, m.
        w: a record of WALK_SETTINGS."""
    return x * (w.ahead + max(w.right * t0, w.right * t1)) + max(w.down * top, w.down * bottom)


@inner
def code_behind(gain, spread, cap, x):
    """Returns the least code whose pixel may lie at or before distance x, 2..65536.

    The measured distance X is reduced by its noise, min(spread X, cap) X. The reduced distance increases with X
    because cap <= 0.5, so there is one such code. Far pixels are behind all rings, which `walk_rings` limits to the
    range.

    Args:
        gain: f_px * lsb_per_px.
        spread: noise of distance over the square of the distance, 1/m.
        cap: greatest noise as a share of the distance.
        x: forward distance, m."""
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
    """Computes `code_behind` of each layer at each ring: behind, (L, R) int32 out.

    The noise of forward distance is sigma_X = ke Z X: ring_noise is multiplied by the greatest Z/X of the layer.

    Args:
        ring_m: (R,) float32 forward distances.
        edges_t: (D + 1,) tangents of the directions.
        layers: (L + 1,) heights.
        w: a record of WALK_SETTINGS.
        behind: (L, R) int32 out."""
    last = len(edges_t) - 1
    for layer in range(len(layers) - 1):
        for r in range(len(ring_m)):
            x = np.float64(ring_m[r])  # without the JIT the comparison would be in float32
            per_forward = optical_depth(x, edges_t[0], edges_t[last], layers[layer], layers[layer + 1], w) / x
            behind[layer, r] = code_behind(w.gain, w.ring_noise * max(per_forward, 0.0), w.ring_noise_cap, x)


@inner
def lowest_clear(t, x, w):
    """Returns the z down to which free space can be distinguished from the ground, in direction t (y/x) at distance
    x.

    Pixels within the tolerance of the ground, or within its noise at that distance, were taken for ground. w: a
    record of WALK_SETTINGS."""
    return w.height_m + (w.slope_x + w.slope_y * t) * x - max(w.tolerance_m, w.spread * x)


@inner_inline
def rows_between(x, top, lower, w):
    """Returns (first, last) of the rows from z = top down to lower at distance x; (-1, -1) if the view does not
    contain all of them."""
    v0, v1 = math.floor(w.horizon_row + w.f_px * top / x + 0.5), math.ceil(w.horizon_row + w.f_px * lower / x - 0.5)
    if v0 < 0 or v1 >= w.rows:
        return -1, -1
    return int(v0), int(v1)


@inner
def rows_of_rings(ring_m, layers, w, rows):
    """Computes `rows_between` of each whole layer at each ring: rows, (L, R, 2) int64 out. It is the same in all
    directions."""
    for layer in range(len(layers) - 1):
        for r in range(len(ring_m)):
            first, last = rows_between(ring_m[r], layers[layer], layers[layer + 1], w)
            rows[layer, r, 0], rows[layer, r, 1] = first, last


@inner
def rows_in_source(H, u0, u1, src_cols, src_rows, rows):
    """Returns (first, last) of the rows that lie in the source in all columns u0..u1 - 1; first > last if there are
    none.

    Cells outside of the source are unknown in one piece, which may hide an obstacle, unlike single missing pixels."""
    first, last = 0, rows - 1
    for u in range(u0, u1):
        begin, end = seen_rows(H, u, src_cols, src_rows, rows)
        first, last = max(first, begin), min(last, end - 1)
    return first, last


@inner
def hides_column(dark_blocks, v0, v1):
    """True if a column is unknown in more than half of its blocks in the rows v0..v1, rounded outward.

    dark_blocks: see `Sampled`."""
    b0, b1 = v0 // DARK_ROWS, min(v1 // DARK_ROWS + 1, dark_blocks.shape[1] - 1)
    most = 0
    for u in range(dark_blocks.shape[0]):
        most = max(most, dark_blocks[u, b1] - dark_blocks[u, b0])
    return 2 * most > b1 - b0


@inner
def walk_rings(sampled, t0, t1, ring_m, behind, rows, top, bottom, w):
    """Walks outward through one direction and layer; returns (first, last, end) of the free rings, (-1, -1, end) if
    there are none.

    The layer reaches from z = top down to bottom, or to `lowest_clear` if that is higher. If the part below may hide
    an obstacle of the least height, no part of it is free. Nothing is free beyond the range.

    Args:
        sampled: Sampled of the direction.
        t0, t1: tangents of its edges.
        ring_m: (R,) float32.
        behind: (R,) int32 of `codes_behind`.
        rows: (R, 2) int64 of `rows_of_rings`.
        top, bottom: heights of the layer.
        w: a record of WALK_SETTINGS."""
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
            why = _UNKNOWN  # too few known cells to make the ring free or to end the walk
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
    """Computes the free ranges of every direction and layer of a levelled view.

    Args:
        codes: (cols, rows) uint16 of the view without pooling.
        view: ViewGeometry.
        image: a record of SOURCE.
        edges_t: (D + 1,) float64.
        behind: (L, R) int32 of `codes_behind`.
        ring_m: (R,) float32.
        layers: (L + 1,) float32.
        w: a record of WALK_SETTINGS.
        out: FreeRanges."""
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
    """Returns the edges of the profile's layers, (L + 1,) float32 z in metres, increasing, read-only.

    Inner layers are centred on the height of the camera. Outer layers extend above and below them to profile_reach_m,
    if that is farther than the inner layers reach."""
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
    """Free ranges by pixels alone, before they are limited by planes. Ranges are forward distances.

    Attributes:
        edges_rad: (D + 1,) float64, azimuths of the edges of the directions.
        edges_t: (D + 1,) float64, their tangents.
        pixel_t: tangent of a column of the view.
        row_t: tangent of a row of the view.
        layers_m: (L + 1,) float32, edges of the layers, z down.
        free_from_m: (D, L) float32.
        free_to_m: (D, L) float32.
        end: (D, L) uint8 FreeEnd."""

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
    """Returns the free ranges by the pixels of a levelled view without pooling.

    Args:
        codes: (cols, rows) uint16.
        view: geometry of `codes`.
        source: (1,) SOURCE.
        ground: ground of the frame.
        ke_per_m: noise coefficient.
        params: parameters."""
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
    """Returns (edges_rad, edges_t, free_from_m, free_to_m, end) of FreeObservation.

    Directions are step_rad wide, except for the last one. Rings are ring_m apart, up to clear_m.

    Args:
        codes, view, source: see `observe_free`.
        layers: of `layer_edges`.
        settings: (1,) WALK_SETTINGS."""
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
