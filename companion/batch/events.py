"""The events of a flight, from its frames and health reports in order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final

from osape_client.proto import osape_v1_pb2 as pb

NS: Final = 1_000_000_000
_UNKNOWN_CM: Final = 65535
NO_FRAME: Final = "no_frame"
"""Cause of a blind event without frames: the camera delivered none in this time."""


class EventKind(StrEnum):
    """Stable codes of events."""

    BLIND = "blind"
    RECOVERED = "recovered"
    NEAR_PASS = "near_pass"
    OBSTACLE_REPORT = "obstacle_report"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSummary:
    """What events depend on."""

    camera: str
    t_ns: int
    file: int  # number of the log file
    valid: bool
    cause: str
    armed: bool | None
    distance_m: float | None  # of the nearest plane, None: no plane


@dataclass(slots=True)
class _Interval:
    """Frames in a row with the same property."""

    first: FrameSummary
    last_ns: int
    frames: int = 1
    least_m: float | None = None

    def add(self, frame: FrameSummary) -> None:
        self.last_ns = frame.t_ns
        self.frames += 1
        if frame.distance_m is not None:
            self.least_m = frame.distance_m if self.least_m is None else min(self.least_m, frame.distance_m)

    def row(self, kind: EventKind, end_ns: int | None) -> dict[str, Any]:
        f = self.first
        until_ns = self.last_ns if end_ns is None else end_ns
        return {
            "file": f.file,
            "kind": str(kind),
            "camera": f.camera,
            "t_ns": f.t_ns,
            "end_ns": end_ns,
            "duration_s": (until_ns - f.t_ns) / NS,
            "armed": f.armed,
            "cause": f.cause if kind is EventKind.BLIND else "",
            "distance_m": self.least_m,
            "frames": self.frames,
        }


class FlightEvents:
    """`frame` and `health` in the order of the log, then `end`; each gives the rows of completed events."""

    def __init__(self, near_m: float) -> None:
        """near_m: a frame with a plane nearer than this is part of a near pass."""
        self._near_m = near_m
        self._blind: dict[str, _Interval] = {}
        self._near: dict[str, _Interval] = {}
        self._newest: dict[str, FrameSummary] = {}
        self._report_ns = 0
        self.gap_s = math.inf
        """Without a frame of a camera for longer, it is blind. To be set for each file; inf: not every frame is in it."""
        self.blind_s = 0.0
        """Sum over the cameras of the time from an invalid frame to the next valid one."""

    def frame(self, frame: FrameSummary) -> Iterator[dict[str, Any]]:
        """Takes the next frame of a camera."""
        yield from self._gap(frame)
        blind = self._blind.get(frame.camera)
        if not frame.valid:
            if blind is None:
                self._blind[frame.camera] = _Interval(frame, frame.t_ns)
            else:
                blind.add(frame)
        elif blind is not None:
            del self._blind[frame.camera]
            yield self._ended_blind(blind, frame.t_ns)
            yield _Interval(frame, frame.t_ns).row(EventKind.RECOVERED, frame.t_ns)
        yield from self._near_frame(frame)

    def _gap(self, frame: FrameSummary) -> Iterator[dict[str, Any]]:
        """A blind event where frames are missing before this one. Within a blind event they are part of it."""
        before = self._newest.get(frame.camera)
        self._newest[frame.camera] = frame
        if before is None or frame.camera in self._blind or frame.t_ns - before.t_ns <= self.gap_s * NS:
            return
        missing = replace(before, valid=False, cause=NO_FRAME, distance_m=None)
        if not frame.valid:
            self._blind[frame.camera] = _Interval(missing, before.t_ns, frames=0)
            return
        yield self._ended_blind(_Interval(missing, before.t_ns, frames=0), frame.t_ns)
        yield _Interval(frame, frame.t_ns).row(EventKind.RECOVERED, frame.t_ns)

    def _near_frame(self, frame: FrameSummary) -> Iterator[dict[str, Any]]:
        near = self._near.get(frame.camera)
        if frame.valid and frame.distance_m is not None and frame.distance_m < self._near_m:
            if near is None:
                self._near[frame.camera] = _Interval(frame, frame.t_ns, least_m=frame.distance_m)
            else:
                near.add(frame)
        elif near is not None and frame.valid:  # an invalid frame does not end it: the obstacle may still be there
            del self._near[frame.camera]
            yield near.row(EventKind.NEAR_PASS, frame.t_ns)

    def _ended_blind(self, blind: _Interval, end_ns: int | None) -> dict[str, Any]:
        row = blind.row(EventKind.BLIND, end_ns)
        self.blind_s += row["duration_s"]
        return row

    def health(self, report: pb.Health, file: int) -> Iterator[dict[str, Any]]:
        """Takes a health report: it names the obstacle report that was sent last."""
        sent = report.autopilot.obstacles_sent
        if not report.autopilot.HasField("obstacles_sent") or sent.t_ns == self._report_ns:
            return
        self._report_ns = sent.t_ns
        yield {
            "file": file,
            "kind": str(EventKind.OBSTACLE_REPORT),
            "camera": "",
            "t_ns": sent.t_ns,
            "end_ns": sent.t_ns,
            "duration_s": 0.0,
            "armed": report.autopilot.armed,
            "cause": "",
            "distance_m": nearest_sent_m(sent),
            "frames": 0,
        }

    def end(self) -> Iterator[dict[str, Any]]:
        """The events that last to the end of the log."""
        for blind in self._blind.values():
            yield self._ended_blind(blind, None)
        for near in self._near.values():
            yield near.row(EventKind.NEAR_PASS, None)


def nearest_sent_m(sent: pb.ObstacleSectors) -> float | None:
    """The nearest distance in an obstacle report; None: no sector has an obstacle."""
    limit = sent.clear_cm or _UNKNOWN_CM
    distances = [cm for cm in sent.cm if cm < limit]
    return min(distances) / 100.0 if distances else None
