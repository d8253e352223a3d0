"""Removal of planes, or parts of them, that later frames observe to be clear.

A step of a plane (evidence.py) is removed if it was observed to be clear more often than occupied, by 5 to 20
observations as delivered. A wall that noise hides now and then is kept. A plane grows by one observation and shrinks by
many. The trail of a moving object is removed step by step behind it."""

from __future__ import annotations

import math

from ..free_view import NO_DIRECTION, direction_of, lowest_free
from ..jit import inner
from ..types import FreeEnd
from .association import put_box
from .evidence import copy_steps, count_clear, erase, has_evidence, is_refuted, part_of, plane_steps
from .free_grid import HALF_M
from .join_cost import END_A, END_B, Box, box_of
from .plane_index import insert, lru_insert, lru_remove, new_slot, remove, set_links

_OBSTACLE = int(FreeEnd.OBSTACLE)
_BEHIND_M, _CLEAR_SIGMAS = 0.5, 3.0
"""Observed free space must reach this far behind a plane and its margin, and farther by this many standard deviations of its
distance."""
_CLEAR_SHARE = 0.5
"""Least share of the height of a plane that must be observed free."""
_LEAST_M = 0.1
"""A remaining part of a plane is kept if it is longer."""


@inner
def is_observed_clear(x, y, top, bottom, slack, pose_sigma_m, view):
    """True if a profile is free beyond a place over enough of the heights top..bottom.

    It is not if any layer there ends at an obstacle at about that range, which may be the plane itself. A layer that
    the ground cuts is free as a whole, but was tested only above the ground: heights below the ground, or within its
    noise, do not count.

    Args:
        x, y: the place, relative to the camera.
        top, bottom: heights.
        slack: distance behind the place to which it must be free, without noise.
        pose_sigma_m: error of the position of the camera."""
    layers, near_m, far_m = view.layers_m, view.near_m, view.far_m
    r = math.sqrt(x * x + y * y)
    d = direction_of(view.edges_rad, math.atan2(y, x))
    if d == NO_DIRECTION:
        return False
    off = slack + _CLEAR_SIGMAS * view.ke_per_m * r * r
    through, lowest = 0.0, lowest_free(x, y, r, HALF_M, view)
    for k in range(layers.shape[0] - 1):
        over = min(bottom, layers[k + 1]) - max(top, layers[k])
        if over <= 0.0:
            continue
        if near_m[d, k] <= r - (off - slack + pose_sigma_m) and far_m[d, k] >= r + off:
            through += max(0.0, min(bottom, layers[k + 1], lowest) - max(top, layers[k]))
        elif view.end[d, k] == _OBSTACLE and abs(far_m[d, k] - r) < off:
            return False
    return through >= _CLEAR_SHARE * (bottom - top)


@inner
def is_observed_later(newer, x, y, top, bottom, off):
    """True if a frame that was exposed later observed a plane within `off` of a place, at any of its heights.

    newer: (N,) OBSERVATION of those frames; x, y: the place; top, bottom: heights."""
    for j in range(newer.shape[0]):
        b = newer[j]
        if b.bottom_m <= top or b.top_m >= bottom:
            continue
        dx, dy = b.bx_m - b.ax_m, b.by_m - b.ay_m
        share = min(1.0, max(0.0, ((x - b.ax_m) * dx + (y - b.ay_m) * dy) / (dx * dx + dy * dy)))
        if math.hypot(x - b.ax_m - share * dx, y - b.ay_m - share * dy) <= off + b.margin_m:
            return True
    return False


@inner
def count_clear_view(tables, i, pose_sigma_m, view, newer):
    """Counts one observation as clear of each step of slot i that a frame observed to be clear, and no later one observed.

    view: FreeView; newer: (N,) OBSERVATION of frames that were exposed later."""
    steps, rows = plane_steps(tables, i), tables.steps
    if not has_evidence(tables, steps):
        return
    plane = tables.planes[i]
    top, bottom = float(plane.top_m), float(plane.bottom_m)
    x, y = float(plane.ax_m) - view.x_m, float(plane.ay_m) - view.y_m
    slack = _BEHIND_M + pose_sigma_m + float(plane.margin_m)
    for k in range(steps.first, steps.end):
        begin, end = part_of(steps, k)
        along = 0.5 * (begin + end)
        sx, sy = x + along * steps.dx, y + along * steps.dy
        if not is_observed_clear(sx, sy, top, bottom, slack, pose_sigma_m, view):
            continue
        if not is_observed_later(newer, sx + view.x_m, sy + view.y_m, top, bottom, slack):
            count_clear(rows[i, k % rows.shape[1]])


@inner
def refuted_run(tables, i, steps):
    """Returns begin and end of the first run of steps of slot i that are to be removed; the same number: none."""
    rows = tables.steps
    size, begin = rows.shape[1], steps.end
    for k in range(steps.first, steps.end):
        if is_refuted(rows[i, k % size]):
            begin = k
            break
    end = begin
    while end < steps.end and is_refuted(rows[i, end % size]):
        end += 1
    return begin, end


@inner
def cut_cleared(tables, i):
    """Removes the steps of slot i that were observed to be clear often enough.

    Each part between two removed ones gets a new slot."""
    for _ in range(tables.steps.shape[1]):
        if tables.planes[i].hits == 0:
            return
        steps = plane_steps(tables, i)
        if not has_evidence(tables, steps):
            return
        first, after = refuted_run(tables, i, steps)
        if first == after:
            return
        i = cut_run(tables, i, steps, first, after)


@inner
def cut_run(tables, i, steps, first, after):
    """Removes the steps first..after - 1 of slot i; returns the slot of the part behind them."""
    a = box_of(tables.planes[i])
    dx, dy, length = steps.dx, steps.dy, steps.length_m
    begin, _end = part_of(steps, first)
    _begin, end = part_of(steps, after - 1)
    tables.state[0].cleared += 1
    erase(tables, i, first, after)
    left, right = begin > _LEAST_M, length - end > _LEAST_M
    if not left and not right:
        set_links(tables, i, False)
        remove(tables, i)
        return i
    near_part = Box(a.ax, a.ay, a.ax + begin * dx, a.ay + begin * dy, a.top, a.bottom)
    far_part = Box(a.ax + end * dx, a.ay + end * dy, a.bx, a.by, a.top, a.bottom)
    k, plane = i, tables.planes[i]
    if left and right:
        k = copy_part(tables, i, far_part)
    if right:
        tables.planes[k].cut = END_A | (plane.cut & END_B)
    if left:
        plane.cut = END_B | (plane.cut & END_A)
        put_box(tables, i, near_part)
    else:  # a separate call, because in a kernel the two boxes have different types
        put_box(tables, i, far_part)
    return k


@inner
def copy_part(tables, i, box):
    """Copies a part of slot i, with the same moments and its evidence, to a new slot, and returns that. box: of the
    part."""
    planes = tables.planes
    lru_remove(tables, i)
    lru_insert(tables, i)  # otherwise slot i might be removed to make room for the new one
    k = new_slot(tables, planes[i].seen_ns)
    part = planes[k]
    older, newer = part.older, part.newer
    planes[k] = planes[i]
    part.older, part.newer, part.changed = older, newer, tables.state[0].frame
    part.ax_m, part.ay_m, part.bx_m, part.by_m = box.ax, box.ay, box.bx, box.by
    part.top_m, part.bottom_m = box.top, box.bottom
    copy_steps(tables, i, k, plane_steps(tables, k))
    insert(tables, k)
    return k
