"""Whether several tracks together hide from the camera what one detection hides.

In foliage and along cluttered surfaces the planes of one surface change from frame to frame: a detection continues no
track, although all of it stands where tracks stand already. Then the tracks that hide it are observed, and no track is
added beside them.

A track can hide the part of a detection over which it is seen, a short distance behind it or at most the gate in front of
it. The detection is divided along its length where such a part begins or ends, and each of these pieces must be hidden over
its whole height. No track is extended: what they leave uncovered makes the detection a track of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel, of_type, record
from .boxes import find_near, track_boxes
from .line import EDGE_ON, facing, met_at, offset, point_at, seen_at, sideways
from .publish import BEHIND_M
from .representation import LOST_M
from .tables import CUT_BOTTOM, CUT_LEFT, CUT_RIGHT, CUT_TOP, NONE, count_observation, observe_cells

BEHIND_MAX_M, BEHIND_SHARE = 0.2, 0.5
"""A track may lie behind a detection by this share of the detection's margin, between BEHIND_M and this."""
MOST_PARTS = 32
"""Tracks that are considered for one detection."""
_EXACT_M = 1e-3
"""Narrower pieces are not looked at."""

PART = record(
    *of_type(np.float64, "s0_m s1_m"),
    *of_type(np.int32, "slot hits"),
)
"""A part of a detection that a track can hide. s0_m, s1_m: along the detection from its first end; slot: of the track;
hits: its observations."""


class Piece(NamedTuple):
    """A piece of a detection that one track hides: s0_m..s1_m along it from its first end, at heights top_m..bottom_m."""

    s0_m: Any
    s1_m: Any
    top_m: Any
    bottom_m: Any


class Search(NamedTuple):
    """What `observe_hiding` searches, and its scratch. boxes: of `track_boxes`; found: of `find_near`; parts: (MOST_PARTS,) PART;
    borders: (2 * MOST_PARTS + 2,) float64, ends of the pieces along a detection, m."""

    boxes: Any
    found: Any
    parts: Any
    borders: Any


@kernel
def begin_search(tracks):
    """The search among tracks (T,) TRACK."""
    found = np.empty(tracks.shape[0], np.int64)
    return Search(track_boxes(tracks), found, np.zeros(MOST_PARTS, PART), np.zeros(2 * MOST_PARTS + 2))


@inner
def observe_hiding(table, d, gate_m, exposure, search):
    """Observes the tracks that together hide a detection; returns whether there are any. Their lines and extents remain, and
    their margins reach its nearest face."""
    count = find_parts(table.tracks, d, gate_m, exposure.eye, search)
    if count == 0 or not visit_pieces(table, d, count, exposure, search, False):
        return False
    visit_pieces(table, d, count, exposure, search, True)
    return True


@inner
def visit_pieces(table, d, count, exposure, search, observes):
    """Divides a detection into pieces that one track each hides; returns False where no track hides a part of it. count: parts
    found; observes: each piece is an observation of its track."""
    parts, borders, eye = search.parts, search.borders, exposure.eye
    n = find_borders(parts, count, d, borders)
    for k in range(n - 1):
        if borders[k + 1] - borders[k] < _EXACT_M:
            continue
        middle = 0.5 * (borders[k] + borders[k + 1])
        z = d.top_m + _EXACT_M
        for _ in range(2 * count + 1):
            if z >= d.bottom_m - _EXACT_M:
                break
            best = next_part(table.tracks, d, parts, count, middle, z, eye)
            if best == NONE:
                return False
            j, top = parts[best].slot, z
            z = max(z, lower_edge(table.tracks[j], d, middle, eye))
            if observes:
                piece = Piece(borders[k], borders[k + 1], top, min(z, d.bottom_m))
                observe_part(table, j, d, piece, exposure)
        if z < d.bottom_m - _EXACT_M:
            return False
    return True


@inner
def behind_of(d):
    """How far a track may lie behind a detection that it hides, m."""
    return min(BEHIND_MAX_M, max(BEHIND_M, BEHIND_SHARE * d.margin_m))


@inner
def find_parts(tracks, d, gate_m, eye, search):
    """The parts of a detection that tracks can hide, those observed most often first where there are too many."""
    parts, found, count = search.parts, search.found, 0
    reach = max(gate_m, BEHIND_MAX_M)
    for j in found[: find_near(d, search.boxes, reach, reach, found)]:
        t = tracks[j]
        x0, y0 = point_at(t, t.s0_m)
        x1, y1 = point_at(t, t.s1_m)
        if offset(t, eye[0], eye[1]) <= 0.0:
            continue  # seen from behind
        a, b = seen_on(d, x0, y0, eye), seen_on(d, x1, y1, eye)
        low, high = within(t, d, max(0.0, min(a, b)), min(d.length_m, max(a, b)), gate_m, eye)
        if high - low < _EXACT_M:
            continue
        at = count
        if count == parts.shape[0]:
            at = 0
            for k in range(count):
                at = k if parts[k].hits < parts[at].hits else at
            if parts[at].hits >= t.hits:
                continue
        else:
            count += 1
        p = parts[at]
        p.s0_m, p.s1_m, p.slot, p.hits = low, high, j, t.hits
    return count


@inner
def within(t, d, low, high, gate_m, eye):
    """The part of low..high of a detection over which the line of a track is seen within the tolerances."""
    first = offset(t, d.ax_m, d.ay_m)
    slope = (offset(t, d.bx_m, d.by_m) - first) / d.length_m
    middle_x, middle_y = 0.5 * (d.ax_m + d.bx_m), 0.5 * (d.ay_m + d.by_m)
    behind, gate_m = behind_of(d), gate_m * max(EDGE_ON, abs(facing(t, middle_x, middle_y, eye)))
    if abs(slope) < 1e-9:
        if first > behind or first < -gate_m:
            return 0.0, 0.0
    else:
        enter, leave = (-gate_m - first) / slope, (behind - first) / slope
        low, high = max(low, min(enter, leave)), min(high, max(enter, leave))
    if high <= low:
        return 0.0, 0.0
    for end in range(2):
        s = low if end == 0 else high
        x, y = d.ax_m + s * d.tx, d.ay_m + s * d.ty
        if abs(facing(t, x, y, eye)) < EDGE_ON and sideways(t, x, y, offset(t, x, y), eye) > LOST_M:
            return 0.0, 0.0
    return low, high


@inner
def seen_on(d, x, y, eye):
    """Where the viewing ray of a point meets the line of a detection, m from its first end; see `met_at`."""
    return met_at(x - d.ax_m, y - d.ay_m, d.tx, d.ty, x - eye[0], y - eye[1])


@inner
def find_borders(parts, count, d, borders):
    """Sorted ends of the parts and of the detection; returns how many."""
    borders[0], borders[1], n = 0.0, d.length_m, 2
    for k in range(count):
        for end in range(2):
            s = parts[k].s0_m if end == 0 else parts[k].s1_m
            if not 0.0 < s < d.length_m:
                continue
            at = n
            while at > 0 and borders[at - 1] > s:
                borders[at] = borders[at - 1]
                at -= 1
            borders[at] = s
            n += 1
    return n


@inner
def next_part(tracks, d, parts, count, s, z, eye):
    """The part that hides a detection at s from height z downwards: of the track observed most often. NONE: there is none."""
    best = NONE
    for k in range(count):
        p = parts[k]
        if p.s0_m > s or p.s1_m < s or (best != NONE and p.hits <= parts[best].hits):
            continue
        t = tracks[p.slot]
        share = range_share(t, d, s, eye)
        upper, lower = eye[2] + (t.top_m - eye[2]) / share, eye[2] + (t.bottom_m - eye[2]) / share
        if min(lower, d.bottom_m) - max(upper, d.top_m) < _EXACT_M:
            continue
        if upper <= z + _EXACT_M and lower > z + _EXACT_M:
            best = k
    return best


@inner
def lower_edge(t, d, s, eye):
    """Height at which the lower edge of a track is seen on a detection at s."""
    return eye[2] + (t.bottom_m - eye[2]) / range_share(t, d, s, eye)


@inner
def range_share(t, d, s, eye):
    """Range of a track over that of a detection at s, on the same viewing ray."""
    off = offset(t, d.ax_m + s * d.tx, d.ay_m + s * d.ty)
    whole = offset(t, eye[0], eye[1])
    if whole < 1.0:
        return 1.0  # seen edge-on: the foot is compared
    return min(2.0, max(0.5, whole / (whole - off)))


@inner
def observe_part(table, j, d, piece, exposure):
    """One observation of the track in slot j over a Piece of a detection."""
    t, eye, t_ns = table.tracks[j], exposure.eye, exposure.t_ns
    s0, s1 = piece.s0_m, piece.s1_m
    ax, ay = d.ax_m + s0 * d.tx, d.ay_m + s0 * d.ty
    bx, by = d.ax_m + s1 * d.tx, d.ay_m + s1 * d.ty
    sa, sb = seen_at(t, ax, ay, eye), seen_at(t, bx, by, eye)
    low, high = min(sa, sb), max(sa, sb)
    share = range_share(t, d, 0.5 * (s0 + s1), eye)
    top = eye[2] + share * (piece.top_m - _EXACT_M - eye[2])
    bottom = eye[2] + share * (piece.bottom_m + _EXACT_M - eye[2])
    low, high = max(t.s0_m, low), min(t.s1_m, high)
    top, bottom = max(t.top_m, top), min(t.bottom_m, bottom)
    if high < low:
        return
    t.frame_s0_m, t.frame_s1_m = min(t.frame_s0_m, low), max(t.frame_s1_m, high)
    t.frame_top_m, t.frame_bottom_m = min(t.frame_top_m, top), max(t.frame_bottom_m, bottom)
    keep_cut_edges(t, d.plane_flags)
    near = max(offset(t, ax, ay), offset(t, bx, by))
    t.excess_m = max(t.excess_m, near) if t.seen_ns == t_ns else near
    t.margin_m = max(t.margin_m, d.margin_m + min(0.0, near))
    observe_cells(table, j, low, high, d, bottom - top, t_ns)
    count_observation(t, t_ns)


@inner
def keep_cut_edges(t, flags):
    """Extends the frame's extent of a track to its own edges where the border of the image cut a detection, with these flags,
    that it hides: the track may continue there, and does not shrink."""
    if flags & (CUT_LEFT | CUT_RIGHT):
        t.frame_s0_m, t.frame_s1_m = t.s0_m, t.s1_m
    if flags & CUT_TOP:
        t.frame_top_m = t.top_m
    if flags & CUT_BOTTOM:
        t.frame_bottom_m = t.bottom_m
