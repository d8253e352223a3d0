"""Levelled view (Section 4.1, Lemma 1): the frame as a gravity-aligned camera would have measured it.

Input: the marks of `classify` and the attitude. Output: `LevelledView`, quantised disparity per cell of the view.

The paper corrects pitch by Eq. 3 and rotates the image by the roll angle. Here the same is done exactly, for any roll
and pitch: a pure rotation has no parallax, so that each pixel keeps its measurement and only changes its place.
Columns become vertical, and Eq. 15 applies unchanged. Depth is never interpolated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..frames import Rotation
from ..jit import inline_ieee, inner, inner_inline, kernel
from ..params import Params
from ..types import FAR_MM, CameraInfo
from .pooling import level_pool, pool_columns
from .view_geometry import Q_FAR, Q_MIN, Q_UNKNOWN, ViewGeometry, pooled_geometry

_TILE_COLS, _TILE_HIGH, _TILE_ROWS = 32, 128, 64
"""Cells that are processed together; their part of the source fits the L1 cache. The cells of a column are written in
one go, so that memory is accessed in order. Positions are computed in float32 relative to the first of _TILE_ROWS
cells: cells that lie within 2e-4 px of the border between two pixels may take the other pixel if these sizes
change."""
_FAR = np.uint16(FAR_MM)
_AGREE_SIGMAS = 2.0
"""Pooled columns that differ by less noise are one surface, of which the mean counts; otherwise the nearest counts."""


@inner
def _rows_inside(a, b, first, last):
    """Returns the part (first, last) of the rows first..last in which a + b v >= 0."""
    # limited before the conversion: if b is a rounding error, the crossing exceeds any integer
    if b > 0.0:
        first = max(first, int(math.ceil(min(max(-a / b, -1.0), 1e6))))
    elif b < 0.0:
        last = min(last, int(math.floor(min(max(-a / b, -1.0), 1e6))))
    elif a < 0.0:
        last = first - 1
    return first, last


@inner
def source_rows_of_column(H, u, src_cols, src_rows, rows):
    """Returns (first, end) of the rows of column u whose nearest pixel lies in the source; first == end if there is
    none."""
    a0, b0 = H[0, 0] * u + H[0, 2], H[0, 1]
    a1, b1 = H[1, 0] * u + H[1, 2], H[1, 1]
    a2, b2 = H[2, 0] * u + H[2, 2], H[2, 1]
    first, last = _rows_inside(a2 - 1e-3, b2, 0, rows - 1)
    first, last = _rows_inside(a0 + 0.4999 * a2, b0 + 0.4999 * b2, first, last)
    first, last = _rows_inside(a1 + 0.4999 * a2, b1 + 0.4999 * b2, first, last)
    first, last = _rows_inside((src_cols - 0.5001) * a2 - a0, (src_cols - 0.5001) * b2 - b0, first, last)
    first, last = _rows_inside((src_rows - 0.5001) * a2 - a1, (src_rows - 0.5001) * b2 - b1, first, last)
    return first, max(first, last + 1)


@inline_ieee
def codes_of(marks, forward, gain, out):
    """Computes the quantised disparity of pixels.

    Args:
        marks: (N,) uint16.
        forward: (N,) float32, Z_optical / X of the cells, which turns 1/Z into 1/X.
        out: (N,) uint16."""
    for i in range(len(out)):
        mark = marks[i]
        d = np.float32(1000.0) / np.float32(mark)
        code = np.int32(min(d * forward[i] * gain + np.float32(0.5), np.float32(65535.0)))
        code = max(code, np.int32(Q_MIN))
        if mark == _FAR:
            code = np.int32(Q_FAR)
        if mark == 0:
            code = np.int32(Q_UNKNOWN)
        out[i] = np.uint16(code)


@inline_ieee
def source_of_rows(H, u, first, src_cols, src_rows, forward, at):
    """Computes the nearest source pixel of the cells (u, first), (u, first + 1), ...

    Pixels are clamped to the image; the cells must be those of `source_rows_of_column`.

    Args:
        H, u, first: see ViewGeometry.
        src_cols, src_rows: size of the source.
        forward: (N,) float32 out, Z_optical / X.
        at: (N,) uint32 out, index of the pixel in the flat image."""
    a0, b0 = H[0, 0] * u + H[0, 2], H[0, 1]
    a1, b1 = H[1, 0] * u + H[1, 2], H[1, 1]
    a2, b2 = H[2, 0] * u + H[2, 2], H[2, 1]
    # float32 relative to the first cell: within 2e-4 px of the exact position
    x0, y0, w0 = np.float32(a0 + b0 * first), np.float32(a1 + b1 * first), np.float32(a2 + b2 * first)
    dx, dy, dw = np.float32(b0), np.float32(b1), np.float32(b2)
    right, bottom, stride = np.int32(src_cols - 1), np.int32(src_rows - 1), np.int32(src_cols)
    half = np.float32(0.5)
    for i in range(len(at)):
        v = np.float32(np.int32(i))
        w = w0 + dw * v
        r = np.float32(1.0) / w
        x = min(max(np.int32((x0 + dx * v) * r + half), np.int32(0)), right)
        y = min(max(np.int32((y0 + dy * v) * r + half), np.int32(0)), bottom)
        at[i] = np.uint32(y * stride + x)
        forward[i] = w


@kernel
def level_nearest(marks, H, gain, out, picked):
    """Assigns the nearest source pixel to each cell of the view. Cells outside of the source are unknown.

    Positions are computed apart from the access to pixels, so that this part is vectorised.
    out: (cols, rows) uint16 quantised disparity out, one line per column of the view; picked: (H * W,) uint8 out, 1 for
    each source pixel that a cell took."""
    picked[:] = 0
    (src_rows, src_cols), (cols, rows), flat, gain = marks.shape, out.shape, marks.ravel(), np.float32(gain)
    seen, at = np.empty((_TILE_COLS, 2), np.int64), np.empty(_TILE_ROWS, np.uint32)
    forward, mark = np.empty(_TILE_ROWS, np.float32), np.empty(_TILE_ROWS, np.uint16)
    for u0 in range(0, cols, _TILE_COLS):
        wide = min(_TILE_COLS, cols - u0)
        for k in range(wide):
            seen[k, 0], seen[k, 1] = source_rows_of_column(H, u0 + k, src_cols, src_rows, rows)
            out[u0 + k, : seen[k, 0]] = Q_UNKNOWN
            out[u0 + k, seen[k, 1] :] = Q_UNKNOWN
        for high in range(0, rows, _TILE_HIGH):
            for k in range(wide):
                for v0 in range(high, min(rows, high + _TILE_HIGH), _TILE_ROWS):
                    first, end = max(seen[k, 0], v0), min(seen[k, 1], v0 + _TILE_ROWS)
                    n = end - first
                    if n <= 0:
                        continue
                    source_of_rows(H, u0 + k, first, src_cols, src_rows, forward, at[:n])
                    fetch_pixels(flat, at[:n], mark, picked)
                    codes_of(mark, forward, gain, out[u0 + k, first:end])


@inner_inline
def fetch_pixels(flat, at, mark, picked):
    """Copies the marks of the pixels `at` of the flat image to `mark` and sets their flags in `picked`."""
    for i in range(len(at)):
        mark[i] = flat[at[i]]
        picked[at[i]] = 1


@kernel
def level_into(marks, R, k, view, out, picked):
    """Fills `out` by `level_nearest` and `level_pool`. picked: (H * W,) uint8 scratch."""
    level_nearest(marks, view.H, view.f_px * view.lsb_per_px, out, picked)
    level_pool(marks, picked, R, k, view, out)


@dataclass(frozen=True, slots=True, eq=False)
class LevelledView:
    """A frame as a gravity-aligned camera would have measured it."""

    # (cols, rows) uint16, quantised disparity, Q_UNKNOWN or Q_FAR. Columns are pooled by `column_step`.
    codes: NDArray[np.uint16]
    view: ViewGeometry  # geometry of `codes`
    # the same without pooling. Free space is judged by it, because pooling would hide unknown columns.
    exact_codes: NDArray[np.uint16]
    exact_view: ViewGeometry  # geometry of `exact_codes`


def level_view(
    marks: NDArray[np.uint16],
    info: CameraInfo,
    R_level_optical: Rotation,
    view: ViewGeometry,
    ke_per_m: float,
    params: Params,
    buffers: Buffers,
) -> LevelledView:
    """Returns the levelled view of an image of marks. Its arrays lie in `buffers` and are valid until the next frame.

    ke_per_m: noise coefficient, which determines what columns are pooled."""
    codes, picked = buffers("codes", (view.cols, view.rows), np.uint16), buffers("picked", (marks.size,), np.uint8)
    k, step = info.intrinsics, params.column_step
    level_into(marks, np.ascontiguousarray(R_level_optical), np.array([k.fx, k.fy, k.cx, k.cy]), view, codes, picked)
    if step == 1:
        return LevelledView(codes, view, codes, view)
    apart_px = math.sqrt(2.0) * _AGREE_SIGMAS * max(ke_per_m * view.f_px, params.min_sigma_px)
    pooled = buffers("pooled", (-(-view.cols // step), view.rows), np.uint16)
    pool_columns(codes, step, int(apart_px * view.lsb_per_px), pooled)
    return LevelledView(pooled, pooled_geometry(view, step), codes, view)
