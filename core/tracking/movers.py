"""Which followed groups of detections are moving obstacles.

An object is declared moving only with two independent kinds of support: its velocity exceeds its error several times and
agrees with the distance travelled, and free space was observed where it was or where it is now. A static obstacle whose
outline, pose or noise changes fails the second one: its place was never observed to be free.
"""

from __future__ import annotations

import math

from ..jit import inner, kernel
from .groups import may_move
from .objects import TAKEN_AFTER, begin_object, free_object, object_lost_at, speed_variance, take_over, update_object
from .observed import CLEAR, classify, seen_from
from .tables import NONE

HISTORY = 10
"""Earlier places that are kept of each object."""
HISTORY_STEP_S = 0.2
OLD_S = 0.35
"""Least age of an earlier place, and of an earlier view, that is compared with the present one."""
NO_EVIDENCE, WAITING, SUPPORTED = 0, 1, 2
"""Evidence of a frame for the motion of an object."""
_MIN_SPEED_M_S, _MAX_SPEED_M_S = 0.5, 15.0
"""A slower obstacle is static. A faster motion is an error of association."""
_SPEED_SIGMAS = 4.0
"""Least speed of a moving obstacle, as a multiple of its error."""
_LEAST_HITS = 4
_SUPPORT = 3
"""Observations in a row that support the motion, before it is declared."""
_MOST_MISFIT = 6.0
"""A less regular motion is flicker."""
_OBSERVED_SHARE = 0.6
"""Least share of the frames that observed a moving object."""
_SMALL_M = 0.3
"""Slack of the free-space comparison."""


@kernel
def update_objects(groups, objects, history, next_id, t_ns, view):
    """Filters the objects by their groups and begins new ones. Returns (next id, number of objects that may have begun to
    move and whose present place has to be compared with earlier views: see `support_by_view`).

    history: (M, HISTORY, 3) float64 time (s), x, y; view: FreeView of this frame."""
    waiting = 0
    for g in range(groups.shape[0]):
        if groups[g].object != NONE:
            update_object(objects[groups[g].object], groups[g], t_ns)
    for g in range(groups.shape[0]):
        group, m = groups[g], groups[g].object
        if m == NONE and may_move(group):
            m = object_lost_at(group, objects, t_ns)
            if m != NONE:
                if objects[m].missed < TAKEN_AFTER:
                    continue  # the object may be back in the next frame
                take_over(objects[m], group, t_ns)
            else:
                m = free_object(objects)
                if m != NONE:
                    begin_object(objects[m], group, next_id, t_ns)
                    next_id += 1
            group.object = m
        if m == NONE:
            continue
        o = objects[m]
        o.evidence = NO_EVIDENCE
        if moves_regularly(o, view):
            o.evidence = left_place(o, history[m], view, t_ns)
        waiting += 1 if o.evidence == WAITING and o.moving_ns == 0 else 0
        add_place(o, history[m], t_ns)
    end_passed(objects, view, t_ns)
    return next_id, waiting


@inner
def end_passed(objects, view, t_ns):
    """Ends the objects that this frame did not observe, and whose predicted place it observed to be free: they are not where
    their velocity would have brought them."""
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0 or o.seen_ns == t_ns:
            continue
        if classify(seen_from(o.x_m, o.y_m, view), o.top_m, o.bottom_m, _SMALL_M, view) == CLEAR:
            o.hits = 0


@kernel
def support_by_view(objects, earlier):
    """Supports the motion of objects that stand where an earlier view observed free space. earlier: FreeView. Returns how
    many still wait for evidence."""
    waiting = 0
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0 or o.evidence != WAITING or o.moving_ns != 0:
            continue
        if classify(seen_from(o.x_m, o.y_m, earlier), o.top_m, o.bottom_m, _SMALL_M, earlier) == CLEAR:
            o.evidence = SUPPORTED
        else:
            waiting += 1
    return waiting


@kernel
def declare_objects(objects, t_ns):
    """Declares objects with enough support moving, and slow ones static."""
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0 or o.seen_ns != t_ns:
            continue
        o.support = o.support + 1 if o.evidence == SUPPORTED else 0
        if o.moving_ns == 0 and o.support >= _SUPPORT:
            o.moving_ns = t_ns
        elif o.moving_ns != 0 and math.hypot(o.vx_m_s, o.vy_m_s) < 0.5 * _MIN_SPEED_M_S:
            o.moving_ns, o.support = 0, 0


@inner
def moves_regularly(o, view):
    """Whether the observations of an object agree with a motion faster than its error. view: FreeView of this frame."""
    speed = math.sqrt(o.vx_m_s**2 + o.vy_m_s**2)
    if o.hits < _LEAST_HITS or speed < _MIN_SPEED_M_S or speed > _MAX_SPEED_M_S:
        return False
    if o.misfit > _MOST_MISFIT or o.hits < _OBSERVED_SHARE * o.frames:
        return False
    return speed >= _SPEED_SIGMAS * math.sqrt(speed_variance(o, view.x_m, view.y_m))


@inner
def left_place(o, places, view, t_ns):
    """Evidence of one frame that an object has moved: SUPPORTED where an earlier place that agrees with its velocity is free
    now, WAITING where one agrees, NO_EVIDENCE elsewhere."""
    evidence = NO_EVIDENCE
    for n in range(o.places):
        dt_s = t_ns * 1e-9 - places[n, 0]
        if dt_s < OLD_S - 1e-6:
            break
        dx, dy = o.x_m - places[n, 1], o.y_m - places[n, 2]
        miss = math.sqrt((dx - o.vx_m_s * dt_s) ** 2 + (dy - o.vy_m_s * dt_s) ** 2)
        if miss > 0.5 * math.sqrt(dx * dx + dy * dy):
            continue
        place = seen_from(places[n, 1], places[n, 2], view)
        if classify(place, o.top_m, o.bottom_m, _SMALL_M, view) == CLEAR:
            return SUPPORTED
        evidence = WAITING
    return evidence


@inner
def add_place(o, places, t_ns):
    """Adds the present place to the history, at most one each HISTORY_STEP_S; the oldest one is replaced."""
    t_s = t_ns * 1e-9
    if o.places > 0 and t_s - places[o.places - 1, 0] < HISTORY_STEP_S - 1e-3:
        return
    if o.places == HISTORY:
        for n in range(HISTORY - 1):
            for c in range(3):
                places[n, c] = places[n + 1, c]
        o.places = HISTORY - 1
    places[o.places, 0], places[o.places, 1], places[o.places, 2] = t_s, o.x_m, o.y_m
    o.places += 1


@kernel
def mark_tracks(detections, groups, objects, tracks):
    """Gives the tracks observed in this frame the id of their moving object, 0: static."""
    for i in range(detections.shape[0]):
        j, g = detections[i].track, detections[i].group
        if j == NONE:
            continue
        tracks[j].object_id = 0
        if g != NONE and groups[g].object != NONE:
            o = objects[groups[g].object]
            if o.moving_ns != 0:
                tracks[j].object_id = o.id


@kernel
def carry_tracks(tracks, objects, dt_s):
    """Moves the tracks of moving objects that are observed by the objects' velocities."""
    for j in range(tracks.shape[0]):
        t = tracks[j]
        if t.hits == 0 or t.object_id == 0:
            continue
        for m in range(objects.shape[0]):
            o = objects[m]
            if o.hits > 0 and o.id == t.object_id and o.seen_ns == t.seen_ns and o.moving_ns != 0:
                t.x_m += o.vx_m_s * dt_s
                t.y_m += o.vy_m_s * dt_s


@kernel
def release_tracks(tracks, objects):
    """Makes the tracks static whose moving object has ended."""
    for j in range(tracks.shape[0]):
        t = tracks[j]
        if t.hits == 0 or t.object_id == 0:
            continue
        present = False
        for m in range(objects.shape[0]):
            o = objects[m]
            present = present or (o.hits > 0 and o.moving_ns != 0 and o.id == t.object_id)
        if not present:
            t.object_id = 0
