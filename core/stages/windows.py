"""Section 4.2 for one peak of one column: windows are accepted, join to segments, and segments become strips."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline
from .row_mask import NO_PEAK, TAKEN, ends_of
from .strips import ROUGH, SMOOTH, Pixels, emit


class Peak(NamedTuple):
    """A peak of the density: its label in the column, disparity in px, the quantised disparities that it reaches from and
    to, and whether it is wider than noise and kernel."""

    label: Any
    disparity_px: Any
    low_code: Any
    high_code: Any
    rough: Any


class WindowBuffers(NamedTuple):
    """Scratch of `slide_windows` for columns of V rows: sums_open, sums_own (V + 1,) int64, see `running_sums`;
    codes (2, V) int32; parts (3, more than V / band_rows) int64, see `split_bands`."""

    sums_open: Any
    sums_own: Any
    codes: Any
    parts: Any


@inner_inline
def rows_missed(labels, label, top, bottom, count, gap):
    """Rows top..bottom that lie in gaps of more than `gap` rows without one of the `count` pixels that have this label:
    they were not measured at this distance."""
    if bottom - top + 1 - count <= gap:
        return 0
    missed = 0
    at = top
    for _ in range(bottom - top):
        at += gap + 1  # no gap is passed over
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
    """Sums over the rows of first..last before a row, (V + 1,) int64: of the open rows in `sums_open`, of those with this
    label in `sums_own`. Each holds the number of pixels, times 2^32, and the sum of their quantised disparity: the
    difference of two is that of the rows between."""
    label = np.uint8(label)
    open_sum, own_sum = np.int64(0), np.int64(0)
    for v in range(np.uint64(first), np.uint64(last + 1)):
        sums_open[v], sums_own[v] = open_sum, own_sum
        one = (np.int64(1) << 32) + np.int64(line[v])
        open_sum += one if labels[v] <= NO_PEAK else np.int64(0)
        own_sum += one if labels[v] == label else np.int64(0)
    sums_open[last + 1], sums_own[last + 1] = open_sum, own_sum


@inner_inline
def split_bands(sums_own, top, bottom, least, settings, parts):
    """Where a run of pixels steps in depth: returns the number of its parts. sums_own: see `running_sums`. parts:
    (3, > rows / band_rows) int64 out: first row, number of pixels, sum of their quantised disparity.

    Means of short bands are compared with the mean of the part so far; two bands in a row must be off, by the
    greater of band_step_m and the noise of both means, for a new part to begin. least: no pixel has a lesser code."""
    high = settings.band_rows
    q = settings.lsb_per_px
    # what is below this bound needs no closer look: the step at the farthest pixel, the noise of a full band
    far = least / q
    alike = max(
        settings.band_step_m * far * far / settings.f_px,
        settings.band_sigmas * settings.sigma_d_px / math.sqrt(1.0 * high),
    )
    alike *= (1.0 - 1e-9) * q
    k = 0
    parts[0, 0] = top
    part_sum, part_n = np.int64(0), np.int64(0)
    none = np.int64(-1)
    pending = none
    held_sum, held_n = np.int64(0), np.int64(0)
    before = sums_own[top]
    for v0 in range(top, bottom + 1, high):
        behind = sums_own[min(bottom + 1, v0 + high)]
        c, s = (behind - before) >> 32, (behind - before) & 0xFFFFFFFF
        before = behind
        if c == 0:
            continue
        off = abs(s * part_n - part_sum * c)
        if part_n == 0 or off <= alike * (c * part_n) or off <= band_tolerance(part_sum, part_n, c, settings):
            part_sum, part_n = part_sum + s + held_sum, part_n + c + held_n
            pending, held_sum, held_n = none, np.int64(0), np.int64(0)
        elif pending < 0:
            pending, held_sum, held_n = np.int64(v0), s, c
        else:
            parts[1, k], parts[2, k] = part_n, part_sum
            k += 1
            parts[0, k] = pending
            part_sum, part_n = held_sum + s, held_n + c
            pending, held_sum, held_n = none, np.int64(0), np.int64(0)
    parts[1, k], parts[2, k] = part_n + held_n, part_sum + held_sum
    return k + 1


@inner
def band_tolerance(part_sum, part_n, c, settings):
    """How far the mean of a band of c pixels may be off that of the part so far, as |s part_n - part_sum c| in codes."""
    mean = part_sum / (settings.lsb_per_px * part_n)
    noise = settings.band_sigmas * settings.sigma_d_px * math.sqrt(1.0 / c + 1.0 / part_n)
    return max(settings.band_step_m * mean * mean / settings.f_px, noise) * settings.lsb_per_px * (c * part_n)


@inner_inline
def window_half_rows(disparity_px, settings, rows):
    """Half the window's length (Eq. 7, 8): Hs * g(x) px with Z_near = max(Z/2, Z - ke Z^2), in [least, V].

    Z - ke Z^2 turns around at Z = 1/(2 ke), where it is Z/2."""
    z = settings.f_px / disparity_px
    z_near = max(0.5 * z, z - settings.depth_noise_coeff * z * z)
    length = min(max(settings.passable_height_m * settings.f_px / z_near, settings.window_min_px), rows)
    return max(1, int(length / 2.0 + 0.5))


@inner_inline
def slide_windows(column, peak, first, last, settings, buffers, out):
    """Section 4.2 for one peak, among the rows first..last: accepted windows become segments, segments strips.

    A window is accepted when most of its valid pixels belong to the peak and their mean lies in its interval. A segment
    ends at its first and last members. The scan goes on after an end, so a peak can give several segments (the lintel
    over a window). What a segment covers and is not nearer than the peak is taken with it. Windows are half a window
    apart. settings: a record of STRIP_SETTINGS; buffers: WindowBuffers; out: StripOutput."""
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
        m, valid = (sums_own[end] - sums_own[begin]) >> 32, sums_open[end] - sums_open[begin]
        valid, s = valid >> 32, valid & 0xFFFFFFFF
        good = (
            m >= need and m > settings.window_majority * valid and peak.low_code * valid <= s <= peak.high_code * valid
        )
        if good and run < 0:
            run = j
        if run >= 0 and (not good or j == count - 1):
            finish_segment(column, peak, first + run * half, min(last, begin + half - 1), settings, buffers, out)
            run = -1


@inner_inline
def finish_segment(column, peak, top, bottom, settings, buffers, out):
    """Strips of one accepted run of rows top..bottom, split where it steps; its pixels are taken."""
    line, labels, parts = column.line, column.label, buffers.parts
    top, bottom = ends_of(labels, peak.label, top, bottom)
    if top > bottom:
        return
    u_top, u_end = np.uint64(top), np.uint64(bottom + 1)
    own_codes = buffers.codes[1]
    if peak.rough:
        own = np.uint8(peak.label)
        for v in range(u_top, u_end):
            own_codes[v] = line[v] * (labels[v] == own)
    kind = ROUGH if peak.rough else SMOOTH
    count = split_bands(buffers.sums_own, top, bottom, peak.low_code, settings, parts)
    for k in range(count):
        a, b = parts[0, k], bottom if k == count - 1 else parts[0, k + 1] - 1
        a, b = ends_of(labels, peak.label, a, b)
        members = parts[1, k]
        filled = rows_missed(labels, peak.label, a, b, members, settings.irregular_gap_px)
        pixels = Pixels(own_codes, a, b + 1, members, parts[2, k], a, b, filled)
        emit(pixels, peak.rough, kind, column, settings, buffers.codes[0], out)
    tail = np.uint16(
        min(peak.high_code + settings.window_take_sigmas * settings.sigma_d_px * settings.lsb_per_px, 65535.0)
    )
    for v in range(u_top, u_end):
        labels[v] = max(labels[v], TAKEN if line[v] <= tail else np.uint8(0))
