"""Vertical gap filling (Section 5.1): closes gaps between strips of one column that the vehicle cannot pass.

Input and output: the table of strips. A gap lower than Hs is filled. A gap of Hs or more is kept if it is open over a
width of Ws or more, or at one of its sides; a slit between closed sides is filled. The paper extends all strips of a
cluster to its full height; here only strips next to a gap are extended, so that the space below a bridge stays open.
Filled rows that were not measured are counted, and their plane is marked INFERRED."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel, record
from .line_fit import LINE_SIGMAS

MAX_RUNS = 32
"""Greatest number of runs at one time. Gaps beyond it stay open."""

RUN = record(
    ("first", np.int32),  # first and last column
    ("last", np.int32),
    ("cluster", np.int32),
    ("top_m", np.float32),  # heights that all gaps share
    ("bottom_m", np.float32),
    ("x_m", np.float32),  # greatest distance of the strips at the gaps
)
"""A run of neighbouring columns whose gaps share at least Hs of height."""


class Gaps(NamedTuple):
    """The strips of a frame, and the gaps of Hs or more between them."""

    strips: Any  # (N,) STRIP in the order of `sort_columns`
    first_of_column: Any
    lower: Any  # (N,) int32, the strip below the gap that begins at a strip, -1: none
    runs: Any  # (MAX_RUNS,) RUN


@inner
def fill_gap(strips, i, j, settings):
    """Closes the gap between strip i and strip j below it; returns True if both became one strip.

    They do if they lie on one surface. Otherwise the farther one is extended."""
    a, b = strips[i], strips[j]
    rows = b.top_row - a.bottom_row - 1
    d = min(a.disparity_px, b.disparity_px)
    noise = LINE_SIGMAS * math.hypot(a.sigma_px, b.sigma_px)
    if abs(a.disparity_px - b.disparity_px) <= max(settings.band_step_m * d * d / settings.f_px, noise):
        p, q = 1.0 / a.sigma_px**2, 1.0 / b.sigma_px**2
        a.disparity_px = (p * a.disparity_px + q * b.disparity_px) / (p + q)
        a.near_px = max(a.near_px, b.near_px)
        a.sigma_px = 1.0 / math.sqrt(p + q)
        a.bottom_row = b.bottom_row
        a.support += b.support
        a.filled_rows += rows + b.filled_rows
        b.support = 0  # joined: left out by every later stage
        return True
    if a.disparity_px <= b.disparity_px:
        a.bottom_row = b.top_row - 1
        a.filled_rows += rows
    else:
        b.top_row = a.bottom_row + 1
        b.filled_rows += rows
    return False


@kernel
def fill_columns(strips, clusters, first_of_column, settings):
    """Fills gaps lower than Hs, and slits: gaps open over less than Ws and closed on both sides; returns the number
    of slits.

    A gap lies between the strip of a cluster that reaches lowest so far in a column and the next one below it. Where
    two strips become one, the support of the lower one is 0.
    strips: (N,) STRIP in the order of `sort_columns`, in and out; clusters: number of clusters."""
    hs, cols = settings.passable_height_m, len(first_of_column) - 1
    open_of = np.full(clusters, -1, np.int32)  # the strip of a cluster that reaches lowest so far
    lower, runs = np.empty(first_of_column[cols], np.int32), np.empty(MAX_RUNS, RUN)
    gaps = Gaps(strips, first_of_column, lower, runs)
    open_runs, filled = 0, 0
    for u in range(cols):
        first, last = first_of_column[u], first_of_column[u + 1]
        for j in range(first, last):
            lower[j] = -1
            s = strips[j]
            if s.support == 0:
                continue
            i = open_of[s.cluster]
            if i >= first and s.top_row <= strips[i].bottom_row:
                if s.bottom_row >= strips[i].bottom_row:
                    open_of[s.cluster] = j
                continue
            if i >= first and s.top_m - strips[i].bottom_m < hs:
                bottom = s.bottom_m
                if fill_gap(strips, i, j, settings):
                    strips[i].bottom_m = bottom
                    continue
            elif i >= first:
                lower[i] = j
                open_runs = _join_run(strips, i, j, u, hs, runs, open_runs)
            open_of[s.cluster] = j
        if open_runs > 0:
            open_runs, closed = _close_runs(gaps, settings, u, open_runs)
            filled += closed
    _, closed = _close_runs(gaps, settings, cols + settings.link_gap_px, open_runs)
    return filled + closed


@inner
def _close_runs(gaps, settings, u, open_runs):
    """Removes the runs that do not continue in column u and fills those that are slits; returns (runs left, gaps
    filled)."""
    runs, kept, filled = gaps.runs, 0, 0
    for r in range(open_runs):
        run = runs[r]
        if u - run.last <= settings.link_gap_px:
            if kept != r:
                runs[kept] = run
            kept += 1
            continue
        width = (run.last - run.first + 1) * settings.column_t * run.x_m
        if width < settings.passable_width_m and _bounded(gaps, run, settings):
            filled += _fill_run(gaps, run, settings)
    return kept, filled


@inner
def closed_at(strips, first, last, run, ws):
    """True if a strip of first..last - 1 closes a run: same cluster, at the middle of its height, less than ws from
    its distance."""
    z = 0.5 * (run.top_m + run.bottom_m)
    for j in range(first, last):
        s = strips[j]
        if s.cluster == run.cluster and s.support > 0 and s.top_m <= z <= s.bottom_m and abs(s.x_m - run.x_m) < ws:
            return True
    return False


@inner
def _join_run(strips, i, j, u, hs, runs, open_runs):
    """Adds the gap between strips i and j in column u to the run with which it shares hs of height, or begins a run.

    Returns the number of runs."""
    above, below = strips[i], strips[j]
    top, bottom = above.bottom_m, below.top_m
    for r in range(open_runs):
        run = runs[r]
        if run.cluster == above.cluster and run.last < u:
            lo, hi = max(run.top_m, top), min(run.bottom_m, bottom)
            if hi - lo >= hs:
                run.top_m, run.bottom_m, run.x_m = lo, hi, max(run.x_m, max(above.x_m, below.x_m))
                run.last = u
                return open_runs
    if open_runs < MAX_RUNS:
        new = runs[open_runs]
        new.first, new.last, new.cluster = u, u, above.cluster
        new.top_m, new.bottom_m = top, bottom
        new.x_m = max(above.x_m, below.x_m)
        return open_runs + 1
    return open_runs


@inner
def _bounded(gaps, run, settings):
    """True if both sides of a run are closed within `link_gap_px` columns, at the middle of its height."""
    strips, first_of_column, ws = gaps.strips, gaps.first_of_column, settings.passable_width_m
    left, right = False, False
    for k in range(1, settings.link_gap_px + 1):
        a, b = run.first - k, run.last + k
        if a >= 0 and not left:
            left = closed_at(strips, first_of_column[a], first_of_column[a + 1], run, ws)
        if b < len(first_of_column) - 1 and not right:
            right = closed_at(strips, first_of_column[b], first_of_column[b + 1], run, ws)
    return left and right


@inner
def _fill_run(gaps, run, settings):
    """Fills the gaps of one run; returns their number."""
    strips, first_of_column, lower, filled = gaps.strips, gaps.first_of_column, gaps.lower, 0
    for u in range(run.first, run.last + 1):
        for i in range(first_of_column[u], first_of_column[u + 1]):
            j = lower[i]
            if j < 0 or strips[i].support == 0 or strips[j].support == 0 or strips[i].cluster != run.cluster:
                continue
            if strips[i].bottom_m <= run.top_m and strips[j].top_m >= run.bottom_m:
                fill_gap(strips, i, j, settings)
                lower[i] = -1
                filled += 1
    return filled
