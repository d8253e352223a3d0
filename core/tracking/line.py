"""The line of a track: distances of points from it, and its filter (offset and slope with their covariance)."""

from __future__ import annotations

import math

from ..jit import inner
from .tables import SHIFT_M, THIN_M

EDGE_ON = 0.4
"""Sine of the angle between a viewing ray and a line that is seen edge-on."""
_SLOPE_VARIANCE = 0.25
"""Variance of the slope of a line without a direction, rad^2."""
_DRIFT_M, _TURN_RAD = 0.03, math.radians(1.0)
"""Change of a track's place, and of its direction, within one second, standard deviations."""


@inner
def along(track, x, y):
    """s of a point, m."""
    return (x - track.x_m) * track.tx + (y - track.y_m) * track.ty


@inner
def point_at(track, s):
    """(x, y) of the point of the line at s."""
    return track.x_m + s * track.tx, track.y_m + s * track.ty


@inner
def offset(track, x, y):
    """Distance of a point from the line, m; positive on the free side."""
    return (y - track.y_m) * track.tx - (x - track.x_m) * track.ty


@inner
def facing(track, x, y, eye):
    """Sine of the angle between the viewing ray of a point and the line; negative: it is seen from behind."""
    dx, dy = x - eye[0], y - eye[1]
    return (dx * track.ty - dy * track.tx) / max(1e-6, math.sqrt(dx * dx + dy * dy))


@inner
def sideways(track, x, y, off, eye):
    """Part of a point's offset from the line that is perpendicular to its viewing ray, m: so far from the point the line is
    seen."""
    sine = facing(track, x, y, eye)
    return abs(off) * math.sqrt(max(0.0, 1.0 - sine * sine))


@inner
def seen_at(track, x, y, eye):
    """s at which the viewing ray of a point near the line meets it; that of its foot where the line is seen edge-on."""
    return met_at(x - track.x_m, y - track.y_m, track.tx, track.ty, x - eye[0], y - eye[1])


@inner
def met_at(off_x, off_y, tx, ty, dx, dy):
    """Where the viewing ray (dx, dy) of a point meets the line through the origin along (tx, ty), m along the line; the foot
    of the point where the line is seen edge-on. off_x, off_y: place of the point."""
    r = math.sqrt(dx * dx + dy * dy)
    s = off_x * tx + off_y * ty
    if r < 1e-6:
        return s
    facing = (dy * tx - dx * ty) / r
    if abs(facing) < EDGE_ON:
        return s
    return s - (off_y * tx - off_x * ty) * (dx * tx + dy * ty) / r / facing


@inner
def variance_at(track, s):
    """Variance of the line's offset at s, m^2."""
    return track.p00 + 2.0 * s * track.p01 + s * s * track.p11


@inner
def begin_line(track, d):
    """Sets the line of a track to a detection's, with the anchor in its middle."""
    track.x_m, track.y_m = 0.5 * (d.ax_m + d.bx_m), 0.5 * (d.ay_m + d.by_m)
    track.tx, track.ty = d.tx, d.ty
    track.p00, track.p01 = d.sigma_m**2, 0.0
    track.p11 = min(_SLOPE_VARIANCE, 4.0 * d.sigma_m**2 / d.length_m**2)


@inner
def update_line(track, d):
    """Corrects the line by a detection: by the distances of its two ends, each with twice the variance of its place."""
    variance = 2.0 * d.sigma_m**2
    correct_by_ends(track, d.ax_m, d.ay_m, variance, d.bx_m, d.by_m, variance)


@inner
def correct_by_ends(track, ax, ay, variance_a, bx, by, variance_b):
    """Corrects the line by the distances of two points, m, with their variances, m^2.

    Kalman filter of (offset, slope) about the present line, one measurement after the other."""
    delta, slope = 0.0, 0.0
    for end in range(2):
        x, y = (ax, ay) if end == 0 else (bx, by)
        s = along(track, x, y)
        h0, h1 = track.p00 + s * track.p01, track.p01 + s * track.p11
        total = h0 + s * h1 + (variance_a if end == 0 else variance_b)
        k0, k1 = h0 / total, h1 / total
        miss = offset(track, x, y) - delta - s * slope
        delta += k0 * miss
        slope += k1 * miss
        track.p00 -= k0 * h0
        track.p01 -= k0 * h1
        track.p11 -= k1 * h1
    shift_line(track, delta, slope)


@inner
def ahead(track, x, y, eye):
    """How far the line lies behind a point near it, m along the viewing ray. The line is not seen edge-on."""
    return offset(track, x, y) / max(EDGE_ON, facing(track, x, y, eye))


@inner
def shift_line(track, delta_m, slope):
    """Moves the anchor of a line by delta_m along the normal, and turns the line by the angle of a slope."""
    track.x_m -= track.ty * delta_m
    track.y_m += track.tx * delta_m
    tx, ty = track.tx - track.ty * slope, track.ty + track.tx * slope
    norm = math.sqrt(tx * tx + ty * ty)
    track.tx, track.ty = tx / norm, ty / norm


@inner
def predict_line(track, dt_s):
    """Lets the covariance grow over dt_s about the middle of the track."""
    track.p00 += _DRIFT_M**2 * dt_s
    turn = max(0.0, min(_TURN_RAD**2 * dt_s, _SLOPE_VARIANCE - track.p11))
    s = 0.5 * (track.s0_m + track.s1_m)
    track.p11 += turn
    track.p01 -= s * turn
    track.p00 += s * s * turn
    if abs(s) > SHIFT_M:
        shift_anchor(track, s)


@inner
def shift_anchor(track, s):
    """Moves the anchor along the line towards s, by whole cells of twice the present length."""
    cells = 2 * int(math.floor(s / (2.0 * track.cell_m)))
    step = cells * track.cell_m
    track.x_m += track.tx * step
    track.y_m += track.ty * step
    track.p00 += 2.0 * step * track.p01 + step * step * track.p11
    track.p01 += step * track.p11
    track.first_cell -= cells
    track.s0_m -= step
    track.s1_m -= step


@inner
def is_thin(t):
    """Whether a track is as low as a wire."""
    return t.bottom_m - t.top_m <= THIN_M


@inner
def share_at(t, x, y, eye):
    """Range of the line of a track over that of a point on the same viewing ray."""
    whole = offset(t, eye[0], eye[1])
    return min(2.0, max(0.5, whole / max(1e-3, whole - offset(t, x, y))))


@inner
def seen_height(z_m, share, eye):
    """Height that is seen at z_m, at another share of the range."""
    return eye[2] + share * (z_m - eye[2])


@inner
def middle_share(t, o, eye):
    """Range of the line of a track over that of the middle of another track, on the same viewing ray."""
    s = 0.5 * (o.s0_m + o.s1_m)
    return share_at(t, o.x_m + s * o.tx, o.y_m + s * o.ty, eye)


@inner
def seen_heights(track, d, eye):
    """Upper and lower edge of a detection as they are seen on the line of a track, in the middle of the detection."""
    share = share_at(track, 0.5 * (d.ax_m + d.bx_m), 0.5 * (d.ay_m + d.by_m), eye)
    return seen_height(d.top_m, share, eye), seen_height(d.bottom_m, share, eye)
