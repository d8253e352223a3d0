"""Strips that stand out in front of a plane, and are too few to be its surface, become a plane of their own.

`shift_to_near_side` moves a whole plane in front of the nearest edge among its strips. That is right where near edges scatter,
as those of leaves do. One leaf or stray pixel that grew into the piece of a wall would bring the whole wall to its own
distance. So the few strips that stand out farthest are split off, where that spares the rest much more of a shift than
its strips scatter. Nothing is lost: each becomes a strip of another plane, which is shifted to its near side as all are.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel, record
from .line_fit import add_point, clear_moments, fit_line, misfit
from .planes import distance_at, near_excess_m
from .segments import is_jump, strip_variance, tangent

STEPS, _STEP_M = 32, 0.05
"""Not tuning: excesses are counted in so many steps; a greater one counts in the last."""
_LOOK_BACK = 32
"""Not tuning: new planes, the latest first, that a strip may go on with."""

NEW_PLANE = record(("plane", np.int32), ("last_strip", np.int32))
"""The plane that a new one was split off, and the last strip of the new one."""


class OutlierBuffers(NamedTuple):
    """Scratch for n strips and N planes: excess_m (n,) float32, of each strip; above (N, STEPS) float64: support of the
    strips of a plane by the step of their excess; least_m (N,) float64: excess from which strips are split off; new (N,)
    NEW_PLANE."""

    excess_m: NDArray[np.float32]
    above: NDArray[np.float64]
    least_m: NDArray[np.float64]
    new: NDArray[Any]


def outlier_buffers(strips: int, planes: int) -> OutlierBuffers:
    """Scratch for so many strips and planes."""
    return OutlierBuffers(
        np.zeros(strips + 1, np.float32),
        np.zeros((planes, STEPS)),
        np.zeros(planes),
        np.zeros(planes, NEW_PLANE),
    )


@kernel
def measure_excess(strips, n, view, settings, count, plane_of, planes, excess_m, above):
    """excess_m (n,) out: `near_excess_m` of each strip over its plane. above (count, STEPS) out: support of the strips of a
    plane by the step of their excess; a strip without any counts nowhere.

    Tables as `measure_planes` left them."""
    above[:count] = 0.0
    length = np.empty(count)
    for k in range(count):
        length[k] = math.hypot(planes[k].a, planes[k].b)
    for i in range(n):
        strip = strips[i]
        if strip.support == 0:
            excess_m[i] = -1.0
            continue
        k = plane_of[strip.track]
        t = tangent(strip, view)
        excess_m[i] = near_excess_m(strip, distance_at(planes[k], t), t, planes[k], length[k], view.f_px, settings)
        if excess_m[i] > 0.0:
            above[k, min(int(excess_m[i] / _STEP_M), STEPS - 1)] += strip.support


@inner
def outlier_limits(count, planes, settings, above, least_m):
    """least_m (count,) out: excess from which strips are split off their plane, infinite where none is.

    They hold at most stand_out_share of its support, and the rest is spared a shift by stand_out_m and by
    stand_out_spreads times how far its strips lie from its line, root mean square."""
    for k in range(count):
        p = planes[k]
        least_m[k] = math.inf
        if p.front_m <= settings.stand_out_m:
            continue
        first, held = STEPS, 0.0
        for back in range(STEPS):
            held += above[k, STEPS - 1 - back]
            if held > settings.stand_out_share * p.support:
                break
            first = STEPS - 1 - back
        w, s = p.sum_w, p.sum_s
        square = misfit(w, p.sum_t, s, p.sum_tt, p.sum_ts, p.sum_ss, p.a, p.b)
        spread_m = math.sqrt(square) * (w / s) * (w / s)
        if p.front_m - first * _STEP_M >= max(settings.stand_out_m, settings.stand_out_spreads * spread_m):
            least_m[k] = first * _STEP_M


@inner
def split_outliers(strips, n, view, settings, count, tracks, plane_of, planes, buffers):
    """Makes planes of the strips whose excess is at least that of their plane; returns the number of all planes.

    A strip goes on with the latest new plane split off its own that it touches in rows and meets in depth (`is_jump`), at
    most link_gap_px columns on. buffers: OutlierBuffers, filled by `measure_excess` and `outlier_limits`. There must be
    room for one more plane and track a strip, the new tracks from `tracks` on. Lines and ends of the new planes are
    written; all else, and the heights of the old ones, must be measured anew."""
    new, excess_m, half = buffers.new, buffers.excess_m, settings.half_column_t
    slope_weight = 1.0 / (settings.link_slope_px * settings.link_slope_px)
    total = count
    for i in range(n):
        if excess_m[i] <= 0.0:
            continue
        strip = strips[i]
        k = plane_of[strip.track]
        if excess_m[i] < buffers.least_m[k]:
            continue
        at = -1
        for back in range(min(_LOOK_BACK, total - count)):
            q = total - 1 - back
            last = strips[new[q].last_strip]
            if new[q].plane != k or strip.column - last.column > settings.link_gap_px:
                continue
            if strip.top_row > last.bottom_row + 1 or last.top_row > strip.bottom_row + 1:
                continue
            if not is_jump(strip, last, settings):
                at = q
                break
        t = tangent(strip, view)
        if at < 0:
            at = total
            total += 1
            new[at].plane = k
            plane_of[tracks + at - count] = at
            planes[at].inferred = 0
            clear_moments(planes[at])
            planes[at].t0, planes[at].t1 = t - half, t + half
        new[at].last_strip = i
        plane = planes[at]
        plane.t0, plane.t1 = min(plane.t0, t - half), max(plane.t1, t + half)
        variance = strip_variance(strip.disparity_px, strip.sigma_px, view.f_px, settings.roughness_m)
        add_point(plane, t, strip.disparity_px / view.f_px, 1.0 / variance)
        strip.track = tracks + at - count
    for k in range(count, total):
        a, b, _, _ = fit_line(planes[k], slope_weight)
        planes[k].a, planes[k].b = a, b
    return total
