"""Walk outward through one direction and one layer of height: which rings are free, and why the walk ends.

Used by free_space.py for each direction and layer. All distances are forward distances X in level_cam, unless they are
called depth.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, record
from ..params import Params
from ..types import FreeEnd, Ground
from .free_cells import HIDES_ALL, HIDES_NOTHING, HIDES_PART, count_codes, hiding_columns
from .free_holes import holds_hole, side_index
from .level import source_rows_of_column
from .view_geometry import Q_FAR, ViewGeometry

_NOT_SEEN, _OBSTACLE, _UNKNOWN, _VIEW, _RANGE = (
    int(FreeEnd.NOT_SEEN),
    int(FreeEnd.OBSTACLE),
    int(FreeEnd.UNKNOWN),
    int(FreeEnd.FIELD_OF_VIEW),
    int(FreeEnd.MAX_RANGE),
)
_NEAR_REACH = 1.5
"""A thing whose front is nearer than the minimum range may reach to this multiple of it."""
_LEAST_LAYER_M = 0.1
"""A layer with less than this above the ground is unknown."""
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
    ("ahead", np.float64),  # the optical depth of a point of level_cam is ahead x + right y + down z
    ("right", np.float64),
    ("down", np.float64),
    ("clear_m", np.float64),  # greatest optical depth that counts as measured
    ("gain", np.float64),  # f_px * lsb_per_px
    ("ring_noise", np.float64),  # noise of distance over the square of the distance, 1/m
    ("ring_noise_cap", np.float64),  # its greatest share of the distance
    ("ring_m", np.float64),  # step of range
    ("step_rad", np.float64),  # step of direction
    ("near_m", np.float64),  # optical depth to which a thing may reach that is too near to be measured
    ("blank_m", np.float64),  # least side of a thing without texture
)
"""Settings of the walk for one view and ground."""


class Sampled(NamedTuple):
    """Samples of one direction.

    Attributes:
        cells: (N,) uint16 of `look_at`.
        begin: (B + 1,) int64 of `look_at`.
        unknown: (B + 1,) int64, `dark` of `look_at`.
        in_source: (first, last) row, see `common_source_rows`.
        codes: (cols, rows) uint16 of the view.
        own: (first, end) of the columns that have their middle in the direction.
        dark_columns, dark_blocks: (K,) int64 and (K, blocks + 1) int16 of `count_dark_blocks`, of the columns that
            overlap the direction.
        holes, near_holes: (blocks,) uint8, `own` and `widened` of `join_holes`."""

    cells: Any
    begin: Any
    unknown: Any
    in_source: Any
    codes: Any
    own: Any
    dark_columns: Any
    dark_blocks: Any
    holes: Any
    near_holes: Any


def walk_settings(g: ViewGeometry, source: Any, ground: Ground, ke_per_m: float, p: Params) -> NDArray[Any]:
    """Returns (1,) WALK_SETTINGS of a view and the ground found in it. source: a record of SOURCE."""
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
        float(g.H[2, 0]) * g.cu + float(g.H[2, 1]) * g.cv + float(g.H[2, 2]),
        right,
        down,
        source["clear_m"],
        g.f_px * g.lsb_per_px,
        p.profile_sigmas * ke_per_m,
        p.profile_noise_cap,
        p.profile_ring_m,
        math.radians(p.profile_step_deg),
        _NEAR_REACH * source["min_range_m"],
        p.profile_blank_m,
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
def least_optical_depth(x, t0, t1, top, bottom, w):
    """Returns the least optical depth Z at forward distance x between two directions and two heights; arguments: see
    `optical_depth`."""
    return x * (w.ahead + min(w.right * t0, w.right * t1)) + min(w.down * top, w.down * bottom)


@inner
def least_blocking_code(gain, spread, cap, x):
    """Returns the least code whose pixel may lie at or before distance x, 2..65535.

    The measured distance X is reduced by its noise, min(spread X, cap) X. The reduced distance increases with X
    because cap <= 0.5, so there is one such code. The greatest code also stands for all that is nearer, and is always
    before x. Far pixels are behind all rings, which `walk_rings` limits to the range.

    Args:
        gain: f_px * lsb_per_px.
        spread: noise of distance over the square of the distance, 1/m.
        cap: greatest noise as a share of the distance.
        x: forward distance, m."""
    first, last = Q_FAR + 1, 65535
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
def blocking_codes(ring_m, edges_t, layers, w, blocking):
    """Computes `least_blocking_code` of each layer at each ring: blocking, (L, R) int32 out.

    The noise of forward distance is sigma_X = ke Z X: ring_noise is multiplied by the greatest Z/X of the layer.

    Args:
        ring_m: (R,) float32 forward distances.
        edges_t: (D + 1,) tangents of the directions.
        layers: (L + 1,) heights.
        w: a record of WALK_SETTINGS.
        blocking: (L, R) int32 out."""
    last = len(edges_t) - 1
    for layer in range(len(layers) - 1):
        for r in range(len(ring_m)):
            x = np.float64(ring_m[r])  # without the JIT the comparison would be in float32
            per_forward = optical_depth(x, edges_t[0], edges_t[last], layers[layer], layers[layer + 1], w) / x
            blocking[layer, r] = least_blocking_code(w.gain, w.ring_noise * max(per_forward, 0.0), w.ring_noise_cap, x)


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
def common_source_rows(H, u0, u1, src_cols, src_rows, rows):
    """Returns (first, last) of the rows that lie in the source in all columns u0..u1 - 1; first > last if there are
    none.

    Cells outside of the source are unknown in one piece, which may hide an obstacle, unlike single missing pixels."""
    first, last = 0, rows - 1
    for u in range(u0, u1):
        begin, end = source_rows_of_column(H, u, src_cols, src_rows, rows)
        first, last = max(first, begin), min(last, end - 1)
    return first, last


@inner
def is_hidden(sampled, x, before, v0, v1, t0, t1, top, lower, w):
    """True if a hole of the rows v0..v1 may hide a thing between the distances `before` and x.

    Where a part of this space may be too near to be measured, any hole counts, elsewhere one of the size of blank_m.

    Args:
        sampled: Sampled.
        x: forward distance of the ring.
        before: that from which on the ring would make the layer free.
        v0, v1: rows of the layer at x.
        t0, t1: tangents of the directions.
        top, lower: heights of the layer.
        w: a record of WALK_SETTINGS."""
    if least_optical_depth(before, t0, t1, top, lower, w) <= w.near_m:
        return holds_hole(sampled.near_holes, v0, v1, 0)
    return holds_hole(sampled.holes, v0, v1, side_index(w.blank_m * w.f_px / x))


@inner_inline
def part_at(x, v0, v1, in_source, t0, t1, top, bottom, w):
    """Returns (why, lower, first, last) of the part of a layer that can be judged at distance x: why it cannot (_OBSTACLE:
    it can), its lower end and its rows.

    Args:
        x: forward distance, m.
        v0, v1: rows of the whole layer, see `rows_between`.
        in_source: (first, last) row, see `common_source_rows`.
        t0, t1: tangents of the edges of the direction.
        top, bottom: heights of the layer.
        w: a record of WALK_SETTINGS."""
    lower = min(bottom, lowest_clear(0.5 * (t0 + t1), x, w))
    if lower < bottom and x > w.blind_beyond_m:
        return _UNKNOWN, lower, v0, v1
    if lower - top < _LEAST_LAYER_M:
        return _NOT_SEEN, lower, v0, v1
    if optical_depth(x, t0, t1, top, lower, w) > w.clear_m:
        return _RANGE, lower, v0, v1
    if lower < bottom:
        v0, v1 = rows_between(x, top, lower, w)
    if v0 < in_source[0] or v1 > in_source[1]:
        return _VIEW, lower, v0, v1
    return _OBSTACLE, lower, v0, v1


@inner_inline
def samples_of(sampled, v0, v1, w):
    """Returns (first, end, unknown) of the samples in the blocks that hold the rows v0..v1. w: a record of
    WALK_SETTINGS."""
    b0, b1 = v0 // w.block_rows, v1 // w.block_rows + 1
    return sampled.begin[b0], sampled.begin[b1], sampled.unknown[b1] - sampled.unknown[b0]


@inner
def walk_rings(sampled, t0, t1, ring_m, blocking, rows, top, bottom, w):
    """Walks outward through one direction and layer; returns (first, last, end) of the free rings, (-1, -1, end) if
    there are none.

    The walk begins at the first ring that measures a greater distance, and ends at the next one that does not. In it, rings
    with a hole are not free. The free rings are those before the first such hole, or, where that is in the first ring of
    the walk, those behind it. A ring whose columns hide a part ends the walk. So neither makes a ring free that would not be
    without it.

    The layer reaches from z = top down to bottom, or to `lowest_clear` if that is higher. If the part below may hide
    an obstacle of the least height, no part of it is free. Nothing is free beyond the range.

    Args:
        sampled: Sampled of the direction.
        t0, t1: tangents of its edges.
        ring_m: (R,) float32.
        blocking: (R,) int32 of `blocking_codes`.
        rows: (R, 2) int64 of `rows_of_rings`.
        top, bottom: heights of the layer.
        w: a record of WALK_SETTINGS."""
    first, last, end, begun = -1, -1, _NOT_SEEN, False
    for r in range(len(ring_m)):
        x = ring_m[r]
        why, lower, v0, v1 = part_at(x, rows[r, 0], rows[r, 1], sampled.in_source, t0, t1, top, bottom, w)
        if why != _OBSTACLE:
            if begun or why == _UNKNOWN:
                end = _VIEW if why == _NOT_SEEN else why
                break
            if why == _RANGE:
                break
            end = why if why == _NOT_SEEN else end
            continue
        from_cell, to_cell, dark = samples_of(sampled, v0, v1, w)
        total = to_cell - from_cell
        known, enough, near_enough = total - dark, w.free_share * total, (1.0 - w.free_share) * total
        if not begun and known < enough and known <= near_enough:
            end = _UNKNOWN  # too few known cells to make the ring free or to end the walk
            continue
        seen = count_codes(sampled.cells, from_cell, to_cell, Q_FAR, blocking[r] - 1)
        free = total > 0 and seen >= enough
        hides = hiding_columns(sampled, v0, v1, blocking[r]) if free else HIDES_NOTHING
        if free and hides != HIDES_ALL:
            begun = True
            if hides == HIDES_PART:
                end = _UNKNOWN
                break
            if not is_hidden(sampled, x, ring_m[last] if first >= 0 else x, v0, v1, t0, t1, top, lower, w):
                first = r if first < 0 else first
                last, end = r, _RANGE
                continue
            end = _UNKNOWN
            if first < 0:
                continue
            break
        near = known - seen
        if begun or near > near_enough:
            end = _OBSTACLE if near >= dark else _UNKNOWN
            break
        end = _UNKNOWN
    return first, last, end if first >= 0 or not begun else _UNKNOWN
