"""Columns of blocks: where the textureless pixels of a column end, and up to which distance that is evidence. See
docs/explanation/open-space.md."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, parameter_record, record_of
from ..open_sky_params import OpenSkyParams
from .open_blocks import (
    BEYOND_ALL,
    BLOCK,
    CONTINUED,
    EDGE_ROWS,
    IS_CONTINUED,
    IS_MEASURED,
    IS_SMOOTH,
    MEASURED,
    OUTSIDE,
    SMOOTH,
    TEXTURED,
)
from .view_geometry import ViewGeometry

_NOTHING = np.float32(0.0)
_BRIDGE = 4
"""Columns of blocks without a measurement below their edge that are bridged, counted with the next one."""
_BORDER_OF_GROUND = 1
"""Blocks that the border between smooth ground and what is matched below may cross. The visible lower edge of a girder of the
brightness of the ground crosses two or three; such a girder was open with a border of three blocks."""


class Refusal(IntEnum):
    """Why a column of blocks is not open, or not as far as it might be."""

    NONE = 0
    NO_SKY = 1
    """Its uppermost block is not textureless."""
    LOW_SKY = 2
    """Its textureless run is lower than least_rise_deg."""
    EDGE_ABOVE_HORIZON = 3
    EDGE_BELOW_HORIZON = 4
    WIDE_EDGE = 5
    """More than gap_deg of textured blocks lie below the run."""
    SMOOTH_STRIP = 6
    """Smooth blocks lie below that which are not accepted as ground."""
    NOT_MEASURED = 7
    """Nothing is measured below the edge."""
    NEAR_BASE = 8
    """What is measured below the edge is nearer than the range: open up to there."""
    NEAR_ABOVE = 9
    """Something nearer is measured above its own edge or that of a column beside it."""
    NEAR_BASE_BESIDE = 10
    """What is measured below the edge of a column beside it is nearer."""
    NO_EVIDENCE_BESIDE = 11
    """The next column gives no evidence and holds no measurement."""
    FLOATING = 12
    """An object without connection to the ground is measured nearby."""


_REFUSALS = tuple(map(int, Refusal))
_NONE, _NO_SKY, _LOW_SKY, _EDGE_ABOVE, _EDGE_BELOW, _WIDE_EDGE, _SMOOTH_STRIP, _NOT_MEASURED = _REFUSALS[:8]
_NEAR_BASE, _NEAR_ABOVE, _NEAR_BASE_BESIDE, _NO_EVIDENCE_BESIDE, _FLOATING = _REFUSALS[8:]

OPEN_SETTINGS = parameter_record(
    OpenSkyParams,
    ("f_px", np.float64),
    ("horizon_row", np.float64),
    ("gain", np.float64),
    ("far_m", np.float64),
    ("most_m", np.float64),
    ("horizon_t", np.float64),
    ("gap_t", np.float64),
    ("continued_t", np.float64),
    ("least_rise_t", np.float64),
    ("reach_blocks", np.int64),
    ("floating_reach", np.float64),
)
"""The parameters, and: f_px, horizon_row: of the view; gain: f_px * lsb_per_px. far_m: optical depth that a far cell has at least; most_m: nothing is
open beyond. Heights in tangents (`_t`), lengths along rows in blocks;
floating_reach: blocks times metres."""


class Columns(NamedTuple):
    """Of each column of blocks, (C,): the rows top, edge and base of `scan_column`; base_m: distance below the edge, 0: no
    evidence; above_m, floating_m: of `things_above`; limit_m: forward distance up to which it is open, 0: it is not; refusal:
    a `Refusal`, of the rule that set this limit."""

    top: Any
    edge: Any
    base: Any
    base_m: Any
    above_m: Any
    floating_m: Any
    limit_m: Any
    refusal: Any


def empty_columns(n: int) -> Columns:
    """Columns of n columns of blocks, to be filled."""
    top, edge, base = np.zeros((3, n), np.int64)
    base_m, above_m, floating_m, limit_m = np.zeros((4, n), np.float32)
    return Columns(top, edge, base, base_m, above_m, floating_m, limit_m, np.zeros(n, np.uint8))


def open_settings(view: ViewGeometry, most_m: float, far_m: float, p: OpenSkyParams) -> NDArray[Any]:
    """(1,) OPEN_SETTINGS."""
    per_block = BLOCK / view.f_px
    return record_of(
        OPEN_SETTINGS,
        p,
        f_px=view.f_px,
        horizon_row=view.cv,
        gain=view.f_px * view.lsb_per_px,
        far_m=far_m,
        most_m=most_m,
        horizon_t=math.tan(math.radians(p.horizon_deg)),
        gap_t=max(math.tan(math.radians(p.gap_deg)), 1.01 * per_block),
        continued_t=math.tan(math.radians(p.continued_deg)),
        least_rise_t=math.tan(math.radians(p.least_rise_deg)),
        reach_blocks=int(math.tan(math.radians(p.reach_deg)) / per_block),
        floating_reach=p.floating_reach_m / per_block,
    )


@inner
def tangent(i, s):
    """Tangent (z/x, down) of the upper edge of block row i. s: a record of OPEN_SETTINGS."""
    return (i * BLOCK - 0.5 - s.horizon_row) / s.f_px


@inner
def scan_column(kind, near, cells, s):
    """(top, edge, base, R, refusal) of one column: the first row of its textureless run, the row behind its last, the row of what is
    measured below, and the distance of that edge, 0 where the column gives no evidence, with its Refusal. kind, near: (R,); cells:
    `MarkedView.kinds` of both columns of cells that are sampled in it."""
    rows = len(kind)
    top = 0
    while top < rows and kind[top] == OUTSIDE:
        top += 1
    if not s.upper_border:
        while top < rows and kind[top] != SMOOTH:
            top += 1
    edge = top
    while edge < rows and kind[edge] == SMOOTH:
        edge += 1
    if edge == top:
        return top, edge, edge, _NOTHING, _NO_SKY
    if tangent(edge, s) - tangent(top, s) < s.least_rise_t:
        return top, edge, edge, _NOTHING, _LOW_SKY
    if not at_horizon(edge, s):
        return top, edge, edge, _NOTHING, _EDGE_ABOVE if tangent(edge, s) < 0.0 else _EDGE_BELOW
    base = edge
    while base < rows and kind[base] == TEXTURED:
        base += 1
    known = base < rows and (kind[base] == MEASURED or kind[base] == CONTINUED)
    gap = gap_rows(cells, edge, base) if known else (base - edge) * BLOCK
    if gap > s.gap_t * s.f_px:
        return top, edge, edge, _NOTHING, _WIDE_EDGE
    if base < rows and kind[base] == CONTINUED:
        base = end_of_strip(kind, edge, base, s)
        if base >= rows:
            return top, edge, edge, _NOTHING, _SMOOTH_STRIP
    if base >= rows or kind[base] != MEASURED:
        return top, edge, edge, _NOTHING, _NOT_MEASURED
    nearest = BEYOND_ALL
    for i in range(edge, min(base + 2, rows)):
        nearest = min(nearest, near[i])
    return top, edge, base, nearest, _NONE


@inner
def gap_rows(cells, edge, base):
    """Rows of cells between the edge of the sky above block row `edge` and what begins in block row `base`. The marks of an edge begin
    EDGE_ROWS above it, which is sky. cells: as in `scan_column`."""
    one, other = cells
    first = max(0, edge * BLOCK - 1)  # the last row of a block is not sampled
    while first < base * BLOCK and one[first] == IS_SMOOTH and other[first] == IS_SMOOTH:
        first += 1
    end, known = base * BLOCK, IS_MEASURED | IS_CONTINUED
    while end < len(one) and not ((one[end] | other[end]) & known):
        end += 1
    while end > first and ((one[end - 1] | other[end - 1]) & known):
        end -= 1
    return end - first - EDGE_ROWS


@inner
def at_horizon(edge, s):
    """Whether a textureless run that ends above block row `edge` ends at the horizon."""
    return abs(tangent(edge, s)) <= s.horizon_t


@inner
def end_of_strip(kind, edge, first, s):
    """The row behind the smooth ground that begins in row `first`, with textured rows in it; the number of rows where it is none.

    Smooth ground lies below the horizon, and an edge separates it from the sky: what passes into it without one is one blank
    surface. kind: (R,)."""
    rows = len(kind)
    if first == edge or tangent(first + 1, s) <= 0.0:
        return rows
    base, last = first, first
    while base < rows and (kind[base] == CONTINUED or (kind[base] == TEXTURED and base <= last + _BORDER_OF_GROUND)):
        if kind[base] == CONTINUED:
            last = base
        base += 1
    return base if tangent(base, s) - tangent(edge, s) <= s.continued_t + s.gap_t else rows


@inner
def things_above(kind, near, edge):
    """(nearest, floating): least distance measured in a column above row `edge`, and of that what has textureless pixels
    below it, BEYOND_ALL: none. kind, near: (R,)."""
    nearest, floating, below = BEYOND_ALL, BEYOND_ALL, False
    for i in range(len(kind) - 1, -1, -1):
        below = below or kind[i] == SMOOTH
        if i < edge:
            nearest = min(nearest, near[i])
            if below:
                floating = min(floating, near[i])
    return nearest, floating


@inner
def bridge_columns(columns):
    """Columns whose edge has nothing measured below it take that from both sides, where those lie within _BRIDGE columns and
    have the same edge. What is seen there below the edge stays unknown, so nothing at its height is open; only the sky above is,
    which ends at the horizon there too. columns: Columns, changed in place."""
    edge, base, base_m, refusal = columns.edge, columns.base, columns.base_m, columns.refusal
    cols = len(edge)
    for j in range(1, cols - 1):
        if base_m[j] > 0.0:
            continue
        right = j + 1
        while right < min(cols - 1, j + _BRIDGE) and base_m[right] <= 0.0:
            right += 1
        left = j - 1
        same = abs(edge[left] - edge[j]) <= 1 and abs(edge[right] - edge[j]) <= 1
        if same and base_m[left] > 0.0 and base_m[right] > 0.0:
            base[j], base_m[j] = max(base[left], base[right]), min(base_m[left], base_m[right])
            refusal[j] = _NONE


@inner
def limit_columns(columns, s):
    """Fills limit_m and refusal of columns that give evidence. columns: Columns."""
    base_m, above_m, floating_m = columns.base_m, columns.above_m, columns.floating_m
    cols, reach = len(base_m), s.reach_blocks
    for j in range(cols):
        columns.limit_m[j] = _NOTHING
        if base_m[j] <= 0.0:
            continue
        limit, why = base_m[j], _NEAR_BASE
        for k in range(max(0, j - reach), min(cols, j + reach + 1)):
            if not s.neighbours:
                break
            if above_m[k] < limit:
                limit, why = above_m[k], _NEAR_ABOVE
            if 0.0 < base_m[k] < limit:
                limit, why = base_m[k], _NEAR_BASE_BESIDE
            elif base_m[k] <= 0.0 and abs(k - j) <= 1 and above_m[k] == BEYOND_ALL:
                limit, why = _NOTHING, _NO_EVIDENCE_BESIDE
        for k in range(cols):
            if s.floating and floating_m[k] < limit and abs(k - j) * floating_m[k] <= s.floating_reach:
                limit, why = floating_m[k], _FLOATING
        columns.limit_m[j] = limit
        columns.refusal[j] = why if limit < s.most_m else _NONE
