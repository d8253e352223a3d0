"""Thin obstacles: fragments of one line become one track.

The noise of a stereo camera breaks a wire into fragments, whose ends lie on the right viewing rays at wrong ranges. Two thin
tracks that touch in the image, and whose lines agree within their covariance, are joined: the line of one is corrected by
that of the other, and its extent grows along the viewing rays. The plane is moved towards the camera so far that it lies behind
no detection of this frame by more than the margin of that detection. Where this is more than the margin again, the two stay
apart: a nearer obstacle is not hidden. They stay apart where there is a gap between them, too: no opening is closed.
Fragments of one frame are not joined with each other: only what another frame has confirmed is a line. Without a position
nothing is joined: the fragments of several frames would lie apart by the error of the estimated motion, and the line would be
moved far towards the camera.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel
from .association import GATE_MIN_M
from .line import (
    EDGE_ON,
    ahead,
    along,
    correct_by_ends,
    facing,
    is_thin,
    middle_share,
    offset,
    point_at,
    seen_at,
    seen_height,
    seen_heights,
    variance_at,
)
from .merging import absorb
from .publish import BEHIND_M, WIDE_M
from .tables import (
    NONE,
    SHRINK_SHARE,
    THIN_M,
    append_detections,
    count_observation,
    make_room,
    observe_cells,
)

_TOUCH_M = 0.1
"""Fragments this close touch."""
_SIGMAS = 5.0
"""Largest distance of the end of a fragment from the line. Few pixels measure the ends: their standard deviation
is 1.7 times that of wide planes, on which sigma_m of a detection is based."""
_SAME_ROWS = 0.3
"""Share of the lower height that both have, as seen from the camera."""


@kernel
def join_lines(table, detections, exposure):
    """Joins the thin tracks of one line, those observed most often first, where this frame observed one of them."""
    eye, t_ns = exposure.eye, exposure.t_ns
    thin = thin_tracks(table.tracks, eye)
    for a in range(thin.shape[0]):
        for b in range(a + 1, thin.shape[0]):
            t, o = table.tracks[thin[a]], table.tracks[thin[b]]
            if t.hits == 0:
                break
            if o.hits == 0 or max(t.seen_ns, o.seen_ns) < t_ns or min(t.first_ns, o.first_ns) == t_ns:
                continue
            if is_one_line(t, o, eye):
                join(table, detections, thin[a], thin[b], exposure)


@kernel
def thin_tracks(tracks, eye):
    """Slots (N,) int64 of the thin tracks that face the camera, those observed most often first."""
    thin, hits, count = np.empty(tracks.shape[0], np.int64), np.empty(tracks.shape[0], np.int64), 0
    for j in range(tracks.shape[0]):
        if tracks[j].hits > 0 and is_thin(tracks[j]) and offset(tracks[j], eye[0], eye[1]) > 0.0:
            thin[count], hits[count] = j, -tracks[j].hits
            count += 1
    return thin[:count][np.argsort(hits[:count], kind="mergesort")]


@inner
def is_one_line(t, o, eye):
    """Whether a thin track lies on the line of another one within the covariance of both, and touches it in the image."""
    if t.object_id != o.object_id:
        return False
    low, high = math.inf, -math.inf
    for end in range(2):
        s = o.s0_m if end == 0 else o.s1_m
        x, y = point_at(o, s)
        if facing(t, x, y, eye) < EDGE_ON:
            return False
        variance = max(0.0, variance_at(t, along(t, x, y))) + max(0.0, variance_at(o, s))
        if abs(offset(t, x, y)) > max(GATE_MIN_M, o.margin_m, _SIGMAS * math.sqrt(variance)):
            return False
        at = seen_at(t, x, y, eye)
        low, high = min(low, at), max(high, at)
    if min(high, t.s1_m) - max(low, t.s0_m) < -_TOUCH_M or max(high, t.s1_m) - min(low, t.s0_m) < WIDE_M:
        return False
    share = middle_share(t, o, eye)
    top, bottom = seen_height(o.top_m, share, eye), seen_height(o.bottom_m, share, eye)
    if max(bottom, t.bottom_m) - min(top, t.top_m) > THIN_M:
        return False
    over = min(bottom, t.bottom_m) - max(top, t.top_m)
    return over >= _SAME_ROWS * min(bottom - top, t.bottom_m - t.top_m)


@inner
def join(table, detections, j, other, exposure):
    """Joins the slot `other` to the line of slot j, unless the line would then lie behind either of them, or a detection of
    either, by more than its margin."""
    t, o, eye = table.tracks[j], table.tracks[other], exposure.eye
    before = t.x_m, t.y_m, t.tx, t.ty, t.p00, t.p01, t.p11
    ax, ay = point_at(t, t.s0_m)
    bx, by = point_at(t, t.s1_m)
    x0, y0 = point_at(o, o.s0_m)
    x1, y1 = point_at(o, o.s1_m)
    correct_by_ends(t, x0, y0, max(0.0, variance_at(o, o.s0_m)), x1, y1, max(0.0, variance_at(o, o.s1_m)))
    behind_t = max(ahead(t, ax, ay, eye), ahead(t, bx, by, eye))
    behind_o = max(ahead(t, x0, y0, eye), ahead(t, x1, y1, eye))
    need_t, fits_t = needed_move(t, detections, t.first_detection, eye)
    need_o, fits_o = needed_move(t, detections, o.first_detection, eye)
    need = max(need_t, need_o, behind_t - max(BEHIND_M, t.margin_m), behind_o - max(BEHIND_M, o.margin_m))
    fits = fits_t and fits_o and is_within(behind_t, t.margin_m) and is_within(behind_o, o.margin_m)
    fits = fits and faces(t, ax, ay, bx, by, eye) and faces(t, x0, y0, x1, y1, eye)
    if not fits:
        t.x_m, t.y_m, t.tx, t.ty, t.p00, t.p01, t.p11 = before
        return
    t.nearer_m = max(t.nearer_m, o.nearer_m, need)
    widen(table, j, seen_at(t, ax, ay, eye), seen_at(t, bx, by, eye))
    t.margin_m = max(t.margin_m, o.margin_m + behind_o)
    t.first_detection = append_detections(detections, t.first_detection, o.first_detection)
    o.first_detection = NONE
    observe_again(table, detections, j, exposure)
    absorb(table, detections, j, other, eye)


@inner
def faces(t, ax, ay, bx, by, eye):
    """Whether the viewing rays of two points do not meet the line of a track edge-on."""
    return min(facing(t, ax, ay, eye), facing(t, bx, by, eye)) >= EDGE_ON


@inner
def is_within(behind_m, margin_m):
    """Whether a line that lies so far behind a thin plane may be moved towards the camera to be joined with it: by the margin
    of that plane at most."""
    return behind_m <= 2.0 * max(BEHIND_M, margin_m)


@inner
def needed_move(t, detections, first, eye):
    """(How far a track must be moved towards the camera so that its line lies behind none of these detections by more than its
    margin, m; whether it may be moved so far for each of them)."""
    need, fits, k = 0.0, True, first
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        d = detections[k]
        behind = max(ahead(t, d.ax_m, d.ay_m, eye), ahead(t, d.bx_m, d.by_m, eye))
        need = max(need, behind - max(BEHIND_M, d.margin_m))
        fits = fits and is_within(behind, d.margin_m)
        k = d.next
    return need, fits


@inner
def widen(table, j, sa, sb):
    """Extends a track to sa and sb (m), with the evidence of its first and last cell."""
    t = table.tracks[j]
    t.s0_m, t.s1_m = min(sa, sb, t.s0_m), max(sa, sb, t.s1_m)
    make_room(table, j, t.s0_m, t.s1_m)
    first, last = t.cells, -1
    for k in range(t.cells):
        if table.cells[j, k].hits > 0:
            first, last = min(first, k), k
    for k in range(t.cells):
        if k < first < t.cells:
            table.cells[j, k] = table.cells[j, first]
        elif k > last >= 0:
            table.cells[j, k] = table.cells[j, last]


@inner
def observe_again(table, detections, j, exposure):
    """Extents and cells of a track from this frame's detections, after its line has moved."""
    t, eye, t_ns = table.tracks[j], exposure.eye, exposure.t_ns
    if t.first_detection == NONE:
        return
    t.frame_s0_m, t.frame_s1_m = math.inf, -math.inf
    t.frame_top_m, t.frame_bottom_m = math.inf, -math.inf
    k = t.first_detection
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        d = detections[k]
        sa = seen_at(t, d.ax_m, d.ay_m, eye)
        sb = seen_at(t, d.bx_m, d.by_m, eye)
        low, high = min(sa, sb), max(sa, sb)
        t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low), max(t.frame_s1_m, high)
        top, bottom = seen_heights(t, d, eye)
        t.frame_top_m, t.frame_bottom_m = min(t.frame_top_m, top), max(t.frame_bottom_m, bottom)
        make_room(table, j, low, high)
        observe_cells(table, j, low, high, d, d.bottom_m - d.top_m, t_ns)
        count_observation(t, t_ns)
        k = d.next
    t.s0_m, t.s1_m = min(t.s0_m, t.frame_s0_m), max(t.s1_m, t.frame_s1_m)
    t.top_m, t.bottom_m = min(t.top_m, t.frame_top_m), max(t.bottom_m, t.frame_bottom_m)


@inner
def is_line(t, eye):
    """Whether a track is thin and not seen edge-on."""
    ax, ay = point_at(t, t.s0_m)
    bx, by = point_at(t, t.s1_m)
    return is_thin(t) and faces(t, ax, ay, bx, by, eye)


@inner
def end_line(t, detections, eye):
    """How much nearer than its line the plane of a thin track is published, and its margin: it lies behind no detection of
    this frame by more than the margin of that, and with its own margin reaches as far as each of them with theirs."""
    reach, k = t.margin_m, t.first_detection
    for _ in range(detections.shape[0]):
        if k == NONE:
            break
        d = detections[k]
        behind = max(ahead(t, d.ax_m, d.ay_m, eye), ahead(t, d.bx_m, d.by_m, eye))
        reach = max(reach, behind + d.margin_m)
        k = d.next
    t.nearer_m = max((1.0 - SHRINK_SHARE) * t.nearer_m, needed_move(t, detections, t.first_detection, eye)[0])
    t.excess_m = max(t.excess_m, reach - t.margin_m)
