"""Applies the detections of a frame to their tracks, begins new tracks, and merges tracks of one surface."""

from __future__ import annotations

import math

from ..jit import inner, kernel
from .association import (
    CONTINUES,
    COVERS,
    SIDEWAYS_M,
    STEADY_HITS,
    fits_one_rectangle,
    heights_overlap,
    is_much_taller,
)
from .cover import is_hidden, new_parts, support
from .line import along, begin_line, offset, predict_line, seen_at, sideways
from .publish import BEHIND_M
from .representation import correct_line, lies_on, represents
from .tables import CELL_M, NONE, clear_cell, count_observation, free_slot, make_room, observe_cells

_CUT_LEFT, _CUT_RIGHT, _CUT_TOP, _CUT_BOTTOM = 4, 8, 16, 32
_SHRINK_REACH_M = 0.75
"""Not tuning: an end that is observed farther inside belongs to a part of the surface."""
_MERGE_M = 0.2
"""Not tuning: tracks farther apart are not merged."""
_SHORT_M, _TURN_COS = 0.6, 0.9
"""Not tuning: a shorter track takes the direction of a detection that is turned by more."""


@kernel
def begin_frame(table, dt_s, rules):
    """Prepares all tracks for the detections of a frame dt_s after the one before."""
    for j in range(table.tracks.shape[0]):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        predict_line(t, dt_s, rules)
        t.first_detection = NONE
        t.excess_m = 0.0
        t.frame_s0_m, t.frame_s1_m = math.inf, -math.inf
        t.frame_top_m, t.frame_bottom_m = math.inf, -math.inf


@kernel
def apply_detections(table, detections, pairs, order, rules, eye, next_id, t_ns):
    """Updates, begins and merges tracks. eye: x, y, z of the camera. Returns (next id, tracks removed for want of slots,
    detections left out)."""
    removed, left_out = 0, 0
    eye_x, eye_y = eye[0], eye[1]
    for i in range(detections.shape[0]):
        j = detections[i].track
        if j == NONE:
            continue  # it is hidden by several tracks, or gets a track of its own below
        if table.tracks[j].seen_ns == t_ns and not lies_on(table.tracks[j], detections[i], rules, eye_x, eye_y):
            continue  # another detection of this frame has moved the line
        observe(table, j, detections[i], rules, eye_x, eye_y, t_ns)
    merge_pairs(table, detections, pairs, order, rules, eye_x, eye_y)
    parts, borders = new_parts()
    for i in range(detections.shape[0]):
        j = detections[i].track
        for _ in range(table.tracks.shape[0]):
            if j == NONE or table.tracks[j].hits > 0:
                break
            j = table.tracks[j].merged_into
        detections[i].track = j
        if j != NONE and represents(table.tracks[j], detections[i], rules, eye_x, eye_y):
            continue
        count = is_hidden(table.tracks, detections[i], rules.gate_max_m, eye, parts, borders)
        if count > 0:
            support(table, detections[i], parts, count, borders, eye, t_ns)
            continue
        j, evicted = free_slot(table, t_ns)
        removed += 1 if evicted else 0
        if j == NONE:
            left_out += 1
            continue
        detections[i].track, detections[i].next = j, NONE
        begin_track(table, j, detections[i], i, next_id, t_ns)
        next_id += 1
        observe(table, j, detections[i], rules, eye_x, eye_y, t_ns)
    for j in range(table.tracks.shape[0]):
        if table.tracks[j].hits > 0 and table.tracks[j].seen_ns == t_ns:
            end_observation(table.tracks[j], detections, rules, eye_x, eye_y)
    return next_id, removed, left_out


@inner
def begin_track(table, j, d, i, track_id, t_ns):
    """A new track of one detection."""
    t = table.tracks[j]
    t.id, t.object_id, t.first_ns, t.seen_ns = track_id, 0, t_ns, t_ns - 1
    begin_line(t, d)
    t.s0_m, t.s1_m = -0.5 * d.length_m, 0.5 * d.length_m
    t.top_m, t.bottom_m = d.top_m, d.bottom_m
    t.margin_m, t.excess_m, t.nearer_m, t.hit_rate = d.margin_m, 0.0, 0.0, 1.0
    t.frame_s0_m, t.frame_s1_m = math.inf, -math.inf
    t.frame_top_m, t.frame_bottom_m = math.inf, -math.inf
    t.cell_m, t.first_cell, t.cells = CELL_M, int(math.floor(t.s0_m / CELL_M)), 1
    clear_cell(table, j, 0)
    t.hits, t.plane_flags, t.cluster, t.state, t.first_detection = 0, d.plane_flags, d.cluster, 0, i
    t.merged_into = NONE


@inner
def observe(table, j, d, rules, eye_x, eye_y, t_ns):
    """One observation of a track: its line, extent, cells and margin. Extents grow at once."""
    t = table.tracks[j]
    if t.hits > 0:
        turned = abs(t.tx * d.tx + t.ty * d.ty) < _TURN_COS and max(d.length_m, t.s1_m - t.s0_m) < _SHORT_M
        if turned or not correct_line(t, d, rules, eye_x, eye_y):
            replace_line(table, j, d)
    if t.seen_ns != t_ns:
        t.plane_flags = d.plane_flags
    else:
        t.plane_flags = (t.plane_flags | d.plane_flags) & ~2 | (t.plane_flags & d.plane_flags & 2)
    sa, sb = seen_at(t, d.ax_m, d.ay_m, eye_x, eye_y), seen_at(t, d.bx_m, d.by_m, eye_x, eye_y)
    low, high = min(sa, sb), max(sa, sb)
    t.s0_m, t.s1_m = min(t.s0_m, low), max(t.s1_m, high)
    t.top_m, t.bottom_m = min(t.top_m, d.top_m), max(t.bottom_m, d.bottom_m)
    t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low), max(t.frame_s1_m, high)
    t.frame_top_m, t.frame_bottom_m = min(t.frame_top_m, d.top_m), max(t.frame_bottom_m, d.bottom_m)
    make_room(table, j, low, high)
    observe_cells(table, j, low, high, d.bottom_m - d.top_m, t_ns)
    near = max(offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m))
    t.excess_m = max(t.excess_m, near)
    if t.seen_ns != t_ns:
        t.cluster = d.cluster
        if d.margin_m < t.margin_m:
            t.margin_m += rules.shrink_share * (d.margin_m - t.margin_m)
    count_observation(t, t_ns)
    t.margin_m = max(t.margin_m, d.margin_m)


@inner
def replace_line(table, j, d):
    """Gives a track the line and extent of a detection that covers it."""
    t = table.tracks[j]
    hits = 0
    for k in range(t.cells):
        hits = max(hits, table.cells[j, k].hits)
    begin_line(t, d)
    t.nearer_m = 0.0
    t.s0_m, t.s1_m = -0.5 * d.length_m, 0.5 * d.length_m
    t.top_m, t.bottom_m = d.top_m, d.bottom_m
    t.cell_m, t.first_cell, t.cells = CELL_M, int(math.floor(t.s0_m / CELL_M)), 1
    clear_cell(table, j, 0)
    make_room(table, j, t.s0_m, t.s1_m)
    for k in range(t.cells):
        clear_cell(table, j, k)
        table.cells[j, k].hits = hits


@inner
def most_behind(t, eye_x, eye_y):
    """How far a published plane may lie behind the newest observation, m, measured across it. Seen edge-on, a viewing ray
    goes on far between two planes that lie close together; along the ray the distance is at most the margin, which a
    consumer subtracts."""
    ax, ay = t.x_m + t.frame_s0_m * t.tx - eye_x, t.y_m + t.frame_s0_m * t.ty - eye_y
    bx, by = t.x_m + t.frame_s1_m * t.tx - eye_x, t.y_m + t.frame_s1_m * t.ty - eye_y
    r = math.sqrt(max(ax * ax + ay * ay, bx * bx + by * by))
    facing = max(0.0, offset(t, eye_x, eye_y)) / max(1e-6, r)
    return min(max(BEHIND_M, 0.25 * t.margin_m), facing * max(BEHIND_M, t.margin_m))


@inner
def end_observation(t, detections, rules, eye_x, eye_y):
    """Lets the extent of an observed track shrink towards this frame's observations, where no border of the image cut
    them, and its published plane return to the line."""
    behind_m = most_behind(t, eye_x, eye_y)
    t.nearer_m = max((1.0 - rules.shrink_share) * t.nearer_m, t.excess_m - behind_m)
    cut = 0
    k = t.first_detection
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        cut |= detections[k].plane_flags
        k = detections[k].next
    share = rules.shrink_share
    if cut & (_CUT_LEFT | _CUT_RIGHT) == 0:
        if t.frame_s0_m - t.s0_m < _SHRINK_REACH_M:
            t.s0_m += share * (t.frame_s0_m - t.s0_m)
        if t.s1_m - t.frame_s1_m < _SHRINK_REACH_M:
            t.s1_m += share * (t.frame_s1_m - t.s1_m)
    whole = t.frame_bottom_m - t.frame_top_m >= 0.6 * (t.bottom_m - t.top_m)
    share = share if whole else 0.3 * share
    if cut & _CUT_TOP == 0:
        t.top_m += share * (t.frame_top_m - t.top_m)
    if cut & _CUT_BOTTOM == 0:
        t.bottom_m += share * (t.frame_bottom_m - t.bottom_m)


@inner
def merge_pairs(table, detections, pairs, order, rules, eye_x, eye_y):
    """Merges a track into that of a detection which covers it, or which continues both."""
    tracks = table.tracks
    for n in order:
        i, j = pairs[n, 0], pairs[n, 1]
        k = detections[i].track
        if k == NONE or tracks[k].hits == 0:
            continue
        if k == j or tracks[j].hits == 0:
            continue
        if pairs[n, 2] == COVERS:
            if tracks[j].first_detection == NONE:
                absorb(table, k, j)
        elif pairs[n, 2] == CONTINUES and same_surface(tracks[k], tracks[j], rules, eye_x, eye_y):
            absorb(table, k, j)


@inner
def same_surface(t, other, rules, eye_x, eye_y):
    """Whether another track lies on this one's line, overlaps it, and is not observed beside it in this frame."""
    if t.tx * other.tx + t.ty * other.ty < 0.0:
        return False
    low, high, far = math.inf, -math.inf, 0.0
    for end in range(2):
        s = other.s0_m if end == 0 else other.s1_m
        x, y = other.x_m + s * other.tx, other.y_m + s * other.ty
        at = along(t, x, y)
        low, high = min(low, at), max(high, at)
        off = offset(t, x, y)
        far = max(far, abs(off))
        if sideways(t, x, y, off, eye_x, eye_y) > SIDEWAYS_M:
            return False
    if far > min(_MERGE_M, rules.gate_max_m):
        return False
    if other.hits < STEADY_HITS and is_much_taller(other, other.plane_flags, t):
        return False
    if t.hits < STEADY_HITS and is_much_taller(t, t.plane_flags, other):
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
def absorb(table, j, other):
    """Merges the slot `other` into slot j. The id and age of the track observed more often remain."""
    t, o = table.tracks[j], table.tracks[other]
    low = along(t, o.x_m + o.s0_m * o.tx, o.y_m + o.s0_m * o.ty)
    high = along(t, o.x_m + o.s1_m * o.tx, o.y_m + o.s1_m * o.ty)
    low, high = min(low, high), max(low, high)
    if o.hits > t.hits:
        t.id, t.hits, t.hit_rate = o.id, o.hits, o.hit_rate
        t.object_id = o.object_id
    t.first_ns = min(t.first_ns, o.first_ns)
    t.top_m, t.bottom_m = min(t.top_m, o.top_m), max(t.bottom_m, o.bottom_m)
    make_room(table, j, low, high)
    for k in range(o.cells):
        c = table.cells[other, k]
        if c.hits == 0:
            continue
        s = (o.first_cell + k + 0.5) * o.cell_m
        s = min(max(s, o.s0_m), o.s1_m)
        at = along(t, o.x_m + s * o.tx, o.y_m + s * o.ty)
        half = 0.499 * min(o.cell_m, o.s1_m - o.s0_m)
        first = int(math.floor((at - half) / t.cell_m)) - t.first_cell
        last = int(math.floor((at + half) / t.cell_m)) - t.first_cell
        for m in range(max(0, first), min(t.cells - 1, last) + 1):
            own = table.cells[j, m]
            if own.hits == 0:
                own.seen_ns, own.against, own.hits = c.seen_ns, c.against, c.hits
            else:
                own.against = min(own.against, c.against)
                own.hits = max(own.hits, c.hits)
                own.seen_ns = max(own.seen_ns, c.seen_ns)
    t.s0_m, t.s1_m = min(t.s0_m, low), max(t.s1_m, high)
    if o.first_detection != NONE:
        low = along(t, o.x_m + o.frame_s0_m * o.tx, o.y_m + o.frame_s0_m * o.ty)
        high = along(t, o.x_m + o.frame_s1_m * o.tx, o.y_m + o.frame_s1_m * o.ty)
        t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low, high), max(t.frame_s1_m, low, high)
        t.frame_top_m = min(t.frame_top_m, o.frame_top_m)
        t.frame_bottom_m = max(t.frame_bottom_m, o.frame_bottom_m)
    o.hits, o.merged_into = 0, j
