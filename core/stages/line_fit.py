"""A vertical plane as a line, fitted from moments that can be added (Eq. 17, with the mean square that the paper
omits).

The line is a x + b y = 1 in level_cam. With t = y/x (tangent of azimuth) and s = 1/x (inverse forward distance) it is
s = a + b t. The noise of stereo is constant in s, so that least squares in (t, s) is the maximum-likelihood fit
(ours; the paper fits in metres). It equals a total least-squares fit in metres with the weights 1/x^4 that is
normalised by the distance of the plane, without the bias of total least squares towards the camera. A plane through
the camera cannot be represented; no camera sees one.

Moments can be added: those of a track, or of a plane, are fields of its record."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inline_ieee, inner, of_type

MOMENTS = of_type(np.float64, "sum_w sum_t sum_s sum_tt sum_ts sum_ss")
"""Fields of the records that have moments: sums over the strips, weighted by 1/sigma_s^2."""
LINE_SIGMAS = 3.0
"""Noise of a strip, or of a plane, that is allowed in addition to the misfit of a line."""


@inner
def clear_moments(m):
    """Sets the moments of a record to 0."""
    m.sum_w, m.sum_t, m.sum_s = 0.0, 0.0, 0.0
    m.sum_tt, m.sum_ts, m.sum_ss = 0.0, 0.0, 0.0


@inner
def add_point(m, t, s, weight):
    """Adds a strip at (t, s) to the moments of a record. weight: 1/sigma_s^2."""
    m.sum_w += weight
    m.sum_t += weight * t
    m.sum_s += weight * s
    m.sum_tt += weight * t * t
    m.sum_ts += weight * t * s
    m.sum_ss += weight * s * s


@inner
def add_moments(m, other):
    """Adds the moments of another record."""
    m.sum_w += other.sum_w
    m.sum_t += other.sum_t
    m.sum_s += other.sum_s
    m.sum_tt += other.sum_tt
    m.sum_ts += other.sum_ts
    m.sum_ss += other.sum_ss


@inner
def copy_moments(m, other):
    """Copies the moments of another record."""
    m.sum_w, m.sum_t, m.sum_s = other.sum_w, other.sum_t, other.sum_s
    m.sum_tt, m.sum_ts, m.sum_ss = other.sum_tt, other.sum_ts, other.sum_ss


@inner
def fit_line(m, slope_prior):
    """Returns (a, b, t_mean, t_scatter) of the line s = a + b t.

    slope_prior is the weight (1/variance) of a slope of 0. It matters only if the points are too few or too close to
    determine the slope. t_scatter, the weighted sum of squares of t - t_mean, does not contain it."""
    w = m.sum_w
    t_mean, s_mean = m.sum_t / w, m.sum_s / w
    scatter = max(0.0, m.sum_tt - w * t_mean * t_mean)
    b = (m.sum_ts - w * t_mean * s_mean) / (scatter + slope_prior)
    return s_mean - b * t_mean, b, t_mean, scatter


@inline_ieee
def misfit(w, t, s, tt, ts, ss, a, b):
    """Returns the weighted mean square of s - a - b t, in 1/m^2. w, t, s, tt, ts, ss: moments."""
    return max(0.0, ss - 2.0 * a * s - 2.0 * b * ts + a * a * w + 2.0 * a * b * t + b * b * tt) / w


@inner
def incidence_cosine(a, b, length, t):
    """Returns the cosine between the ray (1, t) and the normal (a, b) of the line a x + b y = 1. length: hypot(a, b)."""
    return abs(a + b * t) / (length * math.sqrt(1.0 + t * t))
