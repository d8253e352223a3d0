"""Section 5.2: straight pieces become planes, and planes move to the near side of what they stand for.

A plane is a line a*x + b*y = 1 (see lines.py) between two tangents of azimuth and two heights. No plane may lie more than
`safe_distance_m` behind the robust near edge of the strips it stands for: what exceeds that shifts it towards the
camera, what remains is published as its margin.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import copy_row, inner, kernel
from .line_fit import fit_line, incidence_cosine
from .segments import T_T0, T_T1, tangent
from .strips import BOTTOM, CLUSTER, CUT, FILL, KIND, NEAR, SIGMA, SMOOTH, SUPPORT, TOP, TRACK, D, U

# columns of the float table of planes: line a, b; first and last tangent; heights (m, down); misfit in front (m); distance in the middle (m)
A, B, T0, T1, Z0, Z1, FRONT, MIDDLE = range(8)
# columns of the integer table
P_CLUSTER, P_SUPPORT, P_FILL, P_CUT, P_KIND, P_INFERRED, P_ROWS, P_COLUMNS, P_LAST_U = range(9)
MOST_M = 1e9
"""Stands for no distance at all, as do lines that cross a ray beyond 1/LEAST_S metres."""
LEAST_S = 1e-6


@inner
def distance_at(plane, t):
    """Forward distance x of a plane at tangent t; MOST_M where its line never crosses that ray."""
    s = plane[A] + plane[B] * t
    return 1.0 / s if s > LEAST_S else MOST_M


@inner
def planes_from_tracks(tracks, moments, track_floats, slope, half_column_t, planes, plane_ints, plane_of, parent):
    """A plane of each track, its own parent: line and ends; heights and support come from `measure_planes`."""
    for k in range(tracks):
        a, b, _, _ = fit_line(moments[k], 1.0 / (slope * slope))
        planes[k, A], planes[k, B] = a, b
        planes[k, T0], planes[k, T1] = track_floats[k, T_T0] - half_column_t, track_floats[k, T_T1] + half_column_t
        plane_ints[k, P_INFERRED] = 0
        plane_of[k], parent[k] = k, k


@kernel
def measure_planes(
    ints, floats, n, f, cu, lateral, tan_edge, footprint_t, cut_t, safe_m, along_m, near_sigmas, count, plane_of, planes,
    plane_ints,
):  # fmt: skip
    """Heights, support, filled rows, seen columns, cuts, clusters and the misfit in front, of every plane, from its strips.

    footprint_t: tangent by which rows go beyond their edges, cut_t: where the border of the image cuts them, which go on.
    plane_of: (tracks,) int32 root plane of a track. FRONT is the largest excess of the robust near edge over
    safe_m, perpendicular to the plane, and at least what keeps along_m along the viewing ray."""
    length = np.empty(count)
    for k in range(count):
        length[k] = math.hypot(planes[k, A], planes[k, B])
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
        top = x * (tan_edge[ints[i, TOP]] - (cut_t if ints[i, CUT] & 1 else footprint_t))
        bottom = x * (tan_edge[ints[i, BOTTOM] + 1] + (cut_t if ints[i, CUT] & 2 else footprint_t))
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
        planes[k, FRONT] = max(
            planes[k, FRONT],
            near_excess_m(
                x, t, floats[i, D], floats[i, NEAR], floats[i, SIGMA], ints[i, KIND], planes[k, A], planes[k, B], length[k],
                f, safe_m, along_m, near_sigmas,
            ),
        )  # fmt: skip


@inner
def near_excess_m(x, t, d, near, sigma, kind, a, b, length, f, safe_m, along_m, near_sigmas):
    """How far the near edge of a strip stands out in front of its plane a, b, at x along its tangent t, beyond safe_m:
    perpendicular to the plane, and at least what keeps along_m along the ray.

    d, near, sigma: disparities of the strip; length: hypot(a, b). The edge of a rough one lies no farther than near_sigmas of its noise behind the
    strip itself, whatever its neighbours say."""
    if kind != SMOOTH:
        near = max(near, d - near_sigmas * sigma)
    ray = (x - f / near) * math.sqrt(1.0 + t * t)
    cosine = incidence_cosine(a, b, length, t)
    return max(ray * cosine - safe_m, (ray - along_m) * cosine)


@inner
def shift_to_near_side(count, planes, least_m):
    """Moves each plane towards the camera by FRONT where that is positive, but to no nearer than least_m; FRONT becomes 0
    there.

    Tops below the camera and bottoms above it come along on their rays, so that none of what the plane stopped passes."""
    for k in range(count):
        if planes[k, FRONT] > 0.0:
            c = 1.0 / math.hypot(planes[k, A], planes[k, B])
            scale = c / max(least_m, c - planes[k, FRONT])
            planes[k, A] *= scale
            planes[k, B] *= scale
            planes[k, Z0], planes[k, Z1] = (
                min(planes[k, Z0], planes[k, Z0] / scale),
                max(planes[k, Z1], planes[k, Z1] / scale),
            )
            planes[k, FRONT] = 0.0


@inner
def compact_planes(count, planes, plane_ints, moments, parent, plane_of, tracks):
    """Moves the living planes to the front and points every track at its plane; returns how many live."""
    alive = 0
    for k in range(count):
        if plane_ints[k, P_SUPPORT] >= 0:
            copy_row(planes, alive, k)
            copy_row(plane_ints, alive, k)
            copy_row(moments, alive, k)
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
