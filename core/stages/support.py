"""Removes strips without enough support, sorts strips, and marks those that the border of the image cuts (not in the
paper).

Input and output: the table of strips. A strip needs a least number of source pixels, its own or those of similar
strips beside it, because a mismatch of stereo matching also forms a small strip."""

from __future__ import annotations

import numpy as np

from ..jit import inner, kernel
from .strips import CUT_BOTTOM, CUT_TOP, MERGED, PX, STRIP
from .view_geometry import outside_source


@inner
def drop_unsupported(strips, n, cols, settings, first_of_column, keep):
    """Removes strips with too few pixels; returns the number of the others, which are moved to the front in order.

    A strip needs min_support_px source pixels, a near one as many as min_support_m contains. A smaller one is kept if
    other small strips bring it to that number: those within support_columns, support_rows and support_sigmas (or
    support_relative) of disparity. A pole has them in its own column, a wire along its row; a mismatch of two by two
    pixels has none. A small strip within support_tail_sigmas of a large one beside it is noise of that one and is
    removed. Strips of the kind MERGED support all strips that they touch.

    Args:
        strips: (N,) STRIP in the order of `sort_columns`, in and out.
        cols: number of columns.
        first_of_column: (cols + 1,) int32 of `index_columns`, in and out."""
    least, per_px = PX * settings.min_support_px, settings.support_per_px
    for i in range(n):
        need = max(least, int(per_px * strips[i].disparity_px))
        keep[i] = strips[i].support >= need or is_supported(strips, i, cols, first_of_column, need, settings)
    n = compact(strips, n, keep)
    index_columns(strips, n, cols, first_of_column)
    return n


@inner
def is_supported(strips, i, cols, first_of_column, least, settings):
    """True if small neighbours bring strip i to the support `least`, and it is not noise of a large strip.

    A large strip counts if it touches the rows of strip i in its own column or the next ones, so these are searched
    first."""
    total = strips[i].support
    u, top, bottom, d = strips[i].column, strips[i].top_row, strips[i].bottom_row, strips[i].disparity_px
    reach, rows = settings.support_columns, settings.support_rows
    near = max(settings.support_sigmas * settings.sigma_d_px, settings.support_relative * d)
    tail, large = settings.support_tail_sigmas * settings.sigma_d_px, settings.support_large * least
    for k in range(2 * reach + 1):
        off = (k + 1) // 2  # 0, 1, -1, 2, -2, ..
        w = u + off if k % 2 == 1 else u - off
        if off > 1 and total >= least:
            return True
        if w < 0 or w >= cols:
            continue
        for j in range(first_of_column[w], first_of_column[w + 1]):
            if strips[j].top_row > bottom + rows + off:
                break
            touches, apart = strips[j].bottom_row >= top - rows - off, abs(strips[j].disparity_px - d)
            if touches and strips[j].kind == MERGED:  # it may contain the strips that supported this one
                return True
            if not touches or j == i or apart > near:
                continue
            inside = top >= strips[j].top_row - 1 and bottom <= strips[j].bottom_row + 1
            if inside and strips[j].support >= large:
                if off <= 1 and apart <= tail:
                    return False
            else:
                total += strips[j].support
    return total >= least


@inner
def index_columns(strips, n, cols, first_of_column):
    """Computes first_of_column: the strips of column u are first_of_column[u]..first_of_column[u + 1] - 1.

    The strips must be in the order of columns."""
    i = 0
    for u in range(cols + 1):
        for _ in range(n - i):
            if strips[i].column >= u:
                break
            i += 1
        first_of_column[u] = i


@inner
def compact(strips, n, keep):
    """Moves the strips with keep != 0 to the front; returns their number."""
    m = 0
    for i in range(n):
        if keep[i]:
            if m != i:
                strips[m] = strips[i]
            m += 1
    return m


@kernel
def sort_columns(strips, cols, first_of_column):
    """Sorts the strips of every column by top row, then from near to far. Insertion sort: they are few and nearly
    sorted.

    A record whose fields were read before is copied byte by byte, so `_comes_after` reads them from the table."""
    held = np.zeros(1, STRIP)
    for u in range(cols):
        first = first_of_column[u]
        for i in range(first + 1, first_of_column[u + 1]):
            if not _comes_after(strips[i - 1], strips[i]):
                continue
            held[0] = strips[i]
            at = i
            for _ in range(i - first):
                if not _comes_after(strips[at - 1], held[0]):
                    break
                strips[at] = strips[at - 1]
                at -= 1
            strips[at] = held[0]


@inner
def _comes_after(a, b):
    """True if strip a comes after strip b in the order of `sort_columns`."""
    return a.top_row > b.top_row or (a.top_row == b.top_row and a.disparity_px < b.disparity_px)


@inner
def mark_cuts(strips, n, H, cols, rows, cut_rows):
    """Sets `cut` where the cell cut_rows above or below a strip lies outside of the source image of cols x rows
    pixels."""
    for i in range(n):
        cut = 0
        if outside_source(H, strips[i].column, strips[i].top_row - cut_rows, cols, rows):
            cut = CUT_TOP
        if outside_source(H, strips[i].column, strips[i].bottom_row + cut_rows, cols, rows):
            cut += CUT_BOTTOM
        strips[i].cut = cut
