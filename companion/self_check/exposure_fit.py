"""Estimates the lag between two series of rotations: those measured in images and those of the attitude at shifted
times.

Each pair of images gives one rotation vector; for each lag of a grid the attitude gives the expected rotation. The
estimate is the lag with the least weighted sum of squares, refined by a parabola. A constant small rotation between
camera and vehicle (an error of the mount angles) is estimated together with it: it would otherwise couple the axes,
which appears as a lag where two axes swing out of phase."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LAGS_S: Floats = np.arange(-10.0, 16.0) * 0.01
"""Grid of lags, s; positive: the stamp is later than the exposure."""
MOUNT_PRIOR_RAD = math.radians(3.0)
"""Prior standard deviation of the mount error."""
MIN_NOISE_RAD = 2e-4
"""Least standard deviation per axis, a twentieth of a pixel: covers errors that the model does not contain."""
OUTLIER = 3.0
"""Residuals beyond this many standard deviations are downweighted."""
ROUNDS = 4
"""Iterations of the weights, which depend on the residuals."""
BLOCK = 8
"""Number of successive pairs with correlated errors; the uncertainty is estimated from the scatter between such blocks.
"""


@dataclass(frozen=True, slots=True)
class LagFit:
    """The estimate of a time offset."""

    lag_s: float  # the estimate
    sigma_s: float  # its standard deviation
    explained: float  # share (0..1) of the measured rotation that the attitude explains at this lag
    inside: bool  # whether the minimum is inside the grid


def fit_lag(measured: Floats, sigma: Floats, predicted: Floats) -> LagFit:
    """measured: (N, 3) rotation vectors, rad; sigma: (N, 3) their standard deviations; predicted: (N, L, 3) at each of
    LAGS_S."""
    floor = np.full(3, 1e-3)
    trust = np.ones_like(measured)
    for _ in range(ROUNDS):
        weights = trust / (sigma**2 + floor**2)
        cost, turns = _cost(measured, predicted, weights)
        best = int(np.argmin(cost))
        middle = min(max(best, 1), len(LAGS_S) - 2)
        below, here, above = (float(c) for c in cost[middle - 1 : middle + 2])
        bend = below - 2.0 * here + above
        share = min(1.0, max(-1.0, (below - above) / (2.0 * bend))) if bend > 0.0 else 0.0
        before, at, after = predicted[:, middle - 1], predicted[:, middle], predicted[:, middle + 1]
        model = at + 0.5 * share * (after - before) + 0.5 * share**2 * (after - 2.0 * at + before)
        residual = measured - model - np.cross(turns[middle], model)
        floor = np.maximum(1.4826 * np.median(np.abs(residual), axis=0), MIN_NOISE_RAD)
        trust = 1.0 / (1.0 + residual**2 / ((sigma**2 + floor**2) * OUTLIER**2))
    step_s = float(LAGS_S[1] - LAGS_S[0])
    slope = _without_turn((after - before) / (2.0 * step_s), model, weights)
    total = float(np.sum(weights * measured**2))
    return LagFit(
        lag_s=float(LAGS_S[middle]) + share * step_s,
        sigma_s=_deviation(slope, residual, weights),
        explained=1.0 - float(np.sum(weights * residual**2)) / total if total > 0.0 else 0.0,
        inside=0 < best < len(LAGS_S) - 1,
    )


def _cost(measured: Floats, predicted: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Weighted sum of squares at each lag (L,) with the best mount rotation there, and these rotations (L, 3)."""
    lags = len(LAGS_S)  # one matrix product a lag, over the axes of all pairs: a quarter of the time of np.einsum
    difference = (measured - predicted.transpose(1, 0, 2)).reshape(lags, -1, 1)
    basis = _turned_by(predicted).transpose(1, 2, 0, 3).reshape(lags, 3, -1)
    weighted = basis * weights.ravel()
    normal = weighted @ basis.transpose(0, 2, 1) + np.eye(3) / MOUNT_PRIOR_RAD**2
    right = weighted @ difference
    turns: Floats = np.asarray(np.linalg.solve(normal, right)[..., 0], np.float64)
    cost = np.sum(weights.reshape(-1, 1) * difference**2, axis=(1, 2)) - np.sum(right[..., 0] * turns, axis=1)
    return np.asarray(cost), turns


def _turned_by(v: Floats) -> Floats:
    """(..., 3, 3): derivative of vectors (..., 3) by a small rotation about each axis (next to last index)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _without_turn(slope: Floats, model: Floats, weights: Floats) -> Floats:
    """The derivative by the lag (N, 3), without the part that a mount rotation would explain."""
    basis = _turned_by(model)
    normal = np.einsum("nka,na,nma->km", basis, weights, basis) + np.eye(3) / MOUNT_PRIOR_RAD**2
    turn = np.linalg.solve(normal, np.einsum("nka,na,na->k", basis, weights, slope))
    return np.asarray(slope - np.einsum("nka,k->na", basis, turn))


def _deviation(slope: Floats, residual: Floats, weights: Floats) -> float:
    """Standard deviation of the lag, s: the larger of that from the weights and that from the scatter between blocks."""
    information = float(np.sum(weights * slope**2))
    if not information > 0.0:
        return math.inf
    score = np.sum(weights * residual * slope, axis=1)
    blocks = np.add.reduceat(score, np.arange(0, len(score), BLOCK))
    return max(math.sqrt(float(np.sum(blocks**2))) / information, 1.0 / math.sqrt(information))
