"""Removal of planes, or parts of them, that later frames observe to be clear.

A part is removed if it was observed to be clear more often than occupied, by 5 to 20 observations as delivered. A wall
that noise hides now and then is kept. A plane grows by one observation and shrinks by many. The count is of one part
of a plane, so the trail of a moving object may stay."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit import inner
from .association import box_of, put_box
from .free_grid import direction_of, lowest_free
from .join_cost import Box, length_of
from .plane_index import insert, lru_insert, lru_remove, new_slot, remove, set_links

_OBSTACLE = 1
_HITS_PER_CLEAR = 4
"""Observations of a plane per additional observation as clear that its removal requires. It is not a tuning
parameter."""
_LEAST_M = 0.1
"""A remaining part of a plane is kept if it is longer. It is not a tuning parameter."""


class FrameView(NamedTuple):
    """A frame as removal needs it.

    Attributes:
        x_m, y_m: place of the camera.
        ke_per_m: noise coefficient, 1/m.
        edges_rad: (D + 1,) float64 of its FreeProfile.
        layers_m: (L + 1,) float64.
        near_m, far_m: (D, L) free ranges.
        end: (D, L) uint8.
        plane: its GroundPlane."""

    x_m: Any
    y_m: Any
    ke_per_m: Any
    edges_rad: Any
    layers_m: Any
    near_m: Any
    far_m: Any
    end: Any
    plane: Any


@inner
def is_observed_clear(x, y, top, bottom, slack, rules, view):
    """True if a profile is free beyond a place over enough of the heights top..bottom.

    It is not if any layer there ends at an obstacle at about that range, which may be the plane itself. A layer that
    the ground cuts is free as a whole, but was tested only above the ground: heights below the ground, or within its
    noise, do not count.

    Args:
        x, y: the place, relative to the camera.
        top, bottom: heights.
        slack: distance behind the place to which it must be free, without noise.
        rules: a record of WORLD_RULES.
        view: FrameView."""
    edges, layers, near_m, far_m = view.edges_rad, view.layers_m, view.near_m, view.far_m
    r = math.sqrt(x * x + y * y)
    turn = math.atan2(y, x) - edges[0]
    azimuth = turn - math.floor(turn / math.tau) * math.tau + edges[0]
    if azimuth >= edges[edges.shape[0] - 1]:
        return False
    d = direction_of(edges, azimuth)
    off = slack + rules.free_evidence_sigmas * view.ke_per_m * r * r
    through, lowest = 0.0, lowest_free(x, y, r, view.plane)
    for k in range(layers.shape[0] - 1):
        over = min(bottom, layers[k + 1]) - max(top, layers[k])
        if over <= 0.0:
            continue
        if near_m[d, k] <= r - off and far_m[d, k] >= r + off:
            through += max(0.0, min(bottom, layers[k + 1], lowest) - max(top, layers[k]))
        elif view.end[d, k] == _OBSTACLE and abs(far_m[d, k] - r) < off:
            return False
    return through >= rules.free_evidence_share * (bottom - top)


@inner
def count_clear_view(tables, i, rules, view):
    """Counts one observation that the longest clear part of slot i is clear. view: FrameView."""
    x, y = view.x_m, view.y_m
    plane = tables.planes[i]
    a = box_of(plane)
    length = length_of(a.ax, a.ay, a.bx, a.by)
    count = int(math.ceil(length / rules.step_m))
    slack = rules.behind_m + rules.pose_sigma_m + float(plane.margin_m)
    begin, best0, best1 = -1, 0, 0
    for n in range(count + 1):
        ok = n < count
        if ok:
            share = (n + 0.5) / count
            px, py = a.ax + (a.bx - a.ax) * share - x, a.ay + (a.by - a.ay) * share - y
            ok = is_observed_clear(px, py, a.top, a.bottom, slack, rules, view)
        if ok and begin < 0:
            begin = n
        if not ok and begin >= 0:
            if n - begin > best1 - best0:
                best0, best1 = begin, n
            begin = -1
    if best1 > best0:
        count_clear_part(plane, length * best0 / count, length * best1 / count)


@inner
def count_clear_part(plane, begin, end):
    """Counts one observation of begin..end of a plane as clear.

    The counted part is the one that all observations share. If they do not overlap enough, a new part begins."""
    if plane.clears > 0:
        both0, both1 = max(begin, float(plane.clear_from_m)), min(end, float(plane.clear_to_m))
        if both1 - both0 >= 0.5 * (end - begin):
            plane.clear_from_m, plane.clear_to_m = both0, both1
            plane.clears += 1
            return
        if plane.clears > 1:
            plane.clears -= 1
            return
    plane.clear_from_m, plane.clear_to_m = begin, end
    plane.clears = 1


@inner
def cut_cleared(tables, i, rules):
    """Removes the part of slot i that was observed to be clear often enough; returns True if any part was removed.

    Of two remaining parts, the second one gets a new slot."""
    plane = tables.planes[i]
    need = rules.free_evidence_limit + min(float(plane.hits // _HITS_PER_CLEAR), rules.free_evidence_limit_extra)
    if plane.hits == 0 or plane.clears < need:
        return False
    a = box_of(plane)
    length = length_of(a.ax, a.ay, a.bx, a.by)
    dx, dy = (a.bx - a.ax) / length, (a.by - a.ay) / length
    begin, end = max(0.0, float(plane.clear_from_m)), min(length, float(plane.clear_to_m))
    plane.clears = 0
    tables.state[0].cleared += 1
    left, right = begin > _LEAST_M, length - end > _LEAST_M
    if not left and not right:
        set_links(tables, i, False)
        remove(tables, i)
        return True
    near_part = Box(a.ax, a.ay, a.ax + begin * dx, a.ay + begin * dy, a.top, a.bottom)
    far_part = Box(a.ax + end * dx, a.ay + end * dy, a.bx, a.by, a.top, a.bottom)
    if left and right:
        copy_part(tables, i, far_part)
    if left:
        put_box(tables, i, near_part)
    else:  # a separate call, because in a kernel the two boxes have different types
        put_box(tables, i, far_part)
    return True


@inner
def copy_part(tables, i, box):
    """Copies a part of slot i, with the same moments, to a new slot. box: of the part."""
    planes = tables.planes
    lru_remove(tables, i)
    lru_insert(tables, i)  # otherwise slot i might be removed to make room for the new one
    k = new_slot(tables, planes[i].seen_ns)
    part, plane = planes[k], planes[i]
    part.weight, part.x, part.y, part.xx, part.xy, part.yy = (
        plane.weight,
        plane.x,
        plane.y,
        plane.xx,
        plane.xy,
        plane.yy,
    )
    part.anchor_x_m, part.anchor_y_m = plane.anchor_x_m, plane.anchor_y_m
    part.margin_m, part.noise_m = plane.margin_m, plane.noise_m
    part.clear_from_m, part.clear_to_m = plane.clear_from_m, plane.clear_to_m
    part.hits, part.plane_flags, part.changed = plane.hits, plane.plane_flags, tables.state[0].frame
    part.ax_m, part.ay_m, part.bx_m, part.by_m = box.ax, box.ay, box.bx, box.by
    part.top_m, part.bottom_m = box.top, box.bottom
    insert(tables, k)
