"""Fits a plane to the points of a horizontal surface below the camera, and decides if it is the ground.

Input: the sampled points with their votes, and a height to begin with (ground.py). Output: `GroundPlane` and the
verdict. Not in the paper."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..jit import inner

MIN_SHARE = 0.01
"""Least share of the samples that vote for a ground, and that lie on it."""
_FIT_SIGMAS = 2.0
"""Where the noise exceeds the greatest tolerance, the fit uses pixels up to this distance, and lower ones are below."""
_FIT_MIN_PX = 20
"""Least number of samples for a fit."""
_SLOPE_PRIOR = 0.0175
"""Slope that is expected before the fit, m/m: a narrow patch of ground tilts the fit little."""
_RECEDE_NOISE = 0.1
"""A vote is certain when the noise of the height is below this share of the rise of a wall."""
_BELOW_M, _BELOW_FULL_M = 0.1, 5.0
"""A pixel is below the ground when it is lower than the tolerance and _BELOW_M h / (h + _BELOW_FULL_M), h: height of
the camera."""
_MAX_BELOW_SHARE = 0.05
"""Greatest share of the samples below a ground."""


class GroundPlane(NamedTuple):
    """The plane z = height_m + slope_x x + slope_y y in level_cam (z is down)."""

    height_m: float
    slope_x: float
    slope_y: float


class PlaneSums(NamedTuple):
    """Weighted sums over the points near a GroundPlane. x, y: place in level_cam; r: `below_plane`."""

    w: float
    wx: float
    wy: float
    wr: float
    wxx: float
    wxy: float
    wyy: float
    wxr: float
    wyr: float


@inner
def fit_tolerance(sigma, tuning):
    """Returns the greatest distance of a point of the ground from the plane that is fitted, in metres.

    sigma: noise of the height of the point, m. The tolerance is not limited to less than _FIT_SIGMAS of it: it would
    cut into the noise of the points, and the fit could not move from where it starts."""
    return min(max(tuning.ground_sigmas * sigma, tuning.tolerance_m), max(tuning.cap_m, _FIT_SIGMAS * sigma))


@inner
def below_plane(point, plane):
    """Returns how far a POINT lies below a GroundPlane, in metres along level_cam z."""
    return point.z - (plane.height_m + plane.slope_x * point.x + plane.slope_y * point.y)


@inner
def sums_near(points, plane, tuning):
    """Returns the number of points that voted and lie near a GroundPlane, and PlaneSums over them. points: (N,) POINT."""
    on = 0
    w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(points)):
        if points[i].level == 0.0:  # such as the foot of a wall
            continue
        x, y, r = np.float64(points[i].x), np.float64(points[i].y), below_plane(points[i], plane)
        sigma = plane.height_m / points[i].per_height
        if abs(r) < fit_tolerance(sigma, tuning):
            on += 1
            # inverse variance of height, sigma_h = ke X h
            weight = 1.0 / (tuning.ground_fit_floor_m + sigma) ** 2
            w, wx, wy, wr = w + weight, wx + weight * x, wy + weight * y, wr + weight * r
            wxx, wxy, wyy = wxx + weight * x * x, wxy + weight * x * y, wyy + weight * y * y
            wxr, wyr = wxr + weight * x * r, wyr + weight * y * r
    return on, PlaneSums(w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr)


@inner
def moved_plane(plane, sums, max_slope):
    """Returns the weighted least-squares plane of the points in `sums`, not steeper than `max_slope` (ours).

    The height is that of the mean with the slopes of `plane`; the slopes are those of a plane with an intercept. A
    prior pulls them to 0 where the points do not determine them.
    sums: PlaneSums relative to `plane`; max_slope: greatest magnitude of the slope; 0: the slopes of `plane` are kept."""
    w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr = sums
    off = wr / w
    height, slope_x, slope_y = plane.height_m + off, plane.slope_x, plane.slope_y
    if max_slope > 0.0:
        r0 = wr + slope_x * wx + slope_y * wy - off * w
        rx = wxr + slope_x * wxx + slope_y * wxy - off * wx - r0 * wx / w
        ry = wyr + slope_x * wxy + slope_y * wyy - off * wy - r0 * wy / w
        flat = 1.0 / _SLOPE_PRIOR**2
        xx, xy, yy = wxx + flat - wx * wx / w, wxy - wx * wy / w, wyy + flat - wy * wy / w
        det = xx * yy - xy * xy
        slope_x, slope_y = (yy * rx - xy * ry) / det, (xx * ry - xy * rx) / det
        shrink = min(1.0, max_slope / max(math.hypot(slope_x, slope_y), 1e-12))
        slope_x, slope_y = slope_x * shrink, slope_y * shrink
    return GroundPlane(height, slope_x, slope_y)


@inner
def judge_plane(points, plane, noise_height, tuning):
    """Returns whether a fitted plane is ground, and the share of the points that lie on it.

    It is refused if too many points lie below it, if it is too close to the camera, or if its points do not recede
    from row to row as on a horizontal surface.
    noise_height: height by which the noise of the points is computed, m."""
    n, height = len(points), plane.height_m
    slack = _BELOW_M * height / (height + _BELOW_FULL_M)
    on, below, recedes, recede = 0, 0, 0.0, 0.0
    for i in range(n):
        sigma = noise_height / points[i].per_height
        tolerance = fit_tolerance(sigma, tuning)
        r = below_plane(points[i], plane)
        below += r > tolerance + slack
        if abs(r) < tolerance:
            on += 1
            # On the ground 1/x = (z/x - slopes) / height; on a wall 1/x is the same in all rows.
            rows, rise = np.float64(points[i].tangent_step), np.float64(points[i].inverse_step)
            if sigma < _RECEDE_NOISE * abs(rows) * points[i].x:  # noise cannot have caused the vote of this pair
                rows *= points[i].level
                rise = rows / height
            recedes, recede = recedes + rows * rise, recede + rows * rows
    is_ground = below <= _MAX_BELOW_SHARE * n and height >= tuning.ground_min_height_m
    return is_ground and recedes * height >= tuning.ground_recede_share * recede, on / n


@inner
def fit_ground(points, height, tuning):
    """Fits a plane with bounded slopes to the points that voted and lie near a height.

    Args:
        height: height to begin with, m below the camera.

    Returns:
        (accepted, GroundPlane, share of the points that lie on the plane). A plane with too few points is not
            accepted, nor one that `judge_plane` refuses."""
    plane, before = GroundPlane(height, 0.0, 0.0), height
    for _ in range(tuning.ground_fit_rounds):
        on, sums = sums_near(points, plane, tuning)
        if on < max(_FIT_MIN_PX, MIN_SHARE * len(points)):
            return False, plane, 0.0
        before = plane.height_m
        plane = moved_plane(plane, sums, tuning.ground_max_slope)
    accepted, share = judge_plane(points, plane, before, tuning)
    return accepted, plane, share
