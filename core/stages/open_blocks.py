"""Blocks of a levelled view by what their pixels show: textureless, measured, or neither. See docs/explanation/open-space.md."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inline_ieee, inner, inner_inline, kernel
from ..types import BEYOND_MM, CONTINUED_MM, FAR_MM, SATURATED_MM, TEXTURED_MM, TEXTURELESS_MM, UNKNOWN_MM
from .free_holes import LEAST_SIDE
from .level import source_of_rows, source_rows_of_column
from .view_geometry import Q_FAR, Q_UNKNOWN

BLOCK = 4
"""Side of a block of cells."""
STEP = 2
"""Step at which the cells of a block are sampled."""
EDGE_ROWS = 3
"""Rows above an edge that its marks take: those of the derivative and `SmoothLimits.grow_px`."""
OUTSIDE, SMOOTH, MEASURED, PARTLY, OTHER, CONTINUED, TEXTURED = range(7)
"""Kinds of blocks: beyond the image; all textureless; at least half measured; less, with pixels of which nothing is known; such pixels
alone (masked, dark, saturated, or dropped after they were measured); textureless, or measured in part, of the brightness of what is
measured below; all others, whose unmeasured pixels are textured."""
_IS_OUTSIDE, IS_SMOOTH, IS_MEASURED, _IS_OTHER, IS_CONTINUED, _IS_TEXTURED = (
    np.uint8(1 << kind) for kind in (OUTSIDE, SMOOTH, MEASURED, OTHER, CONTINUED, TEXTURED)
)
"""Kinds of cells, as bits."""
_AS_GROUND = IS_CONTINUED | IS_MEASURED | IS_SMOOTH
BEYOND_ALL = np.float32(np.inf)
"""Distance of what is not measured within the range."""
_CLEAR, _FAR, _SATURATED, _UNKNOWN = np.uint16(Q_FAR), np.uint16(FAR_MM), np.uint16(SATURATED_MM), np.uint16(UNKNOWN_MM)


class MarkedView(NamedTuple):
    """A levelled view with the marks of its source; (cols, rows) each. codes: uint16, those of far cells by what was measured beyond the
    range of the camera; mm: uint16, millimetres or a mark, UNKNOWN_MM outside of the image; kinds: uint8, bits of the kinds of cells."""

    codes: Any
    mm: Any
    kinds: Any


@kernel
def level_marks(flat, shape, codes, H, least_m, gain, marked):
    """Each cell of the levelled view takes what its source pixel holds, and a far one the code of what was measured there.

    flat: (H * W,) uint16 of the source, with its marks; shape: (H, W); codes: (cols, rows) uint16 of the view. least_m: optical depth that a
    far cell has at least; gain: f_px * lsb_per_px. marked: MarkedView, filled."""
    src_rows, src_cols = shape
    rows = codes.shape[1]
    forward_of, at_of = np.empty(rows, np.float32), np.empty(rows, np.uint32)
    for u in range(codes.shape[0]):
        first, end = source_rows_of_column(H, u, src_cols, src_rows, rows)
        line, mm, kinds = marked.codes[u], marked.mm[u], marked.kinds[u]
        line[:first], mm[:first], kinds[:first] = Q_UNKNOWN, UNKNOWN_MM, _IS_OUTSIDE
        line[end:], mm[end:], kinds[end:] = Q_UNKNOWN, UNKNOWN_MM, _IS_OUTSIDE
        forward, at = forward_of[: end - first], at_of[: end - first]
        source_of_rows(H, u, first, src_cols, src_rows, forward, at)
        fetch_marks(flat, at, mm[first:end])
        codes_beyond(codes[u, first:end], mm[first:end], forward, least_m, gain, line[first:end])
        kinds_of(line[first:end], mm[first:end], kinds[first:end])


@inner_inline
def fetch_marks(flat, at, mm):
    """mm: (N,) uint16 out, the pixels at[:N] of the flat image; saturated ones are unknown."""
    for i in range(len(mm)):
        mm[i] = flat[at[i]]
    for i in range(len(mm)):
        z = mm[i]
        mm[i] = _UNKNOWN if z == _SATURATED else z


@inline_ieee
def codes_beyond(codes, mm, forward, least_m, gain, out):
    """out: (N,) uint16, the codes with those of far cells by their mm. least_m: optical depth that a far cell has at least, also where
    nothing was measured; gain: f_px * lsb_per_px."""
    least_mm, scale = np.float32(1000.0 * least_m), np.float32(1000.0 * gain)
    for i in range(len(out)):
        z, code = mm[i], codes[i]
        depth_mm = max(np.float32(z), least_mm) if z < _FAR else least_mm
        measured = np.uint16(np.int32(min(np.ceil(scale * forward[i] / depth_mm), np.float32(65535.0))))
        out[i] = measured if code == _CLEAR else code


@inner_inline
def kinds_of(codes, mm, kinds):
    """kinds: (N,) uint8 out, of cells within the image with these codes and marks."""
    for i in range(len(kinds)):
        z = mm[i]
        kind = _IS_TEXTURED if z == TEXTURED_MM else _IS_OTHER
        kind = IS_CONTINUED if z == CONTINUED_MM else kind
        kind = IS_MEASURED if z == BEYOND_MM else kind
        kind = IS_SMOOTH if z == TEXTURELESS_MM else kind
        kinds[i] = IS_MEASURED if codes[i] != Q_UNKNOWN else kind


@kernel
def join_ground(marked, first):
    """Smooth cells between smooth ground on both sides count as ground too, where these gaps along a row are narrower than the
    smallest hole that may hide an object. The rows above `first`, the horizon, hold no ground. marked: MarkedView, changed in place."""
    cols, rows = marked.mm.shape
    for u in range(1, cols - 1):
        for v in range(first, rows):
            if marked.kinds[u, v] == IS_SMOOTH and width_of_gap(marked.kinds, u, v) < LEAST_SIDE:
                marked.mm[u, v], marked.kinds[u, v] = CONTINUED_MM, IS_CONTINUED


@inner
def width_of_gap(kinds, u, v):
    """Cells between the smooth ground to the left and to the right of cell (u, v), LEAST_SIDE or more where one of them is not that near.
    kinds: (cols, rows) uint8."""
    left, right = LEAST_SIDE, LEAST_SIDE
    for step in range(LEAST_SIDE - 1, 0, -1):
        left = step if u >= step and kinds[u - step, v] == IS_CONTINUED else left
        right = step if u + step < len(kinds) and kinds[u + step, v] == IS_CONTINUED else right
    return left + right - 1


class BlockRows(NamedTuple):
    """What `join_columns` finds of two columns of cells, (rows,)."""

    kinds: Any  # uint8, bits of both
    measured: Any  # uint8, how many of both are measured
    most: Any  # uint16, the greater code


@kernel
def sort_blocks(marked, gain, kind, near):
    """marked: MarkedView. kind: (C, R) uint8 out, of each block of the view; near: (C, R) float32 out, its least forward distance,
    BEYOND_ALL: none within the range. gain: f_px * lsb_per_px.

    Two columns and two rows of a block are looked at; at the border of the view, where it has one, that one twice."""
    cols, rows = marked.codes.shape
    of_both, measured, most = np.empty(rows, np.uint8), np.empty(rows, np.uint8), np.empty(rows, np.uint16)
    scratch = BlockRows(of_both, measured, most)
    for j in range(kind.shape[0]):
        u0 = j * BLOCK
        u1 = u0 + STEP if u0 + STEP < cols else u0
        join_columns(marked.kinds[u0], marked.kinds[u1], marked.codes[u0], marked.codes[u1], scratch)
        for i in range(kind.shape[1]):
            v0 = i * BLOCK
            v1 = v0 + STEP if v0 + STEP < rows else v0
            code = max(most[v0], most[v1])
            near[j, i] = np.float32(gain / code) if code > Q_FAR else BEYOND_ALL
            kind[j, i] = kind_of_block(of_both[v0] | of_both[v1], measured[v0] + measured[v1])


@inner_inline
def join_columns(kinds, other_kinds, codes, other_codes, joined):
    """joined: BlockRows out, of two columns of cells. kinds, other_kinds: (rows,) uint8; codes, other_codes: (rows,) uint16."""
    for v in range(len(kinds)):
        a, b = kinds[v], other_kinds[v]
        joined.kinds[v] = a | b
        joined.measured[v] = np.uint8(a == IS_MEASURED) + np.uint8(b == IS_MEASURED)
    for v in range(len(kinds)):
        c, d = codes[v], other_codes[v]
        joined.most[v] = c if c > d else d


@inner_inline
def kind_of_block(kinds, measured):
    """The kind of a block. kinds: bits of its four cells; measured: how many of them are measured."""
    if kinds & _IS_OUTSIDE:
        return OUTSIDE
    if kinds == IS_SMOOTH:
        return SMOOTH
    if measured >= 2:
        return MEASURED
    if (kinds & IS_CONTINUED) and not (kinds & ~_AS_GROUND):
        return CONTINUED
    if kinds & _IS_OTHER:
        return PARTLY if measured > 0 else OTHER
    return TEXTURED
