"""A vertical plane as a line, by full moments that can be added (Eq. 17, with the term the paper leaves out).

The line is a*x + b*y = 1 in level_cam, that is s = a + b*t with t = y/x (tangent of azimuth) and s = 1/x (inverse
forward distance). Stereo noise is constant in s, so least squares in (t, s) is the maximum-likelihood fit; in metres it
is the total-least-squares fit of the same points with weights 1/x^4, normalised by the plane's distance instead of its
normal, which takes away TLS's pull towards the camera. Only a plane through the camera itself cannot be written so,
and no camera sees that.

Moments are the float64 fields sum_w, sum_t, sum_s, sum_tt, sum_ts and sum_ss of a record (TRACK, PLANE), each a sum over
weights 1/sigma_s^2.
"""

from __future__ import annotations

import math

from ..jit import inline_ieee, inner


@inner
def clear_moments(m):
    """Sets the moments of a record to 0."""
    m.sum_w, m.sum_t, m.sum_s = 0.0, 0.0, 0.0
    m.sum_tt, m.sum_ts, m.sum_ss = 0.0, 0.0, 0.0


@inner
def add_point(m, t, s, weight):
    """Adds one strip at (t, s) with weight 1/sigma_s^2 to the moments of a record."""
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
    """Sets the moments of a record to those of another."""
    m.sum_w, m.sum_t, m.sum_s = other.sum_w, other.sum_t, other.sum_s
    m.sum_tt, m.sum_ts, m.sum_ss = other.sum_tt, other.sum_ts, other.sum_ss


@inner
def fit_line(m, slope_prior):
    """(a, b, t_mean, t_scatter) of s = a + b*t; slope_prior: weight (1/variance) of a slope of 0.

    The prior only counts where the points are too few or too close to carry a slope. t_scatter is without it."""
    w = m.sum_w
    t_mean, s_mean = m.sum_t / w, m.sum_s / w
    scatter = max(0.0, m.sum_tt - w * t_mean * t_mean)
    b = (m.sum_ts - w * t_mean * s_mean) / (scatter + slope_prior)
    return s_mean - b * t_mean, b, t_mean, scatter


@inline_ieee
def misfit(w, t, s, tt, ts, ss, a, b):
    """Weighted mean square of s - a - b*t over what these moments stand for, in 1/x squared."""
    return max(0.0, ss - 2.0 * a * s - 2.0 * b * ts + a * a * w + 2.0 * a * b * t + b * b * tt) / w


@inner
def incidence_cosine(a, b, length, t):
    """Cosine between the ray (1, t) and the normal (a, b) of the line a*x + b*y = 1; length: hypot(a, b)."""
    return abs(a + b * t) / (length * math.sqrt(1.0 + t * t))
