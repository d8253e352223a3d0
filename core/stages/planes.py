"""Section 5.2: straight pieces become planes, and planes move to the near side of what they stand for.

A plane is a line a*x + b*y = 1 (see line_fit.py) between two tangents of azimuth and two heights: a record of PLANE. No plane
may lie more than `safe_distance_m` behind the robust near edge of the strips it stands for: what exceeds that shifts it
towards the camera, what remains is published as its margin.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, record
from .line_fit import copy_moments, fit_line, incidence_cosine
from .segments import tangent
from .strips import CUT_BOTTOM, CUT_TOP, SMOOTH

PLANE = record(
    ("a", np.float64),
    ("b", np.float64),
    ("t0", np.float64),
    ("t1", np.float64),
    ("top_m", np.float64),
    ("bottom_m", np.float64),
    ("front_m", np.float64),
    ("middle_m", np.float64),
    ("sum_w", np.float64),
    ("sum_t", np.float64),
    ("sum_s", np.float64),
    ("sum_tt", np.float64),
    ("sum_ts", np.float64),
    ("sum_ss", np.float64),
    ("cluster", np.int32),
    ("support", np.int32),
    ("filled_rows", np.int32),
    ("cut", np.int32),
    ("kind", np.int32),
    ("inferred", np.int32),
    ("rows", np.int32),
    ("columns", np.int32),
    ("last_column", np.int32),
)
"""a, b: the line s = a + b*t; t0, t1: first and last tangent of azimuth; top_m, bottom_m: heights, z down; front_m: how far
the near edge of its strips stands out in front of it beyond safe_distance_m; middle_m: forward distance in the middle.
sum_w to sum_ss: moments, see line_fit.py. support: as of its strips, negative: the plane does not exist any more. kind: the
greatest of its strips; inferred: 1 where it was never measured; rows, filled_rows: of its strips; columns: that have a
strip; cut: see strips.py; last_column: of the strips counted so far."""

MOST_M = 1e9
"""Stands for no distance at all, as do lines that cross a ray beyond 1/LEAST_S metres."""
LEAST_S = 1e-6


@inner
def distance_at(plane, t):
    """Forward distance x of a plane at tangent t; MOST_M where its line never crosses that ray."""
    s = plane.a + plane.b * t
    return 1.0 / s if s > LEAST_S else MOST_M


@inner
def planes_from_tracks(count, tracks, settings, planes, plane_of, parent):
    """A plane of each track, its own parent: line, moments and ends; heights and support come from `measure_planes`."""
    slope, half = settings.link_slope_px, settings.half_column_t
    for k in range(count):
        track, plane = tracks[k], planes[k]
        a, b, _, _ = fit_line(track, 1.0 / (slope * slope))
        plane.a, plane.b = a, b
        copy_moments(plane, track)
        plane.t0, plane.t1 = track.first_t - half, track.last_t + half
        plane.inferred = 0
        plane_of[k], parent[k] = k, k


@kernel
def measure_planes(strips, n, view, settings, count, plane_of, planes):
    """Heights, support, filled rows, measured columns, cuts, clusters and the misfit in front, of every plane, from its strips.

    strips: the first n of (N,) STRIP. settings: a record of PLANE_SETTINGS. plane_of: (tracks,) int32, the plane of a track.
    planes: (N,) PLANE, of which `count` exist. front_m is the largest excess of the robust near edge over
    safe_distance_m, perpendicular to the plane, and at least what keeps safe_along_m along the viewing ray."""
    length = np.empty(count)
    for k in range(count):
        p = planes[k]
        length[k] = math.hypot(p.a, p.b)
        p.top_m, p.bottom_m, p.front_m = MOST_M, -MOST_M, -MOST_M
        p.support, p.filled_rows, p.cut, p.kind = 0, 0, 0, 0
        p.rows, p.columns, p.last_column = 0, 0, -1
        p.middle_m = distance_at(p, 0.5 * (p.t0 + p.t1))
    for i in range(n):
        strip = strips[i]
        if strip.support == 0:
            continue
        k = plane_of[strip.track]
        p = planes[k]
        t = tangent(strip, view)
        x = distance_at(p, t)
        beyond_top = settings.cut_footprint_t if strip.cut & CUT_TOP else settings.footprint_t
        beyond_bottom = settings.cut_footprint_t if strip.cut & CUT_BOTTOM else settings.footprint_t
        top = x * (view.tan_edge[strip.top_row] - beyond_top)
        bottom = x * (view.tan_edge[strip.bottom_row + 1] + beyond_bottom)
        if top < p.top_m:
            p.top_m = top
            p.cut = (p.cut & ~CUT_TOP) | (strip.cut & CUT_TOP)
        if bottom > p.bottom_m:
            p.bottom_m = bottom
            p.cut = (p.cut & ~CUT_BOTTOM) | (strip.cut & CUT_BOTTOM)
        p.support += strip.support
        p.filled_rows += strip.filled_rows
        p.rows += strip.bottom_row - strip.top_row + 1
        if strip.column != p.last_column:  # strips come in order of their columns
            p.columns += 1
            p.last_column = strip.column
        p.kind = max(p.kind, strip.kind)
        p.cluster = strip.cluster
        p.front_m = max(p.front_m, near_excess_m(strip, x, t, p, length[k], view.f_px, settings))


@inner
def near_excess_m(strip, x, t, plane, length, f_px, settings):
    """How far the near edge of a strip stands out in front of its plane, at x along its tangent t, beyond safe_distance_m:
    perpendicular to the plane, and at least what keeps safe_along_m along the ray.

    length: hypot(a, b) of the plane. The edge of a rough strip lies no farther than rough_near_sigmas of its noise behind
    the strip itself, whatever its neighbours have."""
    near = strip.near_px
    if strip.kind != SMOOTH:
        near = max(near, strip.disparity_px - settings.rough_near_sigmas * strip.sigma_px)
    ray = (x - f_px / near) * math.sqrt(1.0 + t * t)
    cosine = incidence_cosine(plane.a, plane.b, length, t)
    return max(ray * cosine - settings.safe_distance_m, (ray - settings.safe_along_m) * cosine)


@inner
def shift_to_near_side(count, planes, least_m):
    """Moves each plane towards the camera by front_m where that is positive, but to no nearer than least_m; front_m becomes
    0 there.

    Tops below the camera and bottoms above it come along on their rays, so that none of what the plane stopped passes."""
    for k in range(count):
        p = planes[k]
        if p.front_m > 0.0:
            c = 1.0 / math.hypot(p.a, p.b)
            scale = c / max(least_m, c - p.front_m)
            p.a *= scale
            p.b *= scale
            p.top_m, p.bottom_m = min(p.top_m, p.top_m / scale), max(p.bottom_m, p.bottom_m / scale)
            p.front_m = 0.0


@inner
def widen_planes(count, planes, tangent_more):
    """Extends each plane by a tangent at its four borders: by what was taken away from the outlines of things."""
    for k in range(count):
        p = planes[k]
        p.t0 -= tangent_more
        p.t1 += tangent_more
        p.top_m -= tangent_more * p.middle_m
        p.bottom_m += tangent_more * p.middle_m


@inner
def compact_planes(count, planes, parent, plane_of, tracks):
    """Moves the planes that exist to the front and points every track at its plane; returns how many there are."""
    alive = 0
    for k in range(count):
        if planes[k].support >= 0:
            planes[alive] = planes[k]
            parent[k] = -1 - alive  # negative: the new number
            alive += 1
    for t in range(tracks):
        k = plane_of[t]
        for _ in range(count):
            if parent[k] < 0:
                break
            k = parent[k]
        plane_of[t] = -1 - parent[k]
    return alive
