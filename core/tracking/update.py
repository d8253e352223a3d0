"""Applies the detections of a frame to their tracks, begins new tracks, and merges tracks of one surface."""

from __future__ import annotations

import math

from ..jit import inner, kernel
from .association import GATE_MAX_M
from .boxes import set_box
from .cover import begin_search, observe_hiding
from .line import along, begin_line, is_thin, offset, point_at, predict_line, seen_at, seen_heights
from .merging import merge_pairs
from .publish import BEHIND_M
from .representation import correct_line, lies_on, represents
from .tables import (
    CELL_M,
    NONE,
    SHRINK_SHARE,
    UNKNOWN_BEHIND,
    clear_cell,
    count_observation,
    free_slot,
    make_room,
    observe_cells,
    remove_detection,
)
from .thin import end_line, is_line, join_lines

_SHORT_M, _TURN_COS = 0.6, 0.9
"""A shorter track takes the direction of a detection that is turned by more."""


@kernel
def begin_frame(table, dt_s):
    """Prepares all tracks for the detections of a frame dt_s after the one before."""
    for j in range(table.tracks.shape[0]):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        predict_line(t, dt_s)
        t.first_detection = NONE
        t.frame_s0_m, t.frame_s1_m = math.inf, -math.inf
        t.frame_top_m, t.frame_bottom_m = math.inf, -math.inf


@kernel
def apply_detections(table, detections, pairs, exposure, next_id):
    """Updates, begins and merges tracks. pairs: of `find_pairs`, the best first. Returns (next id, tracks removed for want of
    slots, detections left out)."""
    removed, left_out = 0, 0
    eye, t_ns = exposure.eye, exposure.t_ns
    for i in range(detections.shape[0]):
        j = detections[i].track
        if j == NONE:
            continue  # it is hidden by several tracks, or gets a track of its own below
        if table.tracks[j].seen_ns == t_ns and not lies_on(table.tracks[j], detections[i], eye):
            continue  # another detection of this frame has moved the line
        observe(table, j, detections[i], exposure)
    merge_pairs(table, detections, pairs, eye)
    for i in range(detections.shape[0]):  # before a new track takes the slot of a merged one
        detections[i].track = present_slot(table.tracks, detections[i].track)
    search = begin_search(table.tracks)
    for i in range(detections.shape[0]):
        j = detections[i].track
        if j != NONE and represents(table.tracks[j], detections[i], eye):
            continue
        if j != NONE:  # it is no part of that track
            table.tracks[j].first_detection = remove_detection(detections, table.tracks[j].first_detection, i)
        if observe_hiding(table, detections[i], GATE_MAX_M, exposure, search):
            continue
        j, evicted = free_slot(table, t_ns)
        removed += 1 if evicted else 0
        if j == NONE:
            left_out += 1
            continue
        detections[i].track, detections[i].next = j, NONE
        begin_track(table, j, detections[i], i, next_id, t_ns)
        next_id += 1
        observe(table, j, detections[i], exposure)
        set_box(search.boxes, j, table.tracks[j])
    if exposure.positioned:
        join_lines(table, detections, exposure)
    for i in range(detections.shape[0]):
        detections[i].track = present_slot(table.tracks, detections[i].track)
    for j in range(table.tracks.shape[0]):
        if table.tracks[j].hits > 0 and table.tracks[j].seen_ns == t_ns:
            end_observation(table.tracks[j], detections, eye)
    return next_id, removed, left_out


@inner
def present_slot(tracks, j):
    """The slot that holds what slot j held before tracks were merged; NONE: none does."""
    for _ in range(tracks.shape[0]):
        if j == NONE or tracks[j].hits > 0:
            break
        j = tracks[j].merged_into
    return j


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
def observe(table, j, d, exposure):
    """One observation of a track: its line, extent, cells and margin. Extents grow at once."""
    t, eye, t_ns = table.tracks[j], exposure.eye, exposure.t_ns
    if t.hits > 0:
        turned = abs(t.tx * d.tx + t.ty * d.ty) < _TURN_COS and max(d.length_m, t.s1_m - t.s0_m) < _SHORT_M
        if turned or not correct_line(t, d, eye):
            replace_line(table, j, d)
    if t.seen_ns != t_ns:
        t.plane_flags = d.plane_flags
    else:
        both, either = t.plane_flags & d.plane_flags, t.plane_flags | d.plane_flags
        t.plane_flags = either & ~UNKNOWN_BEHIND | both & UNKNOWN_BEHIND
    sa, sb = seen_at(t, d.ax_m, d.ay_m, eye), seen_at(t, d.bx_m, d.by_m, eye)
    low, high = min(sa, sb), max(sa, sb)
    t.s0_m, t.s1_m = min(t.s0_m, low), max(t.s1_m, high)
    top, bottom = seen_heights(t, d, eye) if is_thin(t) else (d.top_m, d.bottom_m)
    t.top_m, t.bottom_m = min(t.top_m, top), max(t.bottom_m, bottom)
    t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low), max(t.frame_s1_m, high)
    t.frame_top_m, t.frame_bottom_m = min(t.frame_top_m, top), max(t.frame_bottom_m, bottom)
    make_room(table, j, low, high)
    observe_cells(table, j, low, high, d, d.bottom_m - d.top_m, t_ns)
    if t.seen_ns != t_ns:
        t.excess_m, t.cluster = 0.0, d.cluster  # end_observation completes the first
        if d.margin_m < t.margin_m:
            t.margin_m += SHRINK_SHARE * (d.margin_m - t.margin_m)
    count_observation(t, t_ns)
    t.margin_m = max(t.margin_m, d.margin_m)


@inner
def replace_line(table, j, d):
    """Gives a track the line of a detection that covers most of it. What the detection does not reach of the track stays, with
    the evidence of its cells: this frame has not observed it to be free."""
    t = table.tracks[j]
    hits, seen_ns, against, measured = 0, 0, 0, 0
    for k in range(t.cells):
        c = table.cells[j, k]
        if c.hits > hits:
            against = c.against
        hits, seen_ns = max(hits, c.hits), max(seen_ns, c.seen_ns)
        measured = max(measured, c.measured)
    x0, y0 = point_at(t, t.s0_m)
    x1, y1 = point_at(t, t.s1_m)
    begin_line(t, d)
    t.nearer_m = 0.0
    sa, sb = along(t, x0, y0), along(t, x1, y1)
    t.s0_m, t.s1_m = min(-0.5 * d.length_m, sa, sb), max(0.5 * d.length_m, sa, sb)
    t.top_m, t.bottom_m = min(t.top_m, d.top_m), max(t.bottom_m, d.bottom_m)
    t.cell_m, t.first_cell, t.cells = CELL_M, int(math.floor(t.s0_m / CELL_M)), 1
    clear_cell(table, j, 0)
    make_room(table, j, t.s0_m, t.s1_m)
    for k in range(t.cells):
        c = table.cells[j, k]
        c.hits, c.seen_ns, c.against, c.measured = hits, seen_ns, against, measured


@inner
def most_behind(t, eye):
    """How far a published plane may lie behind the newest observation, m, measured across it. Seen edge-on, a viewing ray
    goes on far between two planes that lie close together; along the ray the distance is at most the margin, which a
    consumer subtracts."""
    ax, ay = t.x_m + t.frame_s0_m * t.tx - eye[0], t.y_m + t.frame_s0_m * t.ty - eye[1]
    bx, by = t.x_m + t.frame_s1_m * t.tx - eye[0], t.y_m + t.frame_s1_m * t.ty - eye[1]
    r = math.sqrt(max(ax * ax + ay * ay, bx * bx + by * by))
    facing = max(0.0, offset(t, eye[0], eye[1])) / max(1e-6, r)
    return min(max(BEHIND_M, 0.25 * t.margin_m), facing * max(BEHIND_M, t.margin_m))


@inner
def reach_detections(t, detections):
    """Lets the margin of a track reach as near as each of its detections of this frame, those of merged tracks too, now that
    its line is final."""
    k = t.first_detection
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        d = detections[k]
        t.excess_m = max(t.excess_m, offset(t, d.ax_m, d.ay_m), offset(t, d.bx_m, d.by_m))
        t.margin_m = max(t.margin_m, d.margin_m)
        k = d.next


@inner
def end_observation(t, detections, eye):
    """Lets the published plane of an observed track return to its line."""
    reach_detections(t, detections)
    if is_line(t, eye):
        end_line(t, detections, eye)
    else:
        t.nearer_m = max((1.0 - SHRINK_SHARE) * t.nearer_m, t.excess_m - most_behind(t, eye))
