"""Motion of a vehicle without a position, from the tracks themselves: the shift that brings most detections onto them."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel
from .association import CONTINUES
from .line import offset
from .tables import CUT_BOTTOM, CUT_TOP

_ROUNDS, _LEAST_HEIGHTS = 4, 6
_SCALE_M = 0.1
"""Distances above this count less, so that moving obstacles do not decide."""
SPEED_SIGMA_M_S = 1.2
"""Standard deviation of the predicted velocity. The shift that it allows within a frame keeps the tracks in place
along surfaces that are all parallel, or that few planes show: there the noise of the planes would move them."""
_LEAST_PRIOR_M = 1e-3


@kernel
def common_shift(detections, tracks, pairs, scores, dt_s):
    """The shift (x, y, z, m) to add to the tracks. Weighted least squares of the distances of detections from the lines of
    the tracks that they continue best, with weights reduced for large distances; z is the median difference of tops and
    bottoms. Zeros where nothing is paired. pairs (P, 3) int32, scores (P,) float64: of `find_pairs`; dt_s: since the
    frame before."""
    chosen = np.full(detections.shape[0], -1, np.int32)
    for n in range(pairs.shape[0]):
        i = pairs[n, 0]
        if pairs[n, 2] == CONTINUES and (chosen[i] < 0 or scores[n] > scores[chosen[i]]):
            chosen[i] = n
    x, y, prior_m = 0.0, 0.0, max(_LEAST_PRIOR_M, SPEED_SIGMA_M_S * dt_s)
    for k in range(_ROUNDS):
        x, y = shift_once(detections, tracks, pairs, chosen, x, y, _SCALE_M if k > 0 else math.inf, prior_m)
    heights, count = np.empty(2 * detections.shape[0]), 0
    for n in chosen:
        if n < 0:
            continue
        d, t = detections[pairs[n, 0]], tracks[pairs[n, 1]]
        cut = d.plane_flags | t.plane_flags
        if cut & CUT_TOP == 0:
            heights[count] = d.top_m - t.top_m
            count += 1
        if cut & CUT_BOTTOM == 0:
            heights[count] = d.bottom_m - t.bottom_m
            count += 1
    z = np.median(heights[:count]) if count >= _LEAST_HEIGHTS else 0.0
    if not (math.isfinite(x) and math.isfinite(y)):
        return 0.0, 0.0, 0.0
    return x, y, z


@inner
def shift_once(detections, tracks, pairs, chosen, x_m, y_m, scale_m, prior_m):
    """One round of the least squares: the shift (x, y) with the weights of an earlier one; scale_m: distance at which
    the weight is half; prior_m: standard deviation of the shift beyond the prediction."""
    a, b, c = 1.0 / prior_m**2, 0.0, 1.0 / prior_m**2
    u, v = 0.0, 0.0
    for n in chosen:
        if n < 0:
            continue
        d, t = detections[pairs[n, 0]], tracks[pairs[n, 1]]
        miss = offset(t, 0.5 * (d.ax_m + d.bx_m), 0.5 * (d.ay_m + d.by_m))
        nx, ny = -t.ty, t.tx
        far = (miss - nx * x_m - ny * y_m) / scale_m
        weight = min(d.length_m, 2.0) / (d.sigma_m**2 * (1.0 + far * far))
        a += weight * nx * nx
        b += weight * nx * ny
        c += weight * ny * ny
        u += weight * nx * miss
        v += weight * ny * miss
    det = a * c - b * b
    return (c * u - b * v) / det, (a * v - b * u) / det
