"""Splits off the strips of a plane that are far in front of it and too few to be its surface (not in the paper).

Input and output: the tables of planes and strips. `shift_to_near_side` moves a plane in front of the nearest edge of
its strips. That is correct where the near edges scatter, as in foliage. A single leaf or stray pixel that became part
of a wall would move the whole wall to its own distance. So the few strips that are farthest in front become planes of
their own, if the rest is then moved much less, compared with the scatter of its strips. No strip is lost."""

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
"""Number and size of the steps in which excesses are counted; greater ones count in the last step."""
_LOOK_BACK = 32
"""Number of new planes, the latest first, to which a strip may be added."""

NEW_PLANE = record(("plane", np.int32), ("last_strip", np.int32))
"""The plane from which a new one was split off, and the last strip of the new one."""


class OutlierBuffers(NamedTuple):
    """Scratch memory for n strips and N planes."""

    excess_m: NDArray[np.float32]  # (n,), `near_excess_m` of each strip
    above: NDArray[np.float64]  # (N, STEPS), support of the strips of a plane by step of their excess
    least_m: NDArray[np.float64]  # (N,), excess from which strips of a plane are split off
    new: NDArray[Any]  # (N,) NEW_PLANE


def outlier_buffers(strips: int, planes: int) -> OutlierBuffers:
    """Allocates scratch memory for this number of strips and planes."""
    return OutlierBuffers(
        np.zeros(strips + 1, np.float32),
        np.zeros((planes, STEPS)),
        np.zeros(planes),
        np.zeros(planes, NEW_PLANE),
    )


@kernel
def measure_excess(strips, view, settings, count, tables, buffers):
    """Computes `near_excess_m` of each strip, and the support of the strips of each plane by step of their excess:
    excess_m and above of OutlierBuffers.

    Strips without an excess are not counted. The other arguments are those of `measure_planes`."""
    planes, excess_m, above = tables.planes, buffers.excess_m, buffers.above
    above[:count] = 0.0
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


@inner
def outlier_limits(count, planes, settings, buffers):
    """Computes the excess from which strips are split off each plane: least_m of OutlierBuffers, infinite if none are.

    Those strips have at most stand_out_share of the support of the plane. Without them the plane is moved less, by at
    least stand_out_m and at least stand_out_spreads times the root mean square distance of its strips from its line."""
    above, least_m = buffers.above, buffers.least_m
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


@inner
def split_outliers(strips, view, settings, count, tracks, tables, buffers):
    """Makes planes of the strips whose excess is at least the limit of their plane; returns the number of all planes.

    A strip is added to the plane of `split_off_before`, or begins a new one. Line and ends of the new planes are written;
    all else must be measured again, also the heights of the old planes.

    Args:
        strips: StripList, in and out.
        tracks: number of tracks. New tracks are numbered from there on.
        tables: PlaneTables, in and out, with room for one more plane and track per strip.
        buffers: OutlierBuffers, filled by `measure_excess` and `outlier_limits`."""
    planes, plane_of, table = tables.planes, tables.plane_of, strips.table
    new, excess_m, half = buffers.new, buffers.excess_m, settings.half_column_t
    total = count
    for i in range(strips.count):
        if excess_m[i] <= 0.0:
            continue
        strip = table[i]
        k = plane_of[strip.track]
        if excess_m[i] < buffers.least_m[k]:
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
