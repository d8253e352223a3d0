"""Conversion from the frames of the service to those of ROS (REP 103, REP 105).

The frames of the service have z down (docs/reference/frames.md); those of ROS have z up:

| ROS                   | axes                | of the service |
|-----------------------|---------------------|----------------|
| map                   | east, north, up     | ned            |
| base_stabilized       | forward, left, up   | level          |
| base_link             | forward, left, up   | frd            |
| CAMERA_optical_frame  | right, down, forward| optical        |

Origins are the same. Each conversion of the axes is its own inverse."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.frames import quaternion_from_euler
from core.types import CameraMount

from ..log.foxglove_scene import Q_CAMFRD_OPTICAL
from ..pipeline.quaternion import Quaternion, Vector, normalised, product, split_heading

MAP: Final = "map"
BASE_STABILIZED: Final = "base_stabilized"
BASE_LINK: Final = "base_link"

R_ENU_NED: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
R_FLU_FRD: Final = np.diag([1.0, -1.0, -1.0])
_Q_ENU_NED: Final[Quaternion] = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
_Q_FLU_FRD: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class FrameTransform:
    """Pose of the frame `child` in the frame `parent`: p_parent = R(q_wxyz) p_child + translation_m."""

    parent: str
    child: str
    translation_m: Vector
    q_wxyz: Quaternion


def frame_id(frame: str) -> str:
    """The ROS frame of a message's frame. Raises ValueError for a frame other than ned and level."""
    if frame == "ned":
        return MAP
    if frame == "level":
        return BASE_STABILIZED
    raise ValueError(f"frame {frame!r}, expected ned or level; is the message damaged?")


def ros_points(points_m: NDArray[np.floating], frame: str) -> NDArray[np.float64]:
    """(N, 3) points of the frame ned or level in the axes of its ROS frame, m. Raises ValueError for another frame."""
    R = R_ENU_NED if frame_id(frame) == MAP else R_FLU_FRD
    points: NDArray[np.float64] = points_m.astype(np.float64) @ R.T
    return points


def vehicle_transforms(q_ned_frd_wxyz: Quaternion, position_ned_m: Vector | None) -> tuple[FrameTransform, ...]:
    """map -> base_stabilized -> base_link at an attitude and a position; without a position base_stabilized -> base_link.

    base_stabilized has the heading of the vehicle and no roll or pitch."""
    q_ned_level, q_level_frd = split_heading(normalised(q_ned_frd_wxyz))
    tilt = FrameTransform(BASE_STABILIZED, BASE_LINK, (0.0, 0.0, 0.0), _flu_axes(q_level_frd))
    if position_ned_m is None:
        return (tilt,)
    north_m, east_m, down_m = position_ned_m
    q_map_stabilized = product(product(_Q_ENU_NED, q_ned_level), _Q_FLU_FRD)
    return FrameTransform(MAP, BASE_STABILIZED, (east_m, north_m, -down_m), q_map_stabilized), tilt


def camera_transform(mount: CameraMount, optical_frame: str) -> FrameTransform:
    """base_link -> the optical frame of a mounted camera."""
    q_frd_camfrd = quaternion_from_euler(mount.roll_rad, mount.pitch_rad, mount.yaw_rad)
    q_flu_optical = product(product(_Q_FLU_FRD, q_frd_camfrd), Q_CAMFRD_OPTICAL)
    return FrameTransform(BASE_LINK, optical_frame, (mount.x_m, -mount.y_m, -mount.z_m), q_flu_optical)


def _flu_axes(q_frd_frd: Quaternion) -> Quaternion:
    """A rotation between two frames with axes forward, right, down as one between frames with forward, left, up."""
    return product(product(_Q_FLU_FRD, q_frd_frd), _Q_FLU_FRD)
