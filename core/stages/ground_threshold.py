"""Which cells of the levelled view, and which strips, are ground or its noise: the threshold that follows from `find_ground`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_ieee, record
from ..params import Params
from ..types import Ground
from .strips import MERGED
from .support import compact
from .view_geometry import Q_FAR, Q_UNKNOWN, ViewGeometry


class GroundThreshold(NamedTuple):
    """Which cells of the levelled view are ground or below it: a cell of quantised disparity q at row tangent m in column u
    is, when m - shift[u] > limit[q].

    limit: (65536,) float32, infinite where no ground was found; shift: (cols,) float32."""

    limit: NDArray[np.float32]
    shift: NDArray[np.float32]


@inner_ieee
def fill_threshold(view, height, slope_x, slope_y, tolerance, limit, shift):
    """Fills GroundThreshold from z = X m against h + sx X + sy y - tolerance(X), over X = f lsb_per_px / q.

    tolerance: (spread, least, cap): spread X between least and cap, m."""
    spread, least, cap = tolerance
    gain, cu, lateral, f_px = view.f_px * view.lsb_per_px, view.cu, np.float64(view.lateral[0]), view.f_px
    for q in range(len(limit)):
        s = np.int32(q) / gain
        limit[q] = height * s - min(max(spread, least * s), cap * s) + slope_x
    for u in range(len(shift)):
        shift[u] = slope_y * ((np.int32(u) - cu) * lateral / f_px)


def ground_threshold(
    ground: Ground, view: ViewGeometry, ke_per_m: float, params: Params, limit: NDArray[np.float32]
) -> GroundThreshold:
    """The threshold that separates obstacles from the ground of a frame. limit: (65536,) float32 out."""
    if not ground.seen:
        limit[:] = np.inf
        return GroundThreshold(limit, np.zeros(view.cols, np.float32))
    cap, shift = params.ground_tolerance_cap * params.min_obstacle_height_m, np.empty(view.cols, np.float32)
    tolerance = (
        params.ground_sigmas * ke_per_m * ground.height_m,
        float(min(params.ground_tolerance_m, cap)),
        float(cap),
    )
    fill_threshold(view, float(ground.height_m), float(ground.slope_x), float(ground.slope_y), tolerance, limit, shift)
    return GroundThreshold(limit, shift)


GROUND_NOISE_TEST = record(
    ("applies", np.int64),
    ("f_px", np.float64),
    ("lsb_per_px", np.float64),
    ("sigma_px", np.float64),
    ("height_m", np.float64),
    ("slope_x", np.float64),
    ("near_px", np.float64),
    ("slack", np.float64),
    ("need_px", np.float64),
    ("tail_px", np.float64),
)
"""Settings of `drop_ground_noise`. applies: 0 where no ground was found. sigma_px: noise of disparity. near_px: strips of at
least this disparity are not tested. slack: error of the height as a share of it. need_px: least excess of one row over
the ground. tail_px: what is nearer than the strip by more does not count."""


def ground_noise_test(ground: Ground, view: ViewGeometry, ke_per_m: float, p: Params) -> NDArray[Any]:
    """(1,) GROUND_NOISE_TEST of a frame."""
    out = np.zeros(1, GROUND_NOISE_TEST)
    if not ground.seen:
        return out
    spread = p.ground_sigmas * ke_per_m * ground.height_m
    sigma = max(ke_per_m * view.f_px, p.min_sigma_px)
    near_px = view.f_px * spread / (p.ground_tolerance_cap * p.min_obstacle_height_m)
    out[0] = (
        1,
        view.f_px,
        view.lsb_per_px,
        sigma,
        ground.height_m,
        ground.slope_x,
        near_px,
        p.ground_stand_m / ground.height_m,
        p.ground_stand_sigmas * sigma,
        p.ground_sigmas * sigma,
    )
    return out


@inner
def drop_ground_noise(strips, n, codes, tan_mid, shift, test, keep):
    """Removes strips that are no more than the noise of the ground: unknown, neither obstacle nor free; returns how many stay.

    Beyond the range where the noise of height exceeds the cap on the ground's half-thickness, the ground's own pixels stick
    out above it. What stands there shows in the rows of a strip by the sum of all of them: flat ground, whose noisy half is
    in the strip, has the other half in the same rows. So the mean disparity of the rows, over what the ground would have
    there, must be need_px / sqrt(rows) after ground_stand_m, an error of the fit, is taken off. What is nearer than the
    strip by its noise does not count; a cell beyond the range clip counts as one sigma behind the ground.
    strips: (N,) STRIP. codes: (cols, rows) uint16; tan_mid: (rows,) float32; shift: of GroundThreshold; test: a record of
    GROUND_NOISE_TEST; keep: (N,) uint8 scratch."""
    f, quantum, sigma, height = test.f_px, test.lsb_per_px, test.sigma_px, test.height_m
    dropped = 0
    for i in range(n):
        s = strips[i]
        d = np.float64(s.disparity_px)
        keep[i] = 1
        if d >= test.near_px or s.kind == MERGED:
            continue
        u = s.column
        offset, most = test.slope_x + shift[u], d + test.tail_px
        total, count = 0.0, 0
        for v in range(s.top_row, s.bottom_row + 1):
            code = codes[u, v]
            seen = code / quantum
            if code == Q_UNKNOWN or seen > most:
                continue
            ground = max(0.0, f * (tan_mid[v] - offset) / height)
            total += -sigma if code == Q_FAR else seen - ground * (1.0 + test.slack)
            count += 1
        if total < test.need_px * math.sqrt(count):
            keep[i] = 0
            dropped += 1
    return compact(strips, n, keep) if dropped > 0 else n
