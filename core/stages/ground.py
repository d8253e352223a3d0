"""The horizontal surface under the camera, found once per frame before any density is counted.

Flat ground fills about as many pixels per kernel width at any range while the obstacle threshold falls with range, so
left in it becomes an obstacle far away. Here: votes of pixel pairs without a steep surface for a height, a check that little
lies below, a bounded plane fit. Where none is found none is assumed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, kernel, record
from ..params import Params
from ..types import FAR_MM, CameraInfo, Ground

NO_GROUND = Ground(seen=False)
_STEPS_FROM_M = 0.12
"""Steps of height are counted from here, whatever the least height considered is: it does not shift them."""
_FAR = np.uint16(FAR_MM)
_CLIMB_MOST = 2.0 / 3.0
"""Of the camera's height: a pair of pixels reaches no farther up. A few centimetres above the ground the least climb of a
pair would reach over the horizon, and no pair of the ground would vote."""
GROUND_SETTINGS = record(
    ("pair_rows_min", np.float64),
    ("pair_rows_max", np.float64),
    ("tolerance_m", np.float64),
    ("cap_m", np.float64),
    ("min_height_m", np.float64),
    ("max_height_m", np.float64),
    ("height_step", np.float64),
    ("pair_climb", np.float64),
    ("pair_climb_min_m", np.float64),
    ("pair_climb_max_m", np.float64),
    ("pair_flat", np.float64),
    ("pair_sigmas", np.float64),
    ("pair_flat_cap", np.float64),
    ("pair_level", np.float64),
    ("seed_weight", np.float64),
    ("min_samples", np.float64),
    ("min_share", np.float64),
    ("sigmas", np.float64),
    ("fit_sigmas", np.float64),
    ("fit_min_px", np.float64),
    ("fit_floor_m", np.float64),
    ("max_slope", np.float64),
    ("slope_prior", np.float64),
    ("below_m", np.float64),
    ("below_full_m", np.float64),
    ("max_below_share", np.float64),
    ("recede_share", np.float64),
    ("recede_noise", np.float64),
    ("seed_steps", np.int64),
    ("tries", np.int64),
    ("fit_rounds", np.int64),
)
"""pair_rows_min and pair_rows_max: rows between the pixels of a pair; cap_m: most that the tolerance is, tolerance_m: at most
that. All others are the parameters of these names with `ground_` before them."""
_named_parameters = attrgetter(*(f"ground_{name}" for name in (GROUND_SETTINGS.names or ())[4:]))

POINT = record(
    ("x", np.float32),
    ("y", np.float32),
    ("z", np.float32),
    ("per_height", np.float32),
    ("level", np.float32),
    ("tangent_step", np.float32),
    ("inverse_step", np.float32),
)
"""A sampled pixel: its place in level_cam, m; 1/sigma_h per metre of height; 1 where it voted, else 0; by how much its z/x and
its 1/x exceed those of the pixel it is paired with, 0 where there is none."""


def ground_settings(rows: int, p: Params) -> NDArray[Any]:
    """(1,) GROUND_SETTINGS for pictures of so many rows."""
    cap = p.ground_tolerance_cap * p.min_obstacle_height_m
    derived = p.ground_pair_min_px, rows // p.ground_pair_parts, min(p.ground_tolerance_m, cap), cap
    out = np.zeros(1, GROUND_SETTINGS)
    out[0] = (*derived, *_named_parameters(p))
    return out


def height_bins(p: Params) -> int:
    """How many steps of height are counted: a few beyond the greatest height considered."""
    return 4 + math.ceil(math.log(max(p.ground_max_height_m / p.ground_min_height_m, 1.0)) / p.ground_height_step)


@inner
def step_of(height_m, bin_step):
    """The step of height that holds a height > 0, over log height; below 0 under _STEPS_FROM_M."""
    return int(math.floor(math.log(height_m / _STEPS_FROM_M) / bin_step))


@inner
def vote(marks, R, k, ke, column_step, row_step, tuning, votes, points):
    """Votes for the height of horizontal surfaces; returns (points written, pixels sampled).

    marks: (H, W) uint16 of `classify`. R: (3, 3) R_level_optical. k: (4,) fx, fy, cx, cy. tuning: a record of GROUND_SETTINGS. votes: (bins,)
    int32 over log height. points: (N,) POINT out.

    A pair of pixels in one source column votes when what lies between them climbs
    little of what a wall would show over the same rows."""
    rows, cols = marks.shape
    least, bin_step = tuning.min_height_m, tuning.height_step
    bins, lowest = len(votes), step_of(least, bin_step)
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
            if n < points.shape[0]:
                point = points[n]
                point.x, point.y, point.z = x, (R[1, 0] * xu + R[1, 1] * yv + R[1, 2]) / d, z
                point.per_height = d / ke
                point.level, point.tangent_step, point.inverse_step = 0.0, 0.0, 0.0
                n += 1
            if z < least or x <= 0.0:
                continue
            # what a wall would climb over the rows that are looked at
            climb_min = min(tuning.pair_climb_min_m, _CLIMB_MOST * z)
            climb = min(max(tuning.pair_climb * z, climb_min), tuning.pair_climb_max_m)
            v2 = v - int(max(tuning.pair_rows_min, min(tuning.pair_rows_max, climb * k[1] * d)))
            if v2 < 0:
                continue
            mark = marks[v2, u]
            if mark == 0 or mark == _FAR:
                continue
            d2 = np.float32(1000.0) / np.float32(mark)
            yv2 = (v2 - k[3]) / k[1]
            z2 = (R[2, 0] * xu + R[2, 1] * yv2 + R[2, 2]) / d2
            x2 = (R[0, 0] * xu + R[0, 1] * yv2 + R[0, 2]) / d2
            if x2 > 0.0:
                points[n - 1].tangent_step, points[n - 1].inverse_step = z / x - z2 / x2, 1.0 / x - 1.0 / x2
            noise = tuning.pair_sigmas * ke * (z / d + abs(z2) / d2) * 0.5
            allowed = min(tuning.pair_flat * climb + noise, tuning.pair_flat_cap * climb)
            if abs(z2 - z) < allowed and z2 > tuning.pair_level * z:
                points[n - 1].level = 1.0
                bin_ = step_of(0.5 * (z + z2), bin_step) - lowest
                if 0 <= bin_ < bins:
                    votes[bin_] += 1
    return n, sampled


@inner
def bounded_slope(sums, height_off, slope_x, slope_y, prior, limit):
    """(slope_x, slope_y): weighted least squares of z over (x, y) with an intercept, shrunk to 0 where the data do not
    carry them, no steeper than limit.

    sums: w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr over the pixels, r their height off a plane of slopes slope_x, slope_y
    that lies height_off too low."""
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
    """Most that a point of the ground lies off it: what cuts deeper into its noise holds a fit where it began."""
    return max(tuning.cap_m, tuning.fit_sigmas * sigma)


@inner
def fit_ground(points, height, tuning):
    """(seen, height, slope_x, slope_y, share): z = h + sx x + sy y through the points near a height, slopes bounded.

    points: (N,) POINT of `vote`. Not seen: too few lie on it, or too much below it, or those on it do not recede from row to
    row as it would. share: of the points that lie on it."""
    n = len(points)
    slope_x, slope_y, tolerance_at = 0.0, 0.0, height
    for _ in range(tuning.fit_rounds):
        on = 0
        w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        tolerance_at = height
        for i in range(n):
            if points[i].level == 0.0:  # the foot of a wall is near the ground and not level
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
        if on < max(tuning.fit_min_px, tuning.min_share * n):
            return False, height, slope_x, slope_y, 0.0
        height += wr / w
        if tuning.max_slope > 0.0:
            sums = (w, wx, wy, wr, wxx, wxy, wyy, wxr, wyr)
            slope_x, slope_y = bounded_slope(sums, wr / w, slope_x, slope_y, tuning.slope_prior, tuning.max_slope)
    slack = tuning.below_m * height / (height + tuning.below_full_m)
    on, below, recedes, recede = 0, 0, 0.0, 0.0
    for i in range(n):
        sigma = tolerance_at / points[i].per_height
        tolerance = min(max(tuning.sigmas * sigma, tuning.tolerance_m), fit_cap(sigma, tuning))
        r = points[i].z - (height + slope_x * points[i].x + slope_y * points[i].y)
        below += r > tolerance + slack
        if abs(r) < tolerance:
            on += 1
            # 1/x = (z/x - slopes) / height on the ground, the same in all rows of a wall
            rows, rise = np.float64(points[i].tangent_step), np.float64(points[i].inverse_step)
            if sigma < tuning.recede_noise * abs(rows) * points[i].x:  # the vote of such a pair is sure
                rows *= points[i].level
                rise = rows / height
            recedes, recede = recedes + rows * rise, recede + rows * rows
    seen = below <= tuning.max_below_share * n and height >= tuning.min_height_m
    seen = seen and recedes * height >= tuning.recede_share * recede
    return seen, height, slope_x, slope_y, on / n


@kernel
def search_ground(marks, R, k, ke, seed_height, column_step, row_step, settings, votes, points):
    """`fit_ground` at the first height that holds, from the most voted on; arguments as for `vote`."""
    tuning = settings[0]
    n, sampled = vote(marks, R, k, ke, column_step, row_step, tuning, votes, points)
    for i in range(n, len(points)):  # rows of an earlier frame
        points[i].level = 0.0
    bins = len(votes)
    score = np.zeros(bins, np.float64)
    for b in range(bins):
        score[b] = votes[max(b - 1, 0) : b + 2].sum()
    lowest = step_of(tuning.min_height_m, tuning.height_step)
    if seed_height > tuning.min_height_m:
        at, reach = step_of(seed_height, tuning.height_step) - lowest, tuning.seed_steps
        score[max(0, at - reach) : at + reach + 1] *= tuning.seed_weight
    tries = tuning.tries if sampled >= tuning.min_samples else 0
    for _ in range(tries):
        best = np.argmax(score)
        if score[best] < tuning.min_share * sampled:
            break
        height = _STEPS_FROM_M * math.exp((best + lowest + 0.5) * tuning.height_step)
        score[max(0, best - 2) : best + 3] = 0.0  # all sums of three that share a bin with this one
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
    points: NDArray[Any],
) -> Ground:
    """The ground of one frame, or NO_GROUND.

    seed_height_m: height of the last frame's ground (nan: none): its bin and neighbours count more.
    points: (ground_max_samples,) POINT scratch, left for `with_ranges`. The heights are tried from the most voted on; one is taken when
    enough pixels lie on it and few below."""
    k, p = info.intrinsics, params
    across, down = p.ground_column_step, p.ground_row_step
    # as coarse as it takes for the whole picture to find room: a part of it would say nothing of what lies below
    step = max(1, math.ceil(math.sqrt((k.width // across + 1) * (k.height // down + 1) / len(points))))
    seen, height, slope_x, slope_y, share = search_ground(
        marks,
        np.ascontiguousarray(R_level_optical),
        np.array([k.fx, k.fy, k.cx, k.cy]),
        ke,
        seed_height_m,
        across * step,
        down * step,
        ground_settings(k.height, p),
        np.zeros(height_bins(p), np.int32),
        points,
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


@kernel
def ground_ranges(points, height, slope_x, slope_y, tolerance, noise, blind, edges_t, seen_from, seen_to):
    """Nearest and farthest horizontal range at which the ground was measured, for each direction.

    points: (N,) POINT of `vote`: the level ones that lie within tolerance + noise x of the plane, no farther than blind.
    edges_t: (D + 1,) float64 tangents of the directions' edges. seen_from, seen_to: (D,) float32 out, 0: none. A
    direction without a sample between two that have some gets what both have."""
    directions = len(edges_t) - 1
    seen_from[:] = 0.0
    seen_to[:] = 0.0
    for i in range(len(points)):
        x, y, z = np.float64(points[i].x), np.float64(points[i].y), np.float64(points[i].z)
        if (
            points[i].level == 0.0
            or x > blind
            or abs(z - height - slope_x * x - slope_y * y) > max(tolerance, noise * x)
        ):
            continue
        d = int(np.searchsorted(edges_t, y / x, side="right")) - 1
        if d < 0 or d >= directions:
            continue
        r = np.float32(math.hypot(x, y))
        seen_from[d] = r if seen_to[d] == 0.0 else min(seen_from[d], r)
        seen_to[d] = max(seen_to[d], r)
    for d in range(1, directions - 1):
        if seen_to[d] == 0.0 and seen_to[d - 1] > 0.0 and seen_to[d + 1] > 0.0:
            near, far = max(seen_from[d - 1], seen_from[d + 1]), min(seen_to[d - 1], seen_to[d + 1])
            if far > near:
                seen_from[d], seen_to[d] = near, far


def with_ranges(ground: Ground, points: NDArray[Any], edges_t: NDArray[np.float64]) -> Ground:
    """The ground with the ranges at which it was measured. points: as `find_ground` left them; edges_t: (D + 1,) tangents
    of the directions of the frame's free-range profile."""
    if not ground.seen:
        return ground
    seen_from, seen_to = np.empty((2, len(edges_t) - 1), np.float32)
    ground_ranges(
        points,
        ground.height_m,
        ground.slope_x,
        ground.slope_y,
        float(ground.tolerance_m),
        ground.noise_per_m,
        ground.blind_beyond_m,
        edges_t,
        seen_from,
        seen_to,
    )
    return replace(ground, seen_from_m=tuple(seen_from.tolist()), seen_to_m=tuple(seen_to.tolist()))
