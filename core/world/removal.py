"""What is no longer there: planes, or parts of them, that later frames look through.

A part goes when it was looked through more often than onto, by a number of looks; so what moved away is gone in half a
second, and a wall stays that noise hides now and then. Growing is at once, shrinking needs many looks.
"""

from __future__ import annotations

import math

from ..jit import inner
from .association import R_AFTER, R_BEHIND, R_CLEAR_SIGMAS, R_POSE, R_SHARE, R_STEP, R_TRUST, box_of, length_of, put_box
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
    hang,
    into_ring,
    link,
    new_slot,
    out_of_ring,
    take_out,
)

_OBSTACLE = 1
_HITS_A_LOOK = 4
"""Not tuning: looks onto a plane that make one more look through it needed."""
_LEAST_M = 0.1
"""Not tuning: what is left of a plane is kept when it is longer."""


@inner
def seen_through(x, y, top, bottom, slack, ke, sigmas, share, edges, layers, near_m, far_m, end, plane):
    """Whether a profile sees past a place (x, y from the camera) over enough of the heights top..bottom.

    slack: how far behind it must be free, noise added. Not when any layer there ends at an obstacle about as far: that may
    be the very plane, a little off. A layer that the ground cuts is free as a whole, and was judged above the ground only:
    heights below the ground, or within its noise, do not count as seen past. plane: GroundPlane of the frame."""
    r = math.sqrt(x * x + y * y)
    turn = math.atan2(y, x) - edges[0]
    azimuth = turn - math.floor(turn / math.tau) * math.tau + edges[0]
    if azimuth >= edges[edges.shape[0] - 1]:
        return False
    d = direction_of(edges, azimuth)
    off = slack + sigmas * ke * r * r
    through, lowest = 0.0, lowest_free(x, y, r, plane)
    for k in range(layers.shape[0] - 1):
        over = min(bottom, layers[k + 1]) - max(top, layers[k])
        if over <= 0.0:
            continue
        if near_m[d, k] <= r - off and far_m[d, k] >= r + off:
            through += max(0.0, min(bottom, layers[k + 1], lowest) - max(top, layers[k]))
        elif end[d, k] == _OBSTACLE and abs(far_m[d, k] - r) < off:
            return False
    return through >= share * (bottom - top)


@inner
def look_through(tables, i, x, y, ke, rules, edges, layers, near_m, far_m, end, plane):
    """Counts one look of a camera at (x, y) through the longest part of slot i that it sees through.

    plane: GroundPlane of the frame."""
    box, floats = tables[0], tables[2]
    a = box_of(box, i)
    length = length_of(a[0], a[1], a[2], a[3])
    count = int(math.ceil(length / rules[R_STEP]))
    slack = rules[R_BEHIND] + rules[R_POSE] + float(floats[i, MARGIN])
    begin, best0, best1 = -1, 0, 0
    for n in range(count + 1):
        ok = n < count
        if ok:
            share = (n + 0.5) / count
            px, py = a[0] + (a[2] - a[0]) * share - x, a[1] + (a[3] - a[1]) * share - y
            ok = seen_through(
                px, py, a[4], a[5], slack, ke, rules[R_CLEAR_SIGMAS], rules[R_SHARE], edges, layers, near_m, far_m, end, plane
            )  # fmt: skip
        if ok and begin < 0:
            begin = n
        if not ok and begin >= 0:
            if n - begin > best1 - best0:
                best0, best1 = begin, n
            begin = -1
    if best1 > best0:
        count_look(tables, i, length * best0 / count, length * best1 / count)


@inner
def count_look(tables, i, begin, end):
    """One more look through begin..end of slot i: the part that all looks agree on, or a new one where they do not."""
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
    need = rules[R_AFTER] + min(float(ints[i, HITS] // _HITS_A_LOOK), rules[R_TRUST])
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
        link(tables, i, False)
        take_out(tables, i)
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
    out_of_ring(tables, i)
    into_ring(tables, i)  # or it might be the one that goes for the new slot
    k = new_slot(tables, seen_ns[i])
    for c in range(6):
        moments[k, c] = moments[i, c]
    for c in range(5):
        floats[k, c] = floats[i, c]
    ints[k, HITS], ints[k, FLAGS], ints[k, CHANGED] = ints[i, HITS], ints[i, FLAGS], state[FRAME]
    box[k, 0], box[k, 1], box[k, 2], box[k, 3] = a[0] + begin * dx, a[1] + begin * dy, a[2], a[3]
    box[k, TOP], box[k, BOTTOM] = a[4], a[5]
    hang(tables, k)
