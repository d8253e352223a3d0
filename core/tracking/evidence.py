"""Removal of tracks, or parts of them: by free space observed through them, and by age.

Each cell of a track that this frame did not observe is compared with what the frame observed at its place. Clear and explained
cells collect evidence; hidden ones and those out of view are kept until they are too old.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..jit import inner, kernel
from .losses import lost_ns
from .observed import (
    CLEAR,
    EXPLAINED,
    FREE_BEHIND_M,
    HIDDEN,
    OUT_OF_VIEW,
    PARTLY_EXPLAINED,
    by_direction,
    classify,
    is_beside,
    is_seen_through,
    measured_limits,
    seen_from,
)
from .shrinking import shrink
from .snapshot import S_DETECTED, S_HIDDEN, S_MISSED, S_NEW, S_OUT_OF_VIEW
from .tables import MEMORY_HITS, RATE_STEP, clear_cell
from .vertical_limits import share_in_view, vertical_limits

NEW_HITS = 3
"""A track observed less often is new."""
_LEAST_MEMORY_NS = 200_000_000
"""Nothing is forgotten sooner."""
_LEAST_FREE_FRAMES, _MOST_FREE_FRAMES = 2, 4
"""Frames that must observe free space through a cell before it is removed: as many as have observed it, between these. No
single frame removes what was measured."""
_IN_VIEW_SHARE, _PROVEN_SHARE = 0.5, 0.75
"""Shares of the height above the ground. With less of it between the highest and the lowest measured ray a place is
out of view; so much must lie there for free space to remove all of it."""


class Observed(NamedTuple):
    """What one frame observed. free: its FreeView; index: its DetectionIndex; limits: of `measured_limits`; heights: of
    `vertical_limits`; eye_z: height of the camera, z down, m."""

    free: Any
    index: Any
    limits: Any
    heights: Any
    eye_z: Any


class Memory(NamedTuple):
    """How long a cell is kept without an observation. most_ns: `memory_s` of the parameters; most_lost_ns: that without a
    position; losses: of `loss_table`."""

    most_ns: Any
    most_lost_ns: Any
    losses: Any


@kernel
def collect_evidence(table, detections, view, eye_z, t_ns, memory):
    """Evidence of one frame on all cells that it did not observe; removes cells that are clear, or older than the memory.
    Sets the state of each track. Returns the number of cells removed.

    table: TrackTable; detections: (N,) DETECTION and view: FreeView of the frame; eye_z: height of the camera, m; t_ns:
    exposure; memory: Memory."""
    limits = measured_limits(view)
    frame = Observed(view, by_direction(detections, view), limits, vertical_limits(view, eye_z), eye_z)
    removed = 0
    for j in range(table.tracks.shape[0]):
        t = table.tracks[j]
        if t.hits == 0:
            continue
        if t.seen_ns == t_ns:
            shrink(table, j, detections, view, limits)
        best = OUT_OF_VIEW
        for k in range(t.cells):
            c = table.cells[j, k]
            if c.hits == 0 or c.seen_ns == t_ns:
                continue
            s = cell_middle(t, k)
            place = seen_from(t.x_m + s * t.tx, t.y_m + s * t.ty, view)
            seen = observed_as(t, place, frame)
            if seen == PARTLY_EXPLAINED:  # what flickers is one surface with it; of a steady obstacle it proves nothing
                seen = EXPLAINED if c.hits < MEMORY_HITS else HIDDEN
            best = max(best, seen)
            if seen >= EXPLAINED:
                c.against += 2 if c.measured else 4
            share = memory_share(t, c, place, seen, frame)
            needed = max(_LEAST_FREE_FRAMES, min(_MOST_FREE_FRAMES, c.hits))
            if c.against >= 2 * needed or is_too_old(c, share, t_ns, memory):
                clear_cell(table, j, k)
                removed += 1
        if t.seen_ns != t_ns and best >= EXPLAINED:
            t.hit_rate -= RATE_STEP * t.hit_rate
            if t.hits == 1:
                removed += remove_gap(table, j)
        t.state = state_of(t, best, t_ns)
    return removed


@inner
def observed_as(t, place, frame):
    """How a frame, Observed, observed a place (of `seen_from`) on the line of a track, see `classify`."""
    seen = classify(place, t.top_m, t.bottom_m, FREE_BEHIND_M + t.margin_m, frame.free)
    if seen != CLEAR and is_seen_through(place, t, frame.index, frame.free, frame.eye_z):
        seen = CLEAR
    if seen == CLEAR and height_in_view(t, place, frame) < _PROVEN_SHARE:
        return OUT_OF_VIEW
    return seen


@inner
def height_in_view(t, place, frame):
    """Share of the height of a track at a place that a frame measured, see `share_in_view`."""
    return share_in_view(place, t.top_m, t.bottom_m, frame.eye_z, frame.free, frame.heights)


@inner
def memory_share(t, c, place, seen, frame):
    """Share of the memory that a cell of a track has at a place that a frame observed as `seen`.

    With fewer than MEMORY_HITS observations it grows with their square: what flickers does not accumulate where it is
    hidden. Beside the measured directions, and above or below what was measured in them, a cell has the whole memory, unless
    one frame alone has observed it: it may have left the view as soon as it was in it."""
    if not c.measured:
        return 0.0
    share = min(1.0, (c.hits / MEMORY_HITS) ** 2)
    if share == 1.0 or c.hits == 1 or seen > HIDDEN:
        return share
    beside = seen == OUT_OF_VIEW and is_beside(place, frame.limits)
    return 1.0 if beside or height_in_view(t, place, frame) < _IN_VIEW_SHARE else share


@inner
def is_too_old(c, share, t_ns, memory):
    """Whether a cell that has this share of the memory, a Memory, is forgotten."""
    if t_ns - c.seen_ns > max(_LEAST_MEMORY_NS, share * memory.most_ns):
        return True
    return lost_ns(memory.losses, c.seen_ns) > max(_LEAST_MEMORY_NS, share * memory.most_lost_ns)


@inner
def remove_gap(table, j):
    """Removes all cells of a gap that one frame alone filled: free space through a part of it shows that it is none of this
    frame. Returns how many."""
    removed = 0
    for k in range(table.tracks[j].cells):
        if table.cells[j, k].hits > 0 and not table.cells[j, k].measured:
            clear_cell(table, j, k)
            removed += 1
    return removed


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
