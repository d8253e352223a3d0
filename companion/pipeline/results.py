"""Outputs of the pipeline for each frame: the decision whether it is used, and its result."""

from __future__ import annotations

from dataclasses import dataclass

from core.self_check.mount_check import MountState
from core.types import FrameModel, InvalidCause

from .sync import AttitudeAt, DropCause, PoseAt, Source
from .transform import LevelTransform


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameDecision:
    """Decision whether a frame is used, with the cause if it is not."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    cause: DropCause
    attitude: Source = Source.NONE
    attitude_cutoff_ns: int | None = None  # stamp of the newest attitude that had arrived
    pose: Source = Source.NONE
    pose_text: str = ""

    @property
    def used(self) -> bool:
        """Whether the frame was extracted."""
        return self.cause is DropCause.NONE


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PrismsResult:
    """The result of one frame in `frame` ("level" or "ned"). model None: the frame was dropped for the cause `drop`."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    frame: str
    drop: DropCause
    model: FrameModel | None
    attitude: AttitudeAt | None = None
    pose: PoseAt | None = None
    transform: LevelTransform | None = None
    mount: MountState | None = None
    """State of the mount check after this frame; None: the frame was dropped."""

    @property
    def valid(self) -> bool:
        """Whether the model may be used; False: the frame is blind."""
        return self.model is not None and self.model.valid

    @property
    def cause(self) -> DropCause | InvalidCause:
        """Cause of an invalid result; NONE for a valid one."""
        return self.drop if self.model is None else self.model.cause

    @property
    def cause_text(self) -> str:
        """The text of `cause`; empty for a valid result."""
        return self.cause.text


Output = FrameDecision | PrismsResult
