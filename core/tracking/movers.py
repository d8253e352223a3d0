"""Moving obstacles: groups of detections followed with a constant velocity.

Each small group is followed by a Kalman filter of position and velocity, alike in x and y. An obstacle is declared moving
only with two independent kinds of support: its velocity exceeds its error several times and agrees with the distance
travelled, and free space was observed where it was or where it is now. A static obstacle whose outline, pose or noise
changes fails the second one: its place was never observed to be free.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, record
from .evidence import CLEAR, classify
from .groups import may_move
from .tables import NONE

HISTORY = 8
"""Not tuning: earlier places that are kept of each object."""
HISTORY_STEP_S = 0.1
MOST_OBJECTS = 64
"""Not tuning: groups followed at once; more are static."""
OLD_S = 0.35
"""Not tuning: age of an earlier place that is compared with the present one."""
_LOST_S = 0.6
"""Not tuning: an object not observed for this time is no longer followed."""
_LEAST_HITS = 4
_SUPPORT = 3
"""Not tuning: observations in a row that support the motion, before it is declared."""
_ACCELERATION = 0.3
"""Not tuning: change of the velocity within one second, standard deviation, m/s."""
_MISFIT_SHARE, _MOST_MISFIT = 0.3, 6.0
"""Not tuning: weight of an observation in the misfit; a less regular motion is flicker."""
_OBSERVED_SHARE = 0.6
"""Not tuning: least share of the frames that observed a moving object."""
_SPEED_SIGMA = 4.0
"""Not tuning: of the velocity of a group seen once, m/s."""
_SMALL_M = 0.3
"""Not tuning: slack of the free-space comparison."""

OBJECT = record(
    ("id", np.int64),
    ("first_ns", np.int64),
    ("seen_ns", np.int64),
    ("moving_ns", np.int64),
    ("x_m", np.float64),
    ("y_m", np.float64),
    ("vx_m_s", np.float64),
    ("vy_m_s", np.float64),
    ("p00", np.float64),
    ("p01", np.float64),
    ("p11", np.float64),
    ("misfit", np.float64),
    ("size_m", np.float64),
    ("half_x_m", np.float64),
    ("half_y_m", np.float64),
    ("top_m", np.float64),
    ("bottom_m", np.float64),
    ("hits", np.int32),
    ("support", np.int32),
    ("places", np.int32),
    ("frames", np.int32),
)
"""A followed group. moving_ns: when it was declared moving, 0: static; p00, p01, p11: covariance of position and velocity
on each axis; misfit: squared innovation over its variance, mean over the last observations, 2 for an object that moves as
modelled; size_m: diagonal; half_x_m, half_y_m: half of its box; hits: 0: empty; support: observations in a row that
support a motion; places: number of entries of its history; frames: since
the first observation."""

MOVER_RULES = record(
    ("min_speed_m_s", np.float64),
    ("max_speed_m_s", np.float64),
    ("sigmas", np.float64),
    ("max_size_m", np.float64),
)


@kernel
def predict_objects(objects, dt_s, t_ns):
    """Moves the objects by their velocity; ends those not observed for too long."""
    q = _ACCELERATION**2 * dt_s
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0:
            continue
        if t_ns - o.seen_ns > _LOST_S * 1e9:
            o.hits = 0
            continue
        o.frames += 1
        o.x_m += o.vx_m_s * dt_s
        o.y_m += o.vy_m_s * dt_s
        o.p00 += 2.0 * dt_s * o.p01 + dt_s * dt_s * o.p11 + q * dt_s * dt_s / 3.0
        o.p01 += dt_s * o.p11 + 0.5 * q * dt_s
        o.p11 += q


@kernel
def assign_groups(groups, count, objects, rules, order):
    """Gives each group the object nearest to it within the gate, the nearest pair first. order: (G, M) float64 scratch."""
    for g in range(count):
        for m in range(objects.shape[0]):
            order[g, m] = pair_distance(groups[g], objects[m], rules)
    for _ in range(count):
        best, best_g, best_m = 1.0, NONE, NONE
        for g in range(count):
            if groups[g].object != NONE:
                continue
            for m in range(objects.shape[0]):
                if order[g, m] < best:
                    best, best_g, best_m = order[g, m], g, m
        if best_g == NONE:
            break
        groups[best_g].object = best_m
        for g in range(count):
            order[g, best_m] = math.inf


@inner
def pair_distance(g, o, rules):
    """Distance of a group from the predicted place of an object, as a share of the gate; inf: they cannot be one."""
    if o.hits == 0 or not may_move(g, rules):
        return math.inf
    height, other = g.bottom_m - g.top_m, o.bottom_m - o.top_m
    if min(g.bottom_m, o.bottom_m) - max(g.top_m, o.top_m) < 0.5 * min(height, other):
        return math.inf
    if max(g.size_m, o.size_m) > 2.0 * min(g.size_m, o.size_m) + 0.6:
        return math.inf
    reach = min(3.0 * math.sqrt(o.p00 + g.sigma_m**2), 1.5)
    return math.sqrt((g.x_m - o.x_m) ** 2 + (g.y_m - o.y_m) ** 2) / reach


@kernel
def update_objects(groups, count, objects, history, next_id, t_ns, rules, track_rules, view, earlier, has_earlier):
    """Filters the objects by their groups, begins new ones, declares motion; returns the next id.

    history: (M, HISTORY, 3) float64 time (s), x, y; view: FreeView of this frame; earlier: of one OLD_S ago."""
    for g in range(count):
        group, m = groups[g], groups[g].object
        if m == NONE:
            m = free_object(objects) if may_move(group, rules) else NONE
            if m == NONE:
                continue
            begin_object(objects[m], group, next_id, t_ns)
            next_id += 1
            group.object = m
        else:
            update_object(objects[m], group, t_ns)
        o = objects[m]
        supported = supports_motion(o, history[m], rules, track_rules, view, earlier, has_earlier, t_ns)
        o.support = o.support + 1 if supported else 0
        if o.moving_ns == 0 and o.support >= _SUPPORT:
            o.moving_ns = t_ns
        elif o.moving_ns != 0 and math.hypot(o.vx_m_s, o.vy_m_s) < 0.5 * rules.min_speed_m_s:
            o.moving_ns, o.support = 0, 0
        add_place(o, history[m], t_ns)
    return next_id


@inner
def free_object(objects):
    """An empty slot, NONE where there is none."""
    for m in range(objects.shape[0]):
        if objects[m].hits == 0:
            return m
    return NONE


@inner
def begin_object(o, g, object_id, t_ns):
    """A new object of one group."""
    o.id, o.first_ns, o.moving_ns, o.support, o.places, o.hits = object_id, t_ns, 0, 0, 0, 1
    o.frames, o.misfit = 1, 2.0
    o.seen_ns = t_ns
    o.x_m, o.y_m, o.vx_m_s, o.vy_m_s = g.x_m, g.y_m, 0.0, 0.0
    o.p00, o.p01, o.p11 = g.sigma_m**2, 0.0, _SPEED_SIGMA**2
    set_box(o, g, 1.0)


@inner
def set_box(o, g, share):
    """Moves the box of an object towards that of a group by a share of the difference."""
    o.size_m += share * (g.size_m - o.size_m)
    o.half_x_m += share * (0.5 * (g.high_x_m - g.low_x_m) - o.half_x_m)
    o.half_y_m += share * (0.5 * (g.high_y_m - g.low_y_m) - o.half_y_m)
    o.top_m += share * (g.top_m - o.top_m)
    o.bottom_m += share * (g.bottom_m - o.bottom_m)


@inner
def update_object(o, g, t_ns):
    """Kalman update of position and velocity."""
    total = o.p00 + g.sigma_m**2
    k0, k1 = o.p00 / total, o.p01 / total
    miss_x, miss_y = g.x_m - o.x_m, g.y_m - o.y_m
    o.misfit += _MISFIT_SHARE * ((miss_x**2 + miss_y**2) / total - o.misfit)
    o.x_m += k0 * miss_x
    o.y_m += k0 * miss_y
    o.vx_m_s += k1 * miss_x
    o.vy_m_s += k1 * miss_y
    o.p11 -= k1 * o.p01
    o.p01 -= k0 * o.p01
    o.p00 -= k0 * o.p00
    o.hits += 1
    o.seen_ns = t_ns
    set_box(o, g, 0.3)


@inner
def supports_motion(o, places, rules, track_rules, view, earlier, has_earlier, t_ns):
    """Whether this observation supports that the object moves: see the module."""
    speed = math.sqrt(o.vx_m_s**2 + o.vy_m_s**2)
    if o.hits < _LEAST_HITS or speed < rules.min_speed_m_s or speed > rules.max_speed_m_s:
        return False
    if o.misfit > _MOST_MISFIT or o.hits < _OBSERVED_SHARE * o.frames:
        return False
    if speed < rules.sigmas * math.sqrt(o.p11):
        return False
    old = NONE
    for n in range(o.places):
        if t_ns * 1e-9 - places[n, 0] >= OLD_S - 1e-6:
            old = n
    if old == NONE:
        return False
    dt_s = t_ns * 1e-9 - places[old, 0]
    dx, dy = o.x_m - places[old, 1], o.y_m - places[old, 2]
    if math.sqrt((dx - o.vx_m_s * dt_s) ** 2 + (dy - o.vy_m_s * dt_s) ** 2) > 0.5 * math.sqrt(dx * dx + dy * dy):
        return False
    upper, lower = o.top_m, o.bottom_m
    if classify(places[old, 1], places[old, 2], upper, lower, _SMALL_M, track_rules, view) == CLEAR:
        return True
    return has_earlier and classify(o.x_m, o.y_m, upper, lower, _SMALL_M, track_rules, earlier) == CLEAR


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
