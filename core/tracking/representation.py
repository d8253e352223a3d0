"""Whether a track hides from the camera what a detection hides, and the correction of its line that keeps this so."""

from __future__ import annotations

import math

from ..jit import inner
from .association import GATE_MAX_M, SIDEWAYS_M, STEADY_HITS
from .line import along, offset, point_at, seen_at, shift_line, sideways, update_line
from .observed import turn_between

LOST_M = 0.02
"""What a track may leave uncovered of a detection, at each end. A track seen edge-on is too narrow for what lies farther
beside it."""
_SAME_COS = 0.98
"""A steady track keeps its line where a detection has its direction."""
_WITHIN = 0.95
"""Share of the tolerances that a moved line leaves, since moving turns it."""


@inner
def lies_on(t, d, eye):
    """Whether both ends of a detection lie on the line of a track."""
    off_a, off_b = offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m)
    if max(abs(off_a), abs(off_b)) > GATE_MAX_M:
        return False
    return beside(t, d, eye) <= SIDEWAYS_M


@inner
def beside(t, d, eye):
    """How far beside the line of a track the ends of a detection are seen, m."""
    off_a, off_b = offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m)
    return max(sideways(t, d.ax_m, d.ay_m, off_a, eye), sideways(t, d.bx_m, d.by_m, off_b, eye))


@inner
def represents(t, d, eye):
    """Whether a track hides what a detection hides from the camera, so that nothing of a frame is lost."""
    if t.hits == 0 or not lies_on(t, d, eye):
        return False
    if d.top_m < t.top_m - LOST_M or d.bottom_m > t.bottom_m + LOST_M:
        return False
    sa, sb = seen_at(t, d.ax_m, d.ay_m, eye), seen_at(t, d.bx_m, d.by_m, eye)
    if min(sa, sb) < t.frame_s0_m - LOST_M or max(sa, sb) > t.frame_s1_m + LOST_M:
        return False
    # seen edge-on, a track is too narrow for what lies beside it
    if beside(t, d, eye) <= LOST_M:
        return True
    s0, s1 = t.frame_s0_m, t.frame_s1_m  # cells beyond may be removed
    x0, y0 = point_at(t, s0)
    x1, y1 = point_at(t, s1)
    wanted = width_of(d.ax_m, d.ay_m, d.bx_m, d.by_m, eye)
    return width_of(x0, y0, x1, y1, eye) >= 0.8 * wanted


@inner
def width_of(ax, ay, bx, by, eye):
    """Angle between two places, seen from the camera, rad."""
    return abs(turn_between(math.atan2(ay - eye[1], ax - eye[0]), math.atan2(by - eye[1], bx - eye[0])))


@inner
def correct_line(t, d, eye):
    """Corrects the line of a track by a detection; returns False where the detection needs another line. One observation
    that lies beside the line of a track observed often does not replace it: the line is moved just so far that it hides
    what the detection hides."""
    if lies_on(t, d, eye):
        update_line(t, d)
        return True
    if t.hits < STEADY_HITS or t.tx * d.tx + t.ty * d.ty < _SAME_COS:
        return False
    update_line(t, d)
    move_towards(t, d, eye)
    return lies_on(t, d, eye)


@inner
def move_towards(t, d, eye):
    """Moves a line until both ends of a detection lie within the tolerances of `lies_on`."""
    sa, sb = along(t, d.ax_m, d.ay_m), along(t, d.bx_m, d.by_m)
    if abs(sb - sa) < 1e-3:
        return
    move_a = beyond(t, d.ax_m, d.ay_m, eye)
    move_b = beyond(t, d.bx_m, d.by_m, eye)
    slope = (move_b - move_a) / (sb - sa)
    shift_line(t, move_a - slope * sa, slope)


@inner
def beyond(t, x, y, eye):
    """How far a point lies outside the tolerances of a track's line, m, with its sign."""
    off = offset(t, x, y)
    most, side = GATE_MAX_M, sideways(t, x, y, off, eye)
    if side > 1e-9:
        most = min(most, SIDEWAYS_M * abs(off) / side)
    most *= _WITHIN
    return math.copysign(max(0.0, abs(off) - most), off)
