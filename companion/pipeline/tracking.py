"""Tracks the obstacles of each camera from the results of its frames.

It runs after a frame is published, in the order of the frames, and does not change their results. With a position the tracks
stand in ned; without one in axes that point north, east and down from the vehicle, and are published in `level`."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from core.frames import level_cam_at
from core.tracking.params import TrackingParams
from core.tracking.snapshot import TrackerState, TrackingFrame, TrackSnapshot
from core.types import CameraMount, InvalidCause

from .results import PrismsResult
from .sync import DropCause
from .transform import LevelTransform, transform_model

if TYPE_CHECKING:
    from core.tracking.tracker import Tracker

NamedStates = tuple[tuple[str, TrackerState], ...]
"""State of the tracker of each camera, by name."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TracksResult:
    """The tracks after one frame, in its `frame`. valid False: the frame is no evidence. tracks None: it was dropped, so
    that the vehicle's attitude is unknown."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    frame: str
    valid: bool
    cause: DropCause | InvalidCause
    tracks: TrackSnapshot | None


class CameraTracks:
    """The trackers of all cameras."""

    def __init__(self, params: TrackingParams, states: NamedStates = ()) -> None:
        """states: to continue from. Raises ValueError where one does not fit the parameters."""
        self._params = params
        self._trackers: dict[str, Tracker] = {}
        self.resume(states)

    def resume(self, states: NamedStates) -> None:
        """Continues with these states. Raises ValueError where one does not fit the parameters."""
        for camera, state in states:
            self._trackers[camera] = self._new(state)

    def add(self, result: PrismsResult) -> TracksResult:
        """The tracks after a frame, in the order of the frames of each camera."""
        frame, heading_rad = tracking_frame(result)
        tracks: TrackSnapshot | None = None
        if frame is not None:
            if result.camera not in self._trackers:
                self._trackers[result.camera] = self._new(None)
            tracks = rotated(self._trackers[result.camera].observe(frame), -heading_rad)
        return TracksResult(
            camera=result.camera,
            sequence=result.sequence,
            t_exposure_ns=result.t_exposure_ns,
            t_arrival_ns=result.t_arrival_ns,
            frame=result.frame,
            valid=result.valid,
            cause=result.cause,
            tracks=tracks,
        )

    def forget(self, camera: str) -> None:
        """Ends the tracks of a camera, whose description has changed. Their ids are not given again."""
        if camera in self._trackers:
            self._trackers[camera].clear()

    def states(self) -> NamedStates:
        """The states to continue from."""
        return tuple((camera, tracker.state()) for camera, tracker in self._trackers.items())

    def _new(self, state: TrackerState | None) -> Tracker:
        from core.tracking.tracker import Tracker  # imported late: compiled code

        return Tracker(self._params, state)


def tracking_frame(result: PrismsResult) -> tuple[TrackingFrame | None, float]:
    """(The frame for the tracker, the angle from its axes to those of the result, rad); None for a dropped frame."""
    if result.model is None or result.transform is None or result.attitude is None:
        return None, 0.0
    if result.pose is not None:
        frame = TrackingFrame(
            model=result.model,
            camera_m=result.transform.translation_m,
            t_ns=result.t_exposure_ns,
            positioned=True,
            origin_m=result.pose.position_ned_m,
            reset_counter=result.pose.reset_counter,
            position_jump_ns=result.pose.section.jump_ns,
            heading_jumps=result.attitude.jumps,
        )
        return frame, 0.0
    heading_rad = level_cam_at(result.attitude.q_ned_frd_wxyz, CameraMount())[2]
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y, z = result.transform.translation_m
    model = transform_model(result.model, LevelTransform(heading_rad))
    at = (c * x - s * y, s * x + c * y, z)
    frame = TrackingFrame(
        model=model,
        camera_m=at,
        t_ns=result.t_exposure_ns,
        positioned=False,
        heading_jumps=result.attitude.jumps,
    )
    return frame, heading_rad


def rotated(tracks: TrackSnapshot, angle_rad: float) -> TrackSnapshot:
    """The tracks with their planes rotated about the vertical. Without a position there are no moving objects."""
    if angle_rad == 0.0:
        return tracks
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    given = tracks.planes.astype(np.float64)
    planes = given.copy()
    for k in (0, 2):
        planes[:, k] = c * given[:, k] - s * given[:, k + 1]
        planes[:, k + 1] = s * given[:, k] + c * given[:, k + 1]
    return dataclasses.replace(tracks, planes=planes.astype(np.float32))
