"""Sections 5.2 (concave conversion) and 5.3: neighbours meet, pockets too small to enter close, the hidden goes.

Where the paper's text and its listing differ, the text is right: what lies on the far side of the chord between its
neighbours goes when that chord is shorter than Ws; what stands out towards the camera always stays.
"""

from __future__ import annotations

import math

from ..jit import inner
from .evidence import G_ACROSS, G_CU, G_CV, G_DOWN
from .openings import is_open
from .planes import (
    FRONT,
    MOST_M,
    P_CLUSTER,
    P_COLUMNS,
    P_CUT,
    P_FILL,
    P_INFERRED,
    P_KIND,
    P_LAST_U,
    P_ROWS,
    P_SUPPORT,
    T0,
    T1,
    Z0,
    Z1,
    A,
    B,
    distance_at,
)

_NO_METRES = 0.1 * MOST_M
"""Farther than this is no distance: MOST_M with room for rounding."""
_NEARER = 1.0001
"""Not tuning: a plane is no nearer than itself, but for rounding."""
_NO_TURN = 1e-6
"""Lines whose slopes differ by less are parallel: their crossing is noise of the arithmetic."""


@inner
def facing_gap_m(p, q):
    """Distance between the right end of p and the left end of q, seen from above."""
    xp, xq = distance_at(p, p[T1]), distance_at(q, q[T0])
    return math.hypot(xp - xq, xp * p[T1] - xq * q[T0])


@inner
def meet_neighbours(count, planes, plane_ints, reach_m, reach_t, slack_m, safe_m, points, masks, frame):
    """Extends facing ends of neighbours to the intersection of their lines, where that lies within reach of both ends.

    Only over columns nobody stands in front of, at most reach_m along either plane and where the ends are less than
    reach_t apart. An end is cut back only where the other plane stops the same rays, within slack_m of height, and stands no
    farther than safe_m behind what goes; it is drawn out over no opening (looked at in points x points)."""
    for i in range(count):
        for j in range(count):
            p, q = planes[i], planes[j]
            if i == j or plane_ints[i, P_CLUSTER] != plane_ints[j, P_CLUSTER] or q[T0] + q[T1] <= p[T0] + p[T1]:
                continue
            if min(p[Z1], q[Z1]) - max(p[Z0], q[Z0]) <= 0.0 or abs(q[T0] - p[T1]) > reach_t:
                continue
            if facing_gap_m(p, q) > reach_m or abs(p[B] - q[B]) < _NO_TURN:
                continue
            t = (q[A] - p[A]) / (p[B] - q[B])
            if not (p[T0] < t < q[T1]):
                continue
            x = distance_at(p, t)
            far = max(_step_m(p, p[T1], t), _step_m(q, q[T0], t))
            # an end may only be cut back where the other plane takes over all of its height
            cuts_p = t < p[T1] and not _spans(q, p, t, p[T1], slack_m)
            cuts_q = t > q[T0] and not _spans(p, q, t, q[T0], slack_m)
            cuts_p = cuts_p or (t < p[T1] and distance_at(q, p[T1]) - distance_at(p, p[T1]) > safe_m)
            cuts_q = cuts_q or (t > q[T0] and distance_at(p, q[T0]) - distance_at(q, q[T0]) > safe_m)
            if far > reach_m or x >= _NO_METRES or cuts_p or cuts_q:
                continue
            over_p = t > p[T1] and _covers_opening(p, p[T1], t, points, masks, frame)
            over_q = t < q[T0] and _covers_opening(q, t, q[T0], points, masks, frame)
            if not over_p and not over_q:
                if t < p[T1]:
                    _take_over(q, p, t, p[T1])
                if t > q[T0]:
                    _take_over(p, q, t, q[T0])
                p[T1] = t
                q[T0] = t


@inner
def _covers_opening(p, t0, t1, points, masks, frame):
    """Whether plane p from tangent t0 to t1 would cover part of an opening: looked at in points x points."""
    for a in range(points):
        t = t0 + (t1 - t0) * (a + 0.5) / points
        x = distance_at(p, t)
        for b in range(points):
            if is_open(masks, t, (p[Z0] + (p[Z1] - p[Z0]) * (b + 0.5) / points) / x, x, frame):
                return True
    return False


@inner
def _spans(p, q, t, t_end, slack_m):
    """Whether plane p stops every ray that plane q stops between the tangents t and t_end, within slack_m of height at q.

    Where p is nearer than q it must reach as high and as low in the view, not in metres."""
    for at in (t, t_end):
        xp, xq = distance_at(p, at), distance_at(q, at)
        if p[Z0] * xq > (q[Z0] + slack_m) * xp or p[Z1] * xq < (q[Z1] - slack_m) * xp:
            return False
    return True


@inner
def _take_over(p, q, t, t_end):
    """Makes plane p as high and as low as what `_spans` left to the slack: near and thin things are no thicker."""
    for at in (t, t_end):
        ratio = distance_at(p, at) / distance_at(q, at)
        p[Z0], p[Z1] = min(p[Z0], q[Z0] * ratio), max(p[Z1], q[Z1] * ratio)


@inner
def _step_m(p, t_from, t_to):
    """Length along plane p between two tangents."""
    x0, x1 = distance_at(p, t_from), distance_at(p, t_to)
    return math.hypot(x1 - x0, x1 * t_to - x0 * t_from)


@inner
def stands_between(count, planes, plane_ints, i, j, t, z, x, behind_m):
    """Whether a plane other than i and j already closes the ray (t, z/x) in front of x or at most behind_m behind it."""
    for k in range(count):
        p = planes[k]
        if k in (i, j) or plane_ints[k, P_SUPPORT] < 0 or not p[T0] <= t <= p[T1]:
            continue
        own = distance_at(p, t)
        if own < x + behind_m and p[Z0] <= z / x * own <= p[Z1]:
            return True
    return False


@inner
def _touches_opening(p, q, points, masks, frame):
    """Whether the chord between facing ends of p and q would cover part of an opening: looked at in points x points."""
    xp, xq = distance_at(p, p[T1]), distance_at(q, q[T0])
    top, bottom = max(p[Z0], q[Z0]), min(p[Z1], q[Z1])
    steps = points + 1
    for a in range(1, steps):
        t = p[T1] + (q[T0] - p[T1]) * a / steps
        x = steps / ((steps - a) / xp + a / xq)
        for b in range(1, steps):
            if is_open(masks, t, (top + (bottom - top) * b / steps) / x, x, frame):
                return True
    return False


@inner
def close_pockets(
    count, limit, planes, plane_ints, moments, ws, least_t, least_height_m, behind_m, points, masks, frame
):  # fmt: skip
    """Spans gaps narrower than Ws between neighbours of one cluster with planes marked inferred; returns the new count.

    The chord goes from end to end over the height both share. What lies behind it in the pocket is left to
    `trim_covered`. Gaps narrower than least_t need none: no ray passes there. An opening (openings.py) stays open. See
    `stands_between` for behind_m, `_touches_opening` for points."""
    first = count
    for i in range(first):
        p = planes[i]
        best, nearest = -1, ws
        for j in range(first):
            q = planes[j]
            if i == j or plane_ints[i, P_CLUSTER] != plane_ints[j, P_CLUSTER] or q[T0] - p[T1] < least_t:
                continue
            if min(p[Z1], q[Z1]) - max(p[Z0], q[Z0]) < least_height_m:
                continue
            gap = facing_gap_m(p, q)
            if gap < nearest:
                best, nearest = j, gap
        if best < 0 or count >= limit:
            continue
        q = planes[best]
        s0, s1 = 1.0 / distance_at(p, p[T1]), 1.0 / distance_at(q, q[T0])
        t = 0.5 * (p[T1] + q[T0])
        z = 0.5 * (max(p[Z0], q[Z0]) + min(p[Z1], q[Z1]))
        x = 2.0 / (s0 + s1)
        if _touches_opening(p, q, points, masks, frame) or stands_between(
            first, planes, plane_ints, i, best, t, z, x, behind_m
        ):
            continue
        new = planes[count]
        new[B] = (s1 - s0) / (q[T0] - p[T1])
        new[A] = s0 - new[B] * p[T1]
        new[T0], new[T1] = p[T1], q[T0]
        new[Z0], new[Z1], new[FRONT] = max(p[Z0], q[Z0]), min(p[Z1], q[Z1]), max(p[FRONT], q[FRONT])
        plane_ints[count, P_CLUSTER], plane_ints[count, P_SUPPORT] = plane_ints[i, P_CLUSTER], 0
        plane_ints[count, P_FILL], plane_ints[count, P_CUT], plane_ints[count, P_KIND] = 1, 0, 0
        plane_ints[count, P_INFERRED] = 1
        plane_ints[count, P_ROWS], plane_ints[count, P_COLUMNS], plane_ints[count, P_LAST_U] = 1, 0, -1
        for m in range(moments.shape[1]):
            moments[count, m] = moments[i, m] + moments[best, m]
        count += 1
    return count


@inner
def draw_planes(count, planes, plane_ints, frame, nearest):
    """nearest (C, R) float32 out: 1/x of the nearest plane that fills each cell of the view, 0 where none does."""
    nearest[:] = 0.0
    for k in range(count):
        p = planes[k]
        if plane_ints[k, P_SUPPORT] < 0:
            continue
        i0 = max(0, int(math.ceil(p[T0] * frame[G_ACROSS] + frame[G_CU])))
        i1 = min(nearest.shape[0], int(math.floor(p[T1] * frame[G_ACROSS] + frame[G_CU])))
        for i in range(i0, i1):
            s = p[A] + p[B] * (i + 0.5 - frame[G_CU]) / frame[G_ACROSS]
            j0 = max(0, int(math.ceil(p[Z0] * s * frame[G_DOWN] + frame[G_CV])))
            j1 = min(nearest.shape[1], int(math.floor(p[Z1] * s * frame[G_DOWN] + frame[G_CV])))
            for j in range(j0, j1):
                nearest[i, j] = max(nearest[i, j], s)


@inner
def trim_covered(count, planes, plane_ints, depth_m, frame, nearest):
    """Cuts each plane back to what no nearer plane within depth_m hides; support of those wholly hidden gets negative.

    frame: of evidence.py. nearest: (C, R) float32, scratch. Every ray keeps the nearest plane that it meets, and nothing
    can be between that and what is cut, so the order does not matter."""
    draw_planes(count, planes, plane_ints, frame, nearest)
    cols, rows = nearest.shape
    for k in range(count):
        p = planes[k]
        if plane_ints[k, P_SUPPORT] < 0:
            continue
        i0 = int(math.floor(p[T0] * frame[G_ACROSS] + frame[G_CU]))
        i1 = int(math.floor(p[T1] * frame[G_ACROSS] + frame[G_CU])) + 1
        left, right, top, bottom = i1, i0, MOST_M, -MOST_M
        for i in range(i0, i1):
            # inside the plane's own ends: beyond them a plane seen edge-on passes through infinity
            t = (min(max(i + 0.5, 0.5), cols - 0.5) - frame[G_CU]) / frame[G_ACROSS]
            s = p[A] + p[B] * min(max(t, p[T0]), p[T1])
            j0 = int(math.floor(p[Z0] * s * frame[G_DOWN] + frame[G_CV]))
            j1 = int(math.floor(p[Z1] * s * frame[G_DOWN] + frame[G_CV])) + 1
            limit = s * _NEARER
            for j in range(j0, j1):
                inside = 0 <= i < cols and 0 <= j < rows
                if inside and nearest[i, j] > limit and 1.0 / s - 1.0 / nearest[i, j] < depth_m:
                    continue
                left, right = min(left, i), max(right, i + 1)
                top = min(top, (j - frame[G_CV]) / (frame[G_DOWN] * s))
                bottom = max(bottom, (j + 1 - frame[G_CV]) / (frame[G_DOWN] * s))
        if left >= right:
            plane_ints[k, P_SUPPORT] = -1
            continue
        p[T0] = max(p[T0], (left - frame[G_CU]) / frame[G_ACROSS])
        p[T1] = min(p[T1], (right - frame[G_CU]) / frame[G_ACROSS])
        p[Z0], p[Z1] = max(p[Z0], top), min(p[Z1], bottom)


@inner
def covered_by(p, q, depth_m, slack_t):
    """Whether plane q hides plane p wholly, standing less than depth_m in front of it: nothing can be in between."""
    if p[T0] < q[T0] - slack_t or p[T1] > q[T1] + slack_t:
        return False
    for t in (p[T0], p[T1]):
        inside = min(max(t, q[T0]), q[T1])
        xp, xq = distance_at(p, inside), distance_at(q, inside)
        if xq > xp or xp - xq > depth_m or xp > _NO_METRES:
            return False
        if p[Z0] / xp < q[Z0] / xq - slack_t or p[Z1] / xp > q[Z1] / xq + slack_t:
            return False
    return True


@inner
def drop_covered(count, planes, plane_ints, depth_m, slack_t):
    """Marks planes hidden wholly by one nearer plane of their cluster within depth_m; their support becomes negative."""
    for i in range(count):
        for j in range(count):
            if i == j or plane_ints[j, P_SUPPORT] < 0 or plane_ints[i, P_CLUSTER] != plane_ints[j, P_CLUSTER]:
                continue
            if covered_by(planes[i], planes[j], depth_m, slack_t):
                plane_ints[j, P_SUPPORT] += max(0, plane_ints[i, P_SUPPORT])
                plane_ints[i, P_SUPPORT] = -1
                break
