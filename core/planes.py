"""Sections 5.2 and 5.3, the merge: straight pieces become planes, planes that stand for one thing become one.

A plane is a line a*x + b*y = 1 (see lines.py) between two tangents of azimuth and two heights. No plane may lie more than
`safe_distance_m` behind the robust near edge of the strips it stands for: what exceeds that shifts it towards the
camera, what remains is published as its margin.
"""

from __future__ import annotations

import math

from numba import njit

from .lines import W, fit_line, incidence_cosine
from .openings import is_open
from .strips import BOTTOM, CLUSTER, CUT, FILL, KIND, NEAR, SUPPORT, TOP, TRACK, U
from .tracks import T_T0, T_T1, tangent

# columns of the float table of planes: line a, b; first and last tangent; heights (m, down); misfit in front (m); distance in the middle (m)
A, B, T0, T1, Z0, Z1, FRONT, MIDDLE = range(8)
# columns of the integer table
P_CLUSTER, P_SUPPORT, P_FILL, P_CUT, P_KIND, P_INFERRED, P_ROWS, P_COLUMNS, P_LAST_U = range(9)
MOST_M = 1e9
"""Stands for no distance at all, as do lines that cross a ray beyond 1/LEAST_S metres."""
LEAST_S = 1e-6


@njit(cache=True, nogil=True)
def distance_at(plane, t):
    """Forward distance x of a plane at tangent t; MOST_M where its line never crosses that ray."""
    s = plane[A] + plane[B] * t
    return 1.0 / s if s > LEAST_S else MOST_M


@njit(cache=True, nogil=True)
def planes_from_tracks(tracks, moments, track_floats, slope, half_column_t, planes, plane_ints, plane_of):
    """A plane of each track: line and ends; heights and support come from `measure_planes`."""
    for k in range(tracks):
        a, b, _, _ = fit_line(moments[k], 1.0 / (slope * slope))
        planes[k, A], planes[k, B] = a, b
        planes[k, T0], planes[k, T1] = track_floats[k, T_T0] - half_column_t, track_floats[k, T_T1] + half_column_t
        plane_ints[k, P_INFERRED] = 0
        plane_of[k] = k


@njit(cache=True, nogil=True)
def measure_planes(
    ints, floats, n, f, cu, lateral, tan_edge, footprint_t, safe_m, along_m, count, plane_of, planes, plane_ints
):
    """Heights, support, filled rows, seen columns, cuts, clusters and the misfit in front, of every plane, from its strips.

    plane_of: (tracks,) int32 root plane of a track. FRONT is the largest excess of the robust near edge over
    safe_m, perpendicular to the plane, and at least what keeps along_m along the viewing ray."""
    for k in range(count):
        planes[k, Z0], planes[k, Z1], planes[k, FRONT] = MOST_M, -MOST_M, -MOST_M
        plane_ints[k, P_SUPPORT], plane_ints[k, P_FILL], plane_ints[k, P_CUT], plane_ints[k, P_KIND] = 0, 0, 0, 0
        plane_ints[k, P_ROWS], plane_ints[k, P_COLUMNS], plane_ints[k, P_LAST_U] = 0, 0, -1
        planes[k, MIDDLE] = distance_at(planes[k], 0.5 * (planes[k, T0] + planes[k, T1]))
    for i in range(n):
        if ints[i, SUPPORT] == 0:
            continue
        k = plane_of[ints[i, TRACK]]
        t = tangent(ints, i, cu, f, lateral)
        x = distance_at(planes[k], t)
        top = x * (tan_edge[ints[i, TOP]] - footprint_t)
        bottom = x * (tan_edge[ints[i, BOTTOM] + 1] + footprint_t)
        if top < planes[k, Z0]:
            planes[k, Z0] = top
            plane_ints[k, P_CUT] = (plane_ints[k, P_CUT] & ~1) | (ints[i, CUT] & 1)
        if bottom > planes[k, Z1]:
            planes[k, Z1] = bottom
            plane_ints[k, P_CUT] = (plane_ints[k, P_CUT] & ~2) | (ints[i, CUT] & 2)
        plane_ints[k, P_SUPPORT] += ints[i, SUPPORT]
        plane_ints[k, P_FILL] += ints[i, FILL]
        plane_ints[k, P_ROWS] += ints[i, BOTTOM] - ints[i, TOP] + 1
        if ints[i, U] != plane_ints[k, P_LAST_U]:  # strips come in order of their columns
            plane_ints[k, P_COLUMNS] += 1
            plane_ints[k, P_LAST_U] = ints[i, U]
        plane_ints[k, P_KIND] = max(plane_ints[k, P_KIND], ints[i, KIND])
        plane_ints[k, P_CLUSTER] = ints[i, CLUSTER]
        # the near edge along the ray, and its distance to the plane
        ray = (x - f / floats[i, NEAR]) * math.sqrt(1.0 + t * t)
        cosine = incidence_cosine(planes[k, A], planes[k, B], t)
        planes[k, FRONT] = max(planes[k, FRONT], max(ray * cosine - safe_m, (ray - along_m) * cosine))


@njit(cache=True, nogil=True)
def shift_to_near_side(count, planes, least_m):
    """Moves each plane towards the camera by FRONT where that is positive, but to no nearer than least_m; FRONT becomes 0
    there."""
    for k in range(count):
        if planes[k, FRONT] > 0.0:
            c = 1.0 / math.hypot(planes[k, A], planes[k, B])
            scale = c / max(least_m, c - planes[k, FRONT])
            planes[k, A] *= scale
            planes[k, B] *= scale
            planes[k, FRONT] = 0.0


@njit(cache=True, nogil=True)
def _outside_m(plane, t, z, x):
    """Distance of the point (t, z) at range x from a plane's rectangle, in the rectangle's own face."""
    side = max(0.0, max(plane[T0] - t, t - plane[T1])) * x
    height = max(0.0, max(plane[Z0] - z, z - plane[Z1]))
    return math.hypot(side, height)


@njit(cache=True, nogil=True)
def joined_reach_m(p, q, x):
    """How far the joined rectangle of planes p and q reaches beyond both: its farthest corner, or half their gap."""
    t0, t1 = min(p[T0], q[T0]), max(p[T1], q[T1])
    z0, z1 = min(p[Z0], q[Z0]), max(p[Z1], q[Z1])
    reach = 0.5 * max(max(p[T0], q[T0]) - min(p[T1], q[T1]), 0.0) * x
    reach = max(reach, 0.5 * max(max(p[Z0], q[Z0]) - min(p[Z1], q[Z1]), 0.0))
    for t in (t0, t1):
        for z in (z0, z1):
            reach = max(reach, min(_outside_m(p, t, z, x), _outside_m(q, t, z, x)))
    return reach


@njit(cache=True, nogil=True)
def deviation(p, moments, a, b, tolerance_m, sigmas, noise_cap):
    """How far a new line leaves plane p at its ends, over what is allowed (below 1: it may replace it).

    Noise of p, `sigmas` of it, allows for more, but for at most noise_cap times tolerance_m."""
    worst = 0.0
    for t in (p[T0], p[T1]):
        old = distance_at(p, t)
        s = a + b * t
        if s <= LEAST_S:
            return 2.0
        noise = sigmas * old * old / math.sqrt(moments[W])
        worst = max(worst, abs(1.0 / s - old) / (tolerance_m + min(noise, noise_cap * tolerance_m)))
    return worst


@njit(cache=True, nogil=True)
def turn_rad(p, q):
    """Angle between two planes."""
    cross = p[A] * q[B] - p[B] * q[A]
    dot = p[A] * q[A] + p[B] * q[B]
    return abs(math.atan2(cross, dot))


@njit(cache=True, nogil=True)
def merge_cost(
    p, q, mp, mq, total, tolerance_m, sigmas, noise_cap, slope, reach_m, reach_weight, angle_rad, long_m
):  # fmt: skip
    """(cost, a, b) of one plane for both p and q; cost below 1: they stand for one thing. total: (6,) scratch.

    Opening rule: no point of the joined rectangle lies farther than reach_m (below Hs and Ws/2) from what was seen,
    so that no opening the vehicle could pass is ever closed here."""
    x = 0.5 * (p[MIDDLE] + q[MIDDLE])
    if max(p[Z0], q[Z0]) - min(p[Z1], q[Z1]) > 2.0 * reach_m:
        return 2.0, 0.0, 0.0
    reach = joined_reach_m(p, q, x) / reach_m
    if reach > 1.0:
        return 2.0, 0.0, 0.0
    if turn_rad(p, q) > angle_rad and min((p[T1] - p[T0]), (q[T1] - q[T0])) * x > long_m:
        return 2.0, 0.0, 0.0
    for m in range(6):
        total[m] = mp[m] + mq[m]
    a, b, _, _ = fit_line(total, 1.0 / (slope * slope))
    worst = max(
        deviation(p, mp, a, b, tolerance_m, sigmas, noise_cap), deviation(q, mq, a, b, tolerance_m, sigmas, noise_cap)
    )
    return worst + reach_weight * reach, a, b


@njit(cache=True, nogil=True)
def near_evidence(t, z, x, reach_m, piece, following, pieces):
    """Whether the point (t, z) at distance x lies within reach_m of a piece of the chain that begins at `piece`."""
    for _ in range(pieces.shape[0]):
        if piece < 0:
            break
        e = pieces[piece]
        nearest_t = min(max(t, e[0]), e[1])
        share = (nearest_t - e[0]) / max(e[1] - e[0], 1e-9)
        own = 1.0 / (e[4] + (e[5] - e[4]) * share)
        height = max(0.0, max(e[2] - z, z - e[3]))
        if (x - own) ** 2 + (x * t - own * nearest_t) ** 2 + height * height <= reach_m * reach_m:
            return True
        piece = following[piece]
    return False


@njit(cache=True, nogil=True)
def joined_on_evidence(p, q, a, b, i, j, reach_m, step, most, slack_m, following, pieces, masks, frame):
    """Whether every point of the joined rectangle outside both lies within reach_m of a piece that was really seen, and
    no such point in an opening (openings.py), slack_m beside the evidence apart.

    a, b: the joined line. Points lie `step` of the reach apart, at most `most` + 1 each way. Rectangles may already
    cover more than was seen, so that without this planes creep over an opening in small steps. pieces: (tracks, 6) t0, t1, top, bottom, 1/x at t0 and at t1 of what each track saw;
    following: the next piece of a plane, -1 at the end."""
    t0, t1 = min(p[T0], q[T0]), max(p[T1], q[T1])
    z0, z1 = min(p[Z0], q[Z0]), max(p[Z1], q[Z1])
    s0, s1 = max(a + b * t0, 1e-3), max(a + b * t1, 1e-3)
    length = math.hypot(1.0 / s0 - 1.0 / s1, t0 / s0 - t1 / s1)
    across = min(most, 2 + int(length / (step * reach_m)))
    down = min(most, 2 + int((z1 - z0) / (step * reach_m)))
    for k in range(across + 1):
        t = t0 + (t1 - t0) * k / across
        x = 1.0 / max(a + b * t, 1e-3)
        for m in range(down + 1):
            z = z0 + (z1 - z0) * m / down
            if (p[T0] <= t <= p[T1] and p[Z0] <= z <= p[Z1]) or (q[T0] <= t <= q[T1] and q[Z0] <= z <= q[Z1]):
                continue
            limit = slack_m if is_open(masks, t, z / x, x, frame) else reach_m
            if not near_evidence(t, z, x, limit, i, following, pieces) and not near_evidence(
                t, z, x, limit, j, following, pieces
            ):
                return False
    return True


@njit(cache=True, nogil=True)
def merge_planes(
    count, planes, plane_ints, moments, parent, tolerance_m, sigmas, noise_cap, slope, reach_m, reach_weight, angle_rad,
    long_m, step, most, slack_m, rounds, following, pieces, masks, frame,
):  # fmt: skip
    """Joins planes of one cluster, cheapest partner first, until none fits (Eq. 17); dead ones get a negative support.

    parent: (N,) int32, the plane that took each one over. following: (N,) int32 and pieces: (N, 6) float64, scratch."""
    total = moments[0].copy()
    for k in range(count):
        following[k] = -1
        p = planes[k]
        pieces[k, 0], pieces[k, 1], pieces[k, 2], pieces[k, 3] = p[T0], p[T1], p[Z0], p[Z1]
        pieces[k, 4], pieces[k, 5] = 1.0 / distance_at(p, p[T0]), 1.0 / distance_at(p, p[T1])
    for _round in range(rounds):
        changed = False
        for i in range(count):
            if plane_ints[i, P_SUPPORT] < 0:
                continue
            for _ in range(count):
                best, cost, best_a, best_b = -1, 1.0, 0.0, 0.0
                for j in range(count):
                    if j == i or plane_ints[j, P_SUPPORT] < 0 or plane_ints[j, P_CLUSTER] != plane_ints[i, P_CLUSTER]:
                        continue
                    aside = max(planes[i, T0], planes[j, T0]) - min(planes[i, T1], planes[j, T1])
                    if aside * (planes[i, MIDDLE] + planes[j, MIDDLE]) > 4.0 * reach_m:
                        continue  # most pairs are far apart
                    c, a, b = merge_cost(
                        planes[i], planes[j], moments[i], moments[j], total,
                        tolerance_m, sigmas, noise_cap, slope, reach_m, reach_weight, angle_rad, long_m,
                    )  # fmt: skip
                    if c < cost and joined_on_evidence(
                        planes[i], planes[j], a, b, i, j, reach_m, step, most, slack_m, following, pieces, masks, frame
                    ):
                        best, cost, best_a, best_b = j, c, a, b
                if best < 0:
                    break
                _absorb(planes, plane_ints, moments, i, best, best_a, best_b)
                _chain(following, i, best)
                parent[best] = i
                changed = True
        if not changed:
            break


@njit(cache=True, nogil=True)
def _chain(following, i, j):
    """Appends the pieces of plane j to those of plane i."""
    last = j
    for _ in range(following.shape[0]):
        if following[last] < 0:
            break
        last = following[last]
    following[last] = following[i]
    following[i] = j


@njit(cache=True, nogil=True)
def _absorb(planes, plane_ints, moments, i, j, a, b):
    p, q = planes[i], planes[j]
    p[A], p[B] = a, b
    p[T0], p[T1] = min(p[T0], q[T0]), max(p[T1], q[T1])
    p[MIDDLE] = distance_at(p, 0.5 * (p[T0] + p[T1]))
    p[Z0], p[Z1] = min(p[Z0], q[Z0]), max(p[Z1], q[Z1])
    for m in range(6):
        moments[i, m] += moments[j, m]
    plane_ints[i, P_SUPPORT] += plane_ints[j, P_SUPPORT]
    plane_ints[j, P_SUPPORT] = -1


@njit(cache=True, nogil=True)
def compact_planes(count, planes, plane_ints, moments, parent, plane_of, tracks):
    """Moves the living planes to the front and points every track at its plane; returns how many live."""
    alive = 0
    for k in range(count):
        if plane_ints[k, P_SUPPORT] >= 0:
            planes[alive], plane_ints[alive], moments[alive] = planes[k], plane_ints[k], moments[k]
            parent[k] = -1 - alive  # negative: the new number
            alive += 1
    for t in range(tracks):
        k = plane_of[t]
        for _ in range(count):
            if parent[k] < 0:
                break
            k = parent[k]
        plane_of[t] = -1 - parent[k]
    return alive
