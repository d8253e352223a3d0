"""Which plane of a frame is an observation of which track.

Two relations of a detection and a track whose heights overlap: the detection *continues* the track where both its ends
lie on the track's line within the gate; it *covers* the track where the track lies on the detection's rectangle. Pairs are
taken in the order of their overlap, the best first.
"""

from __future__ import annotations

import math

from ..jit import inner, kernel
from .line import along, offset, variance_at
from .tables import NONE

_TOUCH_M = 0.1
"""Not tuning: ends this close touch."""
_SHORT_M = 0.6
"""Not tuning: shorter planes have no direction of their own."""
_COVERED_SHARE = 0.7
"""Not tuning: share of a track's length and height that a detection must cover."""
_FRONT_M = 0.3
"""Not tuning: a covered track lies at most this far in front of the detection, and within its margin."""
_APART_M = 0.2
"""Not tuning: detections of one frame that overlap by more are different surfaces."""
CONTINUES, COVERS = 1, 2


@inner
def heights_overlap(d, track):
    """Share of the smaller height that both have; 0: none."""
    over = min(d.bottom_m, track.bottom_m) - max(d.top_m, track.top_m)
    return over / min(d.bottom_m - d.top_m, track.bottom_m - track.top_m)


@inner
def gate(track, d, s, rules):
    """Largest accepted distance of a detection's point at s from the track's line, m."""
    sigma = math.sqrt(max(0.0, variance_at(track, s)) + d.sigma_m**2)
    return min(rules.gate_max_m, max(rules.gate_min_m, rules.gate_sigmas * sigma))


@inner
def continues(d, track, rules):
    """Score of a detection that continues a track (> 0), 0 where it does not: overlap in m, reduced by the distance."""
    if d.tx * track.tx + d.ty * track.ty < 0.0 and min(d.length_m, track.s1_m - track.s0_m) > _SHORT_M:
        return 0.0
    sa, sb = along(track, d.ax_m, d.ay_m), along(track, d.bx_m, d.by_m)
    over = min(max(sa, sb), track.s1_m) - max(min(sa, sb), track.s0_m)
    height = heights_overlap(d, track)
    if over < -_TOUCH_M or height < 0.3:
        return 0.0
    far_a = abs(offset(track, d.ax_m, d.ay_m)) / gate(track, d, sa, rules)
    far_b = abs(offset(track, d.bx_m, d.by_m)) / gate(track, d, sb, rules)
    far = max(far_a, far_b)
    if far > 1.0:
        return 0.0
    return (max(over, 0.0) + 0.05) * min(height, 1.0) * (1.0 - 0.7 * far)


@inner
def covers(d, track, rules):
    """Whether a detection covers a track: it reaches over most of its length and height, no more than the gate in front of
    it and no more than its own margin behind it."""
    x0, y0 = track.x_m + track.s0_m * track.tx, track.y_m + track.s0_m * track.ty
    x1, y1 = track.x_m + track.s1_m * track.tx, track.y_m + track.s1_m * track.ty
    q0 = (x0 - d.ax_m) * d.tx + (y0 - d.ay_m) * d.ty
    q1 = (x1 - d.ax_m) * d.tx + (y1 - d.ay_m) * d.ty
    low, high = min(q0, q1), max(q0, q1)
    over = min(high, d.length_m) - max(low, 0.0)
    length = track.s1_m - track.s0_m
    if over < _COVERED_SHARE * max(high - low, 1e-3) or high - low < 0.5 * length - _TOUCH_M:
        return False
    height = min(d.bottom_m, track.bottom_m) - max(d.top_m, track.top_m)
    if height < 0.8 * (track.bottom_m - track.top_m):
        return False
    front = max(rules.gate_min_m, min(_FRONT_M, d.margin_m))
    for end in range(2):
        x = x0 if end == 0 else x1
        y = y0 if end == 0 else y1
        near = (y - d.ay_m) * d.tx - (x - d.ax_m) * d.ty
        if near > front or near < -rules.gate_max_m:
            return False
    return True


@kernel
def find_pairs(detections, tracks, boxes, rules, pairs, scores):
    """Lists the pairs of detections and tracks that belong together -> pairs (P, 3) int32: detection, track, relation;
    scores (P,) float64. boxes: (T, 6) float32 scratch. Returns (number of pairs, number of pairs that did not fit)."""
    reach = rules.gate_max_m + _TOUCH_M
    for j in range(tracks.shape[0]):
        t = tracks[j]
        if t.hits == 0:
            boxes[j, 0], boxes[j, 1] = math.inf, -math.inf
            continue
        x0, y0 = t.x_m + t.s0_m * t.tx, t.y_m + t.s0_m * t.ty
        x1, y1 = t.x_m + t.s1_m * t.tx, t.y_m + t.s1_m * t.ty
        boxes[j, 0], boxes[j, 1] = min(x0, x1) - reach, max(x0, x1) + reach
        boxes[j, 2], boxes[j, 3] = min(y0, y1) - reach, max(y0, y1) + reach
        boxes[j, 4], boxes[j, 5] = t.top_m, t.bottom_m
    count, lost = 0, 0
    for i in range(detections.shape[0]):
        d = detections[i]
        x0, x1 = min(d.ax_m, d.bx_m), max(d.ax_m, d.bx_m)
        y0, y1 = min(d.ay_m, d.by_m), max(d.ay_m, d.by_m)
        for j in range(tracks.shape[0]):
            if boxes[j, 0] > x1 or boxes[j, 1] < x0 or boxes[j, 2] > y1 or boxes[j, 3] < y0:
                continue
            if boxes[j, 4] >= d.bottom_m or boxes[j, 5] <= d.top_m:
                continue
            score = continues(d, tracks[j], rules)
            relation = CONTINUES
            if score <= 0.0:
                relation = COVERS
                score = 1e-3 if covers(d, tracks[j], rules) else 0.0
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
def assign(detections, tracks, pairs, order):
    """Gives each detection at most one track: the best pair first. A detection that continues no track takes a track that
    it covers and that no other detection observed."""
    for relation in (CONTINUES, COVERS):
        for n in order:
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
