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
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, kernel, parameter_record, record, record_of
from ..params import Params
from ..types import FAR_MM, CameraInfo, Ground
from .ground_fit import MIN_SHARE, GroundPlane, fit_ground

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
_PAIR_MIN_PX = 4.0
"""Least distance of the rows of a pair."""
_PAIR_FLAT, _PAIR_SIGMAS, _PAIR_FLAT_CAP = 0.25, 2.0, 0.5
"""A pair votes when it rises by less than the first share of the rise of a wall and so many sigma of the noise, together at
most the second share."""
_SEED_WEIGHT, _SEED_STEPS = 1.5, 2
"""Weight of votes up to this many steps of height from the ground of the last frame."""
_TRIES = 6
"""Number of heights that are tried, beginning with the one of most votes."""
GROUND_SETTINGS = parameter_record(Params, ("tolerance_m", np.float64), ("cap_m", np.float64))
"""All parameters, the greatest tolerance `cap_m`, and `ground_tolerance_m` limited to it."""

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


class GroundCamera(NamedTuple):
    """The camera of a frame."""

    R: NDArray[np.float64]  # (3, 3), R_level_optical
    k: NDArray[np.float64]  # (4,), fx, fy, cx, cy
    ke: float  # noise coefficient, 1/m


class GroundSamples(NamedTuple):
    """Which pixels are sampled, and what is known of them."""

    column_step: int  # every column_step-th column is sampled
    row_step: int  # every row_step-th row is sampled
    votes: NDArray[np.int32]  # (bins,), votes per step of height
    points: NDArray[Any]  # (N,) POINT. Further samples vote but are not written


@lru_cache(maxsize=4)
def ground_settings(p: Params) -> NDArray[Any]:
    """Returns (1,) GROUND_SETTINGS."""
    cap = p.ground_tolerance_cap * p.min_obstacle_height_m
    return record_of(GROUND_SETTINGS, p, tolerance_m=min(p.ground_tolerance_m, cap), cap_m=cap)


def height_bins(p: Params) -> int:
    """Returns the number of steps of height, a few more than the greatest height considered needs."""
    return 4 + math.ceil(math.log(max(p.ground_max_height_m / p.ground_min_height_m, 1.0)) / p.ground_height_step)


@inner
def step_of(height_m, bin_step):
    """Returns the index of the step that holds a height > 0. Steps are uniform in log(height), negative below
    _STEPS_FROM_M."""
    return int(math.floor(math.log(height_m / _STEPS_FROM_M) / bin_step))


@inner
def is_measured(mark):
    """True if the pixel with this mark of `classify` is measured."""
    return mark != 0 and mark != _FAR


@inner
def position(marks, v, u, camera):
    """Returns the place of a measured pixel in level_cam, and its 1/Z in 1/m: (x, y, z, 1/Z)."""
    R, k = camera.R, camera.k
    d = np.float32(1000.0) / np.float32(marks[v, u])
    xu, yv = (u - k[2]) / k[0], (v - k[3]) / k[1]
    x = (R[0, 0] * xu + R[0, 1] * yv + R[0, 2]) / d
    y = (R[1, 0] * xu + R[1, 1] * yv + R[1, 2]) / d
    z = (R[2, 0] * xu + R[2, 1] * yv + R[2, 2]) / d
    return x, y, z, d


@inner
def judge_pair(marks, v, u, place, camera, tuning):
    """Pairs a measured pixel with one above it, and judges if both lie on a horizontal surface.

    The other pixel is so many rows above that a wall would rise by a part of the camera's height. On a horizontal
    surface the height changes by only a small part of that: by less than half of z, so that both pixels of a level pair
    lie below the camera.

    Args:
        marks, camera, tuning: see `vote`.
        v, u: the pixel.
        place: `position` of it.

    Returns:
        (level, tangent step, inverse step, mean height). level, tangent step and inverse step: see POINT, 0 if there is
            no pair. Mean height: m below the camera, 0 if level is 0."""
    x, _, z, d = place
    if z < tuning.ground_min_height_m or x <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    # the height that a wall covers over the rows of the pair
    climb_min = min(tuning.ground_pair_climb_min_m, _CLIMB_MOST * z)
    climb = min(max(tuning.ground_pair_climb * z, climb_min), tuning.ground_pair_climb_max_m)
    most_rows = np.float64(marks.shape[0] // tuning.ground_pair_parts)
    v2 = v - int(max(_PAIR_MIN_PX, min(most_rows, climb * camera.k[1] * d)))
    if v2 < 0 or not is_measured(marks[v2, u]):
        return 0.0, 0.0, 0.0, 0.0
    x2, _, z2, d2 = position(marks, v2, u, camera)
    tangent_step, inverse_step = 0.0, 0.0
    if x2 > 0.0:
        tangent_step, inverse_step = z / x - z2 / x2, 1.0 / x - 1.0 / x2
    noise = _PAIR_SIGMAS * camera.ke * (z / d + abs(z2) / d2) * 0.5
    if abs(z2 - z) < min(_PAIR_FLAT * climb + noise, _PAIR_FLAT_CAP * climb):
        return 1.0, tangent_step, inverse_step, 0.5 * (z + z2)
    return 0.0, tangent_step, inverse_step, 0.0


@inner
def vote(marks, camera, tuning, samples):
    """Votes for the heights of horizontal surfaces; returns (points written, pixels sampled).

    Two pixels of one source column form a pair. It votes for its mean height if it is level, see `judge_pair`.
    samples: GroundSamples; votes and points are outputs."""
    rows, cols = marks.shape
    votes, points = samples.votes, samples.points
    lowest = step_of(tuning.ground_min_height_m, tuning.ground_height_step)
    votes[:] = 0
    n, sampled = 0, 0
    for u in range(samples.column_step // 2, cols, samples.column_step):
        for v in range(samples.row_step // 2, rows, samples.row_step):
            if not is_measured(marks[v, u]):
                continue
            sampled += 1
            place = position(marks, v, u, camera)
            level, tangent_step, inverse_step, height = judge_pair(marks, v, u, place, camera, tuning)
            if n < len(points):
                point = points[n]
                point.x, point.y, point.z, point.per_height = place[0], place[1], place[2], place[3] / camera.ke
                point.level, point.tangent_step, point.inverse_step = level, tangent_step, inverse_step
                n += 1
            if level > 0.0:
                at = step_of(height, tuning.ground_height_step) - lowest
                if 0 <= at < len(votes):
                    votes[at] += 1
    return n, sampled


@kernel
def search_ground(marks, camera, last_height, settings, samples):
    """Returns the first accepted result of `fit_ground`, trying heights in the order of their votes.

    marks, camera, samples: see `vote`; last_height: height of the last ground, m; it and its neighbours get more
    weight. nan: none."""
    tuning, votes, points = settings[0], samples.votes, samples.points
    n, sampled = vote(marks, camera, tuning, samples)
    for i in range(n, len(points)):  # points of an earlier frame
        points[i].level = 0.0
    bins = len(votes)
    score = np.zeros(bins, np.float64)
    for b in range(bins):
        score[b] = votes[max(b - 1, 0) : b + 2].sum()
    lowest = step_of(tuning.ground_min_height_m, tuning.ground_height_step)
    if last_height > tuning.ground_min_height_m:
        at, reach = step_of(last_height, tuning.ground_height_step) - lowest, _SEED_STEPS
        score[max(0, at - reach) : at + reach + 1] *= _SEED_WEIGHT
    tries = _TRIES if sampled >= _MIN_SAMPLES else 0
    for _ in range(tries):
        best = np.argmax(score)
        if score[best] < MIN_SHARE * sampled:
            break
        height = _STEPS_FROM_M * math.exp((best + lowest + 0.5) * tuning.ground_height_step)
        score[max(0, best - 2) : best + 3] = 0.0  # all scores that contain votes for this step
        if height <= tuning.ground_max_height_m:
            found = fit_ground(points[:n], height, tuning)
            if found[0]:
                return found
    return False, GroundPlane(0.0, 0.0, 0.0), 0.0


def find_ground(
    marks: NDArray[np.uint16],
    info: CameraInfo,
    R_level_optical: Rotation,
    ke_per_m: float,
    last_height_m: float,
    p: Params,
    points: NDArray[Any],
) -> Ground:
    """Returns the ground of one frame, or NO_GROUND.

    last_height_m: height of the last frame's ground, which gets more weight; nan: none. points: (ground_max_samples,)
    POINT out, for `with_ranges`."""
    k, across, down = info.intrinsics, p.ground_column_step, p.ground_row_step
    # The samples must cover the whole image: points below the ground can be anywhere in it.
    step = max(1, math.ceil(math.sqrt((k.width // across + 1) * (k.height // down + 1) / len(points))))
    camera = GroundCamera(np.ascontiguousarray(R_level_optical), np.array([k.fx, k.fy, k.cx, k.cy]), ke_per_m)
    samples = GroundSamples(across * step, down * step, np.empty(height_bins(p), np.int32), points)
    seen, plane, share = search_ground(marks, camera, last_height_m, ground_settings(p), samples)
    if not seen:
        return NO_GROUND
    noise_per_m = p.ground_sigmas * ke_per_m * plane.height_m
    return Ground(
        seen=True,
        height_m=plane.height_m,
        slope_x=plane.slope_x,
        slope_y=plane.slope_y,
        share=share,
        blind_beyond_m=p.min_obstacle_height_m / noise_per_m,
        tolerance_m=p.ground_tolerance_m,
        noise_per_m=noise_per_m,
    )
