"""Evidence along the planes of the merged world: how often each step of a plane was observed, and observed to be clear.

A plane is divided into steps of equal length, numbered from its anchor along its direction. The steps of a plane are
one row of a table, which is used as a ring: step k is in column k modulo the number of columns. Steps outside of the
plane are 0. A plane with more steps than columns has no evidence, and is not removed by it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, record
from .join_cost import axis_of, box_of
from .zero_table import zero_table

STEP = record(
    ("hits", np.uint16),  # observations
    ("clears", np.uint16),  # observations as clear, less those that observations cancelled
)
"""A step of a plane."""
STEP_M = 0.25
"""Length of a step."""
CLEAR_LIMIT, _MOST_EXTRA = 5, 15
"""Observations as clear after which a step is removed, less those that observations of it cancelled; and by how much this
grows with earlier observations, at most."""
CLEARS_PER_HIT = 2
"""Observations as clear that one observation of a step cancels."""
_MOST = 65535
_EDGE = 0.01
"""Share of a step by which a plane may extend into the next one without having a part of it."""
_HITS_PER_CLEAR = 4
"""Observations of a step per additional observation as clear that its removal requires."""


class Steps(NamedTuple):
    """The steps of a plane."""

    first: Any  # first, end: numbers of the first step, and of the one after the last
    end: Any
    begin_m: Any  # place of end a along the plane, from the anchor
    length_m: Any  # length of the plane
    dx: Any  # dx, dy: direction of the plane
    dy: Any


def empty_steps(most_planes: int, longest_m: float) -> NDArray[Any]:
    """Returns (P, N) STEP for planes of up to longest_m."""
    return zero_table((most_planes, math.ceil(longest_m / STEP_M) + 2), STEP)


@inner
def steps_of(box, anchor_x, anchor_y):
    """Returns the Steps of a Box. anchor_x, anchor_y: of its plane."""
    dx, dy, length = axis_of(box)
    begin = (box.ax - anchor_x) * dx + (box.ay - anchor_y) * dy
    first = int(math.floor(begin / STEP_M + _EDGE))
    end = max(first + 1, int(math.ceil((begin + length) / STEP_M - _EDGE)))
    return Steps(first, end, begin, length, dx, dy)


@inner
def plane_steps(tables, i):
    """Returns the Steps of slot i."""
    plane = tables.planes[i]
    return steps_of(box_of(plane), float(plane.anchor_x_m), float(plane.anchor_y_m))


@inner
def has_evidence(tables, steps):
    """True if these Steps fit into a row."""
    return steps.end - steps.first <= tables.steps.shape[1]


@inner
def part_of(steps, k):
    """Returns begin and end of step k of a plane, in metres from its end a."""
    return max(0.0, k * STEP_M - steps.begin_m), min(steps.length_m, (k + 1) * STEP_M - steps.begin_m)


@inner
def erase(tables, i, first, end):
    """Sets the steps first..end - 1 of slot i to 0."""
    rows = tables.steps
    size = rows.shape[1]
    for k in range(first, min(end, first + size)):
        rows[i, k % size].hits = 0
        rows[i, k % size].clears = 0


@inner
def erase_outside(tables, i, steps):
    """Sets those steps of slot i to 0 that are not among `steps`, the Steps that it will have."""
    old = plane_steps(tables, i)
    if has_evidence(tables, steps):
        erase(tables, i, old.first, min(old.end, steps.first))
        erase(tables, i, max(old.first, steps.end), old.end)
    else:
        erase(tables, i, old.first, old.end)


@inner
def count_hit(tables, i, box):
    """Counts an observation of the steps of slot i beside a Box, which cancels CLEARS_PER_HIT observations as clear."""
    rows, steps = tables.steps, plane_steps(tables, i)
    if not has_evidence(tables, steps):
        return
    plane, size = tables.planes[i], rows.shape[1]
    ax, ay = float(plane.ax_m), float(plane.ay_m)
    s0 = (box.ax - ax) * steps.dx + (box.ay - ay) * steps.dy
    s1 = (box.bx - ax) * steps.dx + (box.by - ay) * steps.dy
    for k in range(steps.first, steps.end):
        begin, end = part_of(steps, k)
        if min(max(s0, s1), end) >= max(min(s0, s1), begin):
            row = rows[i, k % size]
            row.hits = min(_MOST, int(row.hits) + 1)  # without a compiler, uint16 would overflow
            row.clears = max(0, int(row.clears) - CLEARS_PER_HIT)


@inner
def set_hits(tables, i, hits):
    """Sets the observations of all steps of slot i."""
    rows, steps = tables.steps, plane_steps(tables, i)
    if has_evidence(tables, steps):
        for k in range(steps.first, steps.end):
            rows[i, k % rows.shape[1]].hits = min(_MOST, hits)


@inner
def merge_steps(tables, i, k, box):
    """Adds the evidence of slot k to that of slot i, whose Box is going to be `box`.

    Where both planes are, each observation of one cancels CLEARS_PER_HIT observations of the other as clear."""
    rows, plane, other = tables.steps, tables.planes[i], tables.planes[k]
    old, more = plane_steps(tables, i), plane_steps(tables, k)
    new = steps_of(box, float(plane.anchor_x_m), float(plane.anchor_y_m))
    erase_outside(tables, i, new)
    if not has_evidence(tables, new):
        return
    size = rows.shape[1]
    for n in range(new.first, new.end):
        along = (n + 0.5) * STEP_M - new.begin_m
        x, y = box.ax + along * new.dx - float(other.anchor_x_m), box.ay + along * new.dy - float(other.anchor_y_m)
        m = int(math.floor((x * more.dx + y * more.dy) / STEP_M))
        if m < more.first or m >= more.end or not has_evidence(tables, more):
            continue
        row, added = rows[i, n % size], rows[k, m % size]
        if n < old.first or n >= old.end:
            rows[i, n % size] = added
        else:
            left = max(
                int(row.clears) - CLEARS_PER_HIT * int(added.hits), int(added.clears) - CLEARS_PER_HIT * int(row.hits)
            )
            row.hits, row.clears = max(int(row.hits), int(added.hits)), max(0, left)


@inner
def copy_steps(tables, i, k, steps):
    """Copies `steps` of slot i to slot k, which has the same anchor."""
    rows = tables.steps
    size = rows.shape[1]
    for n in range(steps.first, steps.end):
        rows[k, n % size] = rows[i, n % size]


@inner
def count_clear(row):
    """Counts one observation of a step, a record of STEP, as clear."""
    row.clears = min(_MOST, int(row.clears) + 1)


@inner
def is_refuted(row):
    """True if a step was observed as clear often enough to be removed. row: STEP."""
    extra = min(row.hits // _HITS_PER_CLEAR, _MOST_EXTRA)
    return row.clears >= CLEAR_LIMIT + extra
