"""Groups of detections that lie close together: the candidates for moving obstacles."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, of_type, record
from ..union_find import root_of
from .observed import measured_limits, turn_between
from .tables import CUT_LEFT, CUT_RIGHT, NONE, POSE_SIGMA_M, is_gap

GAP_M = 0.4
"""Detections closer together belong to one group."""
_MOST_SIZE_M = 7.0
"""Larger groups are static."""
_CUT_SIDES = CUT_LEFT | CUT_RIGHT
_BORDER_RAD = 0.01
"""What ends so close to the border of the measured directions may continue."""
_TALL_SHARE = 0.5
"""A plane of less of its group's height is a roof or an edge, and not the face that is followed."""
_FACING = 0.3
"""Sine of the angle between a viewing ray and a plane that is not seen edge-on. The middle of a car that
crosses the view would wander along it with the share of its end that is seen."""
_LEAST_SIGMA_M, _SIGMA_OF_SIZE, _SIGMA_OF_RANGE = 0.04, 0.03, 0.003
"""Error of a group's place: constant, share of its size, and share of its range across the viewing ray."""

GROUP = record(
    *of_type(np.float64, "x_m y_m range_m nearest_m azimuth_rad first_rad last_rad face_first_rad face_last_rad"),
    *of_type(np.float64, "radial_sigma_m tangential_sigma_m size_m low_x_m high_x_m low_y_m high_y_m top_m bottom_m"),
    *of_type(np.float64, "area_m2"),
    *of_type(np.int32, "plane_flags object"),
)
"""A group of detections. x_m, y_m: the point of its face in the middle of the directions that it covers; range_m,
azimuth_rad: of that point from the camera; nearest_m: range of the nearest plane of any height there; first_rad, last_rad:
least and greatest direction from azimuth_rad, face_first_rad,
face_last_rad: of its tall planes that are not seen edge-on;
radial_sigma_m, tangential_sigma_m: error of the point along the viewing ray and across it; size_m: horizontal diagonal of
its box; plane_flags: of any of its planes; object: slot that it updates, -1: none."""


@kernel
def find_groups(detections, view, groups):
    """Fills groups (G,) GROUP from detections, ordered by their least x, and sets their `group`; returns how many.

    view: FreeView of the frame."""
    x_m, y_m, limits = view.x_m, view.y_m, measured_limits(view)
    count = number_groups(detections, close_together(detections), groups)
    for g in range(count):
        end_box(groups[g], x_m, y_m)
    for i in range(detections.shape[0]):
        if detections[i].group != NONE:
            widen(groups[detections[i].group], detections[i], x_m, y_m)
    for g in range(count):
        choose_direction(groups[g], limits)
    for i in range(detections.shape[0]):
        if detections[i].group != NONE:
            approach(groups[detections[i].group], detections[i], x_m, y_m)
    for g in range(count):
        end_group(groups[g], x_m, y_m, view.ke_per_m)
    return count


@kernel
def close_together(detections):
    """(N,) int64, the first detection of the group of each, for `root_of`. A filled gap is a group of its own."""
    parents = np.arange(detections.shape[0])
    for k in range(detections.shape[0]):
        d = detections[k]
        if is_gap(d):
            continue
        for i in range(k + 1, detections.shape[0]):
            if min(detections[i].ax_m, detections[i].bx_m) - max(d.ax_m, d.bx_m) >= GAP_M:
                break  # the following ones begin farther away
            if is_close(d, detections[i]) and not is_gap(detections[i]):
                a, b = root_of(parents, i), root_of(parents, k)
                parents[max(a, b)] = min(a, b)
    return parents


@inner
def is_close(d, e):
    """Whether the boxes of two detections lie closer together than GAP_M along y and z."""
    return (
        min(d.ay_m, d.by_m) - max(e.ay_m, e.by_m) < GAP_M
        and min(e.ay_m, e.by_m) - max(d.ay_m, d.by_m) < GAP_M
        and d.top_m - e.bottom_m < GAP_M
        and e.top_m - d.bottom_m < GAP_M
    )


@inner
def number_groups(detections, parents, groups):
    """Sets the `group` of the detections, NONE for filled gaps and where groups (G,) GROUP is full, and adds them to it; returns
    the number of groups. parents: of `close_together`."""
    count = 0
    for i in range(detections.shape[0]):
        d, r = detections[i], root_of(parents, i)
        if r < i:
            d.group = detections[r].group
        elif count == groups.shape[0] or is_gap(d):
            d.group = NONE
        else:
            d.group = count
            begin_group(groups[count])
            count += 1
        if d.group != NONE:
            add_detection(groups[d.group], d)
    return count


@inner
def begin_group(g):
    """An empty group."""
    g.x_m, g.y_m, g.area_m2, g.plane_flags, g.object = 0.0, 0.0, 0.0, 0, NONE
    g.low_x_m, g.high_x_m, g.low_y_m, g.high_y_m = math.inf, -math.inf, math.inf, -math.inf
    g.top_m, g.bottom_m = math.inf, -math.inf


@inner
def add_detection(g, d):
    """Adds a detection to a group."""
    area = max(d.length_m, 0.05) * (d.bottom_m - d.top_m)
    g.x_m += 0.5 * area * (d.ax_m + d.bx_m)
    g.y_m += 0.5 * area * (d.ay_m + d.by_m)
    g.area_m2 += area
    g.low_x_m, g.high_x_m = min(g.low_x_m, d.ax_m, d.bx_m), max(g.high_x_m, d.ax_m, d.bx_m)
    g.low_y_m, g.high_y_m = min(g.low_y_m, d.ay_m, d.by_m), max(g.high_y_m, d.ay_m, d.by_m)
    g.top_m, g.bottom_m = min(g.top_m, d.top_m), max(g.bottom_m, d.bottom_m)
    g.plane_flags |= d.plane_flags


@inner
def end_box(g, x_m, y_m):
    """Size of a complete group, and the direction of its middle from the camera."""
    g.x_m /= g.area_m2
    g.y_m /= g.area_m2
    g.size_m = math.sqrt((g.high_x_m - g.low_x_m) ** 2 + (g.high_y_m - g.low_y_m) ** 2)
    g.azimuth_rad = math.atan2(g.y_m - y_m, g.x_m - x_m)
    g.first_rad, g.last_rad = math.inf, -math.inf
    g.face_first_rad, g.face_last_rad = math.inf, -math.inf


@inner
def widen(g, d, x_m, y_m):
    """Adds the directions that a detection covers."""
    ax, ay, bx, by = d.ax_m - x_m, d.ay_m - y_m, d.bx_m - x_m, d.by_m - y_m
    a, b = turn_between(g.azimuth_rad, math.atan2(ay, ax)), turn_between(g.azimuth_rad, math.atan2(by, bx))
    g.first_rad, g.last_rad = min(g.first_rad, a, b), max(g.last_rad, a, b)
    x, y = ax + bx, ay + by
    if d.bottom_m - d.top_m >= _TALL_SHARE * (g.bottom_m - g.top_m) and abs(x * d.ty - y * d.tx) >= _FACING * math.sqrt(
        x * x + y * y
    ):
        g.face_first_rad, g.face_last_rad = min(g.face_first_rad, a, b), max(g.face_last_rad, a, b)


@inner
def is_cut(g, limits):
    """Whether a group reaches to the first or the last direction that was measured: the left border of a stereo image has no
    measurements, and its planes end before the border of the image."""
    middle = 0.5 * (limits[0] + limits[1])
    half = 0.5 * (limits[1] - limits[0]) - _BORDER_RAD
    at = turn_between(middle, g.azimuth_rad)
    return not (-half < at + g.first_rad and at + g.last_rad < half)


@inner
def choose_direction(g, limits):
    """Turns the direction of a group to the middle of its face, else of all directions that it covers, and marks it where it is
    cut. limits: of `measured_limits`."""
    if is_cut(g, limits):
        g.plane_flags |= _CUT_SIDES
    if g.face_first_rad < g.face_last_rad:
        g.azimuth_rad += 0.5 * (g.face_first_rad + g.face_last_rad)
    else:
        g.azimuth_rad += 0.5 * (g.first_rad + g.last_rad)
    g.range_m = g.nearest_m = math.inf


@inner
def approach(g, d, x_m, y_m):
    """Limits the range of a group's face to that of a detection in the middle direction."""
    ux, uy = math.cos(g.azimuth_rad), math.sin(g.azimuth_rad)
    ax, ay, bx, by = d.ax_m - x_m, d.ay_m - y_m, d.bx_m - x_m, d.by_m - y_m
    side_a, side_b = ux * ay - uy * ax, ux * by - uy * bx
    if side_a * side_b > 0.0 or side_a == side_b:
        return
    s = side_a / (side_a - side_b)
    far = ux * (ax + s * (bx - ax)) + uy * (ay + s * (by - ay))
    if far <= 0.0:
        return
    g.nearest_m = min(g.nearest_m, far)
    if d.bottom_m - d.top_m >= _TALL_SHARE * (g.bottom_m - g.top_m):
        g.range_m = min(g.range_m, far)


@inner
def end_group(g, x_m, y_m, ke_per_m):
    """Place and error of a complete group. The error along the ray is a third of that of one pixel: the noise of a stereo
    camera is correlated over 10 px, so that a group holds few independent samples. Between its planes the group's
    middle is used."""
    if g.range_m == math.inf:
        g.range_m = g.nearest_m
    if g.range_m == math.inf:
        g.range_m = math.sqrt((g.x_m - x_m) ** 2 + (g.y_m - y_m) ** 2)
    g.x_m = x_m + g.range_m * math.cos(g.azimuth_rad)
    g.y_m = y_m + g.range_m * math.sin(g.azimuth_rad)
    least2 = _LEAST_SIGMA_M**2 + POSE_SIGMA_M**2 + (_SIGMA_OF_SIZE * g.size_m) ** 2
    g.radial_sigma_m = math.sqrt(least2 + (0.33 * ke_per_m * g.range_m * g.range_m) ** 2)
    g.tangential_sigma_m = math.sqrt(least2 + (_SIGMA_OF_RANGE * g.range_m) ** 2)


@inner
def may_move(g):
    """Whether a group may be a moving obstacle: small, and not cut by the left or right border of the image."""
    return g.size_m <= _MOST_SIZE_M and g.plane_flags & _CUT_SIDES == 0
