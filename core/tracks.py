"""Section 5.2, the split: strips of neighbouring columns grow into straight pieces, one strip a column.

Greedy growth: a strip joins the piece whose line predicts it within the line tolerance and the noise of both, as long as
the heights go on; else it begins a piece. The misfit is judged along the viewing ray, so that walls seen edge-on
are judged as strictly as those seen face-on.
"""

from __future__ import annotations

import math

from numba import njit

from .clusters import Z_BOTTOM, Z_TOP
from .lines import W, add_point, fit_line
from .strips import BOTTOM, CLUSTER, CUT, SIGMA, SUPPORT, TOP, TRACK, D, U

# columns of the integer table of tracks
T_LAST_U, T_LAST, T_COUNT = range(3)
# columns of the float table: first and last t; highest top of all and lowest real one; highest real bottom, lowest of all
T_T0, T_T1, T_TOP_MIN, T_TOP_MAX, T_BOTTOM_MIN, T_BOTTOM_MAX = range(6)


@njit(cache=True, nogil=True)
def tangent(ints, i, cu, f, lateral):
    """t = y/x of strip i."""
    return (ints[i, U] - cu) / f * lateral[(ints[i, TOP] + ints[i, BOTTOM]) // 2]


@njit(cache=True, nogil=True)
def strip_sigma_s(floats, i, f, rough_m):
    """Noise of 1/x of a strip, with some roughness of the surface, so that near strips do not rule alone."""
    s = floats[i, D] / f
    return math.hypot(floats[i, SIGMA] / f, rough_m * s * s)


@njit(cache=True, nogil=True)
def heights_go_on(ints, place, track, i, hs):
    """Whether strip i continues a track's heights: tops within Hs of each other, and bottoms.

    An end cut by the image border is a bound, not a corner: the thing goes on at least so far, so that a cut end only
    contradicts a real end that lies more than Hs short of it."""
    cut, top, bottom = ints[i, CUT], place[i, Z_TOP], place[i, Z_BOTTOM]
    lowest_top = track[T_TOP_MAX] if cut & 1 else max(track[T_TOP_MAX], top)
    highest_bottom = track[T_BOTTOM_MIN] if cut & 2 else min(track[T_BOTTOM_MIN], bottom)
    return lowest_top - min(track[T_TOP_MIN], top) <= hs and max(track[T_BOTTOM_MAX], bottom) - highest_bottom <= hs


@njit(cache=True, nogil=True)
def widen_heights(ints, place, track, i):
    """Takes the heights of strip i into a track's spans: all of its ends outwards, only real ones inwards."""
    cut, top, bottom = ints[i, CUT], place[i, Z_TOP], place[i, Z_BOTTOM]
    track[T_TOP_MIN] = min(track[T_TOP_MIN], top)
    track[T_BOTTOM_MAX] = max(track[T_BOTTOM_MAX], bottom)
    if not cut & 1:
        track[T_TOP_MAX] = max(track[T_TOP_MAX], top)
    if not cut & 2:
        track[T_BOTTOM_MIN] = min(track[T_BOTTOM_MIN], bottom)


@njit(cache=True, nogil=True)
def match_cost(
    ints, floats, place, moments, track_i, track_f, i, t, f, hs, line_m, sigmas, slope, rough_m, jump, jump_sigmas
):  # fmt: skip
    """Misfit over tolerance of strip i to a track (below 1: joins), or 2 where it cannot be its continuation."""
    last = track_i[T_LAST]
    if ints[i, TOP] > ints[last, BOTTOM] or ints[last, TOP] > ints[i, BOTTOM]:
        return 2.0
    if ints[i, CLUSTER] != ints[last, CLUSTER] or not heights_go_on(ints, place, track_f, i, hs):
        return 2.0
    prior = 1.0 / (slope * slope)
    a, b, mean, scatter = fit_line(moments, prior)
    s = floats[i, D] / f
    sigma = strip_sigma_s(floats, i, f, rough_m)
    spread = 1.0 / moments[W] + (t - mean) ** 2 / (scatter + prior)
    tolerance = line_m * s * s + sigmas * math.sqrt(sigma * sigma + spread)
    # a depth jump is another surface, however little a short track knows of its slope
    step = abs(floats[i, D] - floats[last, D])
    if step > jump * floats[i, D] + jump_sigmas * math.hypot(floats[i, SIGMA], floats[last, SIGMA]):
        return 2.0
    return abs(s - a - b * t) / tolerance


@njit(cache=True, nogil=True)
def grow_tracks(
    ints, floats, place, n, cols, first_of_column, f, cu, lateral, hs, line_m, sigmas, slope, link, rough_m, jump,
    jump_sigmas, moments, track_ints, track_floats,
):  # fmt: skip
    """Writes TRACK of every strip and the tables of tracks; returns their number.

    hs: step of heights that ends a piece. line_m, sigmas: misfit of its line, in metres and in noise. slope: px of
    disparity from one column to the next, the prior of the line. link: columns it may miss. jump, jump_sigmas: step of
    disparity that ends it, as a share and in noise. moments: (N, 6) float64, track_ints: (N, 3) int32, track_floats: (N, 6) float64, outputs with a row a track."""
    tracks = 0
    active = [0 for _ in range(0)]
    for u in range(cols):
        kept = [0 for _ in range(0)]
        for k in active:
            if u - track_ints[k, T_LAST_U] <= link:
                kept.append(k)
        active = kept
        for i in range(first_of_column[u], first_of_column[u + 1]):
            if ints[i, SUPPORT] == 0:
                continue
            t = tangent(ints, i, cu, f, lateral)
            best, cost = -1, 1.0
            for k in active:
                if track_ints[k, T_LAST_U] == u:
                    continue
                c = match_cost(
                    ints, floats, place, moments[k], track_ints[k], track_floats[k], i, t, f, hs, line_m, sigmas, slope,
                    rough_m, jump, jump_sigmas,
                )  # fmt: skip
                if c < cost:
                    best, cost = k, c
            if best < 0:
                best = tracks
                tracks += 1
                _begin(track_ints[best], track_floats[best], moments[best], t)
                active.append(best)
            _join(ints, floats, place, moments[best], track_ints[best], track_floats[best], i, u, t, f, rough_m)
            ints[i, TRACK] = best
    return tracks


@njit(cache=True, nogil=True)
def _begin(track_i, track_f, moments, t):
    moments[:] = 0.0
    track_i[T_COUNT] = 0
    track_f[T_T0] = t
    track_f[T_TOP_MIN], track_f[T_TOP_MAX] = 1e9, -1e9
    track_f[T_BOTTOM_MIN], track_f[T_BOTTOM_MAX] = 1e9, -1e9


@njit(cache=True, nogil=True)
def _join(ints, floats, place, moments, track_i, track_f, i, u, t, f, rough_m):
    sigma = strip_sigma_s(floats, i, f, rough_m)
    add_point(moments, t, floats[i, D] / f, 1.0 / (sigma * sigma))
    track_i[T_LAST_U], track_i[T_LAST] = u, i
    track_i[T_COUNT] += 1
    track_f[T_T1] = t
    widen_heights(ints, place, track_f, i)
