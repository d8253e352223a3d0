"""Selects the rows of a column that may belong to an obstacle: those measured above the ground.

Input: quantised disparity of one column and the threshold of the ground. Output: the column in two representations. A
mask or label per row is used where many rows are processed per instruction. A list of the open pixels from top to
bottom, px (2, V + 8) int32 with the lines ROW and CODE, is used elsewhere."""

from __future__ import annotations

import numpy as np

from ..jit import inner_inline
from .ground_threshold import ground_limit
from .view_geometry import Q_FAR

ROW, CODE = range(2)
"""Lines of a list of pixels: row, and quantised disparity."""
NO_PEAK, TAKEN, CLOSED = 253, 254, 255
"""Labels of a row, besides the index of the peak to which it belongs: NO_PEAK, measured and in no peak; TAKEN, in a
strip; CLOSED, not measured, far or ground. Rows with labels up to NO_PEAK are open: measured and in no strip yet.
Of two labels the greater one is kept."""


@inner_inline
def mask_open_rows(line, ground, shift, tan_mid, mask):
    """Sets mask[v] to 1 where row v of a column is measured and not ground, else to 0; returns the number of measured rows.

    Args:
        shift: of the column, see GroundThreshold.
        tan_mid: (V,) float32 of the view.
        mask: (V rounded up to 8,) uint8 out, zero beyond V."""
    measured = np.int32(0)
    for v in range(line.shape[0]):
        is_measured, is_ground = line[v] > Q_FAR, tan_mid[v] - shift > ground_limit(line[v], ground)
        mask[v] = is_measured & ~is_ground
        measured += is_measured
    return measured


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
def label_rows(line, mask, peaks, count, first_code, labels):
    """Labels V rows by the peak whose bins contain their code, else by NO_PEAK or CLOSED.

    Args:
        mask: (V,) uint8 of `mask_open_rows`.
        count: number of peaks.
        first_code: of BinTable.
        labels: (V,) uint8 out."""
    for v in range(len(line)):
        labels[v] = NO_PEAK if mask[v] == 1 else CLOSED
    for p in range(count):
        # as narrow as the codes, so that more rows are processed per instruction
        least = np.uint16(min(first_code[peaks.low[p]], 65535))
        most = np.uint16(max(first_code[peaks.high[p] + 1] - 1, 0))
        for v in range(len(line)):
            inside, so_far = mask[v] & (line[v] >= least) & (line[v] <= most), labels[v]
            labels[v] = np.uint8(p) if inside else so_far


@inner_inline
def mask_remaining_rows(labels, mask):
    """Sets mask[v] to 1 where row v is open, else to 0. labels, mask: (V,) uint8."""
    for v in range(len(labels)):
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
