"""What the range clip took from a surface just before it: the mean of what is left stands too near (ours).

Pixels beyond `clear_range_m` are far, not measured (classify.py). Of a surface less than about two sigma before that only
the nearer part of its noise is left. In disparity that noise is normal and of known size, so what is left is a normal
distribution cut off at the clip's disparity, and its mean tells the mean of the whole.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inner
from .strips import BOTTOM, KIND, NEAR, SMOOTH, TOP, D

_LEAST, _MOST, _STEPS = -1.0, 3.5, 90
"""Not tuning: range and steps of the table, means of whole distributions in sigma above where they are cut off."""


def _means_left() -> NDArray[np.float64]:
    """(_STEPS + 1,) mean of what is left of a normal distribution cut off below 0, by its own mean: mu + phi(mu) / Phi(mu)."""
    whole = np.linspace(_LEAST, _MOST, _STEPS + 1)
    left = [mu + math.exp(-0.5 * mu * mu) / math.sqrt(0.5 * math.pi) / math.erfc(-mu / math.sqrt(2.0)) for mu in whole]
    return np.array(left)


MEANS_LEFT = _means_left()


@inner
def shift_back(ints, floats, n, tan_edge, f, axis_x, axis_z, clear_m, ke, left):
    """Moves smooth strips, D and NEAR alike, to where they stood before the clip, never beyond it.

    axis_x, axis_z: the optical axis in level_cam, since the clip is one of depth along it; clear_m: that depth. left:
    MEANS_LEFT. A strip is as its middle row."""
    for i in range(n):
        if ints[i, KIND] != SMOOTH:
            continue
        per_forward = axis_x + axis_z * 0.5 * (tan_edge[ints[i, TOP]] + tan_edge[ints[i, BOTTOM] + 1])
        sigma, cut = ke * f * per_forward, f * per_forward / clear_m
        if not sigma > 0.0 or floats[i, D] >= cut + _MOST * sigma:
            continue
        mean = whole_mean((floats[i, D] - cut) / sigma, left)
        by = max(0.0, floats[i, D] - max(cut, cut + mean * sigma))
        floats[i, D] -= by
        floats[i, NEAR] -= by


@inner
def whole_mean(mean, left):
    """Mean of a normal distribution of which that above 0 has this mean, all in sigma; at least _LEAST."""
    if mean <= left[0]:
        return _LEAST
    low, high = 0, _STEPS
    for _ in range(16):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if left[middle] <= mean:
            low = middle
        else:
            high = middle
    share = min(1.0, (mean - left[low]) / (left[high] - left[low]))
    return _LEAST + (low + share) * (_MOST - _LEAST) / _STEPS
