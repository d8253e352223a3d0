"""Section 4.2 for one column: windows and the strips they give.

A strip is a vertical run of pixels at one distance: (disparity, column, first row, last row). Every kernel works
on plain arrays. Tables of strips: ints (N, 9) int32 U, TOP, BOTTOM (rows, inclusive), SUPPORT (distinct source pixels, in 1/16), KIND,
CLUSTER, TRACK, FILL (rows filled, not seen), CUT (1: top, 2: bottom cut by the image border); floats (N, 3) float32
D (disparity, px), NEAR (of the robust near edge, a lower bound), SIGMA (1 sigma of D).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .level import source_px_per_cell

FREE_PX, GROUND_PX, NONE_PX, FAR_PX, TAKEN_PX = range(5)
"""What a row of the column is: a measurement nobody has yet, ground, unknown, far, or a strip's."""

PX = 16
"""Support is counted in sixteenths of a source pixel: where the view magnifies, a cell is less than one."""

# columns of the integer table of strips
U, TOP, BOTTOM, SUPPORT, KIND, CLUSTER, TRACK, FILL, CUT = range(9)
# columns of the float table
D, NEAR, SIGMA = range(3)

SMOOTH, ROUGH, IRREGULAR, HORIZONTAL = range(4)

# indices of the float settings handed to the kernels
(
    S_SIGMA_D, S_F, S_HS, S_HD, S_ALPHA, S_VALLEY, S_MAJORITY, S_ROUGH, S_QUANTILE, S_BAND_STEP, S_BAND_SIGMAS,
    S_DEPTH, S_SAFE, S_KE, S_CORRELATION, S_CENTRE, S_HORIZON, S_QUANTUM, S_JUMP, S_TAKE, S_NEAR_SIGMAS, S_NEAR_SHARE,
    S_REST_SIGMAS, S_SUPPORT_PER_PX, S_SUPPORT_SIGMAS, S_SUPPORT_RELATIVE, S_TAIL, S_SMOOTH_RELATIVE, S_SMOOTH_SIGMAS,
) = range(29)  # fmt: skip
# indices of the integer settings
(
    I_WINDOW_MIN, I_MEMBERS, I_RANK, I_BAND_ROWS, I_GAP, I_PAPER, I_SUPPORT, I_SUPPORT_COLUMNS, I_SUPPORT_ROWS, I_LARGE,
    I_CUT, I_HORIZONTAL,
) = range(12)  # fmt: skip


@njit(cache=True, nogil=True)
def histogram(line, gate, shift, tan_mid, bin_of_code, bins, state, hist):
    """Sorts one column into bins and takes the ground out; returns the number of ground pixels.

    line: (V,) uint16 codes. gate: (65536,) float32, the tangent of elevation below which a code is ground;
    shift: the sideways slope of the ground in this column. bins: (V,) uint16 out. state: (V,) uint8 out."""
    hist[:] = 0
    ground = 0
    for v in range(line.shape[0]):
        code = line[v]
        bins[v] = 0
        if code < 2:
            state[v] = NONE_PX if code == 0 else FAR_PX
        elif tan_mid[v] - shift > gate[code]:
            state[v] = GROUND_PX
            ground += 1
        else:
            state[v] = FREE_PX
            b = bin_of_code[code]
            bins[v] = b
            hist[b] += 1
    return ground


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def add_strip(ints, floats, n, u, top, bottom, support, kind, d, near, sigma, filled):
    """Appends a strip. There is always room: strips of one column share no pixel, so a view has no more than cells."""
    ints[n, U], ints[n, TOP], ints[n, BOTTOM] = u, top, bottom
    ints[n, SUPPORT], ints[n, KIND], ints[n, CLUSTER], ints[n, TRACK] = support, kind, -1, -1
    ints[n, FILL], ints[n, CUT] = filled, 0
    floats[n, D], floats[n, NEAR], floats[n, SIGMA] = d, near, sigma
    return n + 1


@njit(cache=True, nogil=True)
def near_side(values, n, mean, fs, si):
    """(disparity, near edge) of rough or irregular pixels; reorders values.

    The near edge is the k-th closest less near_sigmas of noise, never behind the mean; k is no more than half of
    them. The strip stands at most safe_distance behind it (Eq. 9 with a k-th largest for its one-pixel maximum)."""
    k = max(si[I_RANK], int(fs[S_QUANTILE] * n))
    k = min(k, (n + 1) // 2)
    closest = kth_largest(values, n, k)
    near = max(closest - np.float32(fs[S_NEAR_SIGMAS] * fs[S_SIGMA_D]), mean)
    behind = fs[S_F] / (fs[S_F] / near + fs[S_SAFE])
    return max(mean, np.float32(behind)), near


@njit(cache=True, nogil=True)
def emit_pixels(line, state, member, label, top, bottom, rough, kind, u, H, fs, si, scratch, ints, floats, n):
    """One strip from the rows top..bottom with member[v] == label; returns the new count.

    Runs of more than irregular_gap_px rows between members were never seen at this distance: they count as filled."""
    count = 0
    filled = 0
    total = np.float64(0.0)
    first_row = -1
    last_row = -1
    for v in range(top, bottom + 1):
        if member[v] == label and state[v] == FREE_PX:
            d = np.float32(line[v] / fs[S_QUANTUM])
            scratch[count] = d
            total += d
            count += 1
            if first_row < 0:
                first_row = v
            elif v - last_row - 1 > si[I_GAP]:
                filled += v - last_row - 1
            last_row = v
    if count == 0:
        return n
    mean = np.float32(total / count)
    d, near = mean, mean
    if rough:
        d, near = near_side(scratch, count, mean, fs, si)
    sigma = fs[S_SIGMA_D] / math.sqrt(count)
    # a lower confidence bound: a few stray pixels in front of a wall move no plane
    near = np.float32(max(fs[S_NEAR_SHARE] * d, near - fs[S_BAND_SIGMAS] * sigma))
    share = min(1.0, source_px_per_cell(H, u, 0.5 * (first_row + last_row)))
    support = max(1, int(PX * count * share + 0.5))
    return add_strip(ints, floats, n, u, first_row, last_row, support, kind, d, near, np.float32(sigma), filled)


@njit(cache=True, nogil=True)
def split_bands(line, state, member, label, top, bottom, fs, si, cuts):
    """Where a run of members steps in depth: cuts[:k] are the first rows of its parts (cuts[0] = top); returns k.

    Means of short bands are compared with the mean of the part so far; two bands in a row must be off, by the
    greater of band_step_m and the noise of both means, for a new part to begin."""
    cuts[0] = top
    parts = 1
    part_sum, part_n = 0.0, 0
    pending = -1
    held_sum, held_n = 0.0, 0
    rows = si[I_BAND_ROWS]
    for band in range((bottom - top) // rows + 1):
        v0 = top + band * rows
        s, c = 0.0, 0
        for v in range(v0, min(bottom, v0 + rows - 1) + 1):
            if member[v] == label and state[v] == FREE_PX:
                s += line[v] / fs[S_QUANTUM]
                c += 1
        if c == 0:
            continue
        if part_n == 0:
            part_sum, part_n = s, c
            continue
        mean = part_sum / part_n
        step = fs[S_BAND_STEP] * mean * mean / fs[S_F]
        noise = fs[S_BAND_SIGMAS] * fs[S_SIGMA_D] * math.sqrt(1.0 / c + 1.0 / part_n)
        if abs(s / c - mean) <= max(step, noise):
            part_sum, part_n = part_sum + s + held_sum, part_n + c + held_n
            pending, held_sum, held_n = -1, 0.0, 0
        elif pending < 0:
            pending, held_sum, held_n = v0, s, c
        else:
            if parts < cuts.shape[0]:
                cuts[parts] = pending
                parts += 1
            part_sum, part_n = held_sum + s, held_n + c
            pending, held_sum, held_n = -1, 0.0, 0
    return parts


@njit(cache=True, nogil=True)
def window_blocks(line, state, member, label, first, last, block, counts):
    """Members, valid pixels and sum of codes in blocks of half a window; returns the number of blocks.

    counts: (3, >= blocks) int64. Windows half a window apart are then two neighbouring blocks."""
    blocks = (last - first) // block + 1
    for j in range(blocks):
        m, valid, s = 0, 0, np.int64(0)
        for v in range(first + j * block, min(last, first + (j + 1) * block - 1) + 1):
            if state[v] == FREE_PX:
                valid += 1
                s += np.int64(line[v])
                if member[v] == label:
                    m += 1
        counts[0, j], counts[1, j], counts[2, j] = m, valid, s
    return blocks


@njit(cache=True, nogil=True)
def window_half_rows(d, fs, si, rows):
    """Half the window's length (Eq. 7, 8): Hs * g(x) px with Z_near = max(Z/2, Z - ke Z^2), in [least, V].

    Z - ke Z^2 turns around at Z = 1/(2 ke), where it is Z/2."""
    z = fs[S_F] / d
    z_near = max(0.5 * z, z - fs[S_KE] * z * z)
    length = min(max(fs[S_HS] * fs[S_F] / z_near, si[I_WINDOW_MIN]), rows)
    return max(1, int(length / 2.0 + 0.5))


@njit(cache=True, nogil=True)
def slide_windows(
    line, state, member, label, d, low_code, high_code, rough, u, H, fs, si, scratch, counts, cuts,
    ints, floats, n,
):  # fmt: skip
    """Section 4.2 for one peak: accepted windows become segments, segments strips; returns the new count.

    A window is accepted when most of its valid pixels belong to the peak and their mean lies in its interval. A
    segment ends at its first and last members. The scan goes on after an end, so a peak can give several
    segments (the lintel over a window). What a segment covers and is not nearer than the peak is taken with it."""
    rows = line.shape[0]
    first, last = -1, -1
    for v in range(rows):
        if member[v] == label and state[v] == FREE_PX:
            if first < 0:
                first = v
            last = v
    if first < 0:
        return n
    block = window_half_rows(d, fs, si, rows)
    blocks = window_blocks(line, state, member, label, first, last, block, counts)
    run = -1
    for j in range(blocks):
        k = min(j + 1, blocks - 1)
        m, valid, s = counts[0, j], counts[1, j], counts[2, j]
        if k > j:
            m, valid, s = m + counts[0, k], valid + counts[1, k], s + counts[2, k]
        size = valid
        if si[I_PAPER] == 1:
            size = (k - j + 1) * block
        need = min(si[I_WINDOW_MIN], si[I_MEMBERS])
        good = m >= need and m > fs[S_MAJORITY] * size and low_code * valid <= s <= high_code * valid
        if good and run < 0:
            run = j
        if run >= 0 and (not good or j == blocks - 1):
            a = first + run * block
            b = min(last, first + (j + 1) * block - 1)
            n = finish_segment(
                line, state, member, label, a, b, high_code, rough, u, H, fs, si, scratch, cuts,
                ints, floats, n,
            )  # fmt: skip
            run = -1
            if si[I_PAPER] == 1:
                break
    return n


@njit(cache=True, nogil=True)
def finish_segment(line, state, member, label, a, b, high_code, rough, u, H, fs, si, scratch, cuts, ints, floats, n):
    """Strips of one accepted run of rows a..b, split where it steps; its pixels are taken."""
    for v in range(a, b + 1):
        if member[v] == label and state[v] == FREE_PX:
            break
        a += 1
    for _v in range(b - a + 1):
        if member[b] == label and state[b] == FREE_PX:
            break
        b -= 1
    if si[I_PAPER] == 1:
        n = emit_paper(line, state, a, b, rough, u, fs, ints, floats, n)
    else:
        parts = split_bands(line, state, member, label, a, b, fs, si, cuts)
        for i in range(parts):
            end = b if i == parts - 1 else cuts[i + 1] - 1
            n = emit_pixels(
                line, state, member, label, cuts[i], end, rough, ROUGH if rough else SMOOTH, u, H, fs, si, scratch,
                ints, floats, n,
            )  # fmt: skip
    tail = high_code + fs[S_TAKE] * fs[S_SIGMA_D] * fs[S_QUANTUM]
    for v in range(a, b + 1):
        if state[v] == FREE_PX and (line[v] <= tail or si[I_PAPER] == 1):
            state[v] = TAKEN_PX
    return n


@njit(cache=True, nogil=True)
def emit_paper(line, state, a, b, rough, u, fs, ints, floats, n):
    """Eq. 9 as printed: the mean or the one-pixel maximum over all measured pixels between both ends."""
    count, total, most = 0, 0.0, 0.0
    for v in range(a, b + 1):
        if state[v] == FREE_PX or state[v] == TAKEN_PX:
            d = line[v] / fs[S_QUANTUM]
            total += d
            most = max(most, d)
            count += 1
    if count == 0:
        return n
    d = most if rough else total / count
    sigma = fs[S_SIGMA_D] / math.sqrt(count)
    kind = ROUGH if rough else SMOOTH
    return add_strip(ints, floats, n, u, a, b, PX * count, kind, np.float32(d), np.float32(d), np.float32(sigma), 0)
