"""Plane refinement (Section 5.3) and concave surfaces (Section 5.2, Algorithm 2).

Input and output: the table of planes. Neighbours are extended to their common corner, concavities too small for the
vehicle are closed, and hidden planes are removed.

The text and the listing of Algorithm 2 contradict each other. This module follows the text: a point on the far side
of the chord between its neighbours is deleted if the chord is shorter than Ws, and a point on the near side is kept."""

from __future__ import annotations

import math

from ..jit import inner
from .evidence import is_measured_behind
from .line_fit import add_moments, copy_moments
from .openings import is_open
from .planes import MOST_M, distance_at

_NO_METRES = 0.1 * MOST_M
"""A distance beyond this is MOST_M, except for rounding."""
_NEARER = 1.0001
"""Factor on 1/x by which a plane is nearer than another one, greater than rounding errors."""
_NO_TURN = 1e-6
"""Lines whose slopes differ by less are parallel; their intersection would be a rounding error."""
_NO_GAP_T = 1e-6
"""Ends whose tangents differ by less meet; the slope of a chord between them would be a rounding error."""
_REACH_WS = 0.25
"""Greatest extension of neighbouring planes to meet each other, in Ws."""
_SLACK_M = 0.05
"""Heights that differ by at most this are equal where planes meet."""
_LEAST_COMMON_M = 0.25
"""Least height that the sides of a concavity have in common."""
_POINTS = 5
"""Number of points in each direction at which a rectangle is tested for openings."""


@inner
def facing_gap_m(p, q):
    """Returns the horizontal distance between the right end of p and the left end of q."""
    xp, xq = distance_at(p, p.t1), distance_at(q, q.t0)
    return math.hypot(xp - xq, xp * p.t1 - xq * q.t0)


@inner
def extend_to_corners(count, planes, settings, cover):
    """Moves the facing ends of neighbours to the intersection of their lines, if that is within reach of both ends.

    An end is moved by at most _REACH_WS of Ws along its plane, and only if the ends are less than reach_t apart. It is
    shortened only where the other plane extends as far and blocks the same rays, within _SLACK_M of height and at
    most safe_distance_m behind. It is not extended over an opening, which is tested at _POINTS x _POINTS points, nor
    over a cell in which the nearest strip lies behind the plane, as under the lintel beside a pillar.
    planes: (N,) PLANE, in and out; cover: Cover."""
    for i in range(count):
        for j in range(count):
            p, q = planes[i], planes[j]
            if i == j or not _face_each_other(p, q, settings):
                continue
            t = (q.a - p.a) / (p.b - q.b)
            if _may_meet(p, q, t, settings):
                _meet(p, q, t, settings, cover)


@inner
def _face_each_other(p, q, settings):
    """True if q continues p to the right: their lines intersect, they share heights, and the facing ends are close."""
    if p.cluster != q.cluster or q.t0 + q.t1 <= p.t0 + p.t1 or abs(p.b - q.b) < _NO_TURN:
        return False
    if min(p.bottom_m, q.bottom_m) - max(p.top_m, q.top_m) <= 0.0 or abs(q.t0 - p.t1) > settings.reach_t:
        return False
    return facing_gap_m(p, q) <= _REACH_WS * settings.passable_width_m


@inner
def _may_meet(p, q, t, settings):
    """True if the right end of p and the left end of q may both be moved to the tangent t, where their lines intersect.

    An end is shortened only where the other plane reaches as far and blocks the same rays, not too far behind."""
    reach_m, safe_m = _REACH_WS * settings.passable_width_m, settings.safe_distance_m
    if not p.t0 < t < q.t1 or distance_at(p, t) >= _NO_METRES:
        return False
    if max(_step_m(p, p.t1, t), _step_m(q, q.t0, t)) > reach_m:
        return False
    if t < p.t1:
        if q.t1 < p.t1 or not _blocks_same_rays(q, p, t, p.t1):
            return False
        if distance_at(q, p.t1) - distance_at(p, p.t1) > safe_m:
            return False
    if t > q.t0:
        if p.t0 > q.t0 or not _blocks_same_rays(p, q, t, q.t0):
            return False
        if distance_at(p, q.t0) - distance_at(q, q.t0) > safe_m:
            return False
    return True


@inner
def _meet(p, q, t, settings, cover):
    """Moves the right end of p and the left end of q to the tangent t, unless one of them would cover an opening or
    something that was measured behind it."""
    if (t > p.t1 and _covers_free(p, p.t1, t, settings, cover)) or (
        t < q.t0 and _covers_free(q, t, q.t0, settings, cover)
    ):
        return
    if t < p.t1:
        _extend_heights(q, p, t, p.t1)
    if t > q.t0:
        _extend_heights(p, q, t, q.t0)
    p.t1, q.t0 = t, t


@inner
def _covers_free(p, t0, t1, settings, cover):
    """True if plane p from tangent t0 to t1 would cover part of an opening, or of what was measured behind it."""
    return _covers_opening(p, t0, t1, cover.openings) or is_measured_behind(p, t0, t1, settings, cover.evidence)


@inner
def _covers_opening(p, t0, t1, openings):
    """True if plane p from tangent t0 to t1 would cover part of an opening."""
    for a in range(_POINTS):
        t = t0 + (t1 - t0) * (a + 0.5) / _POINTS
        x = distance_at(p, t)
        for b in range(_POINTS):
            if is_open(openings, t, (p.top_m + (p.bottom_m - p.top_m) * (b + 0.5) / _POINTS) / x, x):
                return True
    return False


@inner
def _blocks_same_rays(p, q, t, t_end):
    """True if plane p blocks every ray that plane q blocks between the tangents t and t_end, within _SLACK_M of height
    at q.

    If p is nearer than q, it must cover the same rows of the view, not the same heights."""
    for at in (t, t_end):
        xp, xq = distance_at(p, at), distance_at(q, at)
        if p.top_m * xq > (q.top_m + _SLACK_M) * xp or p.bottom_m * xq < (q.bottom_m - _SLACK_M) * xp:
            return False
    return True


@inner
def _extend_heights(p, q, t, t_end):
    """Extends the heights of plane p by what `_blocks_same_rays` allowed as slack, so that p blocks all rays that q blocked."""
    for at in (t, t_end):
        ratio = distance_at(p, at) / distance_at(q, at)
        p.top_m, p.bottom_m = min(p.top_m, q.top_m * ratio), max(p.bottom_m, q.bottom_m * ratio)


@inner
def _step_m(p, t_from, t_to):
    """Returns the length along plane p between two tangents."""
    x0, x1 = distance_at(p, t_from), distance_at(p, t_to)
    return math.hypot(x1 - x0, x1 * t_to - x0 * t_from)


@inner
def stands_between(count, planes, i, j, t, z, x, behind_m):
    """True if a plane other than i and j blocks the ray (t, z/x) in front of x, or at most behind_m behind it."""
    for k in range(count):
        p = planes[k]
        if k in (i, j) or p.support < 0 or not p.t0 <= t <= p.t1:
            continue
        own = distance_at(p, t)
        if own < x + behind_m and p.top_m <= z / x * own <= p.bottom_m:
            return True
    return False


@inner
def _touches_opening(p, q, openings):
    """True if the chord between the facing ends of p and q would cover part of an opening."""
    xp, xq = distance_at(p, p.t1), distance_at(q, q.t0)
    top, bottom = max(p.top_m, q.top_m), min(p.bottom_m, q.bottom_m)
    steps = _POINTS + 1
    for a in range(1, steps):
        t = p.t1 + (q.t0 - p.t1) * a / steps
        x = steps / ((steps - a) / xp + a / xq)
        for b in range(1, steps):
            if is_open(openings, t, (top + (bottom - top) * b / steps) / x, x):
                return True
    return False


@inner
def close_concavities(count, planes, settings, openings):
    """Closes gaps narrower than Ws between neighbours of one cluster by planes marked inferred; returns the number of
    planes.

    The chord connects the two ends over the height that both share, at least _LEAST_COMMON_M. `trim_covered` removes what
    lies behind it. Openings (openings.py) stay open.
    planes: in and out; no plane is added to a full table."""
    first = count
    for i in range(first):
        p = planes[i]
        best, nearest = -1, settings.passable_width_m
        for j in range(first):
            q = planes[j]
            if i == j or p.cluster != q.cluster or q.t0 - p.t1 < _NO_GAP_T:
                continue
            if min(p.bottom_m, q.bottom_m) - max(p.top_m, q.top_m) < _LEAST_COMMON_M:
                continue
            gap = facing_gap_m(p, q)
            if gap < nearest:
                best, nearest = j, gap
        if best < 0 or count >= len(planes):
            continue
        q = planes[best]
        s0, s1 = 1.0 / distance_at(p, p.t1), 1.0 / distance_at(q, q.t0)
        t = 0.5 * (p.t1 + q.t0)
        z = 0.5 * (max(p.top_m, q.top_m) + min(p.bottom_m, q.bottom_m))
        x = 2.0 / (s0 + s1)
        if _touches_opening(p, q, openings) or stands_between(
            first, planes, i, best, t, z, x, settings.pocket_behind_m
        ):
            continue
        _fill_chord(planes[count], p, q, s0, s1)
        count += 1
    return count


@inner
def _fill_chord(new, p, q, s0, s1):
    """Makes `new` the plane from the right end of p, at 1/x = s0, to the left end of q, at 1/x = s1."""
    new.b = (s1 - s0) / (q.t0 - p.t1)
    new.a = s0 - new.b * p.t1
    new.t0, new.t1 = p.t1, q.t0
    new.top_m, new.bottom_m = max(p.top_m, q.top_m), min(p.bottom_m, q.bottom_m)
    new.front_m = max(p.front_m, q.front_m)
    new.cluster, new.support = p.cluster, 0
    new.filled_rows, new.cut, new.irregular, new.inferred = 1, 0, 0, 1
    new.rows, new.columns, new.last_column = 1, 0, -1
    copy_moments(new, p)
    add_moments(new, q)


@inner
def draw_planes(count, planes, evidence):
    """Computes 1/x of the nearest plane that fills each cell of the view, 0 if none does. The cells of Evidence are
    overwritten."""
    nearest = evidence.nearest
    nearest[:] = 0.0
    for k in range(count):
        p = planes[k]
        if p.support < 0:
            continue
        i0 = max(0, int(math.ceil(p.t0 * evidence.across + evidence.cu)))
        i1 = min(nearest.shape[0], int(math.floor(p.t1 * evidence.across + evidence.cu)))
        for i in range(i0, i1):
            s = p.a + p.b * (i + 0.5 - evidence.cu) / evidence.across
            j0 = max(0, int(math.ceil(p.top_m * s * evidence.down + evidence.cv)))
            j1 = min(nearest.shape[1], int(math.floor(p.bottom_m * s * evidence.down + evidence.cv)))
            for j in range(j0, j1):
                nearest[i, j] = max(nearest[i, j], s)


@inner
def trim_covered(count, planes, depth_m, evidence):
    """Shortens each plane to the part that no nearer plane within depth_m hides. Planes that are hidden get a
    negative support.

    Each ray keeps the nearest plane that it meets, so the result does not depend on the order. The cells of Evidence
    are overwritten."""
    draw_planes(count, planes, evidence)
    nearest = evidence.nearest
    cols, rows = nearest.shape
    for k in range(count):
        p = planes[k]
        if p.support < 0:
            continue
        i0 = int(math.floor(p.t0 * evidence.across + evidence.cu))
        i1 = int(math.floor(p.t1 * evidence.across + evidence.cu)) + 1
        left, right, top, bottom = i1, i0, MOST_M, -MOST_M
        for i in range(i0, i1):
            # not beyond the ends of the plane: there a plane seen edge-on passes through infinity
            t = (min(max(i + 0.5, 0.5), cols - 0.5) - evidence.cu) / evidence.across
            s = p.a + p.b * min(max(t, p.t0), p.t1)
            j0 = int(math.floor(p.top_m * s * evidence.down + evidence.cv))
            j1 = int(math.floor(p.bottom_m * s * evidence.down + evidence.cv)) + 1
            limit = s * _NEARER
            for j in range(j0, j1):
                inside = 0 <= i < cols and 0 <= j < rows
                if inside and nearest[i, j] > limit and 1.0 / s - 1.0 / nearest[i, j] < depth_m:
                    continue
                left, right = min(left, i), max(right, i + 1)
                top = min(top, (j - evidence.cv) / (evidence.down * s))
                bottom = max(bottom, (j + 1 - evidence.cv) / (evidence.down * s))
        if left >= right:
            p.support = -1
            continue
        p.t0 = max(p.t0, (left - evidence.cu) / evidence.across)
        p.t1 = min(p.t1, (right - evidence.cu) / evidence.across)
        p.top_m, p.bottom_m = max(p.top_m, top), min(p.bottom_m, bottom)


@inner
def covered_by(p, q, depth_m, slack_t):
    """True if plane q hides plane p completely and is less than depth_m in front of it. slack_t: tolerance of the
    borders."""
    if p.t0 < q.t0 - slack_t or p.t1 > q.t1 + slack_t:
        return False
    for t in (p.t0, p.t1):
        inside = min(max(t, q.t0), q.t1)
        xp, xq = distance_at(p, inside), distance_at(q, inside)
        if xq > xp or xp - xq > depth_m or xp > _NO_METRES:
            return False
        if p.top_m / xp < q.top_m / xq - slack_t or p.bottom_m / xp > q.bottom_m / xq + slack_t:
            return False
    return True


@inner
def drop_covered(count, planes, depth_m, slack_t):
    """Removes planes that one nearer plane of their cluster hides completely within depth_m. Their support becomes
    negative."""
    for i in range(count):
        p = planes[i]
        for j in range(count):
            q = planes[j]
            if i == j or q.support < 0 or p.cluster != q.cluster:
                continue
            if covered_by(p, q, depth_m, slack_t):
                q.support += max(0, p.support)
                p.support = -1
                break
