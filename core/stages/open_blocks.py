"""Blocks of a levelled view by what their pixels show: textureless, measured, or neither. See docs/explanation/open-space.md."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner
from ..types import BEYOND_MM, CONTINUED_MM, FAR_MM, TEXTURED_MM, TEXTURELESS_MM
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


@inner
def source_mm(depth_mm, H, u, v):
    """The depth of the source pixel nearest to cell (u, v), millimetres or a mark; -1 outside of the image. depth_mm: (H, W) uint16."""
    w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    if w <= 1e-6:
        return -1
    x = math.floor((H[0, 0] * u + H[0, 1] * v + H[0, 2]) / w + 0.5)
    y = math.floor((H[1, 0] * u + H[1, 1] * v + H[1, 2]) / w + 0.5)
    if x < 0 or y < 0 or x >= depth_mm.shape[1] or y >= depth_mm.shape[0]:
        return -1
    return int(depth_mm[int(y), int(x)])


@inner
def sample(depth_mm, code, H, u, v):
    """Kind of one cell (u, v) of the view with this code. depth_mm: (H, W) uint16 of the source, with its marks."""
    if code != Q_UNKNOWN:
        return MEASURED
    mm = source_mm(depth_mm, H, u, v)
    if mm < 0:
        return OUTSIDE
    if mm == TEXTURELESS_MM:
        return SMOOTH
    if mm == CONTINUED_MM:
        return CONTINUED
    if mm == TEXTURED_MM:
        return TEXTURED
    return MEASURED if mm == BEYOND_MM else OTHER


@inner
def sort_blocks(depth_mm, codes, H, gain, kind, near):
    """kind: (C, R) uint8 out, of each block of the view; near: (C, R) float32 out, its least forward distance, BEYOND_ALL: none
    within the range. gain: f_px * lsb_per_px."""
    cols, rows = codes.shape
    for j in range(kind.shape[0]):
        for i in range(kind.shape[1]):
            outside, smooth, measured, continued, other, count, most = 0, 0, 0, 0, 0, 0, 0
            for u in range(j * BLOCK, min((j + 1) * BLOCK, cols), _STEP):
                for v in range(i * BLOCK, min((i + 1) * BLOCK, rows), _STEP):
                    code = int(codes[u, v])
                    what = sample(depth_mm, code, H, u, v)
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


@inner
def recode_far(depth_mm, codes, H, clear_m, gain, out):
    """out: (cols, rows) uint16, the codes, with those of far cells by what was measured there beyond the range of the camera.

    clear_m: optical depth from which on a cell is far; gain: f_px * lsb_per_px."""
    cols, rows = codes.shape
    clear = np.uint16(min(65535.0, math.ceil(gain / clear_m)))
    for u in range(cols):
        for v in range(rows):
            code = codes[u, v]
            if code == Q_FAR:
                mm = source_mm(depth_mm, H, u, v)
                measured = mm < FAR_MM and mm > 1000.0 * clear_m
                w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
                code = np.uint16(math.ceil(gain * 1000.0 * w / mm)) if measured else clear
            out[u, v] = code
