"""Section 4.2 for one column: windows and the strips they give.

A strip is a vertical run of pixels at one distance: (disparity, column, first row, last row). Every kernel works
on plain arrays. Tables of strips: ints (N, 9) int32 U, TOP, BOTTOM (rows, inclusive), SUPPORT (distinct source pixels, in 1/16), KIND,
CLUSTER, TRACK, FILL (rows filled, not seen), CUT (1: top, 2: bottom cut by the image border); floats (N, 3) float32
D (disparity, px), NEAR (of the robust near edge, a lower bound), SIGMA (1 sigma of D).
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, inner_inline
from .row_mask import NO_PEAK, TAKEN, ends_of

PX = 16
"""Support is counted in sixteenths of a source pixel: where the view magnifies, a cell is less than one."""

# columns of the integer table of strips
U, TOP, BOTTOM, SUPPORT, KIND, CLUSTER, TRACK, FILL, CUT = range(9)
# columns of the float table
D, NEAR, SIGMA = range(3)

SMOOTH, ROUGH, IRREGULAR, HORIZONTAL, MERGED = range(5)

# indices of the float settings handed to the kernels
(
    S_SIGMA_D, S_F, S_HS, S_HD, S_ALPHA, S_VALLEY, S_MAJORITY, S_ROUGH, S_QUANTILE, S_BAND_STEP, S_BAND_SIGMAS,
    S_DEPTH, S_SAFE, S_KE, S_CORRELATION, S_CENTRE, S_HORIZON, S_QUANTUM, S_JUMP, S_TAKE, S_NEAR_SIGMAS, S_NEAR_SHARE,
    S_REST_SIGMAS, S_SUPPORT_PER_PX, S_SUPPORT_SIGMAS, S_SUPPORT_RELATIVE, S_TAIL, S_SMOOTH_RELATIVE, S_SMOOTH_SIGMAS,
    S_WS, S_LINE_SIGMAS, S_ALIKE_PX,
) = range(32)  # fmt: skip
# indices of the integer settings
(
    I_WINDOW_MIN, I_MEMBERS, I_RANK, I_BAND_ROWS, I_GAP, I_SUPPORT, I_SUPPORT_COLUMNS, I_SUPPORT_ROWS, I_LARGE,
    I_CUT, I_HORIZONTAL, I_ROOM, I_LINK,
) = range(13)  # fmt: skip

N, FIRST, OVERFLOW = range(3)
"""What `tally` (3,) int64 counts: strips, strips before this column, and strips merged for want of room."""


@inner
def kth_largest(values, n, k):
    """The k-th largest of values[:n], k counted from 1; reorders values."""
    left, right, want = 0, n - 1, k - 1
    for _ in range(2 * n + 2):
        if left >= right:
            break
        pivot = values[(left + right) // 2]
        i, j = left, right
        for _a in range(n + 1):
            if i > j:
                break
            for _b in range(n):
                if values[i] <= pivot:
                    break
                i += 1
            for _b in range(n):
                if values[j] >= pivot:
                    break
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if want <= j:
            right = j
        elif want >= i:
            left = i
        else:
            break
    return values[want]


@inner_inline
def add_strip(ints, floats, tally, room, u, top, bottom, support, kind, d, near, sigma, filled):
    """Appends a strip. A column that has `room` strips grows its last one instead: from end to end, at the nearer of
    both distances. Nothing is dropped, and tally[OVERFLOW] says how often that was."""
    n = tally[N]
    if n - tally[FIRST] < room:
        ints[n, U], ints[n, TOP], ints[n, BOTTOM] = u, top, bottom
        ints[n, SUPPORT], ints[n, KIND], ints[n, CLUSTER], ints[n, TRACK] = support, kind, -1, -1
        ints[n, FILL], ints[n, CUT] = filled, 0
        floats[n, D], floats[n, NEAR], floats[n, SIGMA] = d, near, sigma
        tally[N] = n + 1
        return
    n -= 1
    between = max(0, max(top - ints[n, BOTTOM], ints[n, TOP] - bottom) - 1)
    ints[n, TOP], ints[n, BOTTOM] = min(ints[n, TOP], top), max(ints[n, BOTTOM], bottom)
    ints[n, SUPPORT] += support
    ints[n, KIND] = MERGED
    ints[n, FILL] += filled + between
    floats[n, D], floats[n, NEAR] = max(floats[n, D], d), max(floats[n, NEAR], near)
    floats[n, SIGMA] = max(floats[n, SIGMA], sigma)
    tally[OVERFLOW] += 1


@inner
def homography_area(H):
    """|det(H)|: over w^3 it is the area of a cell of the levelled view in source pixels (its Jacobian)."""
    a = H[0, 0] * (H[1, 1] * H[2, 2] - H[1, 2] * H[2, 1])
    b = H[0, 1] * (H[1, 0] * H[2, 2] - H[1, 2] * H[2, 0])
    c = H[0, 2] * (H[1, 0] * H[2, 1] - H[1, 1] * H[2, 0])
    return abs(a - b + c)


@inner_inline
def support_of(H, area, u, top, bottom, count):
    """Distinct source pixels, in 1/16, that `count` cells of column u stand for: where cells repeat pixels, fewer.

    area: homography_area(H)."""
    w = H[2, 0] * u + H[2, 1] * (0.5 * (top + bottom)) + H[2, 2]
    share = 0.0
    if w > 1e-6:
        share = min(1.0, area / (w * w * w))
    return max(1, int(PX * count * share + 0.5))


@inner_inline
def kth_closest(codes, first, last, k, best):
    """The k-th largest of codes[first..last - 1], k counted from 1. best: scratch, as long as there are codes."""
    if k <= 3:
        a, b, c = np.int32(-1), np.int32(-1), np.int32(-1)
        for i in range(np.uint64(first), np.uint64(last)):
            x = codes[i]
            a, b, c = max(a, x), max(b, min(a, x)), max(c, min(b, x))
        return a if k == 1 else b if k == 2 else c
    for i in range(last - first):
        best[i] = codes[first + i]
    return kth_largest(best, last - first, k)


@inner
def mean_noise(sigma, count, alike_px):
    """Noise of the mean of `count` neighbouring pixels of noise sigma, of which runs of alike_px share theirs (1: none)."""
    return sigma * math.sqrt(alike_px / (count + alike_px - 1.0))


@inner_inline
def emit(
    codes, first, last, count, total, top, bottom, filled, rough, kind, u, H, area, fs, si, best, ints, floats, tally
):  # fmt: skip
    """One strip from `count` pixels in rows top..bottom: codes[first..last - 1], whose sum is `total`; zeros among them
    are not counted.

    A smooth one stands at their mean. The near edge of a rough one is the k-th closest less near_sigmas of noise, never
    behind the mean; k is no more than half of them. It stands at most safe_distance behind that edge (Eq. 9 with a
    k-th largest for its one-pixel maximum)."""
    sigma_d = fs[S_SIGMA_D]
    mean = np.float32(total / (fs[S_QUANTUM] * count))
    d, near = mean, mean
    if rough:
        k = min(max(si[I_RANK], int(fs[S_QUANTILE] * count)), (count + 1) // 2)
        closest = np.float32(kth_closest(codes, first, last, k, best) / fs[S_QUANTUM])
        near = max(closest - np.float32(fs[S_NEAR_SIGMAS] * sigma_d), mean)
        d = max(mean, np.float32(fs[S_F] * near / (fs[S_F] + fs[S_SAFE] * near)))
    # leaves scatter by more than noise: what is rough is no more certain for it, and keeps its near side
    sigma = mean_noise(sigma_d, count, fs[S_ALIKE_PX] if kind == SMOOTH else 1.0)
    # a lower confidence bound: a few stray pixels in front of a wall move no plane
    near = np.float32(max(fs[S_NEAR_SHARE] * d, near - fs[S_BAND_SIGMAS] * sigma))
    support = support_of(H, area, u, top, bottom, count)
    add_strip(ints, floats, tally, si[I_ROOM], u, top, bottom, support, kind, d, near, np.float32(sigma), filled)


@inner_inline
def rows_missed(mark, label, top, bottom, count, gap):
    """Rows top..bottom that lie in gaps of more than `gap` rows without one of the `count` pixels that have this mark:
    they were never seen at this distance."""
    if bottom - top + 1 - count <= gap:
        return 0
    missed = 0
    at = top
    for _ in range(bottom - top):
        at += gap + 1  # no gap is passed over
        if at >= bottom:
            break
        if mark[at] != label:
            first = at
            for _a in range(gap):
                if mark[first - 1] == label:
                    break
                first -= 1
            for _a in range(bottom - at):
                if mark[at] == label:
                    break
                at += 1
            if at - first > gap:
                missed += at - first
    return missed


@inner_inline
def running_sums(line, mark, label, first, last, seen, own):
    """Sums over the rows of first..last before a row, (V + 1,) int64: of what is open in `seen`, of what has this mark in
    `own`. Each holds the number of pixels, times 2^32, and the sum of their codes: the difference of two is that of the
    rows between."""
    label = np.uint8(label)
    open_sum, own_sum = np.int64(0), np.int64(0)
    for v in range(np.uint64(first), np.uint64(last + 1)):
        seen[v], own[v] = open_sum, own_sum
        one = (np.int64(1) << 32) + np.int64(line[v])
        open_sum += one if mark[v] <= NO_PEAK else np.int64(0)
        own_sum += one if mark[v] == label else np.int64(0)
    seen[last + 1], own[last + 1] = open_sum, own_sum


@inner_inline
def split_bands(own, top, bottom, least, fs, si, parts):
    """Where a run of pixels steps in depth: returns the number of its parts. own: see `running_sums`. parts: (3, > rows
    / band_rows) int64 out: first row, number of pixels, sum of their codes.

    Means of short bands are compared with the mean of the part so far; two bands in a row must be off, by the
    greater of band_step_m and the noise of both means, for a new part to begin. least: no pixel has a lesser code."""
    high = si[I_BAND_ROWS]
    q = fs[S_QUANTUM]
    # what is below this bound needs no closer look: the step at the farthest pixel, the noise of a full band
    far = least / q
    alike = max(fs[S_BAND_STEP] * far * far / fs[S_F], fs[S_BAND_SIGMAS] * fs[S_SIGMA_D] / math.sqrt(1.0 * high))
    alike *= (1.0 - 1e-9) * q
    k = 0
    parts[0, 0] = top
    part_sum, part_n = np.int64(0), np.int64(0)
    none = np.int64(-1)
    pending = none
    held_sum, held_n = np.int64(0), np.int64(0)
    before = own[top]
    for v0 in range(top, bottom + 1, high):
        behind = own[min(bottom + 1, v0 + high)]
        c, s = (behind - before) >> 32, (behind - before) & 0xFFFFFFFF
        before = behind
        if c == 0:
            continue
        off = abs(s * part_n - part_sum * c)
        if part_n == 0 or off <= alike * (c * part_n) or off <= band_tolerance(part_sum, part_n, c, fs):
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
def band_tolerance(part_sum, part_n, c, fs):
    """How far the mean of a band of c pixels may be off that of the part so far, as |s part_n - part_sum c| in codes."""
    mean = part_sum / (fs[S_QUANTUM] * part_n)
    noise = fs[S_BAND_SIGMAS] * fs[S_SIGMA_D] * math.sqrt(1.0 / c + 1.0 / part_n)
    return max(fs[S_BAND_STEP] * mean * mean / fs[S_F], noise) * fs[S_QUANTUM] * (c * part_n)


@inner_inline
def window_half_rows(d, fs, si, rows):
    """Half the window's length (Eq. 7, 8): Hs * g(x) px with Z_near = max(Z/2, Z - ke Z^2), in [least, V].

    Z - ke Z^2 turns around at Z = 1/(2 ke), where it is Z/2."""
    z = fs[S_F] / d
    z_near = max(0.5 * z, z - fs[S_KE] * z * z)
    length = min(max(fs[S_HS] * fs[S_F] / z_near, si[I_WINDOW_MIN]), rows)
    return max(1, int(length / 2.0 + 0.5))


@inner_inline
def slide_windows(
    line, mark, first, last, label, d, low_code, high_code, rough, u, H, area, fs, si, seen, own, best, parts, ints,
    floats, tally,
):  # fmt: skip
    """Section 4.2 for one peak, among the rows first..last: accepted windows become segments, segments strips.

    line: (V,) uint16 codes, mark: see `mark_rows`, of one column. A window is accepted when most of its valid pixels
    belong to the peak and their mean lies in its interval. A segment ends at its first and last members. The scan goes
    on after an end, so a peak can give several segments (the lintel over a window). What a segment covers and is not
    nearer than the peak is taken with it. Windows are half a window apart."""
    first, last = ends_of(mark, label, first, last)
    if first > last:
        return
    running_sums(line, mark, label, first, last, seen, own)
    half = window_half_rows(d, fs, si, line.shape[0])
    need = min(si[I_WINDOW_MIN], si[I_MEMBERS])
    count = (last - first) // half + 1
    run = -1
    for j in range(count):
        begin, end = first + j * half, min(last + 1, first + (j + 2) * half)
        m, valid = (own[end] - own[begin]) >> 32, seen[end] - seen[begin]
        valid, s = valid >> 32, valid & 0xFFFFFFFF
        good = m >= need and m > fs[S_MAJORITY] * valid and low_code * valid <= s <= high_code * valid
        if good and run < 0:
            run = j
        if run >= 0 and (not good or j == count - 1):
            finish_segment(
                line, mark, first + run * half, min(last, begin + half - 1), label, low_code, high_code, rough, u, H, area,
                fs, si, own, best, parts, ints, floats, tally,
            )  # fmt: skip
            run = -1


@inner_inline
def finish_segment(
    line, mark, top, bottom, label, low_code, high_code, rough, u, H, area, fs, si, own, best, parts, ints, floats, tally
):  # fmt: skip
    """Strips of one accepted run of rows top..bottom, split where it steps; its pixels are taken.

    own: see `running_sums`. best: (2, V) int32 scratch."""
    top, bottom = ends_of(mark, label, top, bottom)
    if top > bottom:
        return
    u_top, u_end = np.uint64(top), np.uint64(bottom + 1)
    if rough:
        own_mark = np.uint8(label)
        for v in range(u_top, u_end):
            best[1, v] = line[v] * (mark[v] == own_mark)
    kind = ROUGH if rough else SMOOTH
    count = split_bands(own, top, bottom, low_code, fs, si, parts)
    for k in range(count):
        a, b = parts[0, k], bottom if k == count - 1 else parts[0, k + 1] - 1
        a, b = ends_of(mark, label, a, b)
        pixels = parts[1, k]
        filled = rows_missed(mark, label, a, b, pixels, si[I_GAP])
        emit(
            best[1], a, b + 1, pixels, parts[2, k], a, b, filled, rough, kind, u, H, area, fs, si, best[0], ints, floats,
            tally,
        )  # fmt: skip
    tail = np.uint16(min(high_code + fs[S_TAKE] * fs[S_SIGMA_D] * fs[S_QUANTUM], 65535.0))
    for v in range(u_top, u_end):
        mark[v] = max(mark[v], TAKEN if line[v] <= tail else np.uint8(0))
