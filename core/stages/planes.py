"""Table of planes (Section 5.2): tracks become planes, which are measured and moved in front of their strips.

A plane is a line a x + b y = 1 (line_fit.py) between two tangents of azimuth and two heights, a record of PLANE. A
fitted plane passes through the middle of noise and foliage. It is therefore moved towards the camera until the near
edge of no strip is more than safe_distance_m in front of it; what remains is part of the published margin."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel, record
from .line_fit import MOMENTS, copy_moments, incidence_cosine
from .segments import tangent
from .strips import CUT_BOTTOM, CUT_TOP, IRREGULAR, SMOOTH

PLANE = record(
    ("a", np.float64),  # line s = a + b t
    ("b", np.float64),
    ("t0", np.float64),  # tangents of azimuth of the left and right end
    ("t1", np.float64),
    ("top_m", np.float64),  # heights, z down
    ("bottom_m", np.float64),
    ("front_m", np.float64),  # distance of the nearest strip edge in front of the plane, less safe_distance_m
    ("middle_m", np.float64),  # forward distance in the middle
    *MOMENTS,
    ("cluster", np.int32),
    ("support", np.int32),  # of its strips, in 1/PX source pixels; negative: the plane does not exist any more
    ("filled_rows", np.int32),  # rows of its strips that were not measured
    ("cut", np.int32),  # CUT_TOP, CUT_BOTTOM, see strips.py
    ("irregular", np.int32),  # support of its irregular strips, in 1/PX source pixels
    ("inferred", np.int32),  # 1 if no part of it was measured
    ("rows", np.int32),  # rows of its strips
    ("columns", np.int32),  # columns that have a strip
    ("last_column", np.int32),  # of the strips counted so far
)
"""A plane."""


class PlaneTables(NamedTuple):
    """Tables of N planes."""

    planes: Any  # (N,) PLANE
    plane_of: Any  # (N,) int32, the plane of a track
    parent: Any  # (N,) int32, the plane into which a plane was merged, at first itself


MOST_M = 1e9
"""Distance of a line that does not cross a ray, or crosses it beyond 1/LEAST_S metres."""
LEAST_S = 1e-6


@inner
def distance_at(plane, t):
    """Returns the forward distance x of a plane at tangent t; MOST_M if its line does not cross that ray."""
    s = plane.a + plane.b * t
    return 1.0 / s if s > LEAST_S else MOST_M


@inner
def planes_from_tracks(count, tracks, settings, tables):
    """Makes a plane of each track, with line, moments and ends. `measure_planes` computes heights and support."""
    planes, plane_of, parent = tables
    half = settings.half_column_t
    for k in range(count):
        track, plane = tracks[k], planes[k]
        plane.a, plane.b = track.a, track.b
        copy_moments(plane, track)
        plane.t0, plane.t1 = track.first_t - half, track.last_t + half
        plane.inferred = 0
        plane_of[k], parent[k] = k, k


@kernel
def measure_planes(strips, view, settings, count, tables):
    """Computes heights, support, rows, columns, cuts, cluster and front_m of every plane from its strips.

    tables: PlaneTables, planes in and out. front_m is the greatest `near_excess_m` of the strips."""
    planes, length = tables.planes, np.empty(count)
    for k in range(count):
        p = planes[k]
        length[k] = math.hypot(p.a, p.b)
        p.top_m, p.bottom_m, p.front_m = MOST_M, -MOST_M, -MOST_M
        p.support, p.filled_rows, p.cut, p.irregular = 0, 0, 0, 0
        p.rows, p.columns, p.last_column = 0, 0, -1
        p.middle_m = distance_at(p, 0.5 * (p.t0 + p.t1))
    for i in range(strips.count):
        strip = strips.table[i]
        if strip.support == 0:
            continue
        k = tables.plane_of[strip.track]
        p = planes[k]
        t = tangent(strip, view)
        x = distance_at(p, t)
        top = x * (view.tan_edge[strip.top_row] - settings.footprint_t)
        bottom = x * (view.tan_edge[strip.bottom_row + 1] + settings.footprint_t)
        if top < p.top_m:
            p.top_m = top
            p.cut = (p.cut & ~CUT_TOP) | (strip.cut & CUT_TOP)
        if bottom > p.bottom_m:
            p.bottom_m = bottom
            p.cut = (p.cut & ~CUT_BOTTOM) | (strip.cut & CUT_BOTTOM)
        p.support += strip.support
        p.filled_rows += strip.filled_rows
        p.rows += strip.bottom_row - strip.top_row + 1
        if strip.column != p.last_column:  # the strips are in the order of columns
            p.columns += 1
            p.last_column = strip.column
        p.irregular += strip.support if strip.kind >= IRREGULAR else 0
        p.cluster = strip.cluster
        p.front_m = max(p.front_m, near_excess_m(strip, x, t, p, length[k], view.f_px, settings))


@inner
def near_excess_m(strip, x, t, plane, length, f_px, settings):
    """Returns the distance of the near edge of a strip in front of its plane, beyond what is allowed, in metres.

    It is measured perpendicular to the plane and exceeds safe_distance_m there, or safe_along_m along the ray, by the
    result. The edge of a rough strip is not farther than rough_near_sigmas of noise behind the strip.

    Args:
        x: forward distance of the plane at the tangent of the strip.
        t: tangent of the strip.
        length: hypot(a, b) of the plane.
        f_px: focal length of the view."""
    near = strip.near_px
    if strip.kind != SMOOTH:
        near = max(near, strip.disparity_px - settings.rough_near_sigmas * strip.sigma_px)
    ray = (x - f_px / near) * math.sqrt(1.0 + t * t)
    cosine = incidence_cosine(plane.a, plane.b, length, t)
    return max(ray * cosine - settings.safe_distance_m, (ray - settings.safe_along_m) * cosine)


@inner
def shift_to_near_side(count, planes, least_m):
    """Moves each plane towards the camera by front_m if that is positive, but not nearer than least_m. front_m
    becomes 0.

    Tops below the camera and bottoms above it move along their rays, so that the plane still blocks the same rays."""
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
    """Extends each plane by a tangent on all four sides, which compensates for the removal of ramps at outlines."""
    for k in range(count):
        p = planes[k]
        p.t0 -= tangent_more
        p.t1 += tangent_more
        p.top_m -= tangent_more * p.middle_m
        p.bottom_m += tangent_more * p.middle_m


@inner
def compact_planes(count, tracks, tables):
    """Moves the planes that exist to the front and assigns each track its plane; returns the number of planes.

    count, tracks: numbers of planes and tracks; tables: PlaneTables."""
    planes, plane_of, parent = tables
    alive = 0
    for k in range(count):
        if planes[k].support >= 0:
            planes[alive] = planes[k]
            parent[k] = -1 - alive  # negative: the new index
            alive += 1
    for t in range(tracks):
        k = plane_of[t]
        for _ in range(count):
            if parent[k] < 0:
                break
            k = parent[k]
        plane_of[t] = -1 - parent[k]
    return alive
