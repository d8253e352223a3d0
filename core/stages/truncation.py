"""Corrects the distance of strips just before the clear range, where the noise of their pixels is truncated (not in
the paper).

Input and output: the table of strips. Pixels beyond `clear_range_m` are far, not measured (classify.py). If a surface
lies less than about two sigma before that range, only the nearer part of its noise is measured, and its mean is too
near. In disparity this noise is normal with a known sigma, so that the pixels left are a truncated normal
distribution, whose mean determines the mean of the whole one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inner
from .strips import SMOOTH

_LEAST, _MOST, _STEPS = -1.0, 3.5, 90
"""Range and number of steps of the table: the mean of the whole distribution in sigma above the truncation."""


def _means_left() -> NDArray[np.float64]:
    """Returns (_STEPS + 1,) means of a normal distribution truncated below 0, for whole means mu: mu + phi(mu) /
    Phi(mu)."""
    whole = np.linspace(_LEAST, _MOST, _STEPS + 1)
    left = [mu + math.exp(-0.5 * mu * mu) / math.sqrt(0.5 * math.pi) / math.erfc(-mu / math.sqrt(2.0)) for mu in whole]
    return np.array(left)


MEANS_LEFT = _means_left()


@inner
def correct_truncation(strips, n, view, source, ke_per_m):
    """Moves smooth strips, disparity and near edge alike, to where they were before the truncation, not beyond the
    clear range.

    The clear range is a depth along the optical axis; it is converted to a forward distance for the middle row of a
    strip.
    strips: (N,) STRIP, in and out."""
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
        mean = untruncated_mean((strips[i].disparity_px - cut) / sigma, MEANS_LEFT)
        by = max(0.0, strips[i].disparity_px - max(cut, cut + mean * sigma))
        strips[i].disparity_px -= by
        strips[i].near_px -= by


@inner
def untruncated_mean(mean, left):
    """Returns the mean of a normal distribution whose part above 0 has this mean, all in sigma; at least _LEAST."""
    if mean <= left[0]:
        return _LEAST
    low = min(np.searchsorted(left, mean, side="right"), _STEPS) - 1
    share = min(1.0, (mean - left[low]) / (left[low + 1] - left[low]))
    return _LEAST + (low + share) * (_MOST - _LEAST) / _STEPS
