"""The content that the viewer draws of one frame, from a log or from the pipeline."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.frames import Rotation, euler_from_rotation, level_from_level_cam, rotation_frd_optical
from core.frames import rotation_level_cam_optical as level_cam_optical
from core.types import CameraInfo, FrameModel, readonly

SPREAD: Final = 5
"""Number of drawn frames that are spread evenly over a log."""


class FrameStatus(StrEnum):
    """State of a frame for drawing."""

    VALID = "VALID"
    BLIND = "BLIND"
    NO_PRISMS = "NO PRISMS"
    """The log contains the depth image but no results."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ViewFrame:
    """One frame of one camera."""

    info: CameraInfo
    sequence: int
    t_ns: int
    depth_mm: NDArray[np.uint16] | None = None  # (H, W) uint16 as in DepthFrame; None: not in the log
    R_ned_frd: Rotation | None = None  # (3, 3) attitude used; None: none
    model: FrameModel | None = None  # in level_cam; None: not in the log
    dropped: str = ""  # cause if the frame was not used, "": used
    position_ned_m: tuple[float, float, float] | None = None  # of the vehicle; None: no position
    autopilot: dict[str, Any] | None = None  # its newest state, see autopilot_view
    tracks: dict[str, Any] | None = None  # the tracked obstacles, see viewer.tracks; None: not in the log

    def __post_init__(self) -> None:
        k = self.info.intrinsics
        if self.depth_mm is not None:
            object.__setattr__(self, "depth_mm", readonly(self.depth_mm, np.uint16, (k.height, k.width), "depth_mm"))
        if self.model is not None and self.R_ned_frd is None:
            raise ValueError(f"frame {self.sequence} of {self.info.camera}: a model without its attitude")

    @property
    def status(self) -> FrameStatus:
        """BLIND has precedence: a dropped frame is invalid even where the log contains no prisms."""
        if self.dropped or (self.model is not None and not self.model.valid):
            return FrameStatus.BLIND
        return FrameStatus.VALID if self.model is not None else FrameStatus.NO_PRISMS

    @property
    def cause(self) -> str:
        """Why the frame is blind, as text; "" if it is not."""
        if self.dropped:
            return f"frame not used: {self.dropped}"
        if self.model is not None and not self.model.valid:
            return self.model.cause.text or "no cause given"
        return ""

    @property
    def R_level_cam_optical(self) -> Rotation | None:
        """(3, 3); None without an attitude."""
        if self.R_ned_frd is None:
            return None
        return level_cam_optical(self.R_ned_frd @ rotation_frd_optical(self.info.mount))

    @property
    def level_from_level_cam(self) -> tuple[float, NDArray[np.float64]]:
        """(yaw_rad, t_m) of p_level = Rz(yaw) p_level_cam + t; identity without an attitude."""
        if self.R_ned_frd is None:
            return 0.0, np.zeros(3)
        return level_from_level_cam(self.R_ned_frd, self.info.mount)

    @property
    def attitude_deg(self) -> tuple[float, float, float] | None:
        """(roll, pitch, yaw) of the vehicle, degrees, with MAVLink's signs."""
        if self.R_ned_frd is None:
            return None
        roll, pitch, yaw = euler_from_rotation(self.R_ned_frd)
        return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)

    @property
    def heading_rad(self) -> float:
        """Heading of the vehicle, that of `level`; 0 without an attitude."""
        return 0.0 if self.R_ned_frd is None else euler_from_rotation(self.R_ned_frd)[2]

    @property
    def ke_per_m(self) -> float | None:
        """Depth noise used for the frame; None for an invalid frame."""
        return self.model.ke_per_m if self.model is not None and self.model.valid else None


def describe(frame: ViewFrame, t_start_ns: int) -> tuple[str, str]:
    """Two header lines: camera, time and attitude, and the result."""
    who = f"{frame.info.camera}   frame {frame.sequence}   t = {(frame.t_ns - t_start_ns) / 1e9:.2f} s"
    if frame.attitude_deg is None:
        who += "   attitude: none"
    else:
        roll, pitch, yaw = frame.attitude_deg
        who += f"   roll {roll:+.1f}°  pitch {pitch:+.1f}°  yaw {yaw:+.1f}°"
    return who, describe_model(frame.model)


def describe_model(model: FrameModel | None) -> str:
    """The result in one line."""
    if model is None:
        return "no prisms in this log: run `companion replay` first"
    ground = f"ground {model.ground.height_m:.2f} m below" if model.ground.seen else "no ground found"
    s = model.stats
    return (
        f"planes: {len(model.planes)}   clusters: {s.clusters}   prisms: {len(model.prisms)}   strips: {s.strips}   "
        f"{ground}   measured {s.measured_share:.0%}  unknown {s.unknown_share:.0%}  far {s.far_share:.0%}"
    )


def select_frames(counts: list[int], blind: list[bool]) -> list[int]:
    """Indices of the frames to draw: SPREAD frames evenly over the log, the one with most planes and the first blind
    one.

    counts: number of planes per frame; blind: whether each frame is blind. Sorted and unique; empty without frames."""
    n = len(counts)
    if n == 0:
        return []
    chosen = {round(k * (n - 1) / (SPREAD - 1)) for k in range(SPREAD)}
    chosen.add(max(range(n), key=lambda k: counts[k]))
    chosen.update([blind.index(True)] if True in blind else [])
    return sorted(chosen)
