"""The frames of a log for the viewer: depth, attitude, decision and prisms of each exposure put together."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_from_quaternion
from core.types import CameraInfo, DepthFrame, ExtractorState
from drivers.base import BadData, Event
from drivers.mcap_file import LoggedMessage, McapRecording
from drivers.proto import osape_v1_pb2 as pb

from .messages import prisms_from_message, state_from_message
from .pipeline import PrismsResult
from .reframe import reframed
from .view_frame import ViewFrame

WAITING: Final = 30
"""Depth images that may wait for their prisms; a live log writes both within a fraction of a second."""

Key = tuple[str, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class LoggedFrame:
    """A frame and the extractor state it was begun with, which says how to find its strips again."""

    frame: ViewFrame
    state: ExtractorState


@dataclass(slots=True)
class _Pass:
    """What one pass over a log remembers."""

    infos: dict[str, CameraInfo]
    states: dict[str, ExtractorState]
    waiting: OrderedDict[Key, NDArray[np.uint16]] = field(default_factory=OrderedDict)

    def take(self, item: Event | LoggedMessage) -> Iterator[LoggedFrame]:
        """The frames that are complete with this item. Raises ValueError for prisms that do not fit."""
        if isinstance(item, DepthFrame):
            yield from self.depth(item)
        elif isinstance(item, LoggedMessage):
            if isinstance(item.message, pb.FrameDecision):
                self.decision(item.message)
            elif isinstance(item.message, pb.PrismsFrame):
                yield from self.prisms(prisms_from_message(item.message))

    def depth(self, event: DepthFrame) -> Iterator[LoggedFrame]:
        self.waiting[event.camera, event.sequence, event.t_exposure_ns] = event.depth_mm
        if len(self.waiting) > WAITING:
            yield from self.alone(next(iter(self.waiting)))

    def alone(self, key: Key) -> Iterator[LoggedFrame]:
        """A depth image that nothing was extracted from."""
        camera, sequence, t_ns = key
        depth = self.waiting.pop(key, None)
        if depth is not None:
            frame = ViewFrame(info=self.infos[camera], sequence=sequence, t_ns=t_ns, depth_mm=depth)
            yield LoggedFrame(frame, ExtractorState())

    def decision(self, message: pb.FrameDecision) -> None:
        """A frame passed over because its exposure or a newer one had been handled is none of the flight's frames."""
        if message.cause in (pb.CAUSE_DUPLICATE_FRAME, pb.CAUSE_LATE_FRAME):
            self.waiting.pop((message.camera, message.sequence, message.t_exposure_ns), None)

    def prisms(self, result: PrismsResult) -> Iterator[LoggedFrame]:
        info = self.infos.get(result.camera)
        if info is None:
            return
        key = (result.camera, result.sequence, result.t_exposure_ns)
        before = self.states.get(result.camera, ExtractorState())
        yield LoggedFrame(view_frame(result, info, self.waiting.pop(key, None)), before)
        self.states[result.camera] = _after(result, before)


def view_frame(result: PrismsResult, info: CameraInfo, depth_mm: NDArray[np.uint16] | None) -> ViewFrame:
    """The viewer's frame of what the pipeline said of one exposure."""
    model = result.model
    if model is not None and result.transform is not None:
        model = reframed(model, result.transform.inverse())
    k = info.intrinsics
    fits = depth_mm is not None and depth_mm.shape == (k.height, k.width)
    return ViewFrame(
        info=info,
        sequence=result.sequence,
        t_ns=result.t_exposure_ns,
        depth_mm=depth_mm if fits else None,
        R_ned_frd=None if result.attitude is None else rotation_from_quaternion(result.attitude.q_ned_frd_wxyz),
        model=model,
        dropped="" if model is not None else result.cause_text or "no cause given",
        position_ned_m=None if result.pose is None else result.pose.position_ned_m,
    )


def _after(result: PrismsResult, before: ExtractorState) -> ExtractorState:
    """The state the next frame begins with: a frame that says nothing hands on what it got."""
    if result.model is None or not result.model.valid:
        return before
    ground = result.model.ground
    height = ground.height_m if ground.seen and math.isfinite(ground.height_m) else before.ground_height_m
    return ExtractorState(height, result.model.ke_per_m)


def read_frames(
    source: McapRecording, on_progress: Callable[[float], None] = lambda share: None
) -> Iterator[LoggedFrame]:
    """The frames of a log in its order; each pass begins anew. Raises BadData at the end where the log is damaged or
    holds what cannot be used, after all that was readable."""
    state = state_from_message(source.snapshot) if source.snapshot is not None else None
    states = {} if state is None else {name: camera.extractor for name, camera in state.cameras}
    now = _Pass({info.camera: info for info in source.cameras}, states)
    problem: BadData | None = None
    try:
        for item in source.events_with("decision", "prisms"):
            on_progress(source.share_read)
            try:
                yield from now.take(item)
            except ValueError as error:
                problem = problem or BadData(f"{source.path}: prisms that cannot be used were left out: {error}")
    except BadData as error:
        problem = error
    for key in tuple(now.waiting):
        yield from now.alone(key)
    if problem is not None:
        raise problem
