"""Pooling in the levelled view: source pixels that no cell took, and neighbouring columns.

Input: the marks, and the view as `level_nearest` filled it. Output: the view with the nearest pixel in each cell, and
with fewer columns where `column_step` is greater than 1. The paper does not pool; without it a thin pole could
disappear where the view has fewer cells than the source has pixels."""

from __future__ import annotations

import numpy as np

from ..jit import inner_inline, kernel_ieee
from ..types import FAR_MM
from .view_geometry import Q_MIN

_TILE_WIDE = 128
"""Pixels of a row that are processed together; their tables fit the L1 cache."""
_FAR = np.uint16(FAR_MM)


@inner_inline
def left_over(marks, picked, want, found):
    """Writes the positions of the measured pixels that were not picked to `found`; returns their number.

    Eight flags are tested as one number, which is mostly zero. Otherwise each of the eight positions is written, and
    kept if its flag is set.

    Args:
        marks: (N,) uint16.
        picked: (N,) uint8 of `level_nearest`.
        want: (M,) uint8 scratch, M a multiple of 8, zero beyond N.
        found: (M + 1,) int32 out."""
    for u in range(len(marks)):
        want[u] = np.uint8((picked[u] == 0) & (marks[u] != 0) & (marks[u] != _FAR))
    n = np.uint64(0)
    eights = want.view(np.uint64)
    for k in range(len(eights)):
        eight = eights[k]
        if eight != 0:
            for j in range(8):
                found[n] = np.int32(8 * k) + np.int32(j)
                n += (eight >> np.uint64(8 * j)) & np.uint64(1)
    return np.int64(n)


@kernel_ieee
def level_pool(marks, picked, R, k, view, out):
    """Transfers the measured source pixels that no cell took to their cells, where the nearest pixel is kept.

    Thin objects stay where the view has fewer cells than the source has pixels. Where it has more, nothing is
    enlarged, since every pixel was taken. Far pixels are not transferred: they must not make an unknown cell free.
    picked: (H * W,) uint8 of `level_nearest`; out: (cols, rows) uint16 of it, in and out."""
    want, found = np.zeros(_TILE_WIDE, np.uint8), np.empty(_TILE_WIDE + 1, np.int32)
    mark, cell = np.empty(_TILE_WIDE, np.uint16), np.empty(_TILE_WIDE, np.uint32)
    code, flat = np.empty(_TILE_WIDE, np.int32), out.ravel()
    (cols, rows), (src_rows, src_cols) = out.shape, marks.shape
    f, gain, half = np.float32(view.f_px), np.float32(view.f_px * view.lsb_per_px), np.float32(0.5)
    cu, cv = np.float32(view.cu + 0.5), np.float32(view.cv + 0.5)
    right, bottom, high = np.float32(cols), np.float32(rows), np.int32(rows)
    dx, dy, dz = np.float32(R[0, 0] / k[0]), np.float32(R[1, 0] / k[0]), np.float32(R[2, 0] / k[0])
    for u0 in range(0, src_cols, _TILE_WIDE):
        wide = min(_TILE_WIDE, src_cols - u0)
        want[wide:] = 0
        xu = (u0 - k[2]) / k[0]
        for v in range(src_rows):
            line = marks[v, u0 : u0 + wide]
            n = left_over(line, picked[v * src_cols + u0 : v * src_cols + u0 + wide], want, found)
            for i in range(n):
                mark[i] = line[found[i]]
            yv = (v - k[3]) / k[1]
            x0 = np.float32(R[0, 0] * xu + R[0, 1] * yv + R[0, 2])
            y0 = np.float32(R[1, 0] * xu + R[1, 1] * yv + R[1, 2])
            z0 = np.float32(R[2, 0] * xu + R[2, 1] * yv + R[2, 2])
            for i in range(n):
                u = np.float32(found[i])
                forward = x0 + dx * u
                r = np.float32(1.0) / max(forward, np.float32(1e-3))
                iu, iv = (y0 + dy * u) * r * f + cu, (z0 + dz * u) * r * f + cv
                inside = (forward >= np.float32(1e-3)) & (iu >= 0) & (iu < right) & (iv >= 0) & (iv < bottom)
                disparity = np.float32(1000.0) / np.float32(mark[i]) * r * gain + half
                disparity = max(min(disparity, np.float32(65535.0)), np.float32(Q_MIN))
                # pixels outside of the view change nothing: code 0 in the first cell
                at = np.int32(iu) * high + np.int32(iv)
                cell[i] = np.uint32(at if inside else 0)
                code[i] = np.int32(disparity) if inside else np.int32(0)
            for i in range(n):
                flat[cell[i]] = max(np.int32(flat[cell[i]]), code[i])


@kernel_ieee
def pool_columns(codes, step, apart, out):
    """Replaces each group of `step` neighbouring columns by one: the mean of the pixels that agree with the nearest
    one.

    The nearest of several noisy pixels of one wall is too near, their mean is not. A pole does not agree with the
    wall behind it and is kept.

    Args:
        step: columns of a group.
        apart: greatest difference of quantised disparity to the nearest pixel of a group that agrees.
        out: (ceil(cols / step), rows) uint16."""
    (cols, rows), apart = codes.shape, np.int32(apart)
    total, count = np.empty(rows, np.int32), np.empty(rows, np.int32)
    for j in range(len(out)):
        line, end = out[j], min(cols, (j + 1) * step)
        first = codes[j * step]
        for v in range(rows):
            line[v] = first[v]
            total[v], count[v] = 0, 0
        for u in range(j * step + 1, end):
            column = codes[u]
            for v in range(rows):
                line[v] = max(line[v], column[v])
        for u in range(j * step, end):
            column = codes[u]
            for v in range(rows):
                code = np.int32(column[v])
                agrees = (code >= np.int32(Q_MIN)) & (code + apart >= np.int32(line[v]))
                total[v] += code if agrees else np.int32(0)
                count[v] += np.int32(agrees)
        for v in range(rows):
            mean = np.float32(total[v]) / np.float32(max(count[v], np.int32(1)))
            nearest = line[v]
            line[v] = np.uint16(mean + np.float32(0.5)) if count[v] > 1 else nearest
