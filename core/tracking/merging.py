"""Merging of tracks that are one surface."""

from __future__ import annotations

import math

from ..jit import inner
from .association import CONTINUES, COVERS, SIDEWAYS_M, fits_one_rectangle, has_empty_corner, heights_overlap
from .line import along, is_thin, middle_share, offset, point_at, seen_at, seen_height, sideways
from .tables import NONE, append_detections, make_room

_MERGE_M = 0.2
"""Tracks farther apart are not merged."""


@inner
def merge_pairs(table, detections, pairs, eye):
    """Merges a track into that of a detection which covers it, or which continues both. pairs: the best first."""
    tracks = table.tracks
    for n in range(pairs.shape[0]):
        i, j = pairs[n, 0], pairs[n, 1]
        k = detections[i].track
        if k == NONE or tracks[k].hits == 0:
            continue
        if k == j or tracks[j].hits == 0:
            continue
        if pairs[n, 2] == COVERS:
            if tracks[j].first_detection == NONE and not leaves_corner(tracks[k], tracks[j]):
                absorb(table, detections, k, j, eye)
        elif pairs[n, 2] == CONTINUES and same_surface(tracks[k], tracks[j], eye):
            absorb(table, detections, k, j, eye)


@inner
def leaves_corner(t, other):
    """Whether one rectangle for both tracks, on the line of t, has an empty corner."""
    x0, y0 = point_at(other, other.s0_m)
    x1, y1 = point_at(other, other.s1_m)
    sa, sb = along(t, x0, y0), along(t, x1, y1)
    return has_empty_corner(min(sa, sb), max(sa, sb), other.top_m, other.bottom_m, t)


@inner
def same_surface(t, other, eye):
    """Whether another track lies on this one's line, overlaps it, and is not observed beside it in this frame."""
    if t.tx * other.tx + t.ty * other.ty < 0.0:
        return False
    low, high, far = math.inf, -math.inf, 0.0
    for end in range(2):
        s = other.s0_m if end == 0 else other.s1_m
        x, y = point_at(other, s)
        at = along(t, x, y)
        low, high = min(low, at), max(high, at)
        off = offset(t, x, y)
        far = max(far, abs(off))
        if sideways(t, x, y, off, eye) > SIDEWAYS_M:
            return False
    if far > _MERGE_M:
        return False
    if min(high, t.s1_m) - max(low, t.s0_m) <= 0.0 or heights_overlap(other, t) < 0.5:
        return False
    if not fits_one_rectangle(low, high, other.top_m, other.bottom_m, t):
        return False
    if other.first_detection == NONE:
        return True
    begin, end_s = math.inf, -math.inf
    for end in range(2):
        s = other.frame_s0_m if end == 0 else other.frame_s1_m
        at = along(t, other.x_m + s * other.tx, other.y_m + s * other.ty)
        begin, end_s = min(begin, at), max(end_s, at)
    apart = min(end_s, t.frame_s1_m) - max(begin, t.frame_s0_m) <= _MERGE_M
    return apart or min(other.frame_bottom_m, t.frame_bottom_m) <= max(other.frame_top_m, t.frame_top_m)


@inner
def absorb(table, detections, j, other, eye):
    """Merges the slot `other` into slot j. The id and age of the track observed more often remain. Of two thin tracks, whose
    lines may be far apart, slot j hides the same directions then."""
    t, o = table.tracks[j], table.tracks[other]
    thin = is_thin(t) and is_thin(o)
    low = place_on(t, o.x_m + o.s0_m * o.tx, o.y_m + o.s0_m * o.ty, eye, thin)
    high = place_on(t, o.x_m + o.s1_m * o.tx, o.y_m + o.s1_m * o.ty, eye, thin)
    low, high = min(low, high), max(low, high)
    if o.hits > t.hits:
        t.id, t.hits, t.hit_rate = o.id, o.hits, o.hit_rate
        t.object_id = o.object_id
    t.first_ns = min(t.first_ns, o.first_ns)
    share = middle_share(t, o, eye) if thin else 1.0
    t.top_m = min(t.top_m, seen_height(o.top_m, share, eye))
    t.bottom_m = max(t.bottom_m, seen_height(o.bottom_m, share, eye))
    make_room(table, j, low, high)
    for k in range(o.cells):
        c = table.cells[other, k]
        if c.hits == 0:
            continue
        s = (o.first_cell + k + 0.5) * o.cell_m
        s = min(max(s, o.s0_m), o.s1_m)
        at = place_on(t, o.x_m + s * o.tx, o.y_m + s * o.ty, eye, thin)
        half = 0.499 * min(o.cell_m, o.s1_m - o.s0_m)
        first = int(math.floor((at - half) / t.cell_m)) - t.first_cell
        last = int(math.floor((at + half) / t.cell_m)) - t.first_cell
        for m in range(max(0, first), min(t.cells - 1, last) + 1):
            own = table.cells[j, m]
            if own.hits == 0:
                own.seen_ns, own.against, own.hits, own.measured = c.seen_ns, c.against, c.hits, c.measured
            else:
                own.measured = max(own.measured, c.measured)
                own.against = min(own.against, c.against)
                own.hits = max(own.hits, c.hits)
                own.seen_ns = max(own.seen_ns, c.seen_ns)
    t.s0_m, t.s1_m = min(t.s0_m, low), max(t.s1_m, high)
    if o.first_detection != NONE:
        low = place_on(t, o.x_m + o.frame_s0_m * o.tx, o.y_m + o.frame_s0_m * o.ty, eye, thin)
        high = place_on(t, o.x_m + o.frame_s1_m * o.tx, o.y_m + o.frame_s1_m * o.ty, eye, thin)
        t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low, high), max(t.frame_s1_m, low, high)
        t.frame_top_m = min(t.frame_top_m, seen_height(o.frame_top_m, share, eye))
        t.frame_bottom_m = max(t.frame_bottom_m, seen_height(o.frame_bottom_m, share, eye))
    t.first_detection = append_detections(detections, t.first_detection, o.first_detection)
    o.hits, o.merged_into = 0, j


@inner
def place_on(t, x, y, eye, by_ray):
    """s of a point on the line of a track, m: where its viewing ray meets the line, or its foot."""
    return seen_at(t, x, y, eye) if by_ray else along(t, x, y)
