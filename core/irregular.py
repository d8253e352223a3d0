"""Section 4.3 for one column: what no window took, in segments; and which of it is a horizontal surface."""

from __future__ import annotations

import math

from numba import njit

from .density import NO_PEAK
from .strips import (
    FREE_PX,
    HORIZONTAL,
    I_GAP,
    I_HORIZONTAL,
    I_PAPER,
    IRREGULAR,
    S_CENTRE,
    S_CORRELATION,
    S_DEPTH,
    S_F,
    S_HD,
    S_HORIZON,
    S_JUMP,
    S_QUANTUM,
    S_REST_SIGMAS,
    S_SIGMA_D,
    emit_paper,
    emit_pixels,
)


@njit(cache=True, nogil=True)
def is_horizontal(line, member, label, top, bottom, fs, si):
    """Eq. 12-14: do disparity and row of these pixels correlate, and does their line meet the horizon?

    In the levelled view the vanishing row is the horizon whatever the pitch."""
    n, sd, sv, sdd, svv, sdv = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for v in range(top, bottom + 1):
        if member[v] == label:
            d = line[v] / fs[S_QUANTUM]
            n, sd, sv, sdd, svv, sdv = n + 1, sd + d, sv + v, sdd + d * d, svv + 1.0 * v * v, sdv + d * v
    if n < si[I_HORIZONTAL]:
        return False
    var_d, var_v, cov = sdd - sd * sd / n, svv - sv * sv / n, sdv - sd * sv / n
    if var_d <= 1e-9 or var_v <= 1e-9:
        return False
    r = cov / math.sqrt(var_d * var_v)
    centre = (sv / n * sdd - sd / n * sdv) / (sdd - sd * sd / n)
    return 1.0 - abs(r) < fs[S_CORRELATION] and abs(centre - fs[S_HORIZON]) < fs[S_CENTRE]


@njit(cache=True, nogil=True)
def irregular_rest(line, state, member, u, H, fs, si, scratch, ints, floats, n):
    """Section 4.3: what no window took, in segments; returns the new count.

    A segment grows row by row and ends at a gap, at a depth jump, when it is Hd tall at its nearest pixel, or deeper
    than irregular_depth_m. `member` is overwritten with the segment's mark."""
    rows = line.shape[0]
    paper = si[I_PAPER] == 1
    mark = 0
    top, last = -1, -1
    least, most = 0.0, 0.0
    for v in range(rows):
        member[v] = NO_PEAK
    for v in range(rows + 1):
        open_ = top >= 0
        taken = v < rows and state[v] == FREE_PX
        d = line[v] / fs[S_QUANTUM] if taken else 0.0
        close = open_ and (v == rows or v - last > si[I_GAP])
        if open_ and taken and not close:
            lo, hi = min(least, d), max(most, d)
            if paper:
                close = v - top + 1 > fs[S_HD] * most
            else:
                noise = fs[S_REST_SIGMAS] * fs[S_SIGMA_D]
                jump = abs(d - line[last] / fs[S_QUANTUM]) > max(noise, fs[S_JUMP] * d)
                depth = fs[S_F] / lo - fs[S_F] / hi
                deep = depth > fs[S_DEPTH] + noise * fs[S_F] / (lo * lo)
                close = jump or deep or v - top + 1 > fs[S_HD] * hi
        if close:
            n = close_irregular(line, state, member, mark, top, last, u, H, fs, si, scratch, ints, floats, n)
            mark = (mark + 1) % NO_PEAK
            top = -1
        if taken:
            if top < 0:
                top, least, most = v, d, d
            member[v] = mark
            last, least, most = v, min(least, d), max(most, d)
    return n


@njit(cache=True, nogil=True)
def close_irregular(line, state, member, mark, top, last, u, H, fs, si, scratch, ints, floats, n):
    """Ends one irregular segment: a strip at its near side. The paper leaves horizontal surfaces out."""
    horizontal = is_horizontal(line, member, mark, top, last, fs, si)
    if si[I_PAPER] == 1:
        if horizontal:
            return n
        return emit_paper(line, state, top, last, True, u, fs, ints, floats, n)
    kind = HORIZONTAL if horizontal else IRREGULAR
    return emit_pixels(line, state, member, mark, top, last, True, kind, u, H, fs, si, scratch, ints, floats, n)
