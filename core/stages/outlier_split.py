"""Splits off the strips of a plane that are far in front of it and too few to be its surface (not in the paper).

Input and output: the tables of planes and strips. `shift_to_near_side` moves a plane in front of the nearest edge of
its strips. That is correct where the near edges scatter, as in foliage. A single leaf or stray pixel that became part
of a wall would move the whole wall to its own distance. So the few strips that are farthest in front become planes of
their own, if the rest is then moved much less, compared with the scatter of its strips. No strip is lost."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, record
from .line_fit import add_point, clear_moments, fit_line, misfit
from .planes import distance_at, near_excess_m
from .segments import is_jump, strip_variance, tangent

STEPS, _STEP_M = 32, 0.05
"""Number and size of the steps in which excesses are counted; greater ones count in the last step."""
_LOOK_BACK = 32
"""Number of new planes, the latest first, to which a strip may be added."""

NEW_PLANE = record(("plane", np.int32), ("last_strip", np.int32))
"""The plane from which a new one was split off, and the last strip of the new one."""


@kernel
def measure_excess(strips, view, settings, count, tables):
    """Returns `near_excess_m` of each strip, (n,) float32, and the support of the strips of each plane by step of their
    excess, (count, STEPS) float64.

    Strips without an excess are not counted."""
    planes, excess_m, above = tables.planes, np.empty(strips.count, np.float32), np.zeros((count, STEPS))
    length = np.empty(count)
    for k in range(count):
        length[k] = math.hypot(planes[k].a, planes[k].b)
    for i in range(strips.count):
        strip = strips.table[i]
        if strip.support == 0:
            excess_m[i] = -1.0
            continue
        k = tables.plane_of[strip.track]
        t = tangent(strip, view)
        excess_m[i] = near_excess_m(strip, distance_at(planes[k], t), t, planes[k], length[k], view.f_px, settings)
        if excess_m[i] > 0.0:
            above[k, min(int(excess_m[i] / _STEP_M), STEPS - 1)] += strip.support
    return excess_m, above


@inner
def outlier_limit_m(plane, above, settings):
    """Returns the excess from which strips are split off a plane, m; infinite if none are.

    Those strips have at most stand_out_share of the support of the plane. Without them the plane is moved less, by at
    least stand_out_m and at least stand_out_spreads times the root mean square distance of its strips from its line.
    above: (STEPS,) of `measure_excess`."""
    if plane.front_m <= settings.stand_out_m:
        return math.inf
    first, held = STEPS, 0.0
    for back in range(STEPS):
        held += above[STEPS - 1 - back]
        if held > settings.stand_out_share * plane.support:
            break
        first = STEPS - 1 - back
    w, s = plane.sum_w, plane.sum_s
    square = misfit(w, plane.sum_t, s, plane.sum_tt, plane.sum_ts, plane.sum_ss, plane.a, plane.b)
    spread_m = math.sqrt(square) * (w / s) * (w / s)
    least_m = max(settings.stand_out_m, settings.stand_out_spreads * spread_m)
    return first * _STEP_M if plane.front_m - first * _STEP_M >= least_m else math.inf


@inner
def split_off_before(strip, k, strips, new, gap_px):
    """Returns the index in `new` of the latest plane that was split off plane k and that this strip continues; -1: none.

    It continues one whose last strip it touches in rows, without a depth jump (`is_jump`), at most gap_px columns away.
    strips: (N,) STRIP; new: (M,) NEW_PLANE, of which the last _LOOK_BACK are searched."""
    for back in range(min(_LOOK_BACK, len(new))):
        q = len(new) - 1 - back
        last = strips[new[q].last_strip]
        if new[q].plane != k or strip.column - last.column > gap_px:
            continue
        if strip.top_row > last.bottom_row + 1 or last.top_row > strip.bottom_row + 1:
            continue
        if not is_jump(strip, last):
            return q
    return -1


@kernel
def split_outliers(strips, view, settings, count, tracks, tables):
    """Makes planes of the strips whose excess is at least the limit of their plane; returns the number of all planes.

    A strip is added to the plane of `split_off_before`, or begins a new one. Line and ends of the new planes are written;
    all else must be measured again, also the heights of the old planes.

    Args:
        strips: in and out.
        tracks: number of tracks. New tracks are numbered from there on.
        tables: in and out, with room for one more plane and track per strip."""
    planes, plane_of, table, half = tables.planes, tables.plane_of, strips.table, settings.half_column_t
    excess_m, above = measure_excess(strips, view, settings, count, tables)
    least_m, new = np.empty(count), np.empty(len(planes), NEW_PLANE)
    for k in range(count):
        least_m[k] = outlier_limit_m(planes[k], above[k], settings)
    total = count
    for i in range(strips.count):
        if excess_m[i] <= 0.0:
            continue
        strip = table[i]
        k = plane_of[strip.track]
        if excess_m[i] < least_m[k]:
            continue
        at = split_off_before(strip, k, table, new[count:total], settings.link_gap_px)
        t = tangent(strip, view)
        if at >= 0:
            at += count
        else:
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
        variance = strip_variance(strip.disparity_px, strip.sigma_px, view.f_px)
        add_point(plane, t, strip.disparity_px / view.f_px, 1.0 / variance)
        strip.track = tracks + at - count
    for k in range(count, total):
        a, b, _, _ = fit_line(planes[k], settings.slope_prior)
        planes[k].a, planes[k].b = a, b
    return total
