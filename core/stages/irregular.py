"""Irregular objects (Section 4.3): divides the pixels of a column that no window took into segments, each a strip.

Input: the list of the remaining pixels of a column. Output: strips of the kind IRREGULAR. The paper divides
them at constant height intervals Hd; here a segment also ends at gaps and depth jumps. The paper then drops segments on
horizontal surfaces (Eq. 12-14); here the ground is removed before, and other horizontal surfaces are obstacles."""

from __future__ import annotations

import numpy as np

from ..jit import inner_inline
from .row_mask import CODE, ROW
from .strips import IRREGULAR, Pixels, emit

_JUMP_SHARE = 0.08
"""Step of the disparity between rows, as a share, that ends a segment."""


@inner_inline
def irregular_rest(px, n, column, settings, out):
    """Divides the first n pixels of px, which no window took, into segments and makes a strip of each (Section 4.3).

    A segment ends at a gap, at a depth jump, when it is Hd tall at its nearest pixel, or when it is deeper than
    irregular_depth_m.
    px: list of pixels, see row_mask.py; n: number of pixels."""
    if n == 0:
        return
    gap, hd = settings.irregular_gap_px, settings.segment_height_m
    q, f, depth = settings.lsb_per_px, settings.f_px, settings.irregular_depth_m
    noise = settings.irregular_sigmas * settings.sigma_d_px
    first, total = 0, np.int64(px[CODE, 0])
    before = px[CODE, 0] / q
    least, most = before, before
    for i in range(1, n):
        d = px[CODE, i] / q
        lo, hi = min(least, d), max(most, d)
        close = px[ROW, i] - px[ROW, i - 1] > gap
        tall = px[ROW, i] - px[ROW, first] + 1
        close |= (abs(d - before) > max(noise, _JUMP_SHARE * d)) | (tall > hd * hi)
        # f / lo - f / hi > depth + noise * f / lo^2, without the divisions
        close |= f * (hi - lo) * lo > (depth * lo * lo + noise * f) * hi
        if close:
            close_irregular(px, first, i, total, column, settings, out)
            first, total = i, np.int64(0)
            lo, hi = d, d
        total += px[CODE, i]
        before, least, most = d, lo, hi
    close_irregular(px, first, n, total, column, settings, out)


@inner_inline
def close_irregular(px, first, last, total, column, settings, out):
    """Makes a strip of one irregular segment, at its near side."""
    pixels = Pixels(px[CODE], first, last, last - first, total, px[ROW, first], px[ROW, last - 1], 0)
    emit(pixels, True, IRREGULAR, column, settings, out)
