"""Selects the rows of a column that may belong to an obstacle: those measured above the ground.

Input: quantised disparity of one column and the threshold of the ground. Output: the column in two representations. A
mask or label per row is used where many rows are processed per instruction. A list of the open pixels from top to
bottom, px (2, V + 8) int32 with the lines ROW and CODE, is used elsewhere."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, inner_inline, kernel

ROW, CODE = range(2)
"""Lines of a list of pixels: row, and quantised disparity."""
NO_PEAK, TAKEN, CLOSED = 253, 254, 255
"""Labels of a row, besides the index of the peak to which it belongs: NO_PEAK, measured and in no peak; TAKEN, in a
strip; CLOSED, not measured, far or ground. Rows with labels up to NO_PEAK are open: measured and in no strip yet.
Of two labels the greater one is kept."""

MAX_TILES = 16
"""Greatest number of groups of columns that share limits. It affects the time only, not the result."""


@inner
def limit_rises(limit):
    """True if the threshold of the ground increases with the code. It does not if the camera is lower than the
    tolerance."""
    greater, less = limit[3:], limit[2:-1]
    falls = 0
    for i in range(less.shape[0]):
        falls += greater[i] < less[i]
    return falls == 0


@inner
def ground_limits(limit, tan_mid, shift, last_ground):
    """Computes the greatest code that is ground in each row of a column with this shift; 1 if none is.

    A code is ground where tan_mid - shift > limit[code]. Both tables increase, so that one pass along both serves all
    rows.

    Args:
        limit: (65536,) float32, `limit` of GroundThreshold.
        tan_mid: (V,) float32 of the view.
        shift: of the column, see GroundThreshold.
        last_ground: (V,) uint16 out."""
    codes = limit.shape[0]
    high = 2
    for v in range(tan_mid.shape[0]):
        t = tan_mid[v] - shift
        low, step = high - 1, 1
        for _ in range(20):  # growing steps up to a code that is not ground
            if high >= codes or not t > limit[high]:
                break
            low, high, step = high, min(codes, high + step), 2 * step
        for _ in range(20):  # bisection back to the first such code
            if high - low <= 1:
                break
            middle = (low + high) // 2
            if t > limit[middle]:
                low = middle
            else:
                high = middle
        last_ground[v] = high - 1


@kernel
def tile_columns(tan_mid, shift):
    """Returns the number of neighbouring columns that share limits: their shifts differ by less than a row."""
    spread = np.float64(shift.max() - shift.min())
    pitch = np.float64(tan_mid[-1] - tan_mid[0]) / (tan_mid.shape[0] - 1)
    tiles = int(math.ceil(min(max(spread / max(pitch, 1e-9), 1.0), 1.0 * MAX_TILES)))
    return -(-shift.shape[0] // tiles)


@kernel
def tile_limits(limit, rises, tan_mid, shifts, below, above):
    """Computes limits of the ground for all columns with these shifts; returns True if codes between them must be
    tested.

    Args:
        limit: (65536,) float32, `limit` of GroundThreshold.
        rises: of `limit_rises`.
        tan_mid: (V,) float32 of the view.
        shifts: (columns,) float32.
        below: (V,) uint16 out. Codes up to it are ground in all of these columns.
        above: (V,) uint16 out. Codes greater than it are ground in none of them."""
    if not rises:
        below[:] = 1
        above[:] = 65535
        return True
    least, most = shifts.min(), shifts.max()
    ground_limits(limit, tan_mid, most, below)
    if least == most:
        above[:] = below
        return False
    ground_limits(limit, tan_mid, least, above)
    return True


@inner_inline
def mask_open_rows(line, limit, shift, tan_mid, below, above, between, mask, undecided, measured):
    """Sets mask[v] to 1 where row v of a column is measured and not ground, else to 0.

    Args:
        line: (V,) uint16 codes.
        limit: (65536,) float32, `limit` of GroundThreshold.
        shift: of the column.
        tan_mid: (V,) float32 of the view.
        below, above, between: of `tile_limits`.
        mask: (V rounded up to 8,) uint8 out, zero beyond V.
        undecided: scratch like mask, the rows that must be tested.
        measured: (V,) uint16, increased by 1 where the row has a measurement."""
    rows = line.shape[0]
    for v in range(rows):
        mask[v] = line[v] > below[v]
    for v in range(rows):
        measured[v] += line[v] > 1
    if between:
        for v in range(rows):
            undecided[v] = mask[v] & (line[v] <= above[v])
        words = undecided.view(np.uint64)
        for w in range(words.shape[0]):
            if words[w] != 0:
                for v in range(8 * w, min(8 * w + 8, rows)):
                    if undecided[v] != 0 and tan_mid[v] - shift > limit[line[v]]:
                        mask[v] = 0


@inner_inline
def gather_rows(line, mask, px):
    """Writes ROW and CODE of the rows with mask = 1 to px, from top to bottom; returns their number.

    mask: (V rounded up to 8,) uint8, zero beyond V. Eight rows are tested at a time, since most of a view is sky or
    ground."""
    n = np.uint64(0)
    one, eight = np.uint64(1), np.uint64(8)
    words = mask.view(np.uint64)
    whole = line.shape[0] // 8
    for w in range(whole):
        bits = words[w]
        if bits != 0:
            v = eight * np.uint64(w)
            for _ in range(8):
                px[ROW, n] = v
                px[CODE, n] = line[v]
                n += bits & one
                bits >>= eight
                v += one
    count = np.int64(n)
    for row in range(8 * whole, line.shape[0]):
        if mask[row] != 0:
            px[ROW, count], px[CODE, count] = row, line[row]
            count += 1
    return count


@inner_inline
def label_rows(line, mask, first, last, peaks, low, high, first_code, labels):
    """Labels the rows first..last by the peak whose bins contain their code, else by NO_PEAK or CLOSED.

    Args:
        line: (V,) uint16 codes.
        mask: (V rounded up to 8,) uint8 of `mask_open_rows`.
        first, last: rows.
        peaks: number of peaks.
        low, high: (peaks,) bins.
        first_code: of BinTable.
        labels: (V rounded up to 8,) uint8 out, the labels."""
    begin, end = np.uint64(first), np.uint64(last + 1)
    for v in range(begin, end):
        labels[v] = CLOSED - (mask[v] << 1)
    for p in range(peaks):
        # as narrow as the codes, so that more rows are processed per instruction
        least, most = np.uint16(min(first_code[low[p]], 65535)), np.uint16(max(first_code[high[p] + 1] - 1, 0))
        for v in range(begin, end):
            inside, so_far = mask[v] & (line[v] >= least) & (line[v] <= most), labels[v]
            labels[v] = np.uint8(p) if inside else so_far


@inner_inline
def mask_remaining_rows(labels, first, last, mask):
    """Sets mask[v] to 1 where row v of first..last is open, else to 0."""
    for v in range(np.uint64(first), np.uint64(last + 1)):
        mask[v] = labels[v] <= NO_PEAK


@inner_inline
def ends_of(labels, label, first, last):
    """Returns the first and last row of first..last with this label; first > last if there is none."""
    label = np.uint8(label)
    for _ in range(last + 1 - first):
        if labels[np.uint64(first)] == label:
            break
        first += 1
    for _ in range(last + 1 - first):
        if labels[np.uint64(last)] == label:
            break
        last -= 1
    return first, last
