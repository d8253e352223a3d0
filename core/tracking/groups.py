"""Groups of detections that lie close together: the candidates for moving obstacles."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel, record

GAP_M = 0.4
"""Not tuning: detections closer together belong to one group."""
_CUT_SIDES = 4 | 8

GROUP = record(
    ("x_m", np.float64),
    ("y_m", np.float64),
    ("sigma_m", np.float64),
    ("size_m", np.float64),
    ("low_x_m", np.float64),
    ("high_x_m", np.float64),
    ("low_y_m", np.float64),
    ("high_y_m", np.float64),
    ("top_m", np.float64),
    ("bottom_m", np.float64),
    ("area_m2", np.float64),
    ("plane_flags", np.int32),
    ("detections", np.int32),
    ("object", np.int32),
)
"""A group of detections. x_m, y_m: middle of its planes, weighted by area; sigma_m: its error; size_m: horizontal diagonal
of its box; plane_flags: of any of its planes; object: slot that it updates, -1: none."""


@inner
def root(parents, i):
    """The group of an entry."""
    for _ in range(parents.shape[0]):
        if parents[i] == i:
            break
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@kernel
def find_groups(detections, x_m, y_m, ke_per_m, pose_sigma_m, groups):
    """Fills groups (G,) GROUP from detections, ordered by their least x, and sets their `group`; returns how many. x_m, y_m: of the camera."""
    n = detections.shape[0]
    parents = np.arange(n)
    boxes = np.empty((n, 6))
    for i in range(n):
        d = detections[i]
        boxes[i, 0], boxes[i, 1] = min(d.ax_m, d.bx_m), max(d.ax_m, d.bx_m)
        boxes[i, 2], boxes[i, 3] = min(d.ay_m, d.by_m), max(d.ay_m, d.by_m)
        boxes[i, 4], boxes[i, 5] = d.top_m, d.bottom_m
    for k in range(n):
        for i in range(k + 1, n):
            if boxes[i, 0] - boxes[k, 1] >= GAP_M:
                break  # the following ones begin farther away
            if (
                boxes[k, 2] - boxes[i, 3] < GAP_M
                and boxes[i, 2] - boxes[k, 3] < GAP_M
                and boxes[k, 4] - boxes[i, 5] < GAP_M
                and boxes[i, 4] - boxes[k, 5] < GAP_M
            ):
                a, b = root(parents, i), root(parents, k)
                parents[max(a, b)] = min(a, b)
    count = 0
    for i in range(n):
        r = root(parents, i)
        if r == i:
            if count == groups.shape[0]:
                detections[i].group = -1
                continue
            detections[i].group = count
            begin_group(groups[count])
            count += 1
        else:
            detections[i].group = detections[r].group
        if detections[i].group >= 0:
            add_detection(groups[detections[i].group], detections[i])
    for g in range(count):
        end_group(groups[g], x_m, y_m, ke_per_m, pose_sigma_m)
    return count


@inner
def begin_group(g):
    """An empty group."""
    g.x_m, g.y_m, g.area_m2, g.plane_flags, g.detections, g.object = 0.0, 0.0, 0.0, 0, 0, -1
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
    g.detections += 1


@inner
def end_group(g, x_m, y_m, ke_per_m, pose_sigma_m):
    """Middle, size and error of a complete group. The error of the middle is a third of that of one pixel: the noise of a
    stereo camera is correlated over 10 px, so that a group holds few independent samples."""
    g.x_m /= g.area_m2
    g.y_m /= g.area_m2
    g.size_m = math.sqrt((g.high_x_m - g.low_x_m) ** 2 + (g.high_y_m - g.low_y_m) ** 2)
    r2 = (g.x_m - x_m) ** 2 + (g.y_m - y_m) ** 2
    g.sigma_m = math.sqrt(0.04**2 + pose_sigma_m**2 + (0.33 * ke_per_m * r2) ** 2)


@inner
def may_move(g, rules):
    """Whether a group may be a moving obstacle: small, and not cut by the left or right border of the image."""
    return g.size_m <= rules.max_size_m and g.plane_flags & _CUT_SIDES == 0
