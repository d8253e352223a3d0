"""Cost of joining two planes of the merged world (Section 5.3 over time), from their moments (Eq. 17, complete).

The moments of a plane (weight, x, y, xx, xy, yy) are those of its ends and of all points between them, weighted by
inverse variance. The paper's set of moments has no zz: without it a fit has no residual, and walls along one axis
cannot be fitted."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, record
from ..types import PlaneFlags
from .free_grid import any_free

REFUSED = 2.0
TALLEST_M = 650.0
"""No joined plane is higher: messages and files hold up to 655 m."""
END_A, END_B = 1, 2
WORLD_RULES = record(("gap_m", np.float64), ("longest_m", np.float64), ("pose_sigma_m", np.float64))
"""What kernels use of WorldParams. gap_m: `passable_width_m`; the others are the parameters of the same names."""
JOIN_M, _JOIN_SIGMAS, _MOST_NOISE_M = 0.3, 2.0, 0.5
"""Greatest distance of the ends from a joined plane, and the noise of the farther plane that is added to it, at most."""
CORNER_M = 0.5
"""A joined plane contains no empty square of this side at a corner."""
_TURN_COS, _SHORT_M = math.cos(math.radians(20.0)), 1.0
"""Planes within this angle may be one; shorter ones at any angle below 90 degrees."""

_GAP_POINTS = 3
"""Number of places along a gap, and of heights, at which free space is tested."""
_LEAST_WIDTH = 0.5
"""Of a joined plane, seen from a camera, as a share of what the camera observed."""
_FACING = 0.3
"""Sine of the angle below which a line is seen edge-on."""
_IRREGULAR = int(PlaneFlags.IRREGULAR)
_TINY = 1e-9


class Box(NamedTuple):
    """Box of a plane: its ends a and b seen from above, and its heights, z down, in metres."""

    ax: Any
    ay: Any
    bx: Any
    by: Any
    top: Any
    bottom: Any


class Moments(NamedTuple):
    """Sums of w, w x, w y, w x x, w x y and w y y over the points of a plane."""

    w: Any
    x: Any
    y: Any
    xx: Any
    xy: Any
    yy: Any


class Joined(NamedTuple):
    """Result of joining two planes."""

    cost: Any  # below 1 if they may be joined
    ax: Any  # ax, ay, bx, by: ends of the joined plane
    ay: Any
    bx: Any
    by: Any
    gap: Any  # gap between both planes, m


@inner
def length_of(ends):
    """Returns the length of a Box or a Joined, never 0."""
    return max(math.sqrt((ends.bx - ends.ax) ** 2 + (ends.by - ends.ay) ** 2), _TINY)


@inner
def axis_of(ends):
    """Returns (dx, dy, length) of a Box or a Joined: its direction from end a to end b, and its length, never 0."""
    length = length_of(ends)
    return (ends.bx - ends.ax) / length, (ends.by - ends.ay) / length, length


@inner
def box_of(plane):
    """Returns the Box of a record with the ends and heights of a plane, such as SLOT."""
    return Box(
        float(plane.ax_m),
        float(plane.ay_m),
        float(plane.bx_m),
        float(plane.by_m),
        float(plane.top_m),
        float(plane.bottom_m),
    )


@inner
def segment_moments(box, weight, sigma):
    """Returns the Moments of points spread evenly over a plane, each with an error of `sigma` in x and y."""
    x, y, dx, dy, v = 0.5 * (box.ax + box.bx), 0.5 * (box.ay + box.by), box.bx - box.ax, box.by - box.ay, sigma * sigma
    return Moments(
        weight,
        weight * x,
        weight * y,
        weight * (x * x + dx * dx / 12.0 + v),
        weight * (x * y + dx * dy / 12.0),
        weight * (y * y + dy * dy / 12.0 + v),
    )


@inner
def moved_moments(m, ox, oy):
    """Returns Moments about a point that lies at (-ox, -oy)."""
    return Moments(
        m.w,
        m.x + m.w * ox,
        m.y + m.w * oy,
        m.xx + 2.0 * ox * m.x + m.w * ox * ox,
        m.xy + ox * m.y + oy * m.x + m.w * ox * oy,
        m.yy + 2.0 * oy * m.y + m.w * oy * oy,
    )


@inner
def together(m, n, share):
    """Returns the sum of two Moments, the first multiplied by a share."""
    return Moments(
        share * m.w + n.w,
        share * m.x + n.x,
        share * m.y + n.y,
        share * m.xx + n.xx,
        share * m.xy + n.xy,
        share * m.yy + n.yy,
    )


@inner
def shifted(box, x, y):
    """Returns a Box with its ends relative to (x, y)."""
    return Box(box.ax - x, box.ay - y, box.bx - x, box.by - y, box.top, box.bottom)


@inner
def line_of(m, ux, uy):
    """Returns (x, y, dx, dy), middle and direction of the line that fits these moments best, by total least squares.

    The direction is that of (ux, uy). A line that is turned from it by more than _TURN_COS allows belongs to a short
    plane, which keeps (ux, uy)."""
    x, y = m.x / m.w, m.y / m.w
    cxx, cxy, cyy = m.xx / m.w - x * x, m.xy / m.w - x * y, m.yy / m.w - y * y
    turn = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
    dx, dy = math.cos(turn), math.sin(turn)
    along = dx * ux + dy * uy
    if along < 0.0:
        dx, dy, along = -dx, -dy, -along
    if along < _TURN_COS:
        dx, dy = ux, uy
    return x, y, dx, dy


class Extent(NamedTuple):
    """A plane along a line: begin, end and heights, m."""

    begin: Any
    end: Any
    top: Any
    bottom: Any


@inner
def corner_cost(p, q):
    """Returns the side of the largest empty corner in the rectangle around the Extents p and q, over
    CORNER_M; 1 or more: too large.

    At each end one of the two extends farther. If the other one is taller, a corner beside it is empty."""
    worst = 0.0
    for end in range(2):
        reach = q.begin - p.begin if end == 0 else p.end - q.end
        if reach >= 0.0:  # p extends farther: heights of q beyond those of p
            tall = max(p.top - q.top, q.bottom - p.bottom)
        else:
            tall = max(q.top - p.top, p.bottom - q.bottom)
        worst = max(worst, min(abs(reach), tall))
    return worst / CORNER_M


@inner
def off_line(box, x, y, dx, dy):
    """Returns the distance of the farther end of a box from the line through (x, y) along (dx, dy)."""
    return max(
        max(0.0, abs((box.ay - y) * dx - (box.ax - x) * dy)),
        abs((box.by - y) * dx - (box.bx - x) * dy),
    )


@inner
def reach_of(sigma):
    """Returns how far an end may lie from the line of a joined plane. sigma: its noise."""
    return JOIN_M + min(_JOIN_SIGMAS * sigma, _MOST_NOISE_M)


@inner
def distance_of(found, box):
    """Returns the distance of the farther end of a box from a plane. found: Joined."""
    dx, dy, _length = axis_of(found)
    return off_line(box, found.ax, found.ay, dx, dy)


@inner
def joined(a, b, m, sigma, rules):
    """Returns Joined of the boxes a and b.

    m: the sum of their Moments; sigma: noise of the farther one."""
    no = Joined(REFUSED, 0.0, 0.0, 0.0, 0.0, 0.0)
    if min(a.bottom, b.bottom) <= max(a.top, b.top) or max(a.bottom, b.bottom) - min(a.top, b.top) > TALLEST_M:
        return no
    (uax, uay, la), (ubx, uby, lb) = axis_of(a), axis_of(b)
    facing = uax * ubx + uay * uby
    if facing <= 0.0 or (min(la, lb) > _SHORT_M and facing < _TURN_COS):
        return no
    ux, uy = (uax, uay) if la >= lb else (ubx, uby)
    x, y, dx, dy = line_of(m, ux, uy)
    p = Extent((a.ax - x) * dx + (a.ay - y) * dy, (a.bx - x) * dx + (a.by - y) * dy, a.top, a.bottom)
    q = Extent((b.ax - x) * dx + (b.ay - y) * dy, (b.bx - x) * dx + (b.by - y) * dy, b.top, b.bottom)
    begin, end = min(p.begin, q.begin), max(p.end, q.end)
    gap = max(0.0, max(q.begin - p.end, p.begin - q.end))
    if gap >= rules.gap_m or end - begin > rules.longest_m:
        return no
    off = max(off_line(a, x, y, dx, dy), off_line(b, x, y, dx, dy))
    off /= reach_of(sigma)
    corner = corner_cost(p, q)
    if off >= 1.0 or corner >= 1.0:
        return no
    cost = 0.5 * off + 0.3 * gap / rules.gap_m + 0.2 * corner
    return Joined(cost, x + begin * dx, y + begin * dy, x + end * dx, y + end * dy, gap)


@inner
def stands_for(found, box, sigma, x, y):
    """True if a joined plane may stand for what a camera at (x, y) observed as a Box.

    The plane must be near the box, and not far behind it along the viewing rays; and the camera must see the plane from
    its free side, at least half as wide as the box. Otherwise the object in view would be replaced by a plane behind it,
    or by one that is seen edge-on. found: Joined; sigma: noise of the box; box, x, y: relative to the same point."""
    mx, my = 0.5 * (box.ax + box.bx) - x, 0.5 * (box.ay + box.by) - y
    width = mx * (box.by - box.ay) - my * (box.bx - box.ax)
    width /= length_of(box)
    seen = mx * (found.by - found.ay) - my * (found.bx - found.ax)
    seen /= length_of(found)
    if seen < _LEAST_WIDTH * width or distance_of(found, box) >= reach_of(sigma):
        return False
    facing = seen / math.sqrt(mx * mx + my * my) if seen > 0.0 else 0.0
    return ahead_of(found, box) < reach_of(0.5 * sigma) * max(facing, _LEAST_WIDTH)


@inner
def ahead_of(found, box):
    """Returns the distance of the nearer end of a Box in front of the joined plane, on its free side; negative: behind it.

    The margin of a joined plane contains this distance of its parts, so that nothing that was observed lies in front of
    the plane and its margin. found: Joined; box: relative to the same anchor."""
    dx, dy, _length = axis_of(found)
    nx, ny = -dy, dx  # to the right of a -> b
    return max(
        (box.ax - found.ax) * nx + (box.ay - found.ay) * ny,
        (box.bx - found.ax) * nx + (box.by - found.ay) * ny,
    )


@inner
def widened(found, box, x, y, most):
    """Returns Joined with ends that hide the same directions from a camera at (x, y) as a Box, where that needs at most
    `most` metres.

    A plane behind the box would hide less. found: Joined; box, x, y: relative to the same point."""
    dx, dy, length = axis_of(found)
    begin = min(0.0, hidden_end(found, box.ax, box.ay, x, y, most))
    end = max(length, hidden_end(found, box.bx, box.by, x, y, most))
    ax, ay, bx, by = found.ax + begin * dx, found.ay + begin * dy, found.ax + end * dx, found.ay + end * dy
    return Joined(found.cost, ax, ay, bx, by, found.gap)


@inner
def hidden_end(found, px, py, x, y, most):
    """Returns where the viewing ray of a point (px, py) meets the line of `found`, m from its end a along the line, but at
    most `most` from the foot of the point. (x, y): place of the camera."""
    dx, dy, _length = axis_of(found)
    foot = (px - found.ax) * dx + (py - found.ay) * dy
    rx, ry = px - x, py - y
    across = rx * dy - ry * dx
    if abs(across) < _FACING * math.sqrt(rx * rx + ry * ry):
        return foot
    share = ((found.ax - x) * dy - (found.ay - y) * dx) / across
    met = (x + share * rx - found.ax) * dx + (y + share * ry - found.ay) * dy
    return min(foot + most, max(foot - most, met))


@inner
def joined_cuts(found, a, cut_a, b, cut_b):
    """Returns which ends of a joined plane lie beside a removed part: END_A, END_B. found: Joined; a, b: Box of both
    planes relative to the same point; cut_a, cut_b: their ends beside a removed part."""
    dx, dy = found.bx - found.ax, found.by - found.ay
    begins = (b.ax - a.ax) * dx + (b.ay - a.ay) * dy < 0.0
    ends = (b.bx - a.bx) * dx + (b.by - a.by) * dy > 0.0
    return ((cut_b if begins else cut_a) & END_A) | ((cut_b if ends else cut_a) & END_B)


@inner
def stays_open(free, a, cut_a, b, cut_b, flags, gap):
    """True if the gap between the boxes of two planes must stay open.

    It must if a removed part lies in it. A wide one must if it was observed free at any place at the heights of both, or
    beside an irregular plane (flags of either), because the extent of foliage beyond its ends is not known. cut_a, cut_b:
    ends beside a removed part."""
    # the facing ends: b of one and a of the other
    ab = (a.bx - b.ax) ** 2 + (a.by - b.ay) ** 2
    ba = (b.bx - a.ax) ** 2 + (b.by - a.ay) ** 2
    cut = (cut_a & END_B) | (cut_b & END_A) if ab < ba else (cut_a & END_A) | (cut_b & END_B)
    if gap > 0.0 and cut != 0:
        return True
    if gap <= CORNER_M:
        return False
    if flags & _IRREGULAR:
        return True
    x0, y0, x1, y1 = (a.bx, a.by, b.ax, b.ay) if ab < ba else (b.bx, b.by, a.ax, a.ay)
    top, bottom = max(a.top, b.top), min(a.bottom, b.bottom)
    for k in range(1, _GAP_POINTS + 1):
        share = k / (_GAP_POINTS + 1)
        for h in range(1, _GAP_POINTS + 1):
            z = top + (bottom - top) * h / (_GAP_POINTS + 1)
            if any_free(free, x0 + (x1 - x0) * share, y0 + (y1 - y0) * share, z):
                return True
    return False
