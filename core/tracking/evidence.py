"""Removal of tracks, or parts of them: by free space observed through them, and by age.

Each cell of a track that this frame did not observe is compared with the frame's free ranges. It is *clear* where free
space reaches well beyond it, *explained* where another obstacle was observed at about its range, *hidden* where the free
range ends before it, and *out of view* elsewhere. Clear and explained cells collect evidence; hidden ones and those out of view are kept until they are too old.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel
from .snapshot import S_DETECTED, S_HIDDEN, S_MISSED, S_NEW, S_OUT_OF_VIEW
from .tables import NONE, clear_cell, copy_cell, free_slot

OUT_OF_VIEW, HIDDEN, EXPLAINED, CLEAR = 0, 1, 2, 3
NEW_HITS = 3
"""Not tuning: a track observed less often is new."""
MEMORY_HITS = 10
"""Not tuning: observations after which a cell is kept for the whole memory."""
_LEAST_MEMORY_NS = 200_000_000
"""Not tuning: nothing is forgotten sooner."""
_INFERRED, _UNKNOWN_BEHIND = 1, 2
_OBSTACLE = 1
_EXPLAINED_SHARE = 0.15
_CLEAR_SHARE = 0.5
"""Not tuning: shares of a cell's height."""
_RATE_STEP = 0.1
_SPAN_SLACK_RAD, _RANGE_SLACK_M = 1e-6, 1e-3
"""Not tuning: for the rounding of directions and ranges."""
_LEAST_M = 0.02
"""Not tuning: a shorter rest of a track is removed."""


class FreeView(NamedTuple):
    """What one frame observed to be free. x_m, y_m: of the camera; ke_per_m: noise; edges_rad and layers_m: float64, near_m,
    far_m: float32 and end: uint8, of its FreeProfile. ground_z_m: of the ground below the camera, inf: none seen; slope_x,
    slope_y, tolerance_m, noise_per_m: of the Ground."""

    x_m: Any
    y_m: Any
    ke_per_m: Any
    edges_rad: Any
    layers_m: Any
    near_m: Any
    far_m: Any
    end: Any
    ground_z_m: Any
    slope_x: Any
    slope_y: Any
    tolerance_m: Any
    noise_per_m: Any


@inner
def direction_of(edges, azimuth):
    """Index of the direction that holds an azimuth, NONE: outside the view."""
    turn = azimuth - edges[0]
    azimuth = turn - math.floor(turn / math.tau) * math.tau + edges[0]
    low, high = 0, edges.shape[0] - 1
    if azimuth >= edges[high]:
        return NONE
    for _ in range(32):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if edges[middle] <= azimuth:
            low = middle
        else:
            high = middle
    return low


@inner
def lowest_free(x, y, r, view):
    """z down to which a place at (x, y) from the camera can be free: above the ground and its noise."""
    z = view.ground_z_m + view.slope_x * x + view.slope_y * y
    return z - max(view.tolerance_m, view.noise_per_m * r)


@inner
def classify(x, y, top, bottom, slack, rules, view):
    """How a frame observed a place (x, y, in the tracks' frame) with heights top..bottom: CLEAR, EXPLAINED, HIDDEN or
    OUT_OF_VIEW. slack: how far behind the place it must be free, m, without noise."""
    dx, dy = x - view.x_m, y - view.y_m
    r = math.sqrt(dx * dx + dy * dy)
    if r < 1e-3 or view.edges_rad.shape[0] < 2:
        return OUT_OF_VIEW
    d = direction_of(view.edges_rad, math.atan2(dy, dx))
    if d == NONE:
        return OUT_OF_VIEW
    off = slack + rules.free_sigmas * view.ke_per_m * r * r
    lowest = lowest_free(dx, dy, r, view)
    clear, explained, hidden = 0.0, 0.0, 0.0
    for k in range(view.layers_m.shape[0] - 1):
        upper, lower = max(top, view.layers_m[k]), min(bottom, view.layers_m[k + 1])
        if lower <= upper:
            continue
        near, far = view.near_m[d, k], view.far_m[d, k]
        obstacle = view.end[d, k] == _OBSTACLE
        if near <= r - slack and far >= r + off:
            clear += max(0.0, min(lower, lowest) - upper)
        elif obstacle and r - 0.5 * off < far < r + off:
            explained += lower - upper
        elif far < r and (obstacle or far > near):
            hidden += lower - upper
    height = bottom - top
    if explained > _EXPLAINED_SHARE * height:
        return EXPLAINED
    if clear >= _CLEAR_SHARE * height:
        return CLEAR
    return HIDDEN if hidden > 0.0 else OUT_OF_VIEW


@inner
def find_spans(detections, view, spans):
    """Directions that detections cover, and their reach -> spans (3, N) float64: least and greatest direction, rad from the
    middle of the view, and the greatest range with the margin. A detection behind the camera covers all directions."""
    middle = middle_azimuth(view)
    for i in range(detections.shape[0]):
        d = detections[i]
        ax, ay, bx, by = d.ax_m - view.x_m, d.ay_m - view.y_m, d.bx_m - view.x_m, d.by_m - view.y_m
        a, b = turn_between(middle, math.atan2(ay, ax)), turn_between(middle, math.atan2(by, bx))
        if abs(a - b) > math.pi:
            a, b = -math.pi, math.pi
        spans[0, i], spans[1, i] = min(a, b) - _SPAN_SLACK_RAD, max(a, b) + _SPAN_SLACK_RAD
        spans[2, i] = math.sqrt(max(ax * ax + ay * ay, bx * bx + by * by)) + d.margin_m


@inner
def middle_azimuth(view):
    """Middle of the observed directions, 0 where there are none."""
    n = view.edges_rad.shape[0]
    return 0.5 * (view.edges_rad[0] + view.edges_rad[n - 1]) if n > 0 else 0.0


@inner
def turn_between(start, end):
    """The angle from one azimuth to another, -pi to pi."""
    turn = end - start
    return turn - math.tau * math.floor(turn / math.tau + 0.5)


@inner
def find_crossing(azimuth, range_m, spans, crossing):
    """Which detections may cross a direction beyond a range -> crossing (N,) bool. Without branches, so that the compiler
    compares several at once."""
    for i in range(crossing.shape[0]):
        crossing[i] = (spans[0, i] <= azimuth) & (spans[1, i] >= azimuth) & (spans[2, i] >= range_m)


@inner
def is_seen_through(x, y, track, detections, crossing, behind, eye_x, eye_y, eye_z):
    """Whether detections of the frame lie behind a place of a track, as seen from the camera, over most of its height, and
    none lies at it. Gaps that were filled do not count: nothing was measured in them. crossing: (N,) bool of `find_crossing`
    for the direction of the place."""
    dx, dy = x - eye_x, y - eye_y
    r = math.sqrt(dx * dx + dy * dy)
    if r < 1e-3:
        return False
    dx, dy = dx / r, dy / r
    passed, at, height = 0.0, 0.0, track.bottom_m - track.top_m
    for i in range(detections.shape[0]):
        if not crossing[i]:
            continue
        d = detections[i]
        ax, ay, bx, by = d.ax_m - eye_x, d.ay_m - eye_y, d.bx_m - eye_x, d.by_m - eye_y
        side_a, side_b = dx * ay - dy * ax, dx * by - dy * bx
        if side_a * side_b > 0.0 or side_a == side_b:
            continue
        share = side_a / (side_a - side_b)
        far = dx * (ax + share * (bx - ax)) + dy * (ay + share * (by - ay))
        if far <= 0.0:
            continue
        scale = r / far  # heights of the detection as they appear at the range of the place
        over = min(track.bottom_m, eye_z + scale * (d.bottom_m - eye_z)) - max(
            track.top_m, eye_z + scale * (d.top_m - eye_z)
        )
        if over <= 0.0:
            continue
        reach = behind + track.margin_m + d.margin_m
        if far >= r + reach:
            if d.plane_flags & _INFERRED == 0:
                passed = max(passed, over)
        elif far > r - reach:
            at += over
            if at > _EXPLAINED_SHARE * height:
                return False
    return passed >= _CLEAR_SHARE * height


@kernel
def collect_evidence(table, detections, rules, view, eye_z, t_ns, memory_ns):
    """Evidence of one frame on all cells that it did not observe; removes cells that are clear, or older than the memory.
    Sets the state of each track. Returns the number of cells removed.

    eye_z: height of the camera. A cell with fewer than MEMORY_HITS observations has a share of the memory that grows with
    their square: what flickers does not accumulate where it is hidden."""
    removed, middle = 0, middle_azimuth(view)
    spans, crossing = np.empty((3, detections.shape[0])), np.empty(detections.shape[0], np.bool_)
    find_spans(detections, view, spans)
    for j in range(table.tracks.shape[0]):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        best, missed, gap = OUT_OF_VIEW, False, is_gap(t)
        for k in range(t.cells):
            c = table.cells[j, k]
            if c.hits == 0 or c.seen_ns == t_ns:
                continue
            s = cell_middle(t, k)
            x, y = t.x_m + s * t.tx, t.y_m + s * t.ty
            seen = classify(x, y, t.top_m, t.bottom_m, rules.behind_m + t.margin_m, rules, view)
            if seen != CLEAR:
                dx, dy = x - view.x_m, y - view.y_m
                least_m = math.sqrt(dx * dx + dy * dy) - rules.behind_m - t.margin_m - _RANGE_SLACK_M
                find_crossing(turn_between(middle, math.atan2(dy, dx)), least_m, spans, crossing)
                if is_seen_through(x, y, t, detections, crossing, rules.behind_m, view.x_m, view.y_m, eye_z):
                    seen = CLEAR
            if seen >= EXPLAINED:
                c.against += 4 if gap else 2
            missed = missed or seen >= EXPLAINED
            best = max(best, seen)
            share = 0.0 if gap else min(1.0, (c.hits / MEMORY_HITS) ** 2)
            too_old = t_ns - c.seen_ns > max(_LEAST_MEMORY_NS, memory_ns * share)
            if c.against >= 2 * min(rules.free_frames, 1 + c.hits) or too_old:
                c.hits = 0
                removed += 1
        if t.seen_ns != t_ns and missed:
            t.hit_rate -= _RATE_STEP * t.hit_rate
        t.state = state_of(t, best, t_ns)
    return removed


@inner
def is_gap(d):
    """Whether a detection or track is a filled gap that was observed to be open: no obstacle was measured in it. It joins two
    obstacles, and is part of neither."""
    return d.plane_flags & (_INFERRED | _UNKNOWN_BEHIND) == _INFERRED


@inner
def cell_middle(t, k):
    """s of the middle of cell k of a track, within its extent."""
    low = (t.first_cell + k) * t.cell_m
    return 0.5 * (max(low, t.s0_m) + min(low + t.cell_m, t.s1_m))


@inner
def state_of(t, best, t_ns):
    """The state of a track. best: the most that this frame observed of its cells."""
    if t.seen_ns == t_ns:
        return S_NEW if t.hits < NEW_HITS else S_DETECTED
    if best >= EXPLAINED:
        return S_MISSED
    return S_HIDDEN if best == HIDDEN else S_OUT_OF_VIEW


@kernel
def split_tracks(table, next_id, t_ns):
    """Shortens tracks whose ends have been removed, and splits those with a gap; the part observed most often keeps the id.

    Returns (next id, tracks ended, tracks removed for want of slots)."""
    ended, evicted = 0, 0
    for j in range(table.tracks.shape[0]):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        best0, best1 = most_observed_run(table, j)
        if best0 == NONE:
            t.hits = 0
            ended += 1
            continue
        begin = NONE
        for k in range(t.cells + 1):
            alive = k < t.cells and table.cells[j, k].hits > 0
            if alive and begin == NONE:
                begin = k
            if alive or begin == NONE:
                continue
            if begin != best0:
                other, gone = free_slot(table, t_ns)
                evicted += 1 if gone else 0
                if other != NONE and other != j:
                    copy_part(table, j, other, begin, k, next_id)
                    next_id += 1
            begin = NONE
        keep_part(table, j, best0, best1)
        if t.s1_m - t.s0_m < _LEAST_M and t.seen_ns != t_ns:
            t.s0_m -= 0.5 * _LEAST_M
            t.s1_m += 0.5 * _LEAST_M
    return next_id, ended, evicted


@inner
def most_observed_run(table, j):
    """(first cell, end) of the run of cells with the most observations; NONE: there is no cell."""
    t = table.tracks[j]
    best0, best1, best = NONE, NONE, 0
    begin, total = NONE, 0
    for k in range(t.cells + 1):
        hits = table.cells[j, k].hits if k < t.cells else 0
        if hits > 0:
            begin = k if begin == NONE else begin
            total += hits
        elif begin != NONE:
            if total > best:
                best0, best1, best = begin, k, total
            begin, total = NONE, 0
    return best0, best1


@inner
def keep_part(table, j, begin, end):
    """Limits slot j to its cells begin..end - 1."""
    t = table.tracks[j]
    low, high = (t.first_cell + begin) * t.cell_m, (t.first_cell + end) * t.cell_m
    t.s0_m, t.s1_m = max(t.s0_m, low), min(t.s1_m, high)
    if begin > 0:
        for k in range(begin, end):
            copy_cell(table, j, k, k - begin)
    for k in range(end - begin, t.cells):
        clear_cell(table, j, k)
    t.first_cell += begin
    t.cells = end - begin
    if t.s1_m < t.s0_m:
        middle = 0.5 * (t.s0_m + t.s1_m)
        t.s0_m, t.s1_m = middle - 0.5 * _LEAST_M, middle + 0.5 * _LEAST_M


@inner
def copy_part(table, j, other, begin, end, track_id):
    """Gives the cells begin..end - 1 of slot j to the empty slot `other`, as a track of its own."""
    t, o = table.tracks[j], table.tracks[other]
    o.id, o.object_id, o.first_ns, o.seen_ns = track_id, t.object_id, t.first_ns, t.seen_ns
    o.x_m, o.y_m, o.tx, o.ty = t.x_m, t.y_m, t.tx, t.ty
    o.s0_m, o.s1_m, o.top_m, o.bottom_m = t.s0_m, t.s1_m, t.top_m, t.bottom_m
    o.p00, o.p01, o.p11 = t.p00, t.p01, t.p11
    o.margin_m, o.excess_m, o.nearer_m, o.hit_rate = t.margin_m, t.excess_m, t.nearer_m, t.hit_rate
    o.cell_m, o.first_cell, o.cells = t.cell_m, t.first_cell, t.cells
    o.plane_flags, o.cluster, o.state, o.first_detection = t.plane_flags, t.cluster, t.state, t.first_detection
    o.frame_s0_m, o.frame_s1_m = t.frame_s0_m, t.frame_s1_m
    o.frame_top_m, o.frame_bottom_m = t.frame_top_m, t.frame_bottom_m
    o.merged_into = NONE
    most, newest = 0, 0
    for k in range(t.cells):
        table.cells[other, k].seen_ns = table.cells[j, k].seen_ns
        table.cells[other, k].against = table.cells[j, k].against
        table.cells[other, k].hits = table.cells[j, k].hits
        if begin <= k < end:
            most = max(most, table.cells[j, k].hits)
            newest = max(newest, table.cells[j, k].seen_ns)
    o.hits, o.seen_ns = max(1, most), newest
    keep_part(table, other, begin, end)
