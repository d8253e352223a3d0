"""The tracker: frames in, tracked obstacles out. The same frames give the same tracks, bit for bit.

An obstacle appears with its first detection. It is removed only when enough frames observe free space through it, or when
it is hidden or out of view for longer than the memory. Nothing in it states that space is free.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..free_view import FreeView, free_view, view_bytes, view_from_bytes
from .association import GATE, WIDE_GATE, Gate, assign, find_pairs
from .ego_motion import common_shift
from .evidence import Memory, collect_evidence
from .groups import GROUP, find_groups
from .losses import Losses, loss_table, shifted, with_loss, without_old
from .movers import (
    HISTORY,
    OLD_S,
    carry_tracks,
    declare_objects,
    mark_tracks,
    release_tracks,
    support_by_view,
    update_objects,
)
from .objects import MOST_OBJECTS, OBJECT, assign_groups, predict_objects
from .params import TrackingParams
from .publish import MarginGrowth, snapshot_of
from .snapshot import STATE_VERSION, TrackerState, TrackingFrame, TrackSnapshot
from .splitting import split_tracks
from .tables import CELL, CELLS, DETECTION, TRACK, Exposure, TrackTable, detections_of, empty_table
from .update import apply_detections, begin_frame

NS = 1_000_000_000
_PAIRS_PER_DETECTION = 16
"""Pairs considered for each detection, on average."""
_LEAST_PAIRS = 4096
_GROUPS = 128
"""Groups of a frame that may move."""
_JUMP_M, _JUMP_SPEED_M_S = 1.0, 30.0
"""A position that steps by more has been reset."""
_MOST_STEP_S = 10.0
"""The covariance of a line grows for this time at most between two frames."""
_VELOCITY_SHARE = 0.4
"""Weight of a frame in the estimated velocity of a vehicle without a position."""
_SPARE_SLOTS = 64
"""Slots for the parts of split tracks."""
_RESTART_NS = NS
"""Time that has passed at least when a clock went back, as companion/pipeline/sample_buffer.py: frames are left out
so long."""
_VIEWS, _VIEW_STEP_NS = 9, NS // 5
"""Earlier free ranges that are kept, and the least time between them."""


class Tracker:
    """The tracks of one camera. counts: tracks removed for want of slots, detections left out, pairs left out."""

    def __init__(self, params: TrackingParams | None = None, state: TrackerState | None = None) -> None:
        self.params = params or TrackingParams()
        self.counts = {"tracks_evicted": 0, "detections_left_out": 0, "pairs_left_out": 0}
        self._pairs, self._scores = np.zeros((_LEAST_PAIRS, 3), np.int32), np.zeros(_LEAST_PAIRS)
        self._no_detections = np.zeros(0, DETECTION)
        self._groups = np.zeros(_GROUPS, GROUP)
        self._next_id, self._next_object_id = 1, 1
        self._reset()
        if state is not None:
            self._resume(state)

    def _reset(self) -> None:
        self._all = empty_table(self.params.most_tracks)
        self._table = self._all
        self._used = 0  # end of the slots in use
        self._objects = np.zeros(MOST_OBJECTS, OBJECT)
        self._history = np.zeros((MOST_OBJECTS, HISTORY, 3))
        self._views: list[tuple[int, FreeView]] = []
        self._velocity_m_s = 0.0, 0.0
        self._state = TrackerState()  # of the newest frame; its ids, velocity and tables are set by `state`

    def clear(self) -> None:
        """Ends all tracks and moving obstacles. Their ids are not given again."""
        self._reset()

    def observe(self, frame: TrackingFrame) -> TrackSnapshot:
        """The tracks after a frame. One older than the newest frame means that the camera's clock went back: the tracks go on
        from its stamp, and moving obstacles are observed again. An invalid frame is no evidence: its tracks only grow older."""
        if self._state.last_ns is not None and frame.t_ns <= self._state.last_ns:
            self._restart_clock(frame, self._state.last_ns)
        last_ns = self._state.last_ns
        dt_s = 0.0 if last_ns is None else (frame.t_ns - last_ns) / NS
        before = dict(self.counts)
        self._limit_table(len(frame.model.planes))
        aligned = self._align(frame, dt_s)
        begin_frame(self._table, min(dt_s, _MOST_STEP_S))
        followed = aligned and frame.positioned
        if followed:
            predict_objects(self._objects, dt_s, frame.t_ns, frame.model.valid)
            carry_tracks(self._table.tracks, self._objects, dt_s)
        view = free_view(frame.model, frame.camera_m)
        detections = self._no_detections
        if frame.model.valid:
            m = frame.model
            detections = detections_of(m.planes, m.margin_m, m.flags, m.cluster)
            if not followed:
                self._estimate_motion(detections, dt_s, frame.camera_m)
            self._associate(detections, frame, view)
        release_tracks(self._table.tracks, self._objects)
        memory_ns = round(self.params.memory_s * NS)
        losses = without_old(self._losses(frame), frame.t_ns - memory_ns)
        memory = Memory(memory_ns, round(self.params.memory_without_position_s * NS), loss_table(losses))
        collect_evidence(self._table, detections, view, frame.camera_m[2], frame.t_ns, memory)
        self._next_id, self._used, evicted = split_tracks(self._all, len(self._table.tracks), self._next_id, frame.t_ns)
        self._limit_table(0)
        self.counts["tracks_evicted"] += evicted
        self._state = replace(
            self._state,
            last_ns=frame.t_ns,
            positioned=frame.positioned,
            reset_counter=frame.reset_counter,
            position_jump_ns=max(self._state.position_jump_ns, frame.position_jump_ns),
            heading_jump_ns=max([self._state.heading_jump_ns, *(at_ns for at_ns, _ in frame.heading_jumps)]),
            losses=losses,
            origin_m=frame.origin_m,
        )
        self._keep_view(view, frame)
        growth = MarginGrowth(self.params.speed_error_m_s, memory.losses)
        snapshot = snapshot_of(self._table.tracks, self._objects, frame.t_ns, growth, frame.camera_m)
        return replace(
            snapshot,
            left_out=self.counts["detections_left_out"] - before["detections_left_out"],
            evicted=self.counts["tracks_evicted"] - before["tracks_evicted"],
        )

    def _losses(self, frame: TrackingFrame) -> Losses:
        """The losses of the position after a frame."""
        s = self._state
        if s.last_ns is None or (frame.positioned and s.positioned):
            return s.losses
        return with_loss(s.losses, s.last_ns, frame.t_ns)

    def _limit_table(self, detections: int) -> None:
        """Limits the table to the slots in use and as many as the detections of a frame can need. Slots are taken from the
        lowest up, so that empty ones beyond need not be read."""
        tracks, cells = self._all
        limit = self._used + 2 * detections + _SPARE_SLOTS
        self._table = TrackTable(tracks[:limit], cells[:limit])

    def _restart_clock(self, frame: TrackingFrame, last_ns: int) -> None:
        """Moves all stamps so that the newest frame lies _RESTART_NS before this one. Jumps of the vehicle's estimate have
        stamps of another clock: those in the frame count as known."""
        step_ns = frame.t_ns - _RESTART_NS - last_ns
        tracks, cells = self._table
        tracks["first_ns"] += step_ns
        tracks["seen_ns"] += step_ns
        cells["seen_ns"] += step_ns
        self._objects["hits"] = 0
        self._views.clear()
        self._state = replace(
            self._state,
            last_ns=last_ns + step_ns,
            losses=shifted(self._state.losses, step_ns),
            position_jump_ns=frame.position_jump_ns,
            heading_jump_ns=max([at_ns for at_ns, _ in frame.heading_jumps], default=0),
        )

    # ---- place of the tracks ------------------------------------------------------------------------------------------

    def _align(self, frame: TrackingFrame, dt_s: float) -> bool:
        """Moves the tracks to the axes of a frame; returns whether their place is exact, so that no shift has to be
        estimated."""
        s = self._state
        if s.last_ns is None:
            return True
        step = [new - old for new, old in zip(frame.origin_m, s.origin_m, strict=True)]
        both = frame.positioned and s.positioned and frame.reset_counter == s.reset_counter
        both = both and frame.position_jump_ns <= s.position_jump_ns
        jumps = [jump_rad for at_ns, jump_rad in frame.heading_jumps if at_ns > s.heading_jump_ns]
        if both and not jumps and math.hypot(*step) <= _JUMP_M + _JUMP_SPEED_M_S * dt_s:
            if dt_s > 0.0:
                self._velocity_m_s = step[0] / dt_s, step[1] / dt_s
            return True
        # between origins of vehicles the tracks keep their place relative to the vehicle, but for its motion
        vx, vy = self._velocity_m_s
        self._shift(step[0] - vx * dt_s, step[1] - vy * dt_s, step[2])
        self._rotate(sum(jumps), frame.origin_m)
        self._objects["hits"] = 0
        self._views.clear()
        return False

    def _rotate(self, angle_rad: float, about_m: tuple[float, float, float]) -> None:
        """Rotates the tracks, and the estimated velocity, about a vertical axis, clockwise as seen from above."""
        if angle_rad == 0.0:
            return
        tracks, (cx, cy, _) = self._table.tracks, about_m
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        x, y = tracks["x_m"] - cx, tracks["y_m"] - cy
        tracks["x_m"], tracks["y_m"] = cx + c * x - s * y, cy + s * x + c * y
        tx, ty = tracks["tx"].copy(), tracks["ty"].copy()
        tracks["tx"], tracks["ty"] = c * tx - s * ty, s * tx + c * ty
        vx, vy = self._velocity_m_s
        self._velocity_m_s = c * vx - s * vy, s * vx + c * vy

    def _shift(self, x_m: float, y_m: float, z_m: float) -> None:
        tracks = self._table.tracks
        tracks["x_m"] += x_m
        tracks["y_m"] += y_m
        tracks["top_m"] += z_m
        tracks["bottom_m"] += z_m

    def _estimate_motion(self, detections: NDArray[Any], dt_s: float, eye_m: tuple[float, float, float]) -> None:
        """Moves the tracks by the common shift of the detections, and corrects the estimated velocity."""
        count = self._find_pairs(detections, WIDE_GATE, eye_m)
        pairs, scores = self._pairs[:count], self._scores[:count]
        x, y, z = map(float, common_shift(detections, self._table.tracks, pairs, scores, dt_s))
        self._shift(x, y, z)
        if dt_s > 0.0:
            vx, vy = self._velocity_m_s
            share = _VELOCITY_SHARE / dt_s
            self._velocity_m_s = vx - share * x, vy - share * y

    # ---- detections ---------------------------------------------------------------------------------------------------

    def _find_pairs(self, detections: NDArray[Any], gate: Gate, eye_m: tuple[float, float, float]) -> int:
        most = max(_LEAST_PAIRS, _PAIRS_PER_DETECTION * len(detections))
        if len(self._pairs) < most:
            self._pairs, self._scores = np.zeros((most, 3), np.int32), np.zeros(most)
        tracks = self._all.tracks[: self._used]
        count, lost = find_pairs(detections, tracks, gate, eye_m, self._pairs, self._scores)
        self.counts["pairs_left_out"] += lost
        return int(count)

    def _associate(self, detections: NDArray[Any], frame: TrackingFrame, view: FreeView) -> None:
        count = self._find_pairs(detections, GATE, frame.camera_m)
        order = np.argsort(-self._scores[:count], kind="stable")
        pairs = self._pairs[order]
        assign(detections, self._table.tracks, pairs)
        exposure = Exposure(frame.camera_m, frame.t_ns, frame.positioned)
        self._next_id, evicted, left_out = apply_detections(self._table, detections, pairs, exposure, self._next_id)
        self.counts["tracks_evicted"] += evicted
        self.counts["detections_left_out"] += left_out
        if frame.positioned:
            self._follow_movers(detections, frame, view)

    def _follow_movers(self, detections: NDArray[Any], frame: TrackingFrame, view: FreeView) -> None:
        groups = self._groups[: find_groups(detections, view, self._groups)]
        assign_groups(groups, self._objects)
        self._next_object_id, waiting = update_objects(
            groups, self._objects, self._history, self._next_object_id, frame.t_ns, view
        )
        newest_ns = frame.t_ns - round(OLD_S * NS)
        for t_ns, earlier in self._views:
            if waiting and t_ns <= newest_ns:
                waiting = support_by_view(self._objects, earlier)
        declare_objects(self._objects, frame.t_ns)
        mark_tracks(detections, groups, self._objects, self._table.tracks)

    def _keep_view(self, view: FreeView, frame: TrackingFrame) -> None:
        """Keeps the free ranges of a frame for the comparison of moving objects."""
        if not frame.positioned or not frame.model.valid:
            return
        if not self._views or frame.t_ns - self._views[-1][0] >= _VIEW_STEP_NS:
            self._views.append((frame.t_ns, view))
            del self._views[:-_VIEWS]

    # ---- state --------------------------------------------------------------------------------------------------------

    def state(self) -> TrackerState:
        """What another tracker needs to continue identically."""
        tracks, cells = self._all
        slots = np.flatnonzero(tracks["hits"] > 0).astype("<i4")
        return replace(
            self._state,
            next_id=self._next_id,
            next_object_id=self._next_object_id,
            velocity_m_s=self._velocity_m_s,
            slots=slots.tobytes(),
            tracks=tracks[slots].tobytes(),
            cells=cells[slots].tobytes(),
            objects=self._objects.tobytes(),
            history=self._history.tobytes(),
            views=tuple(view_bytes(view, t_ns) for t_ns, view in self._views),
        )

    def _resume(self, state: TrackerState) -> None:
        """Raises ValueError for a state whose parts do not fit together, or that has more tracks than the table."""
        if state.version != STATE_VERSION:
            raise ValueError(
                f"tracker state: version {state.version} cannot be read, this program reads {STATE_VERSION}; begin without it"
            )
        slots = np.frombuffer(state.slots, "<i4")
        n, width = len(slots), CELLS * CELL.itemsize
        if len(state.tracks) != n * TRACK.itemsize or len(state.cells) != n * width:
            raise ValueError(f"tracker state: {n} tracks do not have their stated size; it is of another version")
        if n and (slots.min() < 0 or slots.max() >= self.params.most_tracks or len(np.unique(slots)) != n):
            raise ValueError(
                f"tracker state: a track lies outside the table of {self.params.most_tracks}; was most_tracks changed?"
            )
        self._used = 1 + int(slots.max(initial=-1))
        self._all.tracks[slots] = np.frombuffer(state.tracks, TRACK)
        self._all.cells[slots] = np.frombuffer(state.cells, CELL).reshape(n, CELLS)
        if state.objects or state.history:
            if len(state.objects) != self._objects.nbytes or len(state.history) != self._history.nbytes:
                raise ValueError("tracker state: its moving objects do not have their stated size")
            self._objects[:] = np.frombuffer(state.objects, OBJECT)
            self._history[:] = np.frombuffer(state.history).reshape(self._history.shape)
        self._views = [view_from_bytes(data) for data in state.views]
        self._next_id, self._next_object_id = state.next_id, state.next_object_id
        self._velocity_m_s = state.velocity_m_s
        self._state = replace(state, slots=b"", tracks=b"", cells=b"", objects=b"", history=b"", views=())
