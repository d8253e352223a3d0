"""What stands out in front of a plane, and is too little to be its surface, becomes a plane of its own.

`shift_to_near_side` moves a whole plane in front of the nearest edge among its strips. That is right where near edges scatter,
as those of leaves do. One leaf or stray pixel that grew into the piece of a wall would bring the whole wall to its own
distance. So the few strips that stand out farthest leave, where that spares the rest much more of a shift than its
strips scatter. Nothing is lost: each leaves as a strip of another plane, which is shifted to its near side as all are.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel
from .line_fit import SS, TS, TT, S, T, W, add_point, fit_line, misfit
from .planes import FRONT, P_INFERRED, P_SUPPORT, T0, T1, A, B, distance_at, near_excess_m
from .segments import is_jump, strip_variance, tangent
from .strips import BOTTOM, KIND, NEAR, SIGMA, SUPPORT, TOP, TRACK, D, U

STEPS, _STEP_M = 32, 0.05
"""Not tuning: excesses are told apart in so many steps; what is over counts as the last."""
_LOOK_BACK = 32
"""Not tuning: new planes, the latest first, that a strip may go on with."""
# columns of the table of new planes: the plane they leave, and their last strip
_FROM, _LAST = range(2)


@kernel
def measure_excess(
    ints, floats, n, f, cu, lateral, count, plane_of, planes, safe_m, along_m, near_sigmas, excess, above
):  # fmt: skip
    """excess (n,) float32 out: `near_excess_m` of each strip over its plane. above (count, STEPS) float64 out: support of
    the strips of a plane by the step of their excess; what has none counts nowhere."""
    above[:count] = 0.0
    length = np.empty(count)
    for k in range(count):
        length[k] = math.hypot(planes[k, A], planes[k, B])
    for i in range(n):
        if ints[i, SUPPORT] == 0:
            excess[i] = -1.0
            continue
        k = plane_of[ints[i, TRACK]]
        t = tangent(ints, i, cu, f, lateral)
        excess[i] = near_excess_m(
            distance_at(planes[k], t), t, floats[i, D], floats[i, NEAR], floats[i, SIGMA], ints[i, KIND], planes[k, A],
            planes[k, B], length[k], f, safe_m, along_m, near_sigmas,
        )  # fmt: skip
        if excess[i] > 0.0:
            above[k, min(int(excess[i] / _STEP_M), STEPS - 1)] += ints[i, SUPPORT]


@inner
def what_leaves(count, planes, plane_ints, moments, above, share, spared_m, spreads, least):
    """least (count,) float64 out: excess from which strips leave their plane, infinite where none does.

    They hold at most `share` of its support, and the rest is spared a shift by spared_m and by `spreads` times how far
    its strips lie from its line, root mean square."""
    for k in range(count):
        least[k] = math.inf
        if planes[k, FRONT] <= spared_m:
            continue
        first, held = STEPS, 0.0
        for back in range(STEPS):
            held += above[k, STEPS - 1 - back]
            if held > share * plane_ints[k, P_SUPPORT]:
                break
            first = STEPS - 1 - back
        w, s = moments[k, W], moments[k, S]
        square = misfit(w, moments[k, T], s, moments[k, TT], moments[k, TS], moments[k, SS], planes[k, A], planes[k, B])
        spread_m = math.sqrt(square) * (w / s) * (w / s)
        if planes[k, FRONT] - first * _STEP_M >= max(spared_m, spreads * spread_m):
            least[k] = first * _STEP_M


@inner
def leave(
    ints, floats, n, f, cu, lateral, count, tracks, plane_of, planes, plane_ints, moments, excess, least, jump,
    jump_sigmas, link, slope_weight, rough_m, half_column_t, new,
):  # fmt: skip
    """Makes planes of the strips whose excess is at least that of their plane; returns the number of all.

    A strip goes on with the latest new plane out of its own that it touches in rows and meets in depth (`is_jump`), at
    most `link` columns on. new: (N, 2) int32 scratch. Tables as
    `measure_planes` left them (planes.py), with room for one more plane and track a strip, the new tracks from `tracks` on: lines
    and ends of the new planes are written, all else, and heights of the old ones, must be measured anew."""
    alive = count
    for i in range(n):
        if excess[i] <= 0.0:
            continue
        k = plane_of[ints[i, TRACK]]
        if excess[i] < least[k]:
            continue
        at = -1
        for back in range(min(_LOOK_BACK, alive - count)):
            q = alive - 1 - back
            last = new[q, _LAST]
            if new[q, _FROM] != k or ints[i, U] - ints[last, U] > link:
                continue
            if ints[i, TOP] > ints[last, BOTTOM] + 1 or ints[last, TOP] > ints[i, BOTTOM] + 1:
                continue
            if not is_jump(floats[i, D], floats[last, D], floats[i, SIGMA], floats[last, SIGMA], jump, jump_sigmas):
                at = q
                break
        t = tangent(ints, i, cu, f, lateral)
        if at < 0:
            at = alive
            alive += 1
            new[at, _FROM] = k
            plane_of[tracks + at - count] = at
            plane_ints[at, P_INFERRED] = 0
            for m in range(6):
                moments[at, m] = 0.0
            planes[at, T0], planes[at, T1] = t - half_column_t, t + half_column_t
        new[at, _LAST] = i
        planes[at, T0], planes[at, T1] = min(planes[at, T0], t - half_column_t), max(planes[at, T1], t + half_column_t)
        add_point(moments[at], t, floats[i, D] / f, 1.0 / strip_variance(floats[i, D], floats[i, SIGMA], f, rough_m))
        ints[i, TRACK] = tracks + at - count
    for k in range(count, alive):
        a, b, _, _ = fit_line(moments[k], slope_weight)
        planes[k, A], planes[k, B] = a, b
    return alive
