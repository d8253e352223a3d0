"""Assembles the frames of a log: depth, attitude, decision and prisms of each exposure."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_from_quaternion
from core.types import CameraInfo, DepthFrame, ExtractorState
from drivers.base import BadData, Event
from drivers.logs.reader import LoggedMessage, McapRecording
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import prisms_from_message
from ..pipeline.results import PrismsResult
from ..pipeline.state_messages import state_from_message
from ..pipeline.transform import transform_model
from .autopilot_view import autopilot_data
from .frame import FrameStatus, ViewFrame
from .tracks import tracks_data

TRACKS_WAITING: Final = 4
"""Largest number of frames with prisms that wait for their tracks, which the log contains after them."""
WAITING: Final = 30
"""Largest number of depth images that wait for their prisms; a live log writes both within a fraction of a second."""

Key = tuple[str, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class LoggedFrame:
    """The log's messages of one exposure, not yet decoded."""

    info: CameraInfo
    sequence: int
    t_ns: int
    # depth_mm, message: None if missing
    depth_mm: NDArray[np.uint16] | None
    message: pb.PrismsFrame | None
    state: ExtractorState  # state of the extractor before the frame, from which its strips can be recomputed
    health: pb.Health | None = None  # the newest report of the service before it
    tracks: pb.Tracks | None = None  # the tracked obstacles after it

    @property
    def status(self) -> FrameStatus:
        """As ViewFrame.status, without decoding."""
        if self.message is None:
            return FrameStatus.NO_PRISMS
        return FrameStatus.VALID if self.message.valid else FrameStatus.BLIND

    @property
    def plane_count(self) -> int:
        """Number of planes, without decoding."""
        return 0 if self.message is None else len(self.message.planes.margin_m)

    def frame(self) -> ViewFrame:
        """The decoded frame. Raises ValueError for inconsistent prisms."""
        if self.message is None:
            return ViewFrame(info=self.info, sequence=self.sequence, t_ns=self.t_ns, depth_mm=self.depth_mm)
        frame = view_frame(prisms_from_message(self.message), self.info, self.depth_mm)
        tracks = None if self.tracks is None else tracks_data(self.tracks, frame.heading_rad, frame.position_ned_m)
        return replace(frame, autopilot=autopilot_data(self.health, self.t_ns), tracks=tracks)


@dataclass(slots=True)
class _Pass:
    """State of one pass over a log."""

    infos: dict[str, CameraInfo]
    states: dict[str, ExtractorState]
    waiting: OrderedDict[Key, NDArray[np.uint16]] = field(default_factory=OrderedDict)
    untracked: OrderedDict[Key, LoggedFrame] = field(default_factory=OrderedDict)
    health: pb.Health | None = None

    def take(self, item: Event | LoggedMessage) -> Iterator[LoggedFrame]:
        """The frames that are complete with this item."""
        if isinstance(item, DepthFrame):
            self.waiting[item.camera, item.sequence, item.t_exposure_ns] = item.depth_mm
            if len(self.waiting) > WAITING:
                yield from self.all_untracked()
                yield self.alone(next(iter(self.waiting)))
        elif isinstance(item, LoggedMessage):
            if isinstance(item.message, pb.FrameDecision):
                self.decision(item.message)
            elif isinstance(item.message, pb.Health):
                self.health = item.message
            elif isinstance(item.message, pb.PrismsFrame) and item.message.camera in self.infos:
                yield from self.prisms(item.message)
            elif isinstance(item.message, pb.Tracks):
                yield from self.tracks(item.message)

    def alone(self, key: Key) -> LoggedFrame:
        """The frame of a depth image without results."""
        camera, sequence, t_ns = key
        return LoggedFrame(self.infos[camera], sequence, t_ns, self.waiting.pop(key), None, ExtractorState())

    def decision(self, message: pb.FrameDecision) -> None:
        """Discards a frame that the pipeline skipped because its exposure or a newer one had been handled."""
        if message.cause in (pb.CAUSE_DUPLICATE_FRAME, pb.CAUSE_LATE_FRAME):
            self.waiting.pop((message.camera, message.sequence, message.t_exposure_ns), None)

    def prisms(self, message: pb.PrismsFrame) -> Iterator[LoggedFrame]:
        """Adds a frame with its results, which waits for its tracks."""
        camera, sequence, t_ns = key = message.camera, message.sequence, message.t_exposure_ns
        before = self.states.get(camera, ExtractorState())
        self.states[camera] = _after(message, before)
        self.untracked[key] = LoggedFrame(
            self.infos[camera], sequence, t_ns, self.waiting.pop(key, None), message, before, self.health
        )
        if len(self.untracked) > TRACKS_WAITING:
            yield self.untracked.popitem(last=False)[1]

    def tracks(self, message: pb.Tracks) -> Iterator[LoggedFrame]:
        """The waiting frames up to that of the tracks."""
        key = message.camera, message.sequence, message.t_exposure_ns
        while key in self.untracked:
            first, frame = self.untracked.popitem(last=False)
            yield replace(frame, tracks=message) if first == key else frame

    def all_untracked(self) -> Iterator[LoggedFrame]:
        """The waiting frames, without tracks."""
        while self.untracked:
            yield self.untracked.popitem(last=False)[1]


def view_frame(result: PrismsResult, info: CameraInfo, depth_mm: NDArray[np.uint16] | None) -> ViewFrame:
    """The viewer's frame of a pipeline result."""
    model = result.model
    if model is not None and result.transform is not None:
        model = transform_model(model, result.transform.inverse())
    k = info.intrinsics
    fits = depth_mm is not None and depth_mm.shape == (k.height, k.width)
    return ViewFrame(
        info=info,
        sequence=result.sequence,
        t_ns=result.t_exposure_ns,
        depth_mm=depth_mm if fits else None,
        R_ned_frd=None if result.attitude is None else rotation_from_quaternion(result.attitude.q_ned_frd_wxyz),
        model=model,
        dropped="" if model is not None else result.cause_text or "no cause reported",
        position_ned_m=None if result.pose is None else result.pose.position_ned_m,
    )


def _after(message: pb.PrismsFrame, before: ExtractorState) -> ExtractorState:
    """The state before the next frame; an invalid frame leaves it unchanged."""
    if not message.valid:
        return before
    height = message.ground.height_m if message.ground.seen else before.ground_height_m
    return ExtractorState(height, message.ke_per_m)


def read_frames(
    source: McapRecording, on_progress: Callable[[float], None] = lambda share: None
) -> Iterator[LoggedFrame]:
    """The frames of a log in order; each call starts a new pass. Raises BadData at the end for a damaged or unusable
    log, after all readable frames."""
    state = state_from_message(source.snapshot) if source.snapshot is not None else None
    states = {} if state is None else {name: camera.extractor for name, camera in state.cameras}
    now = _Pass({info.camera: info for info in source.cameras}, states)
    problem: BadData | None = None
    try:
        for item in source.events_with("decision", "prisms", "health", "tracks"):
            on_progress(source.share_read)
            yield from now.take(item)
    except BadData as error:
        problem = error
    yield from now.all_untracked()
    for key in tuple(now.waiting):
        yield now.alone(key)
    if problem is not None:
        raise problem
