"""Shrinks the extents of observed tracks towards the detections of the frame, where the frame observed what lies beyond them."""

from __future__ import annotations

import math

from ..jit import inner
from .line import EDGE_ON, facing, point_at
from .observed import FREE_BEHIND_M, is_unobserved
from .tables import CUT_BOTTOM, CUT_LEFT, CUT_RIGHT, CUT_TOP, MEMORY_HITS, NONE, SHRINK_SHARE

_REACH_M = 0.75
"""An end that is observed farther inside belongs to a part of the surface."""
_WHOLE_SHARE, _PART_SHARE = 0.6, 0.3
"""Detections of less of the height let it shrink by this share only."""


@inner
def shrink(table, j, detections, view, limits):
    """Lets the extent of slot j, an observed track, shrink by a share of the difference. An end that the border of the image
    cut, that a nearer obstacle hides or that lies out of the measured directions stays. limits: of `measured_limits`."""
    t = table.tracks[j]
    cut, share = flags_of(detections, t.first_detection), SHRINK_SHARE
    if cut & (CUT_LEFT | CUT_RIGHT) == 0:
        low, high = t.frame_s0_m - t.s0_m, t.s1_m - t.frame_s1_m
        if low < _REACH_M and not is_end_hidden(table, j, t.s0_m, t.frame_s0_m, view, limits):
            t.s0_m += share * low
        if high < _REACH_M and not is_end_hidden(table, j, t.s1_m, t.frame_s1_m, view, limits):
            t.s1_m -= share * high
    whole = t.frame_bottom_m - t.frame_top_m >= _WHOLE_SHARE * (t.bottom_m - t.top_m)
    share = share if whole else _PART_SHARE * share
    if cut & CUT_TOP == 0:
        t.top_m += share * (t.frame_top_m - t.top_m)
    if cut & CUT_BOTTOM == 0:
        t.bottom_m += share * (t.frame_bottom_m - t.bottom_m)


@inner
def flags_of(detections, first):
    """Flags of all detections of a chain."""
    flags, k = 0, first
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        flags |= detections[k].plane_flags
        k = detections[k].next
    return flags


@inner
def is_end_hidden(table, j, end_s, frame_s, view, limits):
    """Whether the frame did not observe a track's line from the end of its detections, frame_s, to its own end, end_s (m), and
    the end is known from enough frames. Where the line is seen edge-on the noise moves its ends by metres: they are known from
    no frame."""
    t = table.tracks[j]
    k = min(max(int(math.floor(end_s / t.cell_m)) - t.first_cell, 0), t.cells - 1)
    if table.cells[j, k].hits < MEMORY_HITS:
        return False
    s = 0.5 * (end_s + frame_s)
    x, y = point_at(t, s)
    if facing(t, x, y, (view.x_m, view.y_m, 0.0)) < EDGE_ON:
        return False
    return is_unobserved(x, y, t.top_m, t.bottom_m, FREE_BEHIND_M + t.margin_m, view, limits)
