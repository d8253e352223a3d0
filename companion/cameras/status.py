"""The state of a camera, as its supervisor reports it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from core.types import CameraInfo


class CameraCondition(StrEnum):
    """Condition of a camera."""

    STARTING = "starting"
    RUNNING = "running"
    SILENT = "silent"
    FROZEN = "frozen"
    LOST = "lost"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStatus:
    """State of a camera."""

    camera: str
    condition: CameraCondition
    cause: str  # why it does not run
    since_ns: int  # time of the last change of condition
    frames: int = 0
    dropped: int = 0
    starts: int = 0
    last_loss: str = ""  # cause of the last restart
    last_loss_ns: int | None = None  # time of that cause, None: none yet
    last_arrival_ns: int | None = None
    info: CameraInfo | None = None
    notice: str = ""  # `DepthSource.notice` of the opened camera
    alive_ns: int = 0
