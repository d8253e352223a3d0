"""A vertical plane as a line, by full moments that can be added (Eq. 17, with the term the paper leaves out).

The line is a*x + b*y = 1 in level_cam, that is s = a + b*t with t = y/x (tangent of azimuth) and s = 1/x (inverse
forward distance). Stereo noise is constant in s, so least squares in (t, s) is the maximum-likelihood fit; in metres it
is the total-least-squares fit of the same points with weights 1/x^4, normalised by the plane's distance instead of its
normal, which takes away TLS's pull towards the camera. Only a plane through the camera itself cannot be written so,
and no camera sees that. Moments: W, t, s, tt, ts, ss, each a sum over weights 1/sigma_s^2.
"""

from __future__ import annotations

import math

from ..jit import inline_ieee, inner

W, T, S, TT, TS, SS = range(6)


@inner
def add_point(moments, t, s, weight):
    """Adds one strip at (t, s) with weight 1/sigma_s^2 to moments (6,) float64."""
    moments[W] += weight
    moments[T] += weight * t
    moments[S] += weight * s
    moments[TT] += weight * t * t
    moments[TS] += weight * t * s
    moments[SS] += weight * s * s


@inner
def fit_line(moments, slope_prior):
    """(a, b, t_mean, t_scatter) of s = a + b*t; slope_prior: weight (1/variance) of a slope of 0.

    The prior only speaks where the points are too few or too close to carry a slope."""
    w = moments[W]
    t_mean, s_mean = moments[T] / w, moments[S] / w
    scatter = max(0.0, moments[TT] - w * t_mean * t_mean)
    b = (moments[TS] - w * t_mean * s_mean) / (scatter + slope_prior)
    return s_mean - b * t_mean, b, t_mean, scatter


@inline_ieee
def misfit(w, t, s, tt, ts, ss, a, b):
    """Weighted mean square of s - a - b*t over what these moments stand for, in 1/x squared."""
    return max(0.0, ss - 2.0 * a * s - 2.0 * b * ts + a * a * w + 2.0 * a * b * t + b * b * tt) / w


@inner
def incidence_cosine(a, b, length, t):
    """Cosine between the ray (1, t) and the normal (a, b) of the line a*x + b*y = 1; length: hypot(a, b), one for all rays."""
    return abs(a + b * t) / (length * math.sqrt(1.0 + t * t))
