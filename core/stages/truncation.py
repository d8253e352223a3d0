"""Correction of the range clip: the mean of the pixels left of a surface just before the clip is too near (not in the paper).

Pixels beyond `clear_range_m` are far, not measured (classify.py). Of a surface less than about two sigma before that only
the nearer part of its noise is left. In disparity that noise is normal and of known size, so what is left is a normal
distribution cut off at the clip's disparity, and its mean determines the mean of the whole.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inner
from .strips import SMOOTH

_LEAST, _MOST, _STEPS = -1.0, 3.5, 90
"""Not tuning: range and steps of the table, means of whole distributions in sigma above where they are cut off."""


def _means_left() -> NDArray[np.float64]:
    """(_STEPS + 1,) mean of what is left of a normal distribution cut off below 0, by its own mean: mu + phi(mu) / Phi(mu)."""
    whole = np.linspace(_LEAST, _MOST, _STEPS + 1)
    left = [mu + math.exp(-0.5 * mu * mu) / math.sqrt(0.5 * math.pi) / math.erfc(-mu / math.sqrt(2.0)) for mu in whole]
    return np.array(left)


MEANS_LEFT = _means_left()


@inner
def shift_back(strips, n, view, source, ke_per_m):
    """Moves smooth strips, disparity and near edge alike, to where they stood before the clip, never beyond it.

    source: a record of SOURCE: the clip is one of depth along the optical axis. A strip is as its middle row."""
    f, tan_edge = view.f_px, view.tan_edge
    for i in range(n):
        if strips[i].kind != SMOOTH:
            continue
        per_forward = source.axis_x + source.axis_z * 0.5 * (
            tan_edge[strips[i].top_row] + tan_edge[strips[i].bottom_row + 1]
        )
        sigma, cut = ke_per_m * f * per_forward, f * per_forward / source.clear_m
        if not sigma > 0.0 or strips[i].disparity_px >= cut + _MOST * sigma:
            continue
        mean = whole_mean((strips[i].disparity_px - cut) / sigma, MEANS_LEFT)
        by = max(0.0, strips[i].disparity_px - max(cut, cut + mean * sigma))
        strips[i].disparity_px -= by
        strips[i].near_px -= by


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
