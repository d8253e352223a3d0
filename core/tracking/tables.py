"""Tables of the tracker: tracks with their cells, detections of one frame.

A track is a vertical rectangle on a line. The line is an anchor point and a unit tangent; s is the distance from the
anchor along the tangent, and free space lies on the side of the normal (-ty, tx). Cells divide the line into equal
lengths; cell k covers k*cell_m <= s < (k + 1)*cell_m. Each cell holds its own evidence, so that a part of a track can be
removed, and a track be split.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, of_type, record
from ..types import PlaneFlags

CELLS = 32
"""Cells of one track; where it becomes longer, its cells become longer."""
CELL_M = 0.25
"""Initial length of a cell. A narrower gap is never an opening."""
SHIFT_M = 4.0
"""The anchor follows a track whose middle is farther from it."""
THIN_M = 0.3
"""An obstacle of more height is not thin."""
NONE = -1
INFERRED, UNKNOWN_BEHIND, CUT_LEFT, CUT_RIGHT, CUT_TOP, CUT_BOTTOM, _ = map(int, PlaneFlags)
"""The flags of a plane as numbers for the kernels."""
RATE_STEP = 0.1
"""Weight of a frame in the hit rate."""
_MOST_HITS = 1 << 20
_CONFIRMING_SHARE = 0.3
"""An observation of less of a cell's height does not confirm the cell."""
POSE_SIGMA_M = 0.03
"""Error of position and attitude from frame to frame."""
SHRINK_SHARE = 0.1
"""Share of the difference by which a track shrinks to a smaller observation, each frame."""
MEMORY_HITS = 10
"""Observations after which a cell is kept for the whole memory."""
_HIT_WEIGHT = 4
"""Free evidence that an observation cancels; free space, or another obstacle there, adds 2."""

TRACK = record(
    *of_type(np.int64, "id object_id first_ns seen_ns"),
    *of_type(np.float64, "x_m y_m tx ty s0_m s1_m top_m bottom_m p00 p01 p11 margin_m excess_m nearer_m hit_rate"),
    *of_type(np.float64, "cell_m frame_s0_m frame_s1_m frame_top_m frame_bottom_m"),
    *of_type(np.int32, "first_cell cells hits plane_flags cluster state first_detection merged_into"),
)
"""A track, without padding, so that equal tables have equal bytes. object_id: of its moving object, 0: static; first_ns,
seen_ns: first and newest observation. x_m, y_m: anchor; tx, ty: unit tangent; s0_m, s1_m: extent; top_m < bottom_m (z down).
p00, p01, p11: covariance of the line's offset (m) at the anchor and of its slope (rad). margin_m: of its observations,
filtered; excess_m: how much nearer than the line the newest observation was; nearer_m: how much nearer than the line the plane
is published. hit_rate: share of the frames in view that observed it, weighted by age. cell_m: length of a cell; frame_...:
extent of this frame's observations. first_cell, cells: index of the first cell, and their number. hits: frames that observed
it; 0: the slot is empty. plane_flags: PlaneFlags of its newest observations; cluster: of the newest one; state: S_NEW to
S_OUT_OF_VIEW. first_detection: of this frame, -1: none; merged_into: slot of the track that an empty slot was merged into."""

CELL = record(("seen_ns", np.int64), ("hits", np.int32), *of_type(np.int16, "against measured"))
"""A cell. seen_ns: newest observation; hits: frames that observed it, 0: it is empty; against: evidence that it is free;
measured: 1 where a frame measured an obstacle in it, 0 where it is a filled gap of all frames that observed it."""

DETECTION = record(
    *of_type(np.float64, "ax_m ay_m bx_m by_m top_m bottom_m tx ty length_m margin_m sigma_m"),
    *of_type(np.int32, "plane_flags cluster track next group"),
)
"""A plane of the frame, in the axes of the tracks. ax_m to bottom_m: its ends and heights (z down), free space on the right of
a -> b; tx, ty: unit tangent from a to b. margin_m, plane_flags, cluster: of the FrameModel; sigma_m: standard deviation of its
place. track: slot that it updates; next: the next detection of the same track; group: of detections close together; -1:
none."""


class TrackTable(NamedTuple):
    """tracks: (T,) TRACK; cells: (T, CELLS) CELL."""

    tracks: NDArray[Any]
    cells: NDArray[Any]


class Exposure(NamedTuple):
    """From where and when a frame was observed. eye: x, y, z of the camera; t_ns: exposure; positioned: its place is known,
    so that fragments of thin obstacles are joined."""

    eye: Any
    t_ns: Any
    positioned: Any


def empty_table(most: int) -> TrackTable:
    """A table of so many empty slots."""
    return TrackTable(np.zeros(most, TRACK), np.zeros((most, CELLS), CELL))


def detections_of(
    planes: NDArray[np.float32],
    margin_m: NDArray[np.float32],
    flags: NDArray[np.uint8],
    cluster: NDArray[np.int32],
) -> NDArray[Any]:
    """(N,) DETECTION of the planes (P, 6) of a frame, by their least x. Planes that are not finite, or shorter than 1 mm, are
    left out."""
    rows = np.ascontiguousarray(planes, np.float32)
    order = np.argsort(np.minimum(rows[:, 0], rows[:, 2]), kind="stable")
    out = np.zeros(len(rows), DETECTION)
    return out[: fill_detections(rows, margin_m, flags, cluster, order, out)]


@inner
def fill_detections(planes, margin_m, flags, cluster, order, out):
    """Fills out (P,) DETECTION with the planes in this order; returns how many are valid."""
    count = 0
    for p in order:
        ax, ay, bx, by = (
            np.float64(planes[p, 0]),
            np.float64(planes[p, 1]),
            np.float64(planes[p, 2]),
            np.float64(planes[p, 3]),
        )
        top, bottom, margin = np.float64(planes[p, 4]), np.float64(planes[p, 5]), np.float64(margin_m[p])
        length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        if not (length >= 1e-3 and bottom > top and math.isfinite(length + bottom - top + margin)):
            continue
        d = out[count]
        d.ax_m, d.ay_m, d.bx_m, d.by_m, d.top_m, d.bottom_m = ax, ay, bx, by, top, bottom
        d.length_m, d.tx, d.ty = length, (bx - ax) / length, (by - ay) / length
        d.margin_m = margin
        d.sigma_m = math.sqrt(
            0.25 * margin**2 + POSE_SIGMA_M**2 + 1e-4
        )  # 95 % of the true points lie within the margin
        d.plane_flags, d.cluster = flags[p], cluster[p]
        d.track = d.next = d.group = NONE
        count += 1
    return count


@inner
def make_room(table, j, low, high):
    """Gives slot j cells for low..high (s, m): moves the window of its cells, or doubles the length of all."""
    track = table.tracks[j]
    for _ in range(32):
        first = min(int(math.floor(low / track.cell_m)), track.first_cell)
        last = max(int(math.floor(high / track.cell_m)), track.first_cell + track.cells - 1)
        if last - first < CELLS:
            break
        coarsen(table, j)
    shift = track.first_cell - first
    if shift > 0:
        for k in range(track.cells - 1, -1, -1):
            table.cells[j, k + shift] = table.cells[j, k]
        for k in range(shift):
            clear_cell(table, j, k)
        track.first_cell = first
    for k in range(track.cells + shift, last - first + 1):
        clear_cell(table, j, k)
    track.cells = last - first + 1


@inner
def coarsen(table, j):
    """Doubles the length of the cells of slot j; two become one with the stronger evidence of both."""
    track, cells = table.tracks[j], table.cells
    first = track.first_cell >> 1
    count = ((track.first_cell + track.cells - 1) >> 1) - first + 1
    offset = track.first_cell - 2 * first
    for k in range(count):
        lower, upper = 2 * k - offset, 2 * k - offset + 1
        take = lower if lower >= 0 else upper
        seen, against, hits = cells[j, take].seen_ns, cells[j, take].against, cells[j, take].hits
        measured = cells[j, take].measured if hits > 0 else 0
        if lower >= 0 and upper < track.cells and cells[j, upper].hits > 0:
            other = cells[j, upper]
            against = min(against, other.against) if hits > 0 else other.against
            seen, hits = max(seen, other.seen_ns), max(hits, other.hits)
            measured = max(measured, other.measured)
        c = cells[j, k]
        c.seen_ns, c.against, c.hits, c.measured = seen, against, hits, measured
    track.first_cell, track.cells, track.cell_m = first, count, 2.0 * track.cell_m


@inner
def clear_cell(table, j, k):
    """Empties a cell."""
    c = table.cells[j, k]
    c.seen_ns, c.against, c.hits, c.measured = 0, 0, 0, 0


@inner
def is_gap(d):
    """Whether a detection is a filled gap that was observed to be open: no obstacle was measured in it. It joins two obstacles,
    and is part of neither."""
    return d.plane_flags & (INFERRED | UNKNOWN_BEHIND) == INFERRED


@inner
def observe_cells(table, j, low, high, d, height_m, t_ns):
    """One observation of the cells of slot j over low..high (s, m) by a detection that covers so much of their height. A small
    part of the height keeps the cells in this frame, and is no evidence for the rest of them."""
    t = table.tracks[j]
    first = max(0, int(math.floor(low / t.cell_m)) - t.first_cell)
    last = min(t.cells - 1, int(math.floor(high / t.cell_m)) - t.first_cell)
    small, measured = height_m < _CONFIRMING_SHARE * (t.bottom_m - t.top_m), 0 if is_gap(d) else 1
    for k in range(first, last + 1):
        c = table.cells[j, k]
        if c.hits > 0 and small:
            c.seen_ns = t_ns
        elif c.hits == 0 or c.seen_ns != t_ns:
            c.seen_ns = t_ns
            c.hits = min(c.hits + 1, _MOST_HITS)
            c.against = max(0, c.against - _HIT_WEIGHT)
        c.measured = max(c.measured, measured)


@inner
def count_observation(t, t_ns):
    """Counts the first observation of a track in a frame."""
    if t.seen_ns != t_ns:
        t.hit_rate += RATE_STEP * (1.0 - t.hit_rate)
        t.hits = min(t.hits + 1, _MOST_HITS)
        t.seen_ns = t_ns


@inner
def free_slot(table, t_ns):
    """An empty slot; where there is none, that of the track not observed longest, NONE where all are of t_ns.

    Returns (slot, whether a track was removed for it)."""
    oldest = NONE
    for j in range(table.tracks.shape[0]):
        if table.tracks[j].hits == 0:
            return j, False
        if table.tracks[j].seen_ns < t_ns and (
            oldest == NONE or table.tracks[j].seen_ns < table.tracks[oldest].seen_ns
        ):
            oldest = j
    return oldest, oldest != NONE


@inner
def append_detections(detections, first, second):
    """Appends one chain of detections (linked by `next`) to another; returns its first."""
    if first == NONE:
        return second
    k = first
    for _ in range(detections.shape[0]):
        if detections[k].next == NONE:
            break
        k = detections[k].next
    detections[k].next = second
    return first


@inner
def remove_detection(detections, first, i):
    """Takes detection i out of a chain; returns its first."""
    if first == i:
        first = detections[i].next
    else:
        k = first
        for _ in range(detections.shape[0]):
            if k == NONE or detections[k].next == i:
                break
            k = detections[k].next
        if k == NONE:
            return first
        detections[k].next = detections[i].next
    detections[i].next = NONE
    return first
