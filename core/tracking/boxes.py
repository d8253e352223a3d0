"""Bounds of the tracks: which of them stand near a detection, without a look at the others."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel
from .line import point_at


@kernel
def track_boxes(tracks):
    """Bounds of the tracks (T,) TRACK -> (6, T) float64: least and greatest x, y and z, m. That of an empty slot overlaps
    nothing."""
    boxes = np.empty((6, tracks.shape[0]))
    for j in range(tracks.shape[0]):
        set_box(boxes, j, tracks[j])
    return boxes


@inner
def set_box(boxes, j, t):
    """Sets the bounds of the track in slot j."""
    if t.hits == 0:
        for k in range(0, 6, 2):
            boxes[k, j], boxes[k + 1, j] = math.inf, -math.inf
        return
    x0, y0 = point_at(t, t.s0_m)
    x1, y1 = point_at(t, t.s1_m)
    boxes[0, j], boxes[1, j] = min(x0, x1), max(x0, x1)
    boxes[2, j], boxes[3, j] = min(y0, y1), max(y0, y1)
    boxes[4, j], boxes[5, j] = t.top_m, t.bottom_m


@inner
def find_near(d, boxes, reach_m, reach_z_m, found):
    """Lists the boxes (6, T) that a detection touches, enlarged by reach_m to all sides and by reach_z_m up and down -> found
    (T,) int64, ascending. Returns how many."""
    x0, x1 = min(d.ax_m, d.bx_m) - reach_m, max(d.ax_m, d.bx_m) + reach_m
    y0, y1 = min(d.ay_m, d.by_m) - reach_m, max(d.ay_m, d.by_m) + reach_m
    top, bottom = d.top_m - reach_z_m, d.bottom_m + reach_z_m
    count = 0
    for j in range(boxes.shape[1]):
        if boxes[0, j] > x1 or boxes[1, j] < x0 or boxes[2, j] > y1 or boxes[3, j] < y0:
            continue
        if boxes[4, j] <= bottom and boxes[5, j] >= top:
            found[count] = j
            count += 1
    return count
