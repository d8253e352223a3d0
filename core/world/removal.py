"""Removal of planes, or parts of them, that later frames observe to be clear.

A part is removed when it was observed to be clear more often than occupied, by a number of observations: a moved object is
removed within half a second, and a wall that noise hides now and then stays. Growing needs one observation, shrinking many.
"""

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
"""Not tuning: observations of a plane that require one more observation of it as clear."""
_LEAST_M = 0.1
"""Not tuning: what is left of a plane is kept when it is longer."""


class FrameView(NamedTuple):
    """What removal needs of a frame: the camera's place x_m, y_m; the noise constant ke, 1/m; edges_rad and layers_m float64,
    near_m, far_m and end of its FreeProfile; plane: its GroundPlane."""

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
    """Whether a profile is free beyond a place (x, y from the camera) over enough of the heights top..bottom.

    slack: how far behind it must be free, noise added. Not when any layer there ends at an obstacle at about that range:
    that may be the plane itself. A layer that the ground cuts is free as a whole, and was judged above the ground only:
    heights below the ground, or within its noise, do not count as free. view: FrameView."""
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
    """Counts one observation of a frame that the longest part of slot i is clear. view: FrameView."""
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
    """One more observation of begin..end of a plane as clear: the part that all agree on, or a new one where they do not."""
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
    """Removes the part of slot i that frames observed to be clear often enough; a remaining part on the far side gets a new slot.

    Returns whether any part was removed."""
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
    else:  # another type in a kernel: its float64 are elsewhere
        put_box(tables, i, far_part)
    return True


@inner
def copy_part(tables, i, box):
    """A part of slot i in a slot of its own, with the same moments. box: of the part."""
    planes = tables.planes
    lru_remove(tables, i)
    lru_insert(tables, i)  # or it might be the one that goes for the new slot
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
    part.anchor_x_m, part.anchor_y_m, part.margin_m = plane.anchor_x_m, plane.anchor_y_m, plane.margin_m
    part.clear_from_m, part.clear_to_m = plane.clear_from_m, plane.clear_to_m
    part.hits, part.plane_flags, part.changed = plane.hits, plane.plane_flags, tables.state[0].frame
    part.ax_m, part.ay_m, part.bx_m, part.by_m = box.ax, box.ay, box.bx, box.by
    part.top_m, part.bottom_m = box.top, box.bottom
    insert(tables, k)
