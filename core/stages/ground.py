"""Finds the horizontal surface below the camera, once per frame before the density is computed.

Input: the marks of `classify` and the attitude. Output: `Ground`: height, slopes, and the ranges at which it was
measured, or NO_GROUND.

The paper identifies horizontal surfaces per column, among the pixels that remain (Section 4.3, Eq. 10-14). That is
too late for the ground: flat ground fills about the same number of pixels per kernel width at any range, while the
obstacle threshold (Eq. 6) decreases with range, so that distant ground becomes an obstacle. Here pairs of pixels that
are not on a steep surface vote for a height, the height is accepted if few pixels lie below it, and a plane with
bounded slopes is fitted. If no height is accepted, no ground is assumed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, kernel, record, record_of
from ..params import Params
from ..types import FAR_MM, CameraInfo, Ground

NO_GROUND = Ground(seen=False)
_STEPS_FROM_M = 0.12
"""Height at which the steps of height begin. It does not depend on the least height considered, so that that
parameter does not shift the steps."""
_FAR = np.uint16(FAR_MM)
_CLIMB_MOST = 2.0 / 3.0
"""Greatest climb of a pair as a share of the camera's height. At a height of a few centimetres the least climb would
otherwise reach over the horizon, and no pair on the ground would vote."""
_MIN_SAMPLES = 50
"""Least number of sampled pixels; with fewer no ground is searched."""
_MIN_SHARE = 0.01
"""Least share of the samples that vote for a ground, and that lie on it."""
_PAIR_MIN_PX = 4.0
"""Least distance of the rows of a pair."""
_PAIR_FLAT, _PAIR_SIGMAS, _PAIR_FLAT_CAP = 0.25, 2.0, 0.5
"""A pair votes when it rises by less than the first share of the rise of a wall and so many sigma of the noise, together at
most the second share."""
_SEED_WEIGHT, _SEED_STEPS = 1.5, 2
"""Weight of votes up to this many steps of height from the ground of the last frame."""
_TRIES = 6
"""Number of heights that are tried, beginning with the one of most votes."""
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
GROUND_SETTINGS = record(
    ("tolerance_m", np.float64),  # `ground_tolerance_m`, at most cap_m
    ("cap_m", np.float64),  # greatest tolerance
    ("min_height_m", np.float64),
    ("max_height_m", np.float64),
    ("height_step", np.float64),
    ("pair_climb", np.float64),
    ("pair_climb_min_m", np.float64),
    ("pair_climb_max_m", np.float64),
    ("sigmas", np.float64),
    ("fit_floor_m", np.float64),
    ("max_slope", np.float64),
    ("recede_share", np.float64),
    ("pair_parts", np.int64),
    ("fit_rounds", np.int64),
)
"""Settings of the ground search. Fields without a comment are the parameters of these names with the prefix
`ground_`."""

POINT = record(
    ("x", np.float32),  # place in level_cam, m
    ("y", np.float32),
    ("z", np.float32),
    ("per_height", np.float32),  # a point of ground at height h has a sigma of height of h / per_height
    ("level", np.float32),  # 1 if the pixel voted, else 0
    ("tangent_step", np.float32),  # difference of z/x to the other pixel of its pair, 0 if there is none
    ("inverse_step", np.float32),  # difference of 1/x
)
"""A sampled pixel."""


class GroundSamples(NamedTuple):
    """Which pixels are sampled, and what is known of them.

    Attributes:
        column_step: every column_step-th column is sampled.
        row_step: every row_step-th row is sampled.
        votes: (bins,) int32, votes per step of height.
        points: (N,) POINT. Further samples vote but are not written."""

    column_step: int
    row_step: int
    votes: NDArray[np.int32]
    points: NDArray[Any]


def ground_settings(p: Params) -> NDArray[Any]:
    """Returns (1,) GROUND_SETTINGS."""
    cap = p.ground_tolerance_cap * p.min_obstacle_height_m
    named = {name: getattr(p, f"ground_{name}") for name in (GROUND_SETTINGS.names or ())[2:]}
    return record_of(GROUND_SETTINGS, p, tolerance_m=min(p.ground_tolerance_m, cap), cap_m=cap, **named)


def height_bins(p: Params) -> int:
    """Returns the number of steps of height, a few more than the greatest height considered needs."""
    return 4 + math.ceil(math.log(max(p.ground_max_height_m / p.ground_min_height_m, 1.0)) / p.ground_height_step)


@inner
def step_of(height_m, bin_step):
    """Returns the index of the step that holds a height > 0. Steps are uniform in log(height), negative below
    _STEPS_FROM_M."""
    return int(math.floor(math.log(height_m / _STEPS_FROM_M) / bin_step))


@inner
def vote(marks, R, k, ke, tuning, samples):
    """Votes for the heights of horizontal surfaces; returns (points written, pixels sampled).

    Two pixels of one source column form a pair. It votes for its mean height if the height changes between them by
    only a small part of what a wall would show over the same rows.

    Args:
        marks: (H, W) uint16 of `classify`.
        R: (3, 3) R_level_optical.
        k: (4,) fx, fy, cx, cy.
        ke: noise coefficient, 1/m.
        tuning: a record of GROUND_SETTINGS.
        samples: GroundSamples; votes and points are outputs."""
    rows, cols = marks.shape
    column_step, row_step, votes, points = samples
    least, bin_step = tuning.min_height_m, tuning.height_step
    bins, lowest, pair_rows_max = len(votes), step_of(least, bin_step), np.float64(rows // tuning.pair_parts)
    votes[:] = 0
    n = 0
    sampled = 0
    for u in range(column_step // 2, cols, column_step):
        xu = (u - k[2]) / k[0]
        for v in range(row_step // 2, rows, row_step):
            mark = marks[v, u]
            if mark == 0 or mark == _FAR:
                continue
            d = np.float32(1000.0) / np.float32(mark)
            sampled += 1
            yv = (v - k[3]) / k[1]
            z = (R[2, 0] * xu + R[2, 1] * yv + R[2, 2]) / d
            x = (R[0, 0] * xu + R[0, 1] * yv + R[0, 2]) / d
            is_written = n < len(points)
            if is_written:
                point = points[n]
                point.x, point.y, point.z = x, (R[1, 0] * xu + R[1, 1] * yv + R[1, 2]) / d, z
                point.per_height = d / ke
                point.level, point.tangent_step, point.inverse_step = 0.0, 0.0, 0.0
                n += 1
            if z < least or x <= 0.0:
                continue
            # the height that a wall covers over the rows of the pair
            climb_min = min(tuning.pair_climb_min_m, _CLIMB_MOST * z)
            climb = min(max(tuning.pair_climb * z, climb_min), tuning.pair_climb_max_m)
            v2 = v - int(max(_PAIR_MIN_PX, min(pair_rows_max, climb * k[1] * d)))
            if v2 < 0:
                continue
            mark = marks[v2, u]
            if mark == 0 or mark == _FAR:
                continue
            d2 = np.float32(1000.0) / np.float32(mark)
            yv2 = (v2 - k[3]) / k[1]
            z2 = (R[2, 0] * xu + R[2, 1] * yv2 + R[2, 2]) / d2
            x2 = (R[0, 0] * xu + R[0, 1] * yv2 + R[0, 2]) / d2
            if x2 > 0.0 and is_written:
                points[n - 1].tangent_step, points[n - 1].inverse_step = z / x - z2 / x2, 1.0 / x - 1.0 / x2
            noise = _PAIR_SIGMAS * ke * (z / d + abs(z2) / d2) * 0.5
            allowed = min(_PAIR_FLAT * climb + noise, _PAIR_FLAT_CAP * climb)
            if abs(z2 - z) < allowed:
                if is_written:
                    points[n - 1].level = 1.0
                bin_ = step_of(0.5 * (z + z2), bin_step) - lowest
                if 0 <= bin_ < bins:
                    votes[bin_] += 1
    return n, sampled


@inner
def bounded_slope(sums, height_off, slope_x, slope_y, prior, limit):
    """Returns the slopes (x, y) of a weighted least-squares plane with an intercept, not steeper than `limit`.

    The plane is z = h + slope_x x + slope_y y (ours). A prior pulls the slopes to 0 where the points do not determine
    them.

    Args:
        sums: (w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr), weighted sums over the points, where r is the height of a
            point above a plane with the slopes slope_x, slope_y that lies `height_off` too low.
        height_off: see `sums`, m.
        slope_x, slope_y: see `sums`.
        prior: standard deviation of a slope.
        limit: greatest magnitude of the slope."""
    w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr = sums
    r0 = wr + slope_x * wx + slope_y * wy - height_off * w
    rx = wxr + slope_x * wxx + slope_y * wxy - height_off * wx - r0 * wx / w
    ry = wyr + slope_x * wxy + slope_y * wyy - height_off * wy - r0 * wy / w
    xx, xy, yy = wxx + 1.0 / prior**2 - wx * wx / w, wxy - wx * wy / w, wyy + 1.0 / prior**2 - wy * wy / w
    det = xx * yy - xy * xy
    x, y = (yy * rx - xy * ry) / det, (xx * ry - xy * rx) / det
    shrink = min(1.0, limit / max(math.hypot(x, y), 1e-12))
    return x * shrink, y * shrink


@inner
def fit_cap(sigma, tuning):
    """Returns the greatest distance of a point of the ground from the plane that is fitted, in metres.

    A smaller one would cut into the noise of the points, and the fit could not move from where it starts."""
    return max(tuning.cap_m, _FIT_SIGMAS * sigma)


@inner
def fit_ground(points, height, tuning):
    """Fits the plane z = h + slope_x x + slope_y y to the points near a height, with bounded slopes.

    The plane is refused if too few points lie on it, too many below it, or if its points do not recede from row to
    row as on a horizontal surface.

    Args:
        points: (N,) POINT of `vote`.
        height: height to begin with, m below the camera.
        tuning: a record of GROUND_SETTINGS.

    Returns:
        (accepted, height, slope_x, slope_y, share of the points that lie on the plane)."""
    n = len(points)
    slope_x, slope_y, tolerance_at = 0.0, 0.0, height
    for _ in range(tuning.fit_rounds):
        on = 0
        w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        tolerance_at = height
        for i in range(n):
            if points[i].level == 0.0:  # such as the foot of a wall
                continue
            x, y = np.float64(points[i].x), np.float64(points[i].y)
            sigma = height / points[i].per_height
            r = points[i].z - (height + slope_x * x + slope_y * y)
            if abs(r) < min(max(tuning.sigmas * sigma, tuning.tolerance_m), fit_cap(sigma, tuning)):
                on += 1
                # inverse variance of height, sigma_h = ke X h
                weight = 1.0 / (tuning.fit_floor_m + sigma) ** 2
                w, wx, wy, wr = w + weight, wx + weight * x, wy + weight * y, wr + weight * r
                wxx, wxy, wyy = wxx + weight * x * x, wxy + weight * x * y, wyy + weight * y * y
                wxr, wyr = wxr + weight * x * r, wyr + weight * y * r
        if on < max(_FIT_MIN_PX, _MIN_SHARE * n):
            return False, height, slope_x, slope_y, 0.0
        height += wr / w
        if tuning.max_slope > 0.0:
            sums = (w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr)
            slope_x, slope_y = bounded_slope(sums, wr / w, slope_x, slope_y, _SLOPE_PRIOR, tuning.max_slope)
    slack = _BELOW_M * height / (height + _BELOW_FULL_M)
    on, below, recedes, recede = 0, 0, 0.0, 0.0
    for i in range(n):
        sigma = tolerance_at / points[i].per_height
        tolerance = min(max(tuning.sigmas * sigma, tuning.tolerance_m), fit_cap(sigma, tuning))
        r = points[i].z - (height + slope_x * points[i].x + slope_y * points[i].y)
        below += r > tolerance + slack
        if abs(r) < tolerance:
            on += 1
            # On the ground 1/x = (z/x - slopes) / height; on a wall 1/x is the same in all rows.
            rows, rise = np.float64(points[i].tangent_step), np.float64(points[i].inverse_step)
            if sigma < _RECEDE_NOISE * abs(rows) * points[i].x:  # noise cannot have caused the vote of this pair
                rows *= points[i].level
                rise = rows / height
            recedes, recede = recedes + rows * rise, recede + rows * rows
    seen = below <= _MAX_BELOW_SHARE * n and height >= tuning.min_height_m
    seen = seen and recedes * height >= tuning.recede_share * recede
    return seen, height, slope_x, slope_y, on / n


@kernel
def search_ground(marks, R, k, ke, seed_height, settings, samples):
    """Returns the first accepted result of `fit_ground`, trying heights in the order of their votes.

    Args:
        marks, R, k, ke, samples: see `vote`.
        seed_height: height of the last ground, m; it and its neighbours get more weight. nan: none.
        settings: (1,) GROUND_SETTINGS."""
    tuning, votes, points = settings[0], samples.votes, samples.points
    n, sampled = vote(marks, R, k, ke, tuning, samples)
    for i in range(n, len(points)):  # points of an earlier frame
        points[i].level = 0.0
    bins = len(votes)
    score = np.zeros(bins, np.float64)
    for b in range(bins):
        score[b] = votes[max(b - 1, 0) : b + 2].sum()
    lowest = step_of(tuning.min_height_m, tuning.height_step)
    if seed_height > tuning.min_height_m:
        at, reach = step_of(seed_height, tuning.height_step) - lowest, _SEED_STEPS
        score[max(0, at - reach) : at + reach + 1] *= _SEED_WEIGHT
    tries = _TRIES if sampled >= _MIN_SAMPLES else 0
    for _ in range(tries):
        best = np.argmax(score)
        if score[best] < _MIN_SHARE * sampled:
            break
        height = _STEPS_FROM_M * math.exp((best + lowest + 0.5) * tuning.height_step)
        score[max(0, best - 2) : best + 3] = 0.0  # all scores that contain votes for this step
        if height <= tuning.max_height_m:
            found = fit_ground(points[:n], height, tuning)
            if found[0]:
                return found
    return False, 0.0, 0.0, 0.0, 0.0


def find_ground(
    marks: NDArray[np.uint16],
    info: CameraInfo,
    R_level_optical: Rotation,
    ke: float,
    seed_height_m: float,
    params: Params,
    settings: NDArray[Any],
    points: NDArray[Any],
) -> Ground:
    """Returns the ground of one frame, or NO_GROUND.

    Args:
        marks: (H, W) uint16 of `classify`.
        info: description of the camera.
        R_level_optical: (3, 3) rotation.
        ke: noise coefficient, 1/m.
        seed_height_m: height of the last frame's ground, which gets more weight; nan: none.
        params: parameters.
        settings: (1,) of `ground_settings`.
        points: (ground_max_samples,) POINT out, for `with_ranges`."""
    k, p = info.intrinsics, params
    across, down = p.ground_column_step, p.ground_row_step
    # The samples must cover the whole image: points below the ground can be anywhere in it.
    step = max(1, math.ceil(math.sqrt((k.width // across + 1) * (k.height // down + 1) / len(points))))
    seen, height, slope_x, slope_y, share = search_ground(
        marks,
        np.ascontiguousarray(R_level_optical),
        np.array([k.fx, k.fy, k.cx, k.cy]),
        ke,
        seed_height_m,
        settings,
        GroundSamples(across * step, down * step, np.zeros(height_bins(p), np.int32), points),
    )
    if not seen:
        return NO_GROUND
    noise_per_m = p.ground_sigmas * ke * height
    return Ground(
        seen=True,
        height_m=height,
        slope_x=slope_x,
        slope_y=slope_y,
        share=share,
        blind_beyond_m=p.min_obstacle_height_m / noise_per_m,
        tolerance_m=p.ground_tolerance_m,
        noise_per_m=noise_per_m,
    )
