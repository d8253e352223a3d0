"""Blocks of a levelled view by what their pixels show: textureless, measured, or neither. See docs/explanation/open-space.md."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner
from ..types import BEYOND_MM, CONTINUED_MM, FAR_MM, SATURATED_MM, TEXTURED_MM, TEXTURELESS_MM, UNKNOWN_MM
from .level import seen_rows, source_of_rows
from .view_geometry import Q_FAR, Q_UNKNOWN

BLOCK = 4
"""Side of a block of cells."""
_STEP = 2
"""Step at which the cells of a block are sampled."""
OUTSIDE, SMOOTH, MEASURED, PARTLY, OTHER, CONTINUED, TEXTURED = range(7)
"""Kinds of blocks: beyond the image; all textureless; at least half measured; less, with pixels of which nothing is known; such pixels
alone (masked, dark, saturated, or dropped after they were measured); textureless, or measured in part, of the brightness of what is
measured below; all others, whose unmeasured pixels are textured."""
BEYOND_ALL = np.float32(np.inf)
"""Distance of what is not measured within the range."""
OUTSIDE_MM = np.uint16(SATURATED_MM)
"""In `level_marks`: no pixel of the source. Pixels of this value itself are unknown there."""


class ForwardRows(NamedTuple):
    """Scratch of `level_marks`, (rows,): forward float32, at uint32, of `level.source_of_rows`."""

    forward: Any
    at: Any


@inner
def level_marks(flat, shape, codes, H, clear_m, gain, rows_of, mm, out):
    """Each cell of the levelled view takes what its source pixel holds, and a far one the code of what was measured there.

    flat: (H * W,) uint16 of the source, with its marks; shape: (H, W); codes: (cols, rows) uint16 of the view. clear_m: optical depth from
    which on a cell is far; gain: f_px * lsb_per_px. rows_of: ForwardRows, scratch. mm: (cols, rows) uint16 out, millimetres or
    a mark, OUTSIDE_MM outside of the image. out: (cols, rows) uint16 out, the codes, with those of far cells by what was measured
    beyond the range of the camera."""
    src_rows, src_cols = shape
    rows, forward, at = codes.shape[1], rows_of.forward, rows_of.at
    clear = np.uint16(min(65535.0, math.ceil(gain / clear_m)))
    least, scale = np.uint16(min(65535.0, math.floor(1000.0 * clear_m))), np.float32(1000.0 * gain)
    far, saturated, unknown = np.uint16(FAR_MM), np.uint16(SATURATED_MM), np.uint16(UNKNOWN_MM)
    for u in range(codes.shape[0]):
        first, end = seen_rows(H, u, src_cols, src_rows, rows)
        column, marks, line = codes[u], mm[u], out[u]
        marks[:first] = OUTSIDE_MM
        marks[end:] = OUTSIDE_MM
        line[:first] = Q_UNKNOWN
        line[end:] = Q_UNKNOWN
        source_of_rows(H, u, first, src_cols, src_rows, forward, at[: end - first])
        for i in range(end - first):
            z = flat[at[i]]
            marks[first + i] = unknown if z == saturated else z
        for i in range(end - first):
            z, code = marks[first + i], column[first + i]
            beyond = np.ceil(scale * forward[i] / np.float32(max(z, np.uint16(1))))
            measured = np.uint16(min(beyond, np.float32(65535.0))) if (z < far) & (z > least) else clear
            line[first + i] = measured if code == Q_FAR else code


@inner
def kind_of(code, mm):
    """Kind of one cell of the view with this code. mm: of `level_marks`."""
    if code != Q_UNKNOWN:
        return MEASURED
    if mm == OUTSIDE_MM:
        return OUTSIDE
    if mm == TEXTURELESS_MM:
        return SMOOTH
    if mm == CONTINUED_MM:
        return CONTINUED
    if mm == TEXTURED_MM:
        return TEXTURED
    return MEASURED if mm == BEYOND_MM else OTHER


@inner
def sort_blocks(mm, codes, gain, kind, near):
    """mm: of `level_marks`; codes: its out. kind: (C, R) uint8 out, of each block of the view; near: (C, R) float32 out, its least forward distance, BEYOND_ALL: none
    within the range. gain: f_px * lsb_per_px."""
    cols, rows = codes.shape
    for j in range(kind.shape[0]):
        for i in range(kind.shape[1]):
            outside, smooth, measured, continued, other, count, most = 0, 0, 0, 0, 0, 0, 0
            for u in range(j * BLOCK, min((j + 1) * BLOCK, cols), _STEP):
                for v in range(i * BLOCK, min((i + 1) * BLOCK, rows), _STEP):
                    code = int(codes[u, v])
                    what = kind_of(code, mm[u, v])
                    count += 1
                    outside += what == OUTSIDE
                    smooth += what == SMOOTH
                    measured += what == MEASURED
                    continued += what == CONTINUED
                    other += what == OTHER
                    most = max(most, code)
            near[j, i] = np.float32(gain / most) if most > Q_FAR else BEYOND_ALL
            if outside > 0:
                kind[j, i] = OUTSIDE
            elif smooth == count:
                kind[j, i] = SMOOTH
            elif 2 * measured >= count:
                kind[j, i] = MEASURED
            elif continued > 0 and continued + measured + smooth == count:
                kind[j, i] = CONTINUED
            elif other > 0:
                kind[j, i] = PARTLY if measured > 0 else OTHER
            else:
                kind[j, i] = TEXTURED
