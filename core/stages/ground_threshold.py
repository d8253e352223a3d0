"""Classifies cells and strips as ground: the threshold that follows from the ground plane of the frame.

Input: `Ground` and the levelled view. Output: `GroundThreshold`, by which cells are removed before the density is
computed, and `drop_ground_noise`, which removes strips that are noise of the ground. Not in the paper; see ground.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner
from ..params import Params
from ..types import Ground
from .ground_fit import GroundPlane
from .strips import MERGED
from .support import compact
from .view_geometry import Q_FAR, Q_UNKNOWN, ViewGeometry

STAND_SIGMAS = 6.0
"""Where the noise of the height exceeds the greatest tolerance, a strip must rise out of the noise of the ground by this
much over all its rows."""
STAND_M = 0.1
"""Error of the ground's height that is subtracted before that test."""


class GroundThreshold(NamedTuple):
    """Decides which cells of the levelled view are ground or below it, see `ground_limit`.

    A cell z = X m is ground if it is lower than h + slope_x X + slope_y y - tolerance(X), with X = f lsb_per_px / q. The
    tolerance is `spread` X, limited to two constants."""

    height: np.float32  # height h of the ground over f lsb_per_px
    least: np.float32  # least, cap: limits of the tolerance over f lsb_per_px
    cap: np.float32
    spread: np.float32  # tolerance per metre of X
    slope_x: np.float32  # slope of the ground ahead; infinite if no ground was found
    shift: NDArray[np.float32]  # (cols,), slope_y times the tangent of azimuth of each column
    plane: GroundPlane  # the ground, at an infinite height if none was found


@inner
def ground_limit(code, ground):
    """Returns the limit of m - shift[u] above which a cell with this quantised disparity, at the row tangent m of column u, is
    ground. ground: GroundThreshold."""
    q = np.float32(code)
    return ground.height * q - min(max(ground.spread, ground.least * q), ground.cap * q) + ground.slope_x


def ground_threshold(ground: Ground, view: ViewGeometry, params: Params) -> GroundThreshold:
    """Returns the threshold that separates obstacles from the ground of a frame."""
    f, zero = np.float32, np.float32(0.0)
    if not ground.seen:
        nowhere = GroundPlane(math.inf, 0.0, 0.0)
        return GroundThreshold(zero, zero, zero, zero, f(np.inf), np.zeros(view.cols, np.float32), nowhere)
    gain, cap = view.f_px * view.lsb_per_px, params.ground_tolerance_cap * params.min_obstacle_height_m
    azimuth_t = (np.arange(view.cols) - view.cu) * view.lateral[0] / view.f_px
    return GroundThreshold(
        height=f(ground.height_m / gain),
        least=f(min(params.ground_tolerance_m, cap) / gain),
        cap=f(cap / gain),
        spread=f(ground.noise_per_m),
        slope_x=f(ground.slope_x),
        shift=(ground.slope_y * azimuth_t).astype(np.float32),
        plane=GroundPlane(float(ground.height_m), float(ground.slope_x), float(ground.slope_y)),
    )


@inner
def drop_ground_noise(strips, n, codes, view, ground, settings, keep):
    """Removes strips that may be noise of the ground; returns the number of the others. Removed strips are unknown
    space.

    Where the noise of height exceeds the greatest tolerance of the ground, pixels of the ground itself lie above it
    and form strips. The sum over all rows of a strip distinguishes them from obstacles: on flat ground the pixels
    above and below the plane lie in the same rows and cancel. The mean disparity of all cells of these rows must
    exceed that of the ground by STAND_SIGMAS / sqrt(number of cells) of noise, after subtracting the error of the fit. Cells beyond
    the range count as one sigma behind the ground."""
    f, sigma, height = view.f_px, settings.sigma_d_px, ground.plane.height_m
    if height == math.inf:
        return n
    spread = settings.ground_sigmas * settings.ke_per_m * height
    near_px = f * spread / (settings.ground_tolerance_cap * settings.min_obstacle_height_m)
    slack, need_px, dropped = STAND_M / height, STAND_SIGMAS * sigma, 0
    for i in range(n):
        s = strips[i]
        d = np.float64(s.disparity_px)
        keep[i] = 1
        if d >= near_px or s.kind == MERGED:
            continue
        u = s.column
        offset = ground.plane.slope_x + ground.shift[u]
        total, count = 0.0, 0
        for v in range(s.top_row, s.bottom_row + 1):
            code = codes[u, v]
            if code == Q_UNKNOWN:
                continue
            expected = max(0.0, f * (view.tan_mid[v] - offset) / height)
            total += -sigma if code == Q_FAR else code / view.lsb_per_px - expected * (1.0 + slack)
            count += 1
        if total < need_px * math.sqrt(count):
            keep[i] = 0
            dropped += 1
    return compact(strips, n, keep) if dropped > 0 else n
