"""Section 5.2, the split: strips of neighbouring columns grow into straight pieces (tracks), one strip a column.

Greedy growth: a strip joins the track whose line predicts it within the line tolerance and the noise of both, as long as
the heights go on; else it begins a track. The misfit is judged along the viewing ray, so that walls seen edge-on
are judged as strictly as those seen face-on. A track that has a rough strip is expected to lie flatter across the view: near
sides of leaves scatter, and side by side they would pass for walls along the rays.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, record
from .line_fit import add_point, clear_moments, fit_line
from .openings import cell_of, layer_of
from .strips import CUT_BOTTOM, CUT_TOP, SMOOTH

TRACK = record(
    ("first_t", np.float64),
    ("last_t", np.float64),
    ("top_min_m", np.float64),
    ("top_max_m", np.float64),
    ("bottom_min_m", np.float64),
    ("bottom_max_m", np.float64),
    ("a", np.float64),
    ("b", np.float64),
    ("mean_t", np.float64),
    ("scatter", np.float64),
    ("variance", np.float64),
    ("prior", np.float64),
    ("sum_w", np.float64),
    ("sum_t", np.float64),
    ("sum_s", np.float64),
    ("sum_tt", np.float64),
    ("sum_ts", np.float64),
    ("sum_ss", np.float64),
)
"""A straight piece. first_t, last_t: tangents of azimuth; top_min_m: highest top of all strips, top_max_m: lowest one that
no border cuts; bottom_min_m: highest such bottom, bottom_max_m: lowest of all (z down). a, b: the line s = a + b*t so
far; mean_t: its mean t; scatter: of t, with the prior; variance: of the line at its mean; prior: weight of a slope of 0.
sum_w to sum_ss: moments, see line_fit.py."""

BEYOND = 2**30
"""Below the last row of any image: no strip touches it."""


class Front(NamedTuple):
    """Scratch of `grow`: the tracks that may go on, (N,) each, and which of them a strip touches.

    track: the track and strip: its last strip, int32; top_row, bottom_row, cluster: of that strip, int32; touches: uint8;
    near: int32."""

    track: NDArray[np.int32]
    strip: NDArray[np.int32]
    top_row: NDArray[np.int32]
    bottom_row: NDArray[np.int32]
    cluster: NDArray[np.int32]
    touches: NDArray[np.uint8]
    near: NDArray[np.int32]


def front_buffers(strips: int) -> Front:
    """Scratch for so many strips."""
    track, strip, top, bottom, cluster, near = np.zeros((6, strips + 1), np.int32)
    return Front(track, strip, top, bottom, cluster, np.zeros(strips + 1, np.uint8), near)


class StripEnds(NamedTuple):
    """Ends of a strip and where they lie among the masks of openings: top and bottom, m; s = 1/x; its cut; layer of its
    distance; cells across, of its top and of its bottom; length of opening_edge_px at its distance, m."""

    top_m: Any
    bottom_m: Any
    s: Any
    cut: Any
    layer: Any
    across: Any
    upper: Any
    lower: Any
    edge_m: Any


@inner
def tangent(strip, view):
    """t = y/x of a strip."""
    return (strip.column - view.cu) / view.f_px * view.lateral[(strip.top_row + strip.bottom_row) // 2]


@inner
def strip_variance(disparity, sigma, f, rough_m):
    """Variance of s = 1/x of a strip, with some roughness of the surface, so that near strips do not rule alone."""
    s = disparity / f
    noise, rough = sigma / f, rough_m * s * s
    return noise * noise + rough * rough


@inner
def is_jump(strip, last, settings):
    """Whether the disparities of two strips are too far apart for one surface: by more than a share of the first plus
    noise. settings: a record of PLANE_SETTINGS."""
    step = abs(strip.disparity_px - last.disparity_px)
    share = settings.track_jump * strip.disparity_px
    if step <= share:  # most are: saves the root
        return False
    return step > share + settings.track_jump_sigmas * math.hypot(strip.sigma_px, last.sigma_px)


@inner
def heights_go_on(cut, top, bottom, track, hs):
    """Whether a strip from top to bottom (m) continues a track's heights: tops within hs of each other, and bottoms.

    An end cut by the image border is a bound, not a corner: the thing goes on at least so far, so that a cut end only
    contradicts a real end that lies more than hs short of it."""
    lowest_top = track.top_max_m if cut & CUT_TOP else max(track.top_max_m, top)
    highest_bottom = track.bottom_min_m if cut & CUT_BOTTOM else min(track.bottom_min_m, bottom)
    tops_agree = lowest_top - min(track.top_min_m, top) <= hs
    return tops_agree and max(track.bottom_max_m, bottom) - highest_bottom <= hs


@inner
def misfit_share(t, s, variance, track, settings):
    """Misfit of the point (t, s) to a track's line, seen along the ray, over what the tolerance and the noise of both allow."""
    spread = track.variance + (t - track.mean_t) ** 2 / track.scatter
    allowed = settings.line_tolerance_m * s * s + settings.line_sigmas * math.sqrt(variance + spread)
    return abs(s - track.a - track.b * t) / allowed


@inner
def grow(strips, view, first_of_column, settings, openings, tracks, front):
    """Writes `track` of every strip and the table of tracks; returns their number.

    strips: STRIP in order of their columns, with places; first_of_column: (cols + 1,) int32. settings: a record of
    PLANE_SETTINGS. openings: OpeningMasks. tracks: (N,) TRACK out. front: Front.

    A strip goes on with the track of least misfit (of equals, the oldest) of its cluster that touches its rows and has
    no strip in its column yet. The loop is one function on purpose: a call that takes arrays costs more than what it
    does; the functions called here are inlined."""
    count, size = 0, 0
    front_track, front_strip, front_top = front.track, front.strip, front.top_row
    front_bottom, front_cluster, touches, near = front.bottom_row, front.cluster, front.touches, front.near
    f, rough_m = view.f_px, settings.roughness_m
    prior = 1.0 / (settings.link_slope_px * settings.link_slope_px)
    rough_prior = 1.0 / (settings.rough_slope_px * settings.rough_slope_px)
    for u in range(view.cols):
        size = _go_on(u, settings.link_gap_px, strips, front, size)
        for i in range(first_of_column[u], first_of_column[u + 1]):
            strip = strips[i]
            if strip.support == 0:
                continue
            top, bottom, cluster = strip.top_row, strip.bottom_row, strip.cluster
            d = strip.disparity_px
            t, s = (u - view.cu) / f * view.lateral[(top + bottom) // 2], d / f
            variance = strip_variance(d, strip.sigma_px, f, rough_m)
            ends = _ends_of(strip, t, s, settings.opening_edge_px / d, openings)
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
                # a depth jump is another surface, however uncertain the slope of a short track
                if is_jump(strip, last, settings) or not heights_go_on(
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
                begin_track(tracks[count], t, prior)
                count += 1
            k = front_track[best]
            front_strip[best], front_top[best] = i, BEYOND
            strip.track = k
            _reach(tracks[k], t, ends)
            if strip.kind != SMOOTH:
                tracks[k].prior = rough_prior
            _add_to_line(tracks[k], t, s, 1.0 / variance)
    return count


@inner_inline
def begin_track(track, t, prior):
    """Makes a record of TRACK an empty one at tangent t."""
    clear_moments(track)
    track.first_t, track.prior = t, prior
    track.top_min_m, track.top_max_m = 1e9, -1e9
    track.bottom_min_m, track.bottom_max_m = 1e9, -1e9


@inner_inline
def _over_opening(ends, track, openings):
    """Whether one rectangle for strip and track would cover an opening where their ends step: up to the track's farthest
    end in the strip's column, up to the strip's end in the middle of the track."""
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
    """StripEnds of a strip at tangent t with s = 1/x; edge_m: opening_edge_px at its distance."""
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
def _reach(track, t, ends):
    """Makes a track reach tangent t and the heights of its new strip; an end cut by the image's border is a bound only."""
    track.last_t = t
    track.top_min_m, track.bottom_max_m = min(track.top_min_m, ends.top_m), max(track.bottom_max_m, ends.bottom_m)
    if not ends.cut & CUT_TOP:
        track.top_max_m = max(track.top_max_m, ends.top_m)
    if not ends.cut & CUT_BOTTOM:
        track.bottom_min_m = min(track.bottom_min_m, ends.bottom_m)


@inner
def _go_on(u, link, strips, front, size):
    """Keeps what may go on in column u of the front, with the rows of the last strips; returns its size."""
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
def _add_to_line(track, t, s, weight):
    """Adds the point (t, s) to the moments of a track and fits its line anew."""
    add_point(track, t, s, weight)
    track.a, track.b, track.mean_t, scatter = fit_line(track, track.prior)
    track.scatter, track.variance = scatter + track.prior, 1.0 / track.sum_w
