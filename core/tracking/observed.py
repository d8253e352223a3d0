"""How one frame observed a place: by its free ranges, and by its detections behind the place.

A place is *clear* where free space reaches well beyond it, *explained* where another obstacle was observed at about its range,
*hidden* where the free range ends before it, and *out of view* elsewhere.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..free_view import NO_DIRECTION, direction_of, lowest_free
from ..jit import inner, kernel
from ..types import FreeEnd
from .intervals import at_value, index_intervals
from .tables import INFERRED, is_gap

OUT_OF_VIEW, HIDDEN, PARTLY_EXPLAINED, EXPLAINED, CLEAR = range(5)
_OBSTACLE = int(FreeEnd.OBSTACLE)
_EXPLAINED_SHARE = 0.15
_CLEAR_SHARE = 0.5
"""Shares of a place's height."""
FREE_BEHIND_M, FREE_SIGMAS = 0.3, 2.0
"""Observed free space must reach this far behind an obstacle and its margin, and farther by this many standard deviations of
its distance."""
_SPAN_SLACK_RAD = 1e-6
"""For the rounding of directions."""


class DetectionIndex(NamedTuple):
    """The detections of a frame by their directions, to see what lies behind a place. detections: (N,) DETECTION; spans: of
    `find_spans`; intervals: index of the spans; middle_rad: azimuth of the middle of the view, from which directions count."""

    detections: Any
    spans: Any
    intervals: Any
    middle_rad: Any


@inner
def seen_from(x, y, view):
    """A place (x, y, in the tracks' frame) as seen from the camera: x, y, horizontal range, m, and azimuth, rad."""
    dx, dy = x - view.x_m, y - view.y_m
    return dx, dy, math.sqrt(dx * dx + dy * dy), math.atan2(dy, dx)


@inner
def classify(place, top, bottom, slack, view):
    """How a frame observed a place (of `seen_from`) with heights top..bottom: CLEAR, EXPLAINED, PARTLY_EXPLAINED where most of
    the height was not observed, HIDDEN or OUT_OF_VIEW. slack: how far behind the place it must be free, m, without noise."""
    clear, explained, hidden = observed_heights(place, top, bottom, slack, view)
    if explained > _EXPLAINED_SHARE * (bottom - top):
        return EXPLAINED if clear + explained >= _CLEAR_SHARE * (bottom - top) else PARTLY_EXPLAINED
    if clear >= _CLEAR_SHARE * (bottom - top):
        return CLEAR
    return HIDDEN if hidden > 0.0 else OUT_OF_VIEW


@inner
def observed_heights(place, top, bottom, slack, view):
    """How much of the height of a place (of `seen_from`) is (clear, explained, hidden), m; zeros out of view."""
    dx, dy, r, azimuth = place
    clear, explained, hidden = 0.0, 0.0, 0.0
    if r < 1e-3 or view.edges_rad.shape[0] < 2:
        return clear, explained, hidden
    d = direction_of(view.edges_rad, azimuth)
    if d == NO_DIRECTION:
        return clear, explained, hidden
    off = slack + FREE_SIGMAS * view.ke_per_m * r * r
    lowest = lowest_free(dx, dy, r, 0.0, view)
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
    return clear, explained, hidden


@inner
def is_unobserved(x, y, top, bottom, slack, view, limits):
    """Whether a frame did not observe most of a place above the ground: an obstacle hides it, it lies beyond the range, or out
    of the measured directions. limits: of `measured_limits`."""
    place = seen_from(x, y, view)
    if is_beside(place, limits):
        return True
    dx, dy, r, _ = place
    bottom = min(bottom, lowest_free(dx, dy, r, 0.0, view))
    if bottom <= top:
        return False
    return observed_heights(place, top, bottom, slack, view)[2] > 0.5 * (bottom - top)


@inner
def is_beside(place, limits):
    """Whether a place lies beside the measured directions of a frame; any place where it has none. place: of `seen_from`;
    limits: of `measured_limits`."""
    middle, half = 0.5 * (limits[0] + limits[1]), 0.5 * (limits[1] - limits[0])
    return abs(turn_between(middle, place[3])) >= half


@inner
def find_spans(detections, view, spans):
    """Directions that detections cover -> spans (2, N) float64: least and greatest direction, rad from the middle of the view. A
    detection behind the camera covers all directions."""
    middle = middle_azimuth(view)
    for i in range(detections.shape[0]):
        d = detections[i]
        ax, ay, bx, by = d.ax_m - view.x_m, d.ay_m - view.y_m, d.bx_m - view.x_m, d.by_m - view.y_m
        a, b = turn_between(middle, math.atan2(ay, ax)), turn_between(middle, math.atan2(by, bx))
        if abs(a - b) > math.pi:
            a, b = -math.pi, math.pi
        spans[0, i], spans[1, i] = min(a, b) - _SPAN_SLACK_RAD, max(a, b) + _SPAN_SLACK_RAD


@kernel
def by_direction(detections, view):
    """The DetectionIndex of a frame. view: FreeView."""
    spans = np.empty((2, detections.shape[0]))
    find_spans(detections, view, spans)
    return DetectionIndex(detections, spans, index_intervals(spans[0], spans[1]), middle_azimuth(view))


@inner
def middle_azimuth(view):
    """Middle of the observed directions, 0 where there are none."""
    n = view.edges_rad.shape[0]
    return 0.5 * (view.edges_rad[0] + view.edges_rad[n - 1]) if n > 0 else 0.0


@inner
def measured_limits(view):
    """First and last azimuth with a free range, rad; (0, 0): there is none. view: FreeView."""
    first, last = 0, -1
    for d in range(view.near_m.shape[0]):
        for k in range(view.near_m.shape[1]):
            if view.far_m[d, k] > view.near_m[d, k]:
                first = d if last < 0 else first
                last = d
    if last < 0:
        return 0.0, 0.0
    return view.edges_rad[first], view.edges_rad[last + 1]


@inner
def turn_between(start, end):
    """The angle from one azimuth to another, -pi to pi."""
    turn = end - start
    return turn - math.tau * math.floor(turn / math.tau + 0.5)


@inner
def is_seen_through(place, track, index, view, eye_z):
    """Whether detections of the frame lie behind a place (of `seen_from`) of a track, as seen from the camera, over most of its
    height, none lies at it, and none hides it. Gaps that were filled do not count: nothing was measured in them. index:
    DetectionIndex of the frame; eye_z: height of the camera."""
    dx, dy, r, azimuth = place
    if r < 1e-3:
        return False
    azimuth, dx, dy = turn_between(index.middle_rad, azimuth), dx / r, dy / r
    first, end = at_value(index.intervals, azimuth)
    passed, at, hidden, height = 0.0, 0.0, 0.0, track.bottom_m - track.top_m
    for i in index.intervals.items[first:end]:
        if not crosses(index.spans, i, azimuth):
            continue
        d = index.detections[i]
        far = range_along(d, dx, dy, view)
        over = height_over(d, track, far, r, eye_z)
        reach = FREE_BEHIND_M + track.margin_m + d.margin_m
        if over <= 0.0:
            continue
        if far >= r + reach:
            if d.plane_flags & INFERRED == 0:
                passed = max(passed, over)
        elif far > r - reach:
            at += over
        elif not is_gap(d):
            hidden += over
        # at most the whole height is passed
        if at > _EXPLAINED_SHARE * height or hidden > (1.0 - _CLEAR_SHARE) * height:
            return False
    return passed - hidden >= _CLEAR_SHARE * height


@inner
def crosses(spans, i, azimuth):
    """Whether detection i covers a direction, rad from the middle of the view. spans: of `find_spans`."""
    return (spans[0, i] <= azimuth) & (spans[1, i] >= azimuth)


@inner
def range_along(d, dx, dy, view):
    """Range at which a direction (unit vector dx, dy) from the camera meets a detection, m; 0: nowhere."""
    ax, ay, bx, by = d.ax_m - view.x_m, d.ay_m - view.y_m, d.bx_m - view.x_m, d.by_m - view.y_m
    side_a, side_b = dx * ay - dy * ax, dx * by - dy * bx
    if side_a * side_b > 0.0 or side_a == side_b:
        return 0.0
    share = side_a / (side_a - side_b)
    return max(0.0, dx * (ax + share * (bx - ax)) + dy * (ay + share * (by - ay)))


@inner
def height_over(d, track, far, r, eye_z):
    """So much of the height of a track at range r is seen on a detection at range `far` (0: none), m."""
    if far <= 0.0:
        return 0.0
    scale = r / far
    lower = min(track.bottom_m, eye_z + scale * (d.bottom_m - eye_z))
    return max(0.0, lower - max(track.top_m, eye_z + scale * (d.top_m - eye_z)))
