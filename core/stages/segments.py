"""Section 5.2, the split: strips of neighbouring columns grow into straight pieces, one strip a column.

Greedy growth: a strip joins the piece whose line predicts it within the line tolerance and the noise of both, as long as
the heights go on; else it begins a piece. The misfit is judged along the viewing ray, so that walls seen edge-on
are judged as strictly as those seen face-on. A piece that has a rough strip is expected to lie flatter across the view: near
sides of leaves scatter, and side by side they would pass for walls along the rays.
"""

from __future__ import annotations

import math

from ..jit import inner, inner_inline
from .clusters import Z_BOTTOM, Z_TOP
from .line_fit import SS, TS, TT, S, T, W
from .openings import F_ACROSS, F_CU, F_CV, F_DOWN, cell_of, layer_of
from .strips import BOTTOM, CLUSTER, CUT, KIND, SIGMA, SMOOTH, SUPPORT, TOP, TRACK, D, U

# columns of the table of tracks: first and last t; highest top of all and lowest real one; highest real bottom, lowest
# of all; the line s = a + b*t so far, its mean t, scatter of t with the prior, variance of its mean, and that prior
T_T0, T_T1, T_TOP_MIN, T_TOP_MAX, T_BOTTOM_MIN, T_BOTTOM_MAX, T_A, T_B, T_MEAN, T_SCATTER, T_VARIANCE, T_PRIOR = range(
    12
)
# rows of the front, a column for each track that may go on: the track and its last strip; that one's top and bottom row
# and cluster
F_TRACK, F_STRIP, F_TOP, F_BOTTOM, F_CLUSTER = range(5)

BEYOND = 2**30
"""Below the last row of any image: so no strip touches it."""


@inner
def tangent(ints, i, cu, f, lateral):
    """t = y/x of strip i."""
    return (ints[i, U] - cu) / f * lateral[(ints[i, TOP] + ints[i, BOTTOM]) // 2]


@inner
def strip_variance(disparity, sigma, f, rough_m):
    """Variance of s = 1/x of a strip, with some roughness of the surface, so that near strips do not rule alone."""
    s = disparity / f
    noise, rough = sigma / f, rough_m * s * s
    return noise * noise + rough * rough


@inner
def is_jump(d, last_d, sigma, last_sigma, jump, jump_sigmas):
    """Whether two disparities are too far apart for one surface: by more than a share of the first plus noise."""
    step, share = abs(d - last_d), jump * d
    if step <= share:  # most are: saves the root
        return False
    return step > share + jump_sigmas * math.hypot(sigma, last_sigma)


@inner
def heights_go_on(cut, top, bottom, top_min, top_max, bottom_min, bottom_max, hs):
    """Whether a strip from top to bottom (m) continues a track's heights: tops within hs of each other, and bottoms.

    An end cut by the image border is a bound, not a corner: the thing goes on at least so far, so that a cut end only
    contradicts a real end that lies more than hs short of it."""
    lowest_top = top_max if cut & 1 else max(top_max, top)
    highest_bottom = bottom_min if cut & 2 else min(bottom_min, bottom)
    return lowest_top - min(top_min, top) <= hs and max(bottom_max, bottom) - highest_bottom <= hs


@inner
def misfit_share(t, s, variance, a, b, mean, scatter, mean_variance, line_m, sigmas):
    """Misfit of the point (t, s) to a line, seen along the ray, over what the tolerance and the noise of both allow."""
    spread = mean_variance + (t - mean) ** 2 / scatter
    return abs(s - a - b * t) / (line_m * s * s + sigmas * math.sqrt(variance + spread))


@inner
def grow(
    ints, floats, place, cols, first_of_column, f, cu, lateral, hs, line_m, sigmas, slope, rough_slope, link, rough_m, jump,
    jump_sigmas, edge_px, masks, frame, moments, table, front, touches, near,
):  # fmt: skip
    """Writes TRACK of every strip and the table of tracks; returns their number.

    Strips in order of their columns; place: see place_strips; masks, frame: see opening_masks. Out: moments (N, 6) float64, see
    lines.py, and table (N, 12) float64 by the T_ indices, a row a track.

    A strip goes on with the track of least misfit (of equals, the oldest) of its cluster that touches its rows and has
    no strip in its column yet. hs: step of heights that ends a piece. line_m, sigmas: tolerance of its line, in metres
    and in noise. slope, rough_slope: px of disparity from one column to the next, the prior of the line, and that of one with a
    rough strip. link: columns that it may miss. rough_m: roughness added to the noise. jump, jump_sigmas: step of disparity that ends it, as a share and in
    noise. edge_px: what heights may step beside an opening. Scratch: front (5, N) int32, see F_; touches (N,) uint8; near (N,) int32. All in one loop on purpose: to hand
    arrays to a function costs more than what it does; those called here are made part of it."""
    tracks, size = 0, 0
    front_track, front_strip, front_top = front[F_TRACK], front[F_STRIP], front[F_TOP]
    front_bottom, front_cluster = front[F_BOTTOM], front[F_CLUSTER]
    prior, rough_prior = 1.0 / (slope * slope), 1.0 / (rough_slope * rough_slope)
    for u in range(cols):
        size = _go_on(u, link, ints, front, size)
        for i in range(first_of_column[u], first_of_column[u + 1]):
            if ints[i, SUPPORT] == 0:
                continue
            top, bottom, cluster, cut = ints[i, TOP], ints[i, BOTTOM], ints[i, CLUSTER], ints[i, CUT]
            d, sigma, z0, z1 = floats[i, D], floats[i, SIGMA], place[i, Z_TOP], place[i, Z_BOTTOM]
            t, s, variance = (u - cu) / f * lateral[(top + bottom) // 2], d / f, strip_variance(d, sigma, f, rough_m)
            layer, edge_m = layer_of(1.0 / s, frame), edge_px / d
            across = cell_of(t, frame[F_ACROSS], frame[F_CU], masks.shape[1])
            upper = cell_of(z0 * s, frame[F_DOWN], frame[F_CV], masks.shape[2])
            lower = cell_of(z1 * s, frame[F_DOWN], frame[F_CV], masks.shape[2])
            # two steps without a branch that nobody could predict
            for m in range(size):
                touches[m] = (top <= front_bottom[m]) & (front_top[m] <= bottom) & (front_cluster[m] == cluster)
            found = 0
            for m in range(size):
                near[found] = m
                found += touches[m]
            best, cost = -1, 1.0
            for q in range(found):
                m = near[q]
                k, last = front_track[m], front_strip[m]
                # a depth jump is another surface, however little a short track knows of its slope
                if is_jump(d, floats[last, D], sigma, floats[last, SIGMA], jump, jump_sigmas) or not heights_go_on(
                    cut, z0, z1, table[k, T_TOP_MIN], table[k, T_TOP_MAX], table[k, T_BOTTOM_MIN], table[k, T_BOTTOM_MAX], hs
                ):  # fmt: skip
                    continue
                c = misfit_share(
                    t, s, variance, table[k, T_A], table[k, T_B], table[k, T_MEAN], table[k, T_SCATTER],
                    table[k, T_VARIANCE], line_m, sigmas,
                )  # fmt: skip
                if c >= cost:
                    continue
                if _over_opening(z0, z1, s, cut, layer, across, upper, lower, edge_m, table, k, masks, frame):
                    continue
                best, cost = m, c
            if best < 0:
                best = size
                size += 1
                k = front_track[best] = tracks
                tracks += 1
                moments[k] = 0.0
                table[k, T_T0], table[k, T_PRIOR] = t, prior
                table[k, T_TOP_MIN], table[k, T_TOP_MAX] = 1e9, -1e9
                table[k, T_BOTTOM_MIN], table[k, T_BOTTOM_MAX] = 1e9, -1e9
            k = front_track[best]
            front_strip[best], front_top[best] = i, BEYOND
            ints[i, TRACK] = k
            table[k, T_T1] = t
            if ints[i, KIND] != SMOOTH:
                table[k, T_PRIOR] = rough_prior
            _reach(table, k, z0, z1, cut)
            _add_to_line(moments, table, k, t, s, 1.0 / variance, table[k, T_PRIOR])
    return tracks


@inner_inline
def _over_opening(z0, z1, s, cut, layer, across, upper, lower, edge_m, table, k, masks, frame):
    """Whether one rectangle for strip and track k would cover an opening where their ends step: up to the track's farthest
    end in the strip's column (across), up to the strip's (rows upper, lower) in the middle of the track."""
    middle = cell_of(table[k, T_MEAN], frame[F_ACROSS], frame[F_CU], masks.shape[1])
    if not cut & 1:
        if z0 - table[k, T_TOP_MIN] > edge_m:
            down = cell_of(table[k, T_TOP_MIN] * s, frame[F_DOWN], frame[F_CV], masks.shape[2])
            if masks[layer, across, down] == 1:
                return True
        if table[k, T_TOP_MAX] - z0 > edge_m and masks[layer, middle, upper] == 1:
            return True
    if not cut & 2:
        if table[k, T_BOTTOM_MAX] - z1 > edge_m:
            down = cell_of(table[k, T_BOTTOM_MAX] * s, frame[F_DOWN], frame[F_CV], masks.shape[2])
            if masks[layer, across, down] == 1:
                return True
        if z1 - table[k, T_BOTTOM_MIN] > edge_m and masks[layer, middle, lower] == 1:
            return True
    return False


@inner_inline
def _reach(table, k, z0, z1, cut):
    """Makes the heights of track k reach those of its new strip; an end cut by the image's border is a bound only."""
    table[k, T_TOP_MIN], table[k, T_BOTTOM_MAX] = min(table[k, T_TOP_MIN], z0), max(table[k, T_BOTTOM_MAX], z1)
    if not cut & 1:
        table[k, T_TOP_MAX] = max(table[k, T_TOP_MAX], z0)
    if not cut & 2:
        table[k, T_BOTTOM_MIN] = min(table[k, T_BOTTOM_MIN], z1)


@inner
def _go_on(u, link, ints, front, size):
    """Keeps what may go on in column u of the front, with the rows of the last strips; returns its size."""
    kept = 0
    for m in range(size):
        last = front[F_STRIP, m]
        if u - ints[last, U] <= link:
            front[F_TRACK, kept], front[F_STRIP, kept] = front[F_TRACK, m], last
            front[F_TOP, kept], front[F_BOTTOM, kept] = ints[last, TOP], ints[last, BOTTOM]
            front[F_CLUSTER, kept] = ints[last, CLUSTER]
            kept += 1
    return kept


@inner
def _add_to_line(moments, table, k, t, s, weight, prior):
    """Adds the point (t, s) to the moments of track k and fits its line anew, as lines.py does."""
    moments[k, W] += weight
    moments[k, T] += weight * t
    moments[k, S] += weight * s
    moments[k, TT] += weight * t * t
    moments[k, TS] += weight * t * s
    moments[k, SS] += weight * s * s
    w = moments[k, W]
    t_mean, s_mean = moments[k, T] / w, moments[k, S] / w
    scatter = max(0.0, moments[k, TT] - w * t_mean * t_mean) + prior
    b = (moments[k, TS] - w * t_mean * s_mean) / scatter
    table[k, T_A], table[k, T_B], table[k, T_MEAN] = s_mean - b * t_mean, b, t_mean
    table[k, T_SCATTER], table[k, T_VARIANCE] = scatter, 1.0 / w
