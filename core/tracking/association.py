"""Which plane of a frame is an observation of which track.

Two relations of a detection and a track whose heights overlap: the detection *continues* the track where both its ends
lie on the track's line within the gate; it *covers* the track where the track lies on the detection's rectangle. Pairs are
taken in the order of their overlap, the best first.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel
from .boxes import find_near, track_boxes
from .line import along, offset, point_at, sideways, variance_at
from .tables import CUT_BOTTOM, CUT_TOP, NONE

_TOUCH_M = 0.1
"""Ends this close touch."""
_SHORT_M = 0.6
"""Shorter planes have no direction of their own."""
_COVERED_SHARE = 0.7
"""Share of a track's length and height that a detection must cover."""
_FRONT_M = 0.3
"""A covered track lies at most this far in front of the detection, and within its margin."""
_APART_M = 0.2
"""Detections of one frame that overlap by more are different surfaces."""
_EMPTY_SHARE, _EMPTY_M2 = 0.15, 0.1
"""A rectangle around two others may hold this share of its area, and this area, that neither covers."""
_EMPTY_M = 0.5
"""Greatest side of an empty square that it may hold, as a merged plane of one frame (default of join_gap_m)."""
STEADY_HITS = 5
"""A track observed as often is steady."""
_TALLER_M = 0.5
"""One detection makes a steady track taller by at most this, at each edge."""
SIDEWAYS_M = 0.15
"""A detection is seen at most this far beside the line of its track."""
CONTINUES, COVERS = 1, 2
GATE_MIN_M, GATE_MAX_M = 0.15, 0.4
"""Distance from the line of a track that is always accepted, and one that is never exceeded."""
_GATE_SIGMAS = 2.0
"""Between them, the largest distance in standard deviations."""
_WIDE = 1.6
"""Factor of the gate while the motion of the vehicle is estimated."""


class Gate(NamedTuple):
    """Limits of the distance of a detection from the line of a track: least_m is always accepted, most_m never exceeded."""

    least_m: Any
    most_m: Any


GATE, WIDE_GATE = Gate(GATE_MIN_M, GATE_MAX_M), Gate(GATE_MAX_M, _WIDE * GATE_MAX_M)
"""With a known motion of the vehicle, and while it is estimated."""


@inner
def heights_overlap(d, track):
    """Share of the smaller height that both have; 0: none."""
    over = min(d.bottom_m, track.bottom_m) - max(d.top_m, track.top_m)
    return over / min(d.bottom_m - d.top_m, track.bottom_m - track.top_m)


@inner
def gate_at(track, d, s, gate):
    """Largest accepted distance of a detection's point at s from the track's line, m."""
    sigma = math.sqrt(max(0.0, variance_at(track, s)) + d.sigma_m**2)
    return min(gate.most_m, max(gate.least_m, _GATE_SIGMAS * sigma))


@inner
def fits_one_rectangle(low, high, top, bottom, track):
    """Whether one rectangle for a track and another part of its line (s low..high, heights top..bottom) is mostly covered by
    both, and at each corner: a pole beside a car is not one tall surface with it."""
    length = max(high, track.s1_m) - min(low, track.s0_m)
    height = max(bottom, track.bottom_m) - min(top, track.top_m)
    over_s = max(0.0, min(high, track.s1_m) - max(low, track.s0_m))
    over_z = max(0.0, min(bottom, track.bottom_m) - max(top, track.top_m))
    both = (high - low) * (bottom - top) + (track.s1_m - track.s0_m) * (track.bottom_m - track.top_m) - over_s * over_z
    if length * height - both > _EMPTY_SHARE * length * height + _EMPTY_M2:
        return False
    return not has_empty_corner(low, high, top, bottom, track)


@inner
def has_empty_corner(low, high, top, bottom, track):
    """Whether one rectangle for a track and another part of its line (s low..high, heights top..bottom) holds an empty square
    greater than _EMPTY_M at a corner: one of the two reaches farther along there, and the other farther up or down."""
    for left in range(2):
        along_m = low - track.s0_m if left else track.s1_m - high
        for upper in range(2):
            up_m = top - track.top_m if upper else track.bottom_m - bottom
            if along_m * up_m < 0.0 and min(abs(along_m), abs(up_m)) > _EMPTY_M:
                return True
    return False


@inner
def is_much_taller(d, track):
    """Whether a detection reaches far beyond the upper or lower edge of a steady track: one detection of a crown with its trunk
    would hide the open space beside the trunk for long. Where the border of the image cut either of them, the rest may be the
    same surface."""
    if track.hits < STEADY_HITS:
        return False
    cut = d.plane_flags | track.plane_flags
    above = track.top_m - d.top_m > _TALLER_M and cut & CUT_TOP == 0
    return above or (d.bottom_m - track.bottom_m > _TALLER_M and cut & CUT_BOTTOM == 0)


@inner
def continues(d, track, gate, eye):
    """Score of a detection that continues a track (> 0), 0 where it does not: overlap in m, reduced by the distance. eye:
    place of the camera; the track must hide what the detection hides from it."""
    off_a = abs(offset(track, d.ax_m, d.ay_m))
    if off_a > gate.most_m:
        return 0.0
    off_b = abs(offset(track, d.bx_m, d.by_m))
    if off_b > gate.most_m:
        return 0.0
    if sideways(track, d.ax_m, d.ay_m, off_a, eye) > SIDEWAYS_M:
        return 0.0
    if sideways(track, d.bx_m, d.by_m, off_b, eye) > SIDEWAYS_M:
        return 0.0
    if d.tx * track.tx + d.ty * track.ty < 0.0 and min(d.length_m, track.s1_m - track.s0_m) > _SHORT_M:
        return 0.0
    sa, sb = along(track, d.ax_m, d.ay_m), along(track, d.bx_m, d.by_m)
    over = min(max(sa, sb), track.s1_m) - max(min(sa, sb), track.s0_m)
    height = heights_overlap(d, track)
    if over < -_TOUCH_M or height < 0.3 or is_much_taller(d, track):
        return 0.0
    if not fits_one_rectangle(min(sa, sb), max(sa, sb), d.top_m, d.bottom_m, track):
        return 0.0
    far = max(off_a / gate_at(track, d, sa, gate), off_b / gate_at(track, d, sb, gate))
    if far > 1.0:
        return 0.0
    return (max(over, 0.0) + 0.05) * min(height, 1.0) * (1.0 - 0.7 * far)


@inner
def covers(d, track, gate):
    """Whether a detection covers a track: it reaches over most of its length and height, leaves no corner of one
    rectangle for both empty, and lies no more than the gate in front of it and no more than its own margin behind it."""
    height = min(d.bottom_m, track.bottom_m) - max(d.top_m, track.top_m)
    if height < 0.8 * (track.bottom_m - track.top_m) or is_much_taller(d, track):
        return False
    sa, sb = along(track, d.ax_m, d.ay_m), along(track, d.bx_m, d.by_m)
    if has_empty_corner(min(sa, sb), max(sa, sb), d.top_m, d.bottom_m, track):
        return False
    front = max(gate.least_m, min(_FRONT_M, d.margin_m))
    low, high = math.inf, -math.inf
    for end in range(2):
        x, y = point_at(track, track.s0_m if end == 0 else track.s1_m)
        near = (y - d.ay_m) * d.tx - (x - d.ax_m) * d.ty
        if near > front or near < -gate.most_m:
            return False
        at = (x - d.ax_m) * d.tx + (y - d.ay_m) * d.ty
        low, high = min(low, at), max(high, at)
    over = min(high, d.length_m) - max(low, 0.0)
    length = track.s1_m - track.s0_m
    return over >= _COVERED_SHARE * max(high - low, 1e-3) and high - low >= 0.5 * length - _TOUCH_M


@kernel
def find_pairs(detections, tracks, gate, eye, pairs, scores):
    """Lists the pairs of detections and tracks that belong together -> pairs (P, 3) int32: detection, slot of the track,
    relation; scores (P,) float64. gate: Gate; eye: place of the camera. Returns (number of pairs, number of pairs that did
    not fit)."""
    boxes, found = track_boxes(tracks), np.empty(tracks.shape[0], np.int64)
    reach = gate.most_m + _TOUCH_M
    count, lost = 0, 0
    for i in range(detections.shape[0]):
        d = detections[i]
        for j in found[: find_near(d, boxes, reach, 0.0, found)]:
            score = continues(d, tracks[j], gate, eye)
            relation = CONTINUES
            if score <= 0.0:
                relation = COVERS
                score = 1e-3 if covers(d, tracks[j], gate) else 0.0
            if score <= 0.0:
                continue
            if count == pairs.shape[0]:
                lost += 1
                continue
            pairs[count, 0], pairs[count, 1], pairs[count, 2] = i, j, relation
            scores[count] = score
            count += 1
    return count, lost


@inner
def is_apart(detections, i, track):
    """Whether detection i overlaps, side by side, a detection that updates the track already: then they are different
    surfaces of one frame."""
    d = detections[i]
    sa, sb = along(track, d.ax_m, d.ay_m), along(track, d.bx_m, d.by_m)
    low, high = min(sa, sb), max(sa, sb)
    k = track.first_detection
    for _ in range(detections.shape[0]):
        if k == NONE:
            return False
        e = detections[k]
        ea, eb = along(track, e.ax_m, e.ay_m), along(track, e.bx_m, e.by_m)
        if (
            min(high, max(ea, eb)) - max(low, min(ea, eb)) > _APART_M
            and min(d.bottom_m, e.bottom_m) - max(d.top_m, e.top_m) > _APART_M
        ):
            return True
        k = e.next
    return False


@kernel
def assign(detections, tracks, pairs):
    """Gives each detection at most one track: the best pair first. A detection that continues no track takes a track that
    it covers and that no other detection observed. pairs: of `find_pairs`, the best first."""
    for relation in (CONTINUES, COVERS):
        for n in range(pairs.shape[0]):
            if pairs[n, 2] != relation:
                continue
            i, j = pairs[n, 0], pairs[n, 1]
            if detections[i].track != NONE:
                continue
            if relation == COVERS and tracks[j].first_detection != NONE:
                continue
            if relation == CONTINUES and is_apart(detections, i, tracks[j]):
                continue
            detections[i].track = j
            detections[i].next = tracks[j].first_detection
            tracks[j].first_detection = i
