"""Geometry of the free-range profile: which rows of the levelled view cover one direction and layer at a distance, and
which part of them can be judged.

Used by free_walk.py and free_begin.py. All distances are forward distances X in level_cam, unless they are called depth."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, parameter_record, record_of
from ..params import Params
from ..types import FreeEnd, Ground
from .level import source_rows_of_column
from .view_geometry import ViewGeometry

_NOT_SEEN, _OBSTACLE, _UNKNOWN, _VIEW, _RANGE = map(int, FreeEnd)
_NEAR_REACH = 1.5
"""An object whose front is nearer than the minimum range may reach to this multiple of it."""
_LEAST_LAYER_M = 0.1
"""A layer with less than this above the ground is unknown."""
WALK_SETTINGS = parameter_record(
    Params,
    ("f_px", np.float64),
    ("horizon_row", np.float64),
    ("rows", np.int64),
    ("block_rows", np.int64),  # rows that are counted together, an even number
    ("height_m", np.float64),  # of the ground; infinite if there is none
    ("slope_x", np.float64),
    ("slope_y", np.float64),
    ("spread", np.float64),  # noise of the ground's height per metre of distance
    ("blind_beyond_m", np.float64),  # beyond it low obstacles cannot be distinguished from the ground
    ("ahead", np.float64),  # the optical depth of a point of level_cam is ahead x + right y + down z
    ("right", np.float64),
    ("down", np.float64),
    ("clear_m", np.float64),  # greatest optical depth that counts as measured
    ("gain", np.float64),  # f_px * lsb_per_px
    ("ring_noise", np.float64),  # noise of distance over the square of the distance, 1/m
    ("step_rad", np.float64),  # step of direction
    ("near_m", np.float64),  # optical depth to which an object may reach that is too near to be measured
)
"""All parameters, and what follows from them for the walk through one view with its ground."""


class ProfileCell(NamedTuple):
    """One direction and one layer of the profile."""

    t0: float  # t0, t1: tangents y/x of the edges of the direction
    t1: float
    top: float  # top, bottom: heights z of the edges of the layer, m
    bottom: float


class Part(NamedTuple):
    """The part of a cell that can be judged at a distance."""

    x: float  # forward distance, m
    why: int  # FreeEnd, why no part can be judged; OBSTACLE: it can
    lower: float  # its lower end, m; the upper one is that of the cell
    first: int  # first, last: its rows. Valid if it can be judged, or if it cannot because it is out of view
    last: int


def walk_settings(g: ViewGeometry, source: Any, ground: Ground, ke_per_m: float, p: Params) -> NDArray[Any]:
    """Returns (1,) WALK_SETTINGS of a view and the ground found in it. source: a record of SOURCE."""
    ahead = float(g.H[2, 0]) * g.cu + float(g.H[2, 1]) * g.cv + float(g.H[2, 2])
    return record_of(
        WALK_SETTINGS,
        p,
        f_px=g.f_px,
        horizon_row=g.cv,
        rows=g.rows,
        block_rows=p.profile_block_px + p.profile_block_px % 2,
        height_m=ground.height_m if ground.seen else math.inf,
        slope_x=ground.slope_x,
        slope_y=ground.slope_y,
        spread=ground.noise_per_m,
        blind_beyond_m=ground.blind_beyond_m,
        ahead=ahead,
        right=float(g.H[2, 0]) * g.f_px / float(g.lateral[0]),
        down=float(g.H[2, 1]) * g.f_px,
        clear_m=source["clear_m"],
        gain=g.f_px * g.lsb_per_px,
        ring_noise=p.profile_sigmas * ke_per_m,
        step_rad=math.radians(p.profile_step_deg),
        near_m=_NEAR_REACH * source["min_range_m"],
    )


@inner
def optical_depth(cell, x, lower, w):
    """Returns the greatest optical depth Z of a cell down to the height `lower` at forward distance x.

    Z is a linear function of the place, so its maximum is at a corner. w: a record of WALK_SETTINGS."""
    return x * (w.ahead + max(w.right * cell.t0, w.right * cell.t1)) + max(w.down * cell.top, w.down * lower)


@inner
def least_optical_depth(cell, x, lower, w):
    """Returns the least optical depth Z of a cell; arguments: see `optical_depth`."""
    return x * (w.ahead + min(w.right * cell.t0, w.right * cell.t1)) + min(w.down * cell.top, w.down * lower)


@inner
def lowest_clear(t, x, w):
    """Returns the z down to which free space can be distinguished from the ground, in direction t (y/x) at distance
    x.

    Pixels within the tolerance of the ground, or within its noise at that distance, were taken for ground. w: a
    record of WALK_SETTINGS."""
    return w.height_m + (w.slope_x + w.slope_y * t) * x - max(w.ground_tolerance_m, w.spread * x)


@inner_inline
def rows_between(x, top, lower, w):
    """Returns (first, last) of the rows from z = top down to lower at distance x; (-1, -1) if the view does not
    contain all of them."""
    v0, v1 = math.floor(w.horizon_row + w.f_px * top / x + 0.5), math.ceil(w.horizon_row + w.f_px * lower / x - 0.5)
    if v0 < 0 or v1 >= w.rows:
        return -1, -1
    return int(v0), int(v1)


@inner
def common_source_rows(H, columns, image, rows):
    """Returns (first, last) of the rows that lie in the source in all columns of (first, end); first > last if there are
    none.

    Cells outside of the source are unknown in one piece, which may hide an obstacle, unlike single missing pixels.
    H: of ViewGeometry; image: a record of SOURCE; rows: of the view."""
    first, last = 0, rows - 1
    for u in range(columns[0], columns[1]):
        begin, end = source_rows_of_column(H, u, image.width_px, image.height_px, rows)
        first, last = max(first, begin), min(last, end - 1)
    return first, last


@inner_inline
def part_at(cell, x, in_source, w):
    """Returns the Part of a cell that can be judged at forward distance x.

    The part reaches down to `lowest_clear` if that is higher than the bottom of the layer. If the part below may hide an
    obstacle of the least height, no part can be judged.

    Args:
        cell: ProfileCell.
        x: forward distance, m.
        in_source: (first, last) row, see `common_source_rows`.
        w: a record of WALK_SETTINGS."""
    lower = min(cell.bottom, lowest_clear(0.5 * (cell.t0 + cell.t1), x, w))
    if lower < cell.bottom and x > w.blind_beyond_m:
        return Part(x, _UNKNOWN, lower, -1, -1)
    if lower - cell.top < _LEAST_LAYER_M:
        return Part(x, _NOT_SEEN, lower, -1, -1)
    if optical_depth(cell, x, lower, w) > w.clear_m:
        return Part(x, _RANGE, lower, -1, -1)
    first, last = rows_between(x, cell.top, lower, w)
    if first < in_source[0] or last > in_source[1]:
        return Part(x, _VIEW, lower, first, last)
    return Part(x, _OBSTACLE, lower, first, last)
