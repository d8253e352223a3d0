"""Whether a track hides from the camera what a detection hides, and the correction of its line that keeps this so."""

from __future__ import annotations

import math

from ..jit import inner
from .association import GATE_MAX_M, SIDEWAYS_M, STEADY_HITS
from .line import along, offset, seen_at, shift_line, sideways, update_line

_LOST_M = 0.02
"""What a track may leave uncovered of a detection, at each end."""
_SAME_COS = 0.98
"""A steady track keeps its line where a detection has its direction."""
_WITHIN = 0.95
"""Share of the tolerances that a moved line leaves, since moving turns it."""


@inner
def lies_on(t, d, eye_x, eye_y):
    """Whether both ends of a detection lie on the line of a track."""
    off_a, off_b = offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m)
    if max(abs(off_a), abs(off_b)) > GATE_MAX_M:
        return False
    return beside(t, d, eye_x, eye_y) <= SIDEWAYS_M


@inner
def beside(t, d, eye_x, eye_y):
    """How far beside the line of a track the ends of a detection are seen, m."""
    off_a, off_b = offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m)
    return max(sideways(t, d.ax_m, d.ay_m, off_a, eye_x, eye_y), sideways(t, d.bx_m, d.by_m, off_b, eye_x, eye_y))


@inner
def represents(t, d, eye_x, eye_y):
    """Whether a track hides what a detection hides from the camera, so that nothing of a frame is lost."""
    if t.hits == 0 or not lies_on(t, d, eye_x, eye_y):
        return False
    if d.top_m < t.top_m - _LOST_M or d.bottom_m > t.bottom_m + _LOST_M:
        return False
    sa, sb = seen_at(t, d.ax_m, d.ay_m, eye_x, eye_y), seen_at(t, d.bx_m, d.by_m, eye_x, eye_y)
    if min(sa, sb) < t.frame_s0_m - _LOST_M or max(sa, sb) > t.frame_s1_m + _LOST_M:
        return False
    # seen edge-on, a track is too narrow for what lies beside it
    if beside(t, d, eye_x, eye_y) <= _LOST_M:
        return True
    s0, s1 = t.frame_s0_m, t.frame_s1_m  # cells beyond may be removed
    x0, y0 = t.x_m + s0 * t.tx, t.y_m + s0 * t.ty
    x1, y1 = t.x_m + s1 * t.tx, t.y_m + s1 * t.ty
    wanted = width_of(d.ax_m, d.ay_m, d.bx_m, d.by_m, eye_x, eye_y)
    return width_of(x0, y0, x1, y1, eye_x, eye_y) >= 0.8 * wanted


@inner
def width_of(ax, ay, bx, by, eye_x, eye_y):
    """Angle between two places, seen from the camera, rad."""
    turn = math.atan2(by - eye_y, bx - eye_x) - math.atan2(ay - eye_y, ax - eye_x)
    return abs(turn - math.tau * math.floor(turn / math.tau + 0.5))


@inner
def correct_line(t, d, eye_x, eye_y):
    """Corrects the line of a track by a detection; returns False where the detection needs another line. One observation
    that lies beside the line of a track observed often does not replace it: the line is moved just so far that it hides
    what the detection hides."""
    if lies_on(t, d, eye_x, eye_y):
        update_line(t, d)
        return True
    if t.hits < STEADY_HITS or t.tx * d.tx + t.ty * d.ty < _SAME_COS:
        return False
    update_line(t, d)
    move_towards(t, d, GATE_MAX_M, eye_x, eye_y)
    return lies_on(t, d, eye_x, eye_y)


@inner
def move_towards(t, d, gate_max_m, eye_x, eye_y):
    """Moves a line until both ends of a detection lie within the tolerances of `lies_on`."""
    sa, sb = along(t, d.ax_m, d.ay_m), along(t, d.bx_m, d.by_m)
    if abs(sb - sa) < 1e-3:
        return
    move_a = beyond(t, d.ax_m, d.ay_m, gate_max_m, eye_x, eye_y)
    move_b = beyond(t, d.bx_m, d.by_m, gate_max_m, eye_x, eye_y)
    slope = (move_b - move_a) / (sb - sa)
    shift_line(t, move_a - slope * sa, slope)


@inner
def beyond(t, x, y, gate_max_m, eye_x, eye_y):
    """How far a point lies outside the tolerances of a track's line, m, with its sign."""
    off = offset(t, x, y)
    most, side = gate_max_m, sideways(t, x, y, off, eye_x, eye_y)
    if side > 1e-9:
        most = min(most, SIDEWAYS_M * abs(off) / side)
    most *= _WITHIN
    return math.copysign(max(0.0, abs(off) - most), off)
