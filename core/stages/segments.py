"""Line segments of strips (Section 5.2): strips of neighbouring columns grow into straight tracks, one strip per
column.

Input: the table of strips. Output: the table of tracks, and the track of each strip.

Algorithm 2 fits a line to a whole cluster and splits it at the greatest error. Here a strip is added to the track
whose line predicts it within line_tolerance_m and the noise of both, if the heights continue; otherwise it begins a
track. The misfit is measured along the viewing ray, so that walls seen edge-on are judged as strictly as walls seen
face-on."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, kernel, record
from .line_fit import LINE_SIGMAS, MOMENTS, add_point, clear_moments, fit_line
from .openings import cell_of, layer_of
from .strips import CUT_BOTTOM, CUT_TOP

TRACK = record(
    ("first_t", np.float64),  # tangents of azimuth of the first and last strip
    ("last_t", np.float64),
    ("top_min_m", np.float64),  # highest top of all strips (z is down)
    ("top_max_m", np.float64),  # lowest top that the border of the image does not cut
    ("bottom_min_m", np.float64),  # highest bottom that the border of the image does not cut
    ("bottom_max_m", np.float64),  # lowest bottom of all strips
    ("a", np.float64),  # line s = a + b t
    ("b", np.float64),
    ("mean_t", np.float64),
    ("scatter", np.float64),  # weighted sum of squares of t - mean_t, with the prior
    ("variance", np.float64),  # of the line at mean_t
    *MOMENTS,
)
"""A straight segment."""

BEYOND = 2**30
"""A row below every image, which no strip touches."""
ROUGHNESS_M = 0.02
"""Roughness of surfaces that is added to the noise, so that near strips do not dominate."""
JUMP_SHARE, JUMP_SIGMAS = 0.1, 3.0
"""Step of the disparity between neighbouring strips, as a share and in noise, that begins a new track."""
_EDGE_PX = 2.0
"""A track ends where tops or bottoms step by more than this beside an opening."""


class Front(NamedTuple):
    """The tracks that may continue, at most N."""

    track: Any  # (N,) int32, the track
    strip: Any  # (N,) int32, its last strip
    top_row: Any  # top_row, bottom_row, cluster: (N,) int32, of that strip
    bottom_row: Any
    cluster: Any


class StripEnds(NamedTuple):
    """Ends of a strip and their cells in the masks of openings."""

    top_m: Any  # top of the strip
    bottom_m: Any  # bottom of the strip
    s: Any  # 1/x of the strip, 1/m
    cut: Any  # CUT_TOP, CUT_BOTTOM
    layer: Any  # layer of the masks for its distance
    across: Any  # column of its cells
    upper: Any  # row of the cell of its top
    lower: Any  # row of the cell of its bottom
    edge_m: Any  # length of _EDGE_PX at its distance


@inner
def tangent(strip, view):
    """Returns the tangent of azimuth t = y/x of a strip."""
    return (strip.column - view.cu) / view.f_px * view.lateral[(strip.top_row + strip.bottom_row) // 2]


@inner
def strip_variance(disparity, sigma, f):
    """Returns the variance of s = 1/x of a strip: noise and some roughness of the surface, which limits the weight of
    near strips."""
    s = disparity / f
    noise, rough = sigma / f, ROUGHNESS_M * s * s
    return noise * noise + rough * rough


@inner
def is_jump(strip, last):
    """True if the disparities of two strips differ by more than a share of the first one and noise allow for one
    surface."""
    step = abs(strip.disparity_px - last.disparity_px)
    share = JUMP_SHARE * strip.disparity_px
    if step <= share:  # the usual case, without the square root
        return False
    return step > share + JUMP_SIGMAS * math.hypot(strip.sigma_px, last.sigma_px)


@inner
def heights_continue(cut, top, bottom, track, hs):
    """True if a strip from top to bottom (m) continues the heights of a track: tops and bottoms each differ by at
    most hs.

    An end that the border of the image cuts is a bound only: the object extends at least so far. It contradicts a
    real end only if that lies more than hs short of it."""
    lowest_top = track.top_max_m if cut & CUT_TOP else max(track.top_max_m, top)
    highest_bottom = track.bottom_min_m if cut & CUT_BOTTOM else min(track.bottom_min_m, bottom)
    tops_agree = lowest_top - min(track.top_min_m, top) <= hs
    return tops_agree and max(track.bottom_max_m, bottom) - highest_bottom <= hs


@inner
def misfit_share(t, s, variance, track, settings):
    """Returns the misfit of the point (t, s) to the line of a track along the ray, over what tolerance and noise
    allow."""
    spread = track.variance + (t - track.mean_t) ** 2 / track.scatter
    allowed = settings.line_tolerance_m * s * s + LINE_SIGMAS * math.sqrt(variance + spread)
    return abs(s - track.a - track.b * t) / allowed


@kernel
def grow(strips, view, first_of_column, settings, openings, tracks):
    """Assigns each strip to a track and writes the table of tracks; returns their number.

    A strip is added to the track with the least misfit among those of its cluster that touch its rows and have no
    strip in its column yet; of equals to the oldest one. The body is one function because a call that passes arrays
    costs more than its work; the functions called here are inlined.
    strips: with places, in the order of columns; tracks: (N,) TRACK out, N: the number of strips."""
    count, size, n = 0, 0, len(tracks)
    front_track, front_strip, front_top = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    front_bottom, front_cluster = np.empty(n, np.int32), np.empty(n, np.int32)
    front = Front(front_track, front_strip, front_top, front_bottom, front_cluster)
    touches, near = np.empty(n, np.uint8), np.empty(n, np.int32)  # if the strip touches a track's rows; those tracks
    f, prior = view.f_px, settings.slope_prior
    for u in range(view.cols):
        size = _continuing(u, settings.link_gap_px, strips, front, size)
        for i in range(first_of_column[u], first_of_column[u + 1]):
            strip = strips[i]
            if strip.support == 0:
                continue
            top, bottom, cluster = strip.top_row, strip.bottom_row, strip.cluster
            d = strip.disparity_px
            t, s = (u - view.cu) / f * view.lateral[(top + bottom) // 2], d / f
            variance = strip_variance(d, strip.sigma_px, f)
            ends = _ends_of(strip, t, s, _EDGE_PX / d, openings)
            # two steps without a branch, which the processor could not predict
            for m in range(size):
                touches[m] = (top <= front_bottom[m]) & (front_top[m] <= bottom) & (front_cluster[m] == cluster)
            found = 0
            for m in range(size):
                near[found] = m
                found += touches[m]
            best, cost = -1, 1.0
            for q in range(found):
                m = near[q]
                track, last = tracks[front_track[m]], strips[front_strip[m]]
                # a depth jump begins another surface, even if the slope of a short track is uncertain
                if is_jump(strip, last) or not heights_continue(
                    strip.cut, ends.top_m, ends.bottom_m, track, settings.height_step_m
                ):
                    continue
                c = misfit_share(t, s, variance, track, settings)
                if c >= cost or _over_opening(ends, track, openings):
                    continue
                best, cost = m, c
            if best < 0:
                best = size
                size += 1
                front_track[best] = count
                begin_track(tracks[count], t)
                count += 1
            k = front_track[best]
            front_strip[best], front_top[best] = i, BEYOND
            strip.track = k
            _extend_track(tracks[k], t, ends)
            _add_to_line(tracks[k], t, s, 1.0 / variance, prior)
    return count


@inner_inline
def begin_track(track, t):
    """Resets a record of TRACK to an empty track at tangent t."""
    clear_moments(track)
    track.first_t = t
    track.top_min_m, track.top_max_m = 1e9, -1e9
    track.bottom_min_m, track.bottom_max_m = 1e9, -1e9


@inner_inline
def _over_opening(ends, track, openings):
    """True if one rectangle for strip and track would cover an opening where their ends differ.

    Tested up to the farthest end of the track in the column of the strip, and up to the end of the strip in the
    middle of the track."""
    masks = openings.masks
    middle = cell_of(track.mean_t, openings.across, openings.cu, masks.shape[1])
    if not ends.cut & CUT_TOP:
        if ends.top_m - track.top_min_m > ends.edge_m:
            down = cell_of(track.top_min_m * ends.s, openings.down, openings.cv, masks.shape[2])
            if masks[ends.layer, ends.across, down] == 1:
                return True
        if track.top_max_m - ends.top_m > ends.edge_m and masks[ends.layer, middle, ends.upper] == 1:
            return True
    if not ends.cut & CUT_BOTTOM:
        if track.bottom_max_m - ends.bottom_m > ends.edge_m:
            down = cell_of(track.bottom_max_m * ends.s, openings.down, openings.cv, masks.shape[2])
            if masks[ends.layer, ends.across, down] == 1:
                return True
        if ends.bottom_m - track.bottom_min_m > ends.edge_m and masks[ends.layer, middle, ends.lower] == 1:
            return True
    return False


@inner_inline
def _ends_of(strip, t, s, edge_m, openings):
    """Returns StripEnds of a strip at tangent t with s = 1/x. edge_m: length of _EDGE_PX at its distance."""
    masks = openings.masks
    return StripEnds(
        strip.top_m,
        strip.bottom_m,
        s,
        strip.cut,
        layer_of(1.0 / s, openings.steps_m),
        cell_of(t, openings.across, openings.cu, masks.shape[1]),
        cell_of(strip.top_m * s, openings.down, openings.cv, masks.shape[2]),
        cell_of(strip.bottom_m * s, openings.down, openings.cv, masks.shape[2]),
        edge_m,
    )


@inner_inline
def _extend_track(track, t, ends):
    """Extends a track to tangent t and the heights of its new strip. A cut end is a bound only."""
    track.last_t = t
    track.top_min_m, track.bottom_max_m = min(track.top_min_m, ends.top_m), max(track.bottom_max_m, ends.bottom_m)
    if not ends.cut & CUT_TOP:
        track.top_max_m = max(track.top_max_m, ends.top_m)
    if not ends.cut & CUT_BOTTOM:
        track.bottom_min_m = min(track.bottom_min_m, ends.bottom_m)


@inner
def _continuing(u, link, strips, front, size):
    """Keeps the tracks of the front that may continue in column u, with the rows of their last strips; returns their
    number."""
    kept = 0
    for m in range(size):
        k = front.strip[m]
        last = strips[k]
        if u - last.column <= link:
            front.track[kept], front.strip[kept] = front.track[m], k
            front.top_row[kept], front.bottom_row[kept] = last.top_row, last.bottom_row
            front.cluster[kept] = last.cluster
            kept += 1
    return kept


@inner
def _add_to_line(track, t, s, weight, prior):
    """Adds the point (t, s) to the moments of a track and fits its line again. prior: weight of a slope of 0."""
    add_point(track, t, s, weight)
    track.a, track.b, track.mean_t, scatter = fit_line(track, prior)
    track.scatter, track.variance = scatter + prior, 1.0 / track.sum_w
