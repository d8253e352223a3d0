"""When two planes of the world are one, and which: section 5.3 over time, with the moments of Eq. 17 in full.

A plane's moments (weight, x, y, xx, xy, yy) are those of its ends and all between them, weighted by inverse variance;
the paper's lack zz, without which walls along one axis have no fit and no fit has a residual.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, record
from ..types import PlaneFlags
from .free_grid import any_free
from .plane_index import (
    ANCHOR_X,
    ANCHOR_Y,
    AX,
    AY,
    BOTTOM,
    BX,
    BY,
    CHANGED,
    CLEARS,
    FLAGS,
    FRAME,
    FROM,
    HITS,
    JOINED,
    MARGIN,
    TO,
    TOP,
    XX,
    XY,
    YY,
    W,
    X,
    Y,
    insert,
    new_slot,
    remove,
    seen_again,
    set_links,
)

REFUSED = 2.0
# columns of the observations (N, 10) float64, after the box of the plane
O_MARGIN, O_WEIGHT, O_SIGMA, O_FLAGS = 6, 7, 8, 9
WORLD_RULES = record(
    ("turn_cos", np.float64),
    ("gap_m", np.float64),
    ("join_m", np.float64),
    ("join_sigmas", np.float64),
    ("noise_cap_m", np.float64),
    ("corner_m", np.float64),
    ("short_m", np.float64),
    ("longest_m", np.float64),
    ("memory_frames", np.float64),
    ("free_evidence_limit", np.float64),
    ("free_evidence_per_hit", np.float64),
    ("behind_m", np.float64),
    ("free_evidence_sigmas", np.float64),
    ("free_evidence_share", np.float64),
    ("step_m", np.float64),
    ("pose_sigma_m", np.float64),
    ("free_evidence_limit_extra", np.float64),
)
"""Rules of the merged world, see `update.rules_of`. turn_cos: cosine of plane_angle_deg; gap_m: passable_width_m; join_m,
join_sigmas, noise_cap_m, corner_m: how far off a line, and how empty a corner, joined planes may be; short_m, longest_m:
lengths of planes; memory_frames: observations that count; free_evidence_limit to free_evidence_limit_extra: when an observed part is removed."""

_GAP_POINTS = 3
"""Not tuning: a gap is asked for free space at so many places along it and so many heights."""
_OVER = int(PlaneFlags.IRREGULAR) | int(PlaneFlags.UNKNOWN_BEHIND)
"""Flags of a join when either has them; the others when both have."""
_INFERRED = int(PlaneFlags.INFERRED)
_IRREGULAR = int(PlaneFlags.IRREGULAR)
_WHOLE = 0.9
"""Not tuning: an observation of so much of a plane has measured all of it."""
_TINY = 1e-9


@inner
def length_of(ax, ay, bx, by):
    """Of a segment, never 0."""
    return max(math.sqrt((bx - ax) ** 2 + (by - ay) ** 2), _TINY)


@inner
def segment_moments(ax, ay, bx, by, weight, sigma):
    """Moments of points spread evenly over a segment, each with a round error."""
    x, y, dx, dy, v = 0.5 * (ax + bx), 0.5 * (ay + by), bx - ax, by - ay, sigma * sigma
    return (
        weight, weight * x, weight * y, weight * (x * x + dx * dx / 12.0 + v), weight * (x * y + dx * dy / 12.0),
        weight * (y * y + dy * dy / 12.0 + v),
    )  # fmt: skip


@inner
def line_of(m, ux, uy, least_cos):
    """(x, y, dx, dy): middle and direction of the line nearest to what has these moments, by total least squares.

    It runs the way of (ux, uy); a line that turns farther than least_cos from it is of something short: it keeps that."""
    x, y = m[1] / m[0], m[2] / m[0]
    cxx, cxy, cyy = m[3] / m[0] - x * x, m[4] / m[0] - x * y, m[5] / m[0] - y * y
    turn = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
    dx, dy = math.cos(turn), math.sin(turn)
    along = dx * ux + dy * uy
    if along < 0.0:
        dx, dy, along = -dx, -dy, -along
    if along < least_cos:
        dx, dy = ux, uy
    return x, y, dx, dy


@inner
def corner_cost(p0, p1, p_top, p_bottom, q0, q1, q_top, q_bottom, most):
    """Side of the largest empty corner that the rectangle around p and q takes in, over `most`; 1 and more: too large.

    At each end one of the two reaches farther; where the other is taller, a corner beside it is empty."""
    worst = 0.0
    for end in range(2):
        reach = q0 - p0 if end == 0 else p1 - q1
        if reach >= 0.0:  # p reaches farther: q's heights beyond p's
            tall = max(p_top - q_top, q_bottom - p_bottom)
        else:
            tall = max(q_top - p_top, p_bottom - q_bottom)
        worst = max(worst, min(abs(reach), tall))
    return worst / most


@inner
def joined(a, b, m, sigma, rules):
    """(cost, ax, ay, bx, by, gap): what joining boxes a and b costs, below 1 when they may, and the joined ends.

    a, b: ax, ay, bx, by, top, bottom; m: their moments together; sigma: noise of the farther one."""
    no = (REFUSED, 0.0, 0.0, 0.0, 0.0, 0.0)
    if min(a[5], b[5]) <= max(a[4], b[4]):
        return no
    la, lb = length_of(a[0], a[1], a[2], a[3]), length_of(b[0], b[1], b[2], b[3])
    uax, uay, ubx, uby = (a[2] - a[0]) / la, (a[3] - a[1]) / la, (b[2] - b[0]) / lb, (b[3] - b[1]) / lb
    facing = uax * ubx + uay * uby
    if facing <= 0.0 or (min(la, lb) > rules.short_m and facing < rules.turn_cos):
        return no
    ux, uy = (uax, uay) if la >= lb else (ubx, uby)
    x, y, dx, dy = line_of(m, ux, uy, rules.turn_cos)
    a0, a1 = (a[0] - x) * dx + (a[1] - y) * dy, (a[2] - x) * dx + (a[3] - y) * dy
    b0, b1 = (b[0] - x) * dx + (b[1] - y) * dy, (b[2] - x) * dx + (b[3] - y) * dy
    begin, end = min(a0, b0), max(a1, b1)
    gap = max(0.0, max(b0 - a1, a0 - b1))
    if gap >= rules.gap_m or end - begin > rules.longest_m:
        return no
    off = 0.0
    for k in range(2):
        off = max(off, abs((a[2 * k + 1] - y) * dx - (a[2 * k] - x) * dy))
        off = max(off, abs((b[2 * k + 1] - y) * dx - (b[2 * k] - x) * dy))
    off /= rules.join_m + min(rules.join_sigmas * sigma, rules.noise_cap_m)
    corner = corner_cost(a0, a1, a[4], a[5], b0, b1, b[4], b[5], rules.corner_m)
    if off >= 1.0 or corner >= 1.0:
        return no
    cost = 0.5 * off + 0.3 * gap / rules.gap_m + 0.2 * corner
    return cost, x + begin * dx, y + begin * dy, x + end * dx, y + end * dy, gap


@inner
def stays_open(free, a, b, flags, gap, rules):
    """Whether the gap between two boxes stays open: it is wide, and seen free anywhere at the heights of both, or beside
    scattered things (flags of either): the extent of leaves beyond their ends is unknown."""
    if gap <= rules.corner_m:
        return False
    if flags & _IRREGULAR:
        return True
    # the facing ends: b of one and a of the other
    ab = (a[2] - b[0]) ** 2 + (a[3] - b[1]) ** 2
    ba = (b[2] - a[0]) ** 2 + (b[3] - a[1]) ** 2
    x0, y0, x1, y1 = (a[2], a[3], b[0], b[1]) if ab < ba else (b[2], b[3], a[0], a[1])
    top, bottom = max(a[4], b[4]), min(a[5], b[5])
    for k in range(1, _GAP_POINTS + 1):
        share = k / (_GAP_POINTS + 1)
        for h in range(1, _GAP_POINTS + 1):
            z = top + (bottom - top) * h / (_GAP_POINTS + 1)
            if any_free(free, x0 + (x1 - x0) * share, y0 + (y1 - y0) * share, z):
                return True
    return False


@inner
def box_of(box, i):
    """The six numbers of a box."""
    return (
        float(box[i, AX]), float(box[i, AY]), float(box[i, BX]), float(box[i, BY]), float(box[i, TOP]),
        float(box[i, BOTTOM]),
    )  # fmt: skip


@inner
def moments_of(tables, i, ax, ay):
    """Moments of slot i about the anchor (ax, ay)."""
    m, f = tables[1], tables[2]
    w, sx, sy = m[i, W], m[i, X], m[i, Y]
    ox, oy = float(f[i, ANCHOR_X]) - ax, float(f[i, ANCHOR_Y]) - ay
    return moved_moments((w, sx, sy, m[i, XX], m[i, XY], m[i, YY]), ox, oy)


@inner
def moved_moments(m, ox, oy):
    """Moments about a point that lies (ox, oy) back."""
    w, sx, sy, xx, xy, yy = m
    return (
        w, sx + w * ox, sy + w * oy, xx + 2.0 * ox * sx + w * ox * ox, xy + ox * sy + oy * sx + w * ox * oy,
        yy + 2.0 * oy * sy + w * oy * oy,
    )  # fmt: skip


@inner
def together(m, n, share):
    """Moments of both, the former by a share."""
    return (
        share * m[0] + n[0], share * m[1] + n[1], share * m[2] + n[2], share * m[3] + n[3], share * m[4] + n[4],
        share * m[5] + n[5],
    )  # fmt: skip


@inner
def shifted(box, x, y):
    """A box with its ends counted from (x, y)."""
    return box[0] - x, box[1] - y, box[2] - x, box[3] - y, box[4], box[5]


@inner
def put_box(tables, i, ax, ay, bx, by, top, bottom):
    """Moves slot i to another box, its lists too. What was seen through keeps its place."""
    box, floats, ints = tables[0], tables[2], tables[3]
    if ints[i, CLEARS] > 0:
        length = length_of(ax, ay, bx, by)
        back = ((float(box[i, AX]) - ax) * (bx - ax) + (float(box[i, AY]) - ay) * (by - ay)) / length
        floats[i, FROM] += back
        floats[i, TO] += back
    set_links(tables, i, False)
    box[i, AX], box[i, AY], box[i, BX], box[i, BY] = ax, ay, bx, by
    box[i, TOP], box[i, BOTTOM] = top, bottom
    ints[i, CHANGED] = tables[7][FRAME]
    insert(tables, i)


@inner
def observation_box(observations, j):
    """The six numbers of an observation."""
    return (
        observations[j, 0],
        observations[j, 1],
        observations[j, 2],
        observations[j, 3],
        observations[j, 4],
        observations[j, 5],
    )


@inner
def new_plane(tables, observations, j, t_ns):
    """A slot for a plane observed for the first time; the weight of the observation is per metre."""
    i = new_slot(tables, t_ns)
    moments, floats, ints = tables[1], tables[2], tables[3]
    a = observation_box(observations, j)
    floats[i, ANCHOR_X], floats[i, ANCHOR_Y] = 0.5 * (a[0] + a[2]), 0.5 * (a[1] + a[3])
    floats[i, MARGIN], ints[i, FLAGS] = observations[j, O_MARGIN], int(observations[j, O_FLAGS])
    a = shifted(a, float(floats[i, ANCHOR_X]), float(floats[i, ANCHOR_Y]))
    m = segment_moments(
        a[0], a[1], a[2], a[3], observations[j, O_WEIGHT] * length_of(a[0], a[1], a[2], a[3]), observations[j, O_SIGMA]
    )
    for c in range(6):
        moments[i, c] = m[c]
    a = observation_box(observations, j)
    put_box(tables, i, a[0], a[1], a[2], a[3], a[4], a[5])
    return i


@inner
def score_observation(tables, i, observations, j, rules):
    """`joined` of slot i and observation j, ends counted from the slot's anchor, and the share that the slot's past keeps."""
    floats = tables[2]
    x, y = float(floats[i, ANCHOR_X]), float(floats[i, ANCHOR_Y])
    a, b = shifted(box_of(tables[0], i), x, y), shifted(observation_box(observations, j), x, y)
    length = length_of(b[0], b[1], b[2], b[3])
    n = segment_moments(b[0], b[1], b[2], b[3], observations[j, O_WEIGHT] * length, observations[j, O_SIGMA])
    past = moments_of(tables, i, x, y)
    # per metre, or a small new piece of a long wall would count for nothing
    most = rules.memory_frames * observations[j, O_WEIGHT] * length_of(a[0], a[1], a[2], a[3])
    share = min(1.0, most / past[0])
    return joined(a, b, together(past, n, share), observations[j, O_SIGMA], rules), share


@inner
def add_observation(tables, i, observations, j, found, share, rules, t_ns):
    """Adds observation j to slot i. found: the `joined` of both."""
    moments, floats, ints = tables[1], tables[2], tables[3]
    x, y = float(floats[i, ANCHOR_X]), float(floats[i, ANCHOR_Y])
    seen = observation_box(observations, j)
    b = shifted(seen, x, y)
    weight = observations[j, O_WEIGHT] * length_of(b[0], b[1], b[2], b[3])
    n = segment_moments(b[0], b[1], b[2], b[3], weight, observations[j, O_SIGMA])
    m = together(moments_of(tables, i, x, y), n, share)
    part = weight / m[0]
    for c in range(6):
        moments[i, c] = m[c]
    length = length_of(found[1], found[2], found[3], found[4])
    nx, ny = -(found[4] - found[2]) / length, (found[3] - found[1]) / length  # to the right of a -> b: the free side
    ahead = max((b[0] - found[1]) * nx + (b[1] - found[2]) * ny, (b[2] - found[1]) * nx + (b[3] - found[2]) * ny)
    mean = (1.0 - part) * float(floats[i, MARGIN]) + part * observations[j, O_MARGIN]
    floats[i, MARGIN] = max(mean, ahead)  # nothing seen lies before the plane and its margin
    flags = int(observations[j, O_FLAGS])
    measured = flags & _INFERRED == 0 and length_of(b[0], b[1], b[2], b[3]) >= _WHOLE * length
    inferred = found[5] > rules.corner_m or ((ints[i, FLAGS] | flags) & _INFERRED != 0 and not measured)
    ints[i, FLAGS] = joined_flags(ints[i, FLAGS], flags, inferred)
    a = box_of(tables[0], i)
    put_box(tables, i, found[1] + x, found[2] + y, found[3] + x, found[4] + y, min(a[4], seen[4]), max(a[5], seen[5]))
    ints[i, HITS] = min(ints[i, HITS] + 1, 1 << 30)
    forget_looks_through(tables, i, seen, rules)
    seen_again(tables, i, t_ns)


@inner
def joined_flags(a, b, inferred):
    """Flags of two planes that are one; inferred: it covers something that was not measured."""
    return ((a & b) & ~_OVER) | ((a | b) & _OVER) | (_INFERRED if inferred else 0)


@inner
def forget_looks_through(tables, i, seen, rules):
    """An observation of the part of slot i that others observed as clear cancels some of those."""
    box, floats, ints = tables[0], tables[2], tables[3]
    if ints[i, CLEARS] == 0:
        return
    a = box_of(box, i)
    length = length_of(a[0], a[1], a[2], a[3])
    dx, dy = (a[2] - a[0]) / length, (a[3] - a[1]) / length
    s0, s1 = (seen[0] - a[0]) * dx + (seen[1] - a[1]) * dy, (seen[2] - a[0]) * dx + (seen[3] - a[1]) * dy
    if min(s1, float(floats[i, TO])) > max(s0, float(floats[i, FROM])):
        ints[i, CLEARS] = max(0, ints[i, CLEARS] - int(rules.free_evidence_per_hit))


@inner
def score_planes(tables, i, k, rules):
    """`joined` of slots i and k, ends counted from the anchor of i."""
    floats = tables[2]
    x, y = float(floats[i, ANCHOR_X]), float(floats[i, ANCHOR_Y])
    m = together(moments_of(tables, i, x, y), moments_of(tables, k, x, y), 1.0)
    a, b = shifted(box_of(tables[0], i), x, y), shifted(box_of(tables[0], k), x, y)
    return joined(a, b, m, max(float(floats[i, MARGIN]), float(floats[k, MARGIN])) / 2.0, rules)


@inner
def absorb_plane(tables, i, k, found, rules):
    """Slot i takes slot k in, which is then empty."""
    moments, floats, ints, state = tables[1], tables[2], tables[3], tables[7]
    x, y = float(floats[i, ANCHOR_X]), float(floats[i, ANCHOR_Y])
    m = together(moments_of(tables, i, x, y), moments_of(tables, k, x, y), 1.0)
    for c in range(6):
        moments[i, c] = m[c]
    a, b = box_of(tables[0], i), box_of(tables[0], k)
    floats[i, MARGIN] = max(floats[i, MARGIN], floats[k, MARGIN])
    inferred = found[5] > rules.corner_m or (ints[i, FLAGS] | ints[k, FLAGS]) & _INFERRED != 0
    ints[i, FLAGS] = joined_flags(ints[i, FLAGS], ints[k, FLAGS], inferred)
    ints[i, HITS] = max(ints[i, HITS], ints[k, HITS])
    ints[i, CLEARS] = 0
    set_links(tables, k, False)
    remove(tables, k)
    state[JOINED] += 1
    put_box(tables, i, found[1] + x, found[2] + y, found[3] + x, found[4] + y, min(a[4], b[4]), max(a[5], b[5]))
