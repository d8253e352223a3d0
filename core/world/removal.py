"""Removal of planes, or parts of them, that later frames observe to be clear.

A part is removed when it was observed to be clear more often than occupied, by a number of observations: a moved object is
removed within half a second, and a wall that noise hides now and then stays. Growing needs one observation, shrinking many.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit import inner
from .association import box_of, length_of, put_box
from .free_grid import direction_of, lowest_free
from .plane_index import (
    BOTTOM,
    CHANGED,
    CLEARED,
    CLEARS,
    FLAGS,
    FRAME,
    FROM,
    HITS,
    MARGIN,
    TO,
    TOP,
    insert,
    lru_insert,
    lru_remove,
    new_slot,
    remove,
    set_links,
)

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
    box, floats = tables[0], tables[2]
    a = box_of(box, i)
    length = length_of(a[0], a[1], a[2], a[3])
    count = int(math.ceil(length / rules.step_m))
    slack = rules.behind_m + rules.pose_sigma_m + float(floats[i, MARGIN])
    begin, best0, best1 = -1, 0, 0
    for n in range(count + 1):
        ok = n < count
        if ok:
            share = (n + 0.5) / count
            px, py = a[0] + (a[2] - a[0]) * share - x, a[1] + (a[3] - a[1]) * share - y
            ok = is_observed_clear(px, py, a[4], a[5], slack, rules, view)
        if ok and begin < 0:
            begin = n
        if not ok and begin >= 0:
            if n - begin > best1 - best0:
                best0, best1 = begin, n
            begin = -1
    if best1 > best0:
        count_clear_part(tables, i, length * best0 / count, length * best1 / count)


@inner
def count_clear_part(tables, i, begin, end):
    """One more observation of begin..end of slot i as clear: the part that all agree on, or a new one where they do not."""
    floats, ints = tables[2], tables[3]
    if ints[i, CLEARS] > 0:
        both0, both1 = max(begin, float(floats[i, FROM])), min(end, float(floats[i, TO]))
        if both1 - both0 >= 0.5 * (end - begin):
            floats[i, FROM], floats[i, TO] = both0, both1
            ints[i, CLEARS] += 1
            return
        if ints[i, CLEARS] > 1:
            ints[i, CLEARS] -= 1
            return
    floats[i, FROM], floats[i, TO] = begin, end
    ints[i, CLEARS] = 1


@inner
def cut_cleared(tables, i, rules):
    """Takes the part of slot i away that was looked through often enough; what is left on the far side gets a slot.

    Returns whether anything went."""
    _box, floats, ints, state = tables[0], tables[2], tables[3], tables[7]
    need = rules.free_evidence_limit + min(float(ints[i, HITS] // _HITS_PER_CLEAR), rules.free_evidence_limit_extra)
    if ints[i, HITS] == 0 or ints[i, CLEARS] < need:
        return False
    a = box_of(tables[0], i)
    length = length_of(a[0], a[1], a[2], a[3])
    dx, dy = (a[2] - a[0]) / length, (a[3] - a[1]) / length
    begin, end = max(0.0, float(floats[i, FROM])), min(length, float(floats[i, TO]))
    ints[i, CLEARS] = 0
    state[CLEARED] += 1
    left, right = begin > _LEAST_M, length - end > _LEAST_M
    if not left and not right:
        set_links(tables, i, False)
        remove(tables, i)
        return True
    if left and right:
        copy_part(tables, i, a, end, dx, dy)
    if left:
        put_box(tables, i, a[0], a[1], a[0] + begin * dx, a[1] + begin * dy, a[4], a[5])
    else:
        put_box(tables, i, a[0] + end * dx, a[1] + end * dy, a[2], a[3], a[4], a[5])
    return True


@inner
def copy_part(tables, i, a, begin, dx, dy):
    """The part of slot i from begin to its b end, in a slot of its own, with the same moments."""
    box, moments, floats, ints, seen_ns, state = tables[0], tables[1], tables[2], tables[3], tables[4], tables[7]
    lru_remove(tables, i)
    lru_insert(tables, i)  # or it might be the one that goes for the new slot
    k = new_slot(tables, seen_ns[i])
    for c in range(6):
        moments[k, c] = moments[i, c]
    for c in range(5):
        floats[k, c] = floats[i, c]
    ints[k, HITS], ints[k, FLAGS], ints[k, CHANGED] = ints[i, HITS], ints[i, FLAGS], state[FRAME]
    box[k, 0], box[k, 1], box[k, 2], box[k, 3] = a[0] + begin * dx, a[1] + begin * dy, a[2], a[3]
    box[k, TOP], box[k, BOTTOM] = a[4], a[5]
    insert(tables, k)
