"""Sliding windows (Section 4.2, Eq. 7 and 8): finds the rows of one peak of one column and makes strips of them.

Input: the labels of a column and a peak of its density. Output: strips, appended to the table. Accepted windows join
to segments. A segment is split where its depth steps, and each part is a strip."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline
from .row_mask import NO_PEAK, TAKEN, ends_of
from .strips import ROUGH, SMOOTH, Pixels, emit


class Peak(NamedTuple):
    """A peak of the density of a column."""

    label: Any  # index of the peak, which is the label of its rows
    disparity_px: Any  # disparity at the greatest count
    low_code: Any  # least quantised disparity of its interval
    high_code: Any  # greatest quantised disparity of its interval
    rough: Any  # True if the interval is wider than noise and kernel


class WindowBuffers(NamedTuple):
    """Scratch memory of `slide_windows` for columns of V rows."""

    sums_open: Any  # (V + 1,) int64, see `running_sums`
    sums_own: Any  # (V + 1,) int64, see `running_sums`
    codes: Any  # (V,) int32
    parts: Any  # (3, more than V / band_rows) int64, see `split_bands`


@inner_inline
def rows_missed(labels, label, top, bottom, count, gap):
    """Returns the number of rows of top..bottom that lie in gaps of more than `gap` rows without this label.

    These rows were not measured at this distance. count: the number of rows with this label in top..bottom."""
    if bottom - top + 1 - count <= gap:
        return 0
    missed = 0
    at = top
    for _ in range(bottom - top):
        at += gap + 1  # a gap of more than `gap` rows contains one of these rows
        if at >= bottom:
            break
        if labels[at] != label:
            first = at
            for _a in range(gap):
                if labels[first - 1] == label:
                    break
                first -= 1
            for _a in range(bottom - at):
                if labels[at] == label:
                    break
                at += 1
            if at - first > gap:
                missed += at - first
    return missed


@inner_inline
def running_sums(line, labels, label, first, last, sums_open, sums_own):
    """Computes sums over the rows first..v - 1 for each row v, of the open rows and of those with this label.

    An element holds the number of pixels, times 2^32, plus the sum of their codes. The difference of two elements
    gives the number and sum of the rows between.

    Args:
        labels: (V,) uint8.
        label: label of the peak.
        first, last: rows.
        sums_open: (V + 1,) int64 out, of the open rows.
        sums_own: (V + 1,) int64 out, of the rows with this label."""
    label = np.uint8(label)
    open_sum, own_sum = np.int64(0), np.int64(0)
    for v in range(np.uint64(first), np.uint64(last + 1)):
        sums_open[v], sums_own[v] = open_sum, own_sum
        one = (np.int64(1) << 32) + np.int64(line[v])
        open_sum += one if labels[v] <= NO_PEAK else np.int64(0)
        own_sum += one if labels[v] == label else np.int64(0)
    sums_open[last + 1], sums_own[last + 1] = open_sum, own_sum


@inner_inline
def rows_between(sums, begin, end):
    """Returns the number of pixels in the rows begin..end - 1 and the sum of their codes. sums: of `running_sums`."""
    both = sums[end] - sums[begin]
    return both >> 32, both & 0xFFFFFFFF


@inner_inline
def split_bands(sums_own, top, bottom, settings, parts):
    """Splits a run of rows where its depth steps; returns the number of parts (not in the paper).

    Means of short bands are compared with the mean of the part so far. A new part begins where two bands in a row
    differ by more than band_step_m and the noise of both means.

    Args:
        sums_own: (V + 1,) int64 of `running_sums`.
        top, bottom: first and last row of the run.
        parts: (3, more than rows / band_rows) int64 out: first row, number of pixels, sum of their codes."""
    high = settings.band_rows
    k = 0
    parts[0, 0] = top
    part_n, part_sum = 0, 0
    pending, pending_n, pending_sum = -1, 0, 0  # the band before, if it differs from the part
    for v0 in range(top, bottom + 1, high):
        n, total = rows_between(sums_own, v0, min(bottom + 1, v0 + high))
        if n == 0:
            continue
        if part_n == 0 or abs(total * part_n - part_sum * n) <= band_tolerance(part_sum, part_n, n, settings):
            part_n, part_sum = part_n + n + pending_n, part_sum + total + pending_sum
            pending, pending_n, pending_sum = -1, 0, 0
        elif pending < 0:
            pending, pending_n, pending_sum = v0, n, total
        else:
            parts[1, k], parts[2, k] = part_n, part_sum
            k += 1
            parts[0, k] = pending
            part_n, part_sum = pending_n + n, pending_sum + total
            pending, pending_n, pending_sum = -1, 0, 0
    parts[1, k], parts[2, k] = part_n + pending_n, part_sum + pending_sum
    return k + 1


@inner
def band_tolerance(part_sum, part_n, n, settings):
    """Returns the greatest |total part_n - part_sum n| at which a band of n pixels with this total agrees with the part
    so far.

    Their means of disparity differ by total / n - part_sum / part_n, in codes. part_sum, part_n: sum and number of the
    codes of the part."""
    mean = part_sum / (settings.lsb_per_px * part_n)
    noise = settings.band_sigmas * settings.sigma_d_px * math.sqrt(1.0 / n + 1.0 / part_n)
    return max(settings.band_step_m * mean * mean / settings.f_px, noise) * settings.lsb_per_px * (n * part_n)


@inner_inline
def window_half_rows(disparity_px, settings, rows):
    """Returns half of the length of a window in rows (Eq. 7 and 8).

    The length is Hs f / Z_near with Z_near = max(Z/2, Z - ke Z^2), limited to window_min_px .. rows. Z - ke Z^2 of
    Eq. 8 has its maximum at Z = 1/(2 ke), where it is Z/2; beyond that Z/2 is used (ours)."""
    z = settings.f_px / disparity_px
    z_near = max(0.5 * z, z - settings.ke_per_m * z * z)
    length = min(max(settings.passable_height_m * settings.f_px / z_near, settings.window_min_px), rows)
    return max(1, int(length / 2.0 + 0.5))


@inner_inline
def slide_windows(column, peak, first, last, settings, buffers, out):
    """Finds the segments of one peak among the rows first..last and makes strips of them (Section 4.2).

    A window is accepted if most of its open pixels belong to the peak and their mean lies in its interval. Windows
    are half a window apart. Consecutive accepted windows form a segment, which ends at its first and last row of the
    peak. The search continues after a segment, so that one peak can give several (such as the lintel above a window).
    first, last: rows."""
    label = peak.label
    first, last = ends_of(column.label, label, first, last)
    if first > last:
        return
    sums_open, sums_own = buffers.sums_open, buffers.sums_own
    running_sums(column.line, column.label, label, first, last, sums_open, sums_own)
    half = window_half_rows(peak.disparity_px, settings, column.line.shape[0])
    need = min(settings.window_min_px, settings.window_members)
    count = (last - first) // half + 1
    run = -1
    for j in range(count):
        begin, end = first + j * half, min(last + 1, first + (j + 2) * half)
        own, _ = rows_between(sums_own, begin, end)
        n, total = rows_between(sums_open, begin, end)
        good = own >= need and own > settings.window_majority * n
        good = good and peak.low_code * n <= total <= peak.high_code * n
        if good and run < 0:
            run = j
        if run >= 0 and (not good or j == count - 1):
            finish_segment(column, peak, first + run * half, min(last, begin + half - 1), settings, buffers, out)
            run = -1


@inner_inline
def finish_segment(column, peak, top, bottom, settings, buffers, out):
    """Makes strips of the rows top..bottom of one segment, split by `split_bands`.

    Its open rows that are not nearer than the peak are labelled TAKEN, those of other peaks included."""
    line, labels, parts = column.line, column.label, buffers.parts
    top, bottom = ends_of(labels, peak.label, top, bottom)
    if top > bottom:
        return
    u_top, u_end = np.uint64(top), np.uint64(bottom + 1)
    own_codes = buffers.codes
    if peak.rough:
        own = np.uint8(peak.label)
        for v in range(u_top, u_end):
            own_codes[v] = line[v] * (labels[v] == own)
    kind = ROUGH if peak.rough else SMOOTH
    count = split_bands(buffers.sums_own, top, bottom, settings, parts)
    for k in range(count):
        a, b = parts[0, k], bottom if k == count - 1 else parts[0, k + 1] - 1
        a, b = ends_of(labels, peak.label, a, b)
        members = parts[1, k]
        filled = rows_missed(labels, peak.label, a, b, members, settings.irregular_gap_px)
        pixels = Pixels(own_codes, a, b + 1, members, parts[2, k], a, b, filled)
        emit(pixels, peak.rough, kind, column, settings, out)
    tail = np.uint16(
        min(peak.high_code + settings.window_take_sigmas * settings.sigma_d_px * settings.lsb_per_px, 65535.0)
    )
    for v in range(u_top, u_end):
        labels[v] = max(labels[v], TAKEN if line[v] <= tail else np.uint8(0))
