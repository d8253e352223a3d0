"""Groups of detections followed with a constant velocity.

Each small group is followed by two Kalman filters of distance and speed, one along the viewing ray and one across it: the
range of a stereo camera is far less exact than its direction. The point that is followed is the middle of the visible
face. A group takes the object that explains its place best, so that an object whose place is uncertain does not take the
group of one that is known well.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, of_type, record
from .groups import may_move
from .tables import NONE

MOST_OBJECTS = 64
"""Groups followed at once; more are static."""
_LOST_S, _LOST_EACH_S = 0.6, 0.3
"""An object not observed for this time, or for so much for each observation, is no longer followed."""
_ACCELERATION = 0.3
"""Change of the velocity within one second, standard deviation, m/s."""
_MISFIT_SHARE = 0.3
"""Weight of an observation in the misfit."""
_SPEED_SIGMA = 4.0
"""Of the velocity of a group seen once, m/s."""
_GATE_SIGMAS, _REACH_M = 3.0, 1.5
"""Largest distance of an observation from the predicted place."""
TAKEN_AFTER = 2
"""Frames in a row in which a moving object must be missing before a group outside of its gate takes it over: one
outlier is no change of the motion."""
_BOX_SHARE = 0.3
"""Weight of an observation in the size."""

OBJECT = record(
    *of_type(np.int64, "id first_ns seen_ns moving_ns"),
    *of_type(np.float64, "x_m y_m vx_m_s vy_m_s r00 r01 r11 t00 t01 t11 azimuth_rad misfit size_m low_dx_m high_dx_m"),
    *of_type(np.float64, "low_dy_m high_dy_m top_m bottom_m"),
    *of_type(np.int32, "hits support places frames evidence missed"),
)
"""A followed group. x_m, y_m: the point of its face that is followed; moving_ns: when it was declared moving, 0: static;
r00, r01, r11: covariance of distance and speed along the viewing ray; t00, t01, t11: across it; azimuth_rad: of that ray;
misfit: squared innovation
over its variance, mean over the last observations, 2 for an object that moves as modelled; size_m: diagonal; low_dx_m to
high_dy_m: its box from (x_m, y_m); hits: 0: empty; support: observations in a row that support a motion; places: number of
entries of its history; frames: since the first observation; evidence: of the newest observation for a motion. missed: frames in a
row that did not observe it."""


@kernel
def predict_objects(objects, dt_s, t_ns, observing):
    """Moves the objects by their velocity; ends those not observed for too long. observing: whether the frame is valid, so
    that it counts as one that observes or misses them."""
    q = _ACCELERATION**2 * dt_s
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0:
            continue
        if t_ns - o.seen_ns > min(_LOST_S, _LOST_EACH_S * o.hits) * 1e9:
            o.hits = 0
            continue
        if observing:
            o.frames += 1
            o.missed += 1
        o.x_m += o.vx_m_s * dt_s
        o.y_m += o.vy_m_s * dt_s
        o.r00 += 2.0 * dt_s * o.r01 + dt_s * dt_s * o.r11 + q * dt_s * dt_s / 3.0
        o.r01 += dt_s * o.r11 + 0.5 * q * dt_s
        o.r11 += q
        o.t00 += 2.0 * dt_s * o.t01 + dt_s * dt_s * o.t11 + q * dt_s * dt_s / 3.0
        o.t01 += dt_s * o.t11 + 0.5 * q * dt_s
        o.t11 += q


@kernel
def assign_groups(groups, objects):
    """Gives each group the object that explains it best, the best pair first."""
    most = groups.shape[0] * objects.shape[0]
    pairs, costs = np.empty((most, 2), np.int64), np.empty(most)
    found = 0
    for g in range(groups.shape[0]):
        for m in range(objects.shape[0]):
            cost = pair_cost(groups[g], objects[m])
            if cost < math.inf:
                pairs[found, 0], pairs[found, 1], costs[found] = g, m, cost
                found += 1
    taken = np.zeros(objects.shape[0], np.bool_)
    for n in np.argsort(costs[:found], kind="mergesort"):
        g, m = pairs[n, 0], pairs[n, 1]
        if groups[g].object == NONE and not taken[m]:
            groups[g].object, taken[m] = m, True


@inner
def pair_cost(g, o):
    """Twice the negative logarithm of the likelihood of a group's place, without its constant; inf: they cannot be one."""
    if o.hits == 0 or not may_move(g) or not alike(g, o):
        return math.inf
    dx, dy = g.x_m - o.x_m, g.y_m - o.y_m
    if dx * dx + dy * dy > _REACH_M**2:
        return math.inf
    ux, uy = math.cos(g.azimuth_rad), math.sin(g.azimuth_rad)
    radial, tangential = o.r00 + g.radial_sigma_m**2, o.t00 + g.tangential_sigma_m**2
    far2 = (ux * dx + uy * dy) ** 2 / radial + (ux * dy - uy * dx) ** 2 / tangential
    if far2 > _GATE_SIGMAS**2:
        return math.inf
    return far2 + math.log(radial * tangential)


@inner
def alike(g, o):
    """Whether a group and an object have about the same size and height."""
    height, other = g.bottom_m - g.top_m, o.bottom_m - o.top_m
    if min(g.bottom_m, o.bottom_m) - max(g.top_m, o.top_m) < 0.5 * min(height, other):
        return False
    return max(g.size_m, o.size_m) <= 2.0 * min(g.size_m, o.size_m) + 0.6


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
    o.frames, o.misfit, o.evidence, o.missed = 1, 2.0, 0, 0
    o.seen_ns = t_ns
    o.x_m, o.y_m, o.vx_m_s, o.vy_m_s = g.x_m, g.y_m, 0.0, 0.0
    o.r00, o.r01, o.r11 = g.radial_sigma_m**2, 0.0, _SPEED_SIGMA**2
    o.t00, o.t01, o.t11 = g.tangential_sigma_m**2, 0.0, _SPEED_SIGMA**2
    o.azimuth_rad, o.size_m = g.azimuth_rad, g.size_m
    begin_box(o, g)


@inner
def begin_box(o, g):
    """Gives an object the box of a group."""
    o.low_dx_m, o.high_dx_m = g.low_x_m - o.x_m, g.high_x_m - o.x_m
    o.low_dy_m, o.high_dy_m = g.low_y_m - o.y_m, g.high_y_m - o.y_m
    o.top_m, o.bottom_m = g.top_m, g.bottom_m


@inner
def set_box(o, g):
    """Moves the box of an object towards that of a group: each side at once where the group reaches beyond it, by a share
    of the difference where it does not."""
    o.size_m += _BOX_SHARE * (g.size_m - o.size_m)
    o.low_dx_m = lower_side(o.low_dx_m, g.low_x_m - o.x_m)
    o.low_dy_m = lower_side(o.low_dy_m, g.low_y_m - o.y_m)
    o.top_m = lower_side(o.top_m, g.top_m)
    o.high_dx_m = -lower_side(-o.high_dx_m, o.x_m - g.high_x_m)
    o.high_dy_m = -lower_side(-o.high_dy_m, o.y_m - g.high_y_m)
    o.bottom_m = -lower_side(-o.bottom_m, -g.bottom_m)


@inner
def lower_side(side, observed):
    """The lower side of a box after an observation."""
    return min(side + _BOX_SHARE * (observed - side), observed)


@inner
def turn_covariance(o, azimuth_rad):
    """Gives the covariance of an object the axes of another viewing ray. The larger part is kept, and the smaller one takes
    from it the sine of the turn: after many small turns it is no smaller than after one large one."""
    share = abs(math.sin(azimuth_rad - o.azimuth_rad))
    if o.r00 + o.r11 > o.t00 + o.t11:
        o.t00 += share * (o.r00 - o.t00)
        o.t01 += share * (o.r01 - o.t01)
        o.t11 += share * (o.r11 - o.t11)
    else:
        o.r00 += share * (o.t00 - o.r00)
        o.r01 += share * (o.t01 - o.r01)
        o.r11 += share * (o.t11 - o.r11)
    o.azimuth_rad = azimuth_rad


@inner
def take_over(o, g, t_ns):
    """Moves an object to a group outside of its gate: it has stopped or turned. Its velocity is uncertain again."""
    o.x_m, o.y_m, o.azimuth_rad = g.x_m, g.y_m, g.azimuth_rad
    o.r00, o.r01, o.r11 = g.radial_sigma_m**2, 0.0, o.r11 + _SPEED_SIGMA**2
    o.t00, o.t01, o.t11 = g.tangential_sigma_m**2, 0.0, o.t11 + _SPEED_SIGMA**2
    o.places, o.support, o.misfit, o.evidence, o.missed = 0, 0, 2.0, 0, 0
    o.hits += 1
    o.seen_ns, o.size_m = t_ns, g.size_m
    begin_box(o, g)


@inner
def object_lost_at(g, objects, t_ns):
    """Slot of the nearest moving object of a group's size that no group of this frame explains, NONE: there is none within
    reach."""
    best, nearest = NONE, _REACH_M
    for m in range(objects.shape[0]):
        o = objects[m]
        if o.hits == 0 or o.moving_ns == 0 or o.seen_ns == t_ns or not alike(g, o):
            continue
        if max(g.size_m, o.size_m) > 2.0 * min(g.size_m, o.size_m):
            continue
        far = math.sqrt((g.x_m - o.x_m) ** 2 + (g.y_m - o.y_m) ** 2)
        if far < nearest:
            best, nearest = m, far
    return best


@inner
def update_object(o, g, t_ns):
    """Kalman update of position and velocity, along the viewing ray and across it."""
    turn_covariance(o, g.azimuth_rad)
    ux, uy = math.cos(g.azimuth_rad), math.sin(g.azimuth_rad)
    dx, dy = g.x_m - o.x_m, g.y_m - o.y_m
    radial, tangential = ux * dx + uy * dy, ux * dy - uy * dx
    total_r, total_t = o.r00 + g.radial_sigma_m**2, o.t00 + g.tangential_sigma_m**2
    o.misfit += _MISFIT_SHARE * (radial**2 / total_r + tangential**2 / total_t - o.misfit)
    r0, r1, t0, t1 = o.r00 / total_r, o.r01 / total_r, o.t00 / total_t, o.t01 / total_t
    o.x_m += r0 * radial * ux - t0 * tangential * uy
    o.y_m += r0 * radial * uy + t0 * tangential * ux
    o.vx_m_s += r1 * radial * ux - t1 * tangential * uy
    o.vy_m_s += r1 * radial * uy + t1 * tangential * ux
    o.r11 -= r1 * o.r01
    o.r01 -= r0 * o.r01
    o.r00 -= r0 * o.r00
    o.t11 -= t1 * o.t01
    o.t01 -= t0 * o.t01
    o.t00 -= t0 * o.t00
    o.hits += 1
    o.missed = 0
    o.seen_ns = t_ns
    set_box(o, g)


@inner
def speed_variance(o, x_m, y_m):
    """Variance of an object's speed along its velocity, m^2/s^2, seen from (x_m, y_m)."""
    dx, dy = o.x_m - x_m, o.y_m - y_m
    r2, v2 = dx * dx + dy * dy, o.vx_m_s**2 + o.vy_m_s**2
    if r2 < 1e-6 or v2 < 1e-6:
        return max(o.r11, o.t11)
    along2 = (dx * o.vx_m_s + dy * o.vy_m_s) ** 2 / (r2 * v2)
    return along2 * o.r11 + (1.0 - along2) * o.t11
