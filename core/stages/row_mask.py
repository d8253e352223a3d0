"""Which rows of a column count: those with a measurement that is neither ground nor below it.

A column has two representations: row by row, with a mark for each row, where many rows are done at a time; and as a
list of the pixels that are open, px: (2, V + 8) int32 with a line for each of ROW and CODE, from top to bottom.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, inner_inline, kernel

ROW, CODE = range(2)
"""Lines of a list of pixels: their row and their code."""
NO_PEAK, TAKEN, CLOSED = 253, 254, 255
"""Marks of a row besides the number of the peak that it belongs to: of none; in a strip; not measured, far or ground. Up
to NO_PEAK a row is open: measured, and in no strip yet. The greater of two marks is the one that stays."""

MAX_TILES = 16
"""Parts of the view that have limits of their own (resolution of a look-up; no result depends on it)."""


@inner
def gate_rises(gate):
    """Whether the ground's gate rises with the code, as it does unless the camera is lower than the tolerance."""
    greater, less = gate[3:], gate[2:-1]
    falls = 0
    for i in range(less.shape[0]):
        falls += greater[i] < less[i]
    return falls == 0


@inner
def ground_limits(gate, tan_mid, shift, last_ground):
    """last_ground[v]: the greatest code that is ground in row v of a column with this shift, 1 where none is.

    gate: (65536,) float32, rising; tan_mid: (V,) float32, rising: one walk along both serves all rows. last_ground: (V,)
    uint16 out. A code is ground where tan_mid - shift > gate[code]."""
    codes = gate.shape[0]
    high = 2
    for v in range(tan_mid.shape[0]):
        t = tan_mid[v] - shift
        low, step = high - 1, 1
        for _ in range(20):  # ever longer steps up to a code that is not ground
            if high >= codes or not t > gate[high]:
                break
            low, high, step = high, min(codes, high + step), 2 * step
        for _ in range(20):  # and halves back to the first of them
            if high - low <= 1:
                break
            middle = (low + high) // 2
            if t > gate[middle]:
                low = middle
            else:
                high = middle
        last_ground[v] = high - 1


@kernel
def tile_columns(tan_mid, shift):
    """How many columns may share limits: those whose shifts differ by less than a row."""
    spread = np.float64(shift.max() - shift.min())
    pitch = np.float64(tan_mid[-1] - tan_mid[0]) / (tan_mid.shape[0] - 1)
    tiles = int(math.ceil(min(max(spread / max(pitch, 1e-9), 1.0), 1.0 * MAX_TILES)))
    return -(-shift.shape[0] // tiles)


@kernel
def tile_limits(gate, rises, tan_mid, shifts, below, above):
    """Limits of all columns with these shifts: codes up to below[v] are ground in each of them, codes over above[v] in
    none. below, above: (V,) uint16 out. Returns whether codes between must be looked at one by one."""
    if not rises:
        below[:] = 1
        above[:] = 65535
        return True
    least, most = shifts.min(), shifts.max()
    ground_limits(gate, tan_mid, most, below)
    if least == most:
        above[:] = below
        return False
    ground_limits(gate, tan_mid, least, above)
    return True


@inner_inline
def open_rows(line, gate, shift, tan_mid, below, above, between, mask, doubt, measured):
    """mask[v] = 1 where row v of a column is measured and not ground, else 0.

    line: (V,) uint16 codes. below, above, between: see `tile_limits`. mask: (V rounded up to 8,) uint8 out; doubt: the
    same, scratch; both zero beyond V. measured: (V,) uint16, plus 1 where the row has a measurement."""
    rows = line.shape[0]
    for v in range(rows):
        mask[v] = line[v] > below[v]
    for v in range(rows):
        measured[v] += line[v] > 1
    if between:
        for v in range(rows):
            doubt[v] = mask[v] & (line[v] <= above[v])
        words = doubt.view(np.uint64)
        for w in range(words.shape[0]):
            if words[w] != 0:
                for v in range(8 * w, min(8 * w + 8, rows)):
                    if doubt[v] != 0 and tan_mid[v] - shift > gate[line[v]]:
                        mask[v] = 0


@inner_inline
def gather_rows(line, mask, px):
    """ROW and CODE of the rows with mask = 1, from top to bottom; returns their number.

    mask: (V rounded up to 8,) uint8, zero beyond V. Eight rows at a time, since most of a view is sky or ground."""
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
def mark_rows(line, mask, first, last, peaks, low, high, first_code, mark):
    """mark[v] for the rows first..last: the peak whose bins hold its code, NO_PEAK or CLOSED.

    low, high: bins of the peaks. first_code: see BinTable. mark: (V rounded up to 8,) uint8 out."""
    begin, end = np.uint64(first), np.uint64(last + 1)
    for v in range(begin, end):
        mark[v] = CLOSED - (mask[v] << 1)
    for p in range(peaks):
        # as narrow as the codes: more rows are then done at a time
        least, most = np.uint16(min(first_code[low[p]], 65535)), np.uint16(max(first_code[high[p] + 1] - 1, 0))
        for v in range(begin, end):
            inside, so_far = mask[v] & (line[v] >= least) & (line[v] <= most), mark[v]
            mark[v] = np.uint8(p) if inside else so_far


@inner_inline
def free_rows(mark, first, last, mask):
    """mask[v] = 1 where row v of first..last is open."""
    for v in range(np.uint64(first), np.uint64(last + 1)):
        mask[v] = mark[v] <= NO_PEAK


@inner_inline
def ends_of(mark, label, first, last):
    """(first, last) row of first..last with this mark; first > last where there is none."""
    label = np.uint8(label)
    for _ in range(last + 1 - first):
        if mark[np.uint64(first)] == label:
            break
        first += 1
    for _ in range(last + 1 - first):
        if mark[np.uint64(last)] == label:
            break
        last -= 1
    return first, last
