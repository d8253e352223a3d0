"""Section 5.1: gaps between strips of one column that the vehicle cannot pass are filled.

A gap lower than Hs is filled. A gap of Hs or more is kept only where it is open over a width of Ws or more, or opens to a
side; a slit between solid sides is filled. Filling joins neighbours only, never the space under a whole bridge,
and what was filled without having been seen is counted, so that its plane says INFERRED.
"""

from __future__ import annotations

import math

from ..jit import copy_row, inner
from .clusters import Z_BOTTOM, Z_TOP, X
from .strips import BOTTOM, CLUSTER, FILL, NEAR, SIGMA, SUPPORT, TOP, D

MAX_RUNS = 32
"""Room for the runs of gaps that are open at one time: what does not fit stays open, which is never wrong."""
# columns of the table of open runs of gaps
R_FIRST, R_LAST, R_CLUSTER = range(3)


@inner
def fill_gap(ints, floats, i, j, f, step_m, sigmas):
    """Closes the gap between strip i and strip j below it: one strip where they lie on one surface, else the farther grows."""
    rows = ints[j, TOP] - ints[i, BOTTOM] - 1
    d = min(floats[i, D], floats[j, D])
    noise = sigmas * math.hypot(floats[i, SIGMA], floats[j, SIGMA])
    if abs(floats[i, D] - floats[j, D]) <= max(step_m * d * d / f, noise):
        a, b = 1.0 / floats[i, SIGMA] ** 2, 1.0 / floats[j, SIGMA] ** 2
        floats[i, D] = (a * floats[i, D] + b * floats[j, D]) / (a + b)
        floats[i, NEAR] = max(floats[i, NEAR], floats[j, NEAR])
        floats[i, SIGMA] = 1.0 / math.sqrt(a + b)
        ints[i, BOTTOM] = ints[j, BOTTOM]
        ints[i, SUPPORT] += ints[j, SUPPORT]
        ints[i, FILL] += rows + ints[j, FILL]
        ints[j, SUPPORT] = 0  # joined: dropped by the caller
        return True
    if floats[i, D] <= floats[j, D]:
        ints[i, BOTTOM] = ints[j, TOP] - 1
        ints[i, FILL] += rows
    else:
        ints[j, TOP] = ints[i, BOTTOM] + 1
        ints[j, FILL] += rows
    return False


@inner
def gap_height(place, i, j):
    """Clear height between strip i and strip j below it, m."""
    return place[j, Z_TOP] - place[i, Z_BOTTOM]


@inner
def fill_columns(
    ints, floats, place, cols, first_of_column, f, column_m_per_x, hs, ws, step_m, sigmas, link, open_of, lower,
    runs, spans,
):  # fmt: skip
    """Fills gaps lower than Hs, and slits: gaps open over less than Ws and closed on both sides; returns how many slits.

    Strips in order of columns and, within one, from top to bottom; what is filled changes in `ints` and `floats`, and
    in `place` where two strips become one (the lower one's SUPPORT is 0 then).
    A gap lies between the strip of a cluster that reaches lowest so far in a column and the next one below it. A run is
    a row of neighbouring columns whose gaps share at least Hs of height. Scratch: open_of (clusters,), lower (N,),
    runs (MAX_RUNS, 3) int32, spans (MAX_RUNS, 3) float32 (top, bottom, x)."""
    open_of[:] = -1
    open_runs, filled = 0, 0
    for u in range(cols):
        first, last = first_of_column[u], first_of_column[u + 1]
        for j in range(first, last):
            lower[j] = -1
            if ints[j, SUPPORT] == 0:
                continue
            i = open_of[ints[j, CLUSTER]]
            if i >= first and ints[j, TOP] <= ints[i, BOTTOM]:
                if ints[j, BOTTOM] >= ints[i, BOTTOM]:
                    open_of[ints[j, CLUSTER]] = j
                continue
            if i >= first and gap_height(place, i, j) < hs:
                bottom = place[j, Z_BOTTOM]
                if fill_gap(ints, floats, i, j, f, step_m, sigmas):
                    place[i, Z_BOTTOM] = bottom
                    continue
            elif i >= first:
                lower[i] = j
                open_runs = _join_run(ints, place, i, j, u, hs, runs, spans, open_runs)
            open_of[ints[j, CLUSTER]] = j
        if open_runs > 0:
            open_runs, closed = _close_runs(
                ints, floats, place, cols, first_of_column, f, column_m_per_x, ws, step_m, sigmas, link, u, lower, runs,
                spans, open_runs,
            )  # fmt: skip
            filled += closed
    _, closed = _close_runs(
        ints, floats, place, cols, first_of_column, f, column_m_per_x, ws, step_m, sigmas, link, cols + link, lower, runs,
        spans, open_runs,
    )  # fmt: skip
    return filled + closed


@inner
def _close_runs(
    ints, floats, place, cols, first_of_column, f, column_m_per_x, ws, step_m, sigmas, link, u, lower, runs, spans, open_runs
):  # fmt: skip
    """Takes out the runs that column u no longer goes on with, slits being filled; returns (runs left, gaps filled)."""
    kept, filled = 0, 0
    for r in range(open_runs):
        if u - runs[r, R_LAST] <= link:
            if kept != r:
                copy_row(runs, kept, r)
                copy_row(spans, kept, r)
            kept += 1
            continue
        width = (runs[r, R_LAST] - runs[r, R_FIRST] + 1) * column_m_per_x * spans[r, 2]
        if width < ws and _bounded(ints, place, first_of_column, cols, link, ws, runs[r], spans[r]):
            filled += _fill_run(ints, floats, place, first_of_column, f, step_m, sigmas, runs[r], spans[r], lower)
    return kept, filled


@inner
def closed_at(ints, place, first, last, cluster, z, x, ws):
    """Whether a strip of the cluster among first..last-1 stands at height z, less than Ws from distance x."""
    for j in range(first, last):
        if (
            ints[j, CLUSTER] == cluster
            and ints[j, SUPPORT] > 0
            and place[j, Z_TOP] <= z <= place[j, Z_BOTTOM]
            and abs(place[j, X] - x) < ws
        ):
            return True
    return False


@inner
def _join_run(ints, place, i, j, u, hs, runs, spans, open_runs):
    """Adds the gap i-j of column u to the run whose opening it shares, or opens a run; returns the number of runs."""
    top, bottom = place[i, Z_BOTTOM], place[j, Z_TOP]
    for r in range(open_runs):
        if runs[r, R_CLUSTER] == ints[i, CLUSTER] and runs[r, R_LAST] < u:
            lo, hi = max(spans[r, 0], top), min(spans[r, 1], bottom)
            if hi - lo >= hs:
                spans[r, 0], spans[r, 1], spans[r, 2] = lo, hi, max(spans[r, 2], max(place[i, X], place[j, X]))
                runs[r, R_LAST] = u
                return open_runs
    if open_runs < MAX_RUNS:
        runs[open_runs, R_FIRST], runs[open_runs, R_LAST], runs[open_runs, R_CLUSTER] = u, u, ints[i, CLUSTER]
        spans[open_runs, 0], spans[open_runs, 1] = top, bottom
        spans[open_runs, 2] = max(place[i, X], place[j, X])
        return open_runs + 1
    return open_runs


@inner
def _bounded(ints, place, first_of_column, cols, link, ws, run, span):
    """Whether both sides of a run are closed within `link` columns at the middle of its height."""
    z = 0.5 * (span[0] + span[1])
    left = False
    right = False
    for k in range(1, link + 1):
        a, b = run[R_FIRST] - k, run[R_LAST] + k
        if a >= 0 and not left:
            left = closed_at(ints, place, first_of_column[a], first_of_column[a + 1], run[R_CLUSTER], z, span[2], ws)
        if b < cols and not right:
            right = closed_at(ints, place, first_of_column[b], first_of_column[b + 1], run[R_CLUSTER], z, span[2], ws)
    return left and right


@inner
def _fill_run(ints, floats, place, first_of_column, f, step_m, sigmas, run, span, lower):
    """Fills the gaps of one run; returns how many."""
    filled = 0
    for u in range(run[R_FIRST], run[R_LAST] + 1):
        for i in range(first_of_column[u], first_of_column[u + 1]):
            j = lower[i]
            if j < 0 or ints[i, SUPPORT] == 0 or ints[j, SUPPORT] == 0 or ints[i, CLUSTER] != run[R_CLUSTER]:
                continue
            if place[i, Z_BOTTOM] <= span[0] and place[j, Z_TOP] >= span[1]:
                fill_gap(ints, floats, i, j, f, step_m, sigmas)
                lower[i] = -1
                filled += 1
    return filled
