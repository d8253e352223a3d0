"""Conversion of ROS conventions, as pure functions.

REP 103: the world is ENU (x east, y north, z up), the body FLU (x forward, y left, z up), a camera's optical frame has
x right, y down, z forward. This software uses ned and frd. Hence R_ned_frd = R_ned_enu R_enu_flu R_flu_frd, a position
(x, y, z) in ENU is (y, x, -z) in ned, a rate (p, q, r) in FLU is (p, -q, -r) in frd. Frames whose name contains `ned`
or `frd` use these axes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.frames import R_CAMFRD_OPTICAL, Rotation, euler_from_rotation, quaternion_from_euler, rotation_from_quaternion
from core.types import CameraMount
from drivers.base import BadData

from .png import millimetres

R_NED_ENU: Rotation = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
R_FRD_FLU: Rotation = np.diag([1.0, -1.0, -1.0])
DEPTH_TYPES = {"16UC1": 2, "mono16": 2, "32FC1": 4}
"""Encoding -> bytes per pixel; the first two are millimetres, the last metres (REP 118)."""


@dataclass(frozen=True, slots=True, eq=False)
class Rigid:
    """p_parent = R p_child + t_m."""

    R: Rotation
    t_m: NDArray[np.float64]

    def then(self, child: Rigid) -> Rigid:
        """The transform from the source frame of `child` to the target frame of this one."""
        return Rigid(self.R @ child.R, self.R @ child.t_m + self.t_m)

    def inverse(self) -> Rigid:
        """The transform from parent to child."""
        return Rigid(self.R.T, -self.R.T @ self.t_m)


IDENTITY = Rigid(np.eye(3), np.zeros(3))


def rigid(translation: Any, rotation: Any) -> Rigid | None:
    """The transform of a geometry_msgs translation (or position) and quaternion; None when they are not finite or not a
    rotation."""
    t = np.array([translation.x, translation.y, translation.z], dtype=np.float64)
    R = rotation_from_message(rotation)
    return None if R is None or not np.isfinite(t).all() else Rigid(R, t)


def rotation_from_message(q: Any) -> Rotation | None:
    """(3, 3) rotation of a geometry_msgs quaternion; None when it is not a unit quaternion (all zero means "not
    given")."""
    return rotation_of_unit((q.w, q.x, q.y, q.z))


def rotation_of_unit(q_wxyz: tuple[float, float, float, float]) -> Rotation | None:
    """(3, 3) rotation; None when the numbers are not finite or not a unit quaternion."""
    return rotation_from_quaternion(q_wxyz) if 0.9 < math.hypot(*q_wxyz) < 1.1 else None


def to_ned(world_frame: str) -> Rotation:
    """R_ned_world: ENU unless a part of the frame's name is ned (`map_ned`, but not `aligned_map`)."""
    return np.eye(3) if "ned" in _name_parts(world_frame) else R_NED_ENU


def to_frd(body_frame: str) -> Rotation:
    """R_frd_body: FLU unless a part of the frame's name is frd (`base_link_frd`)."""
    return np.eye(3) if "frd" in _name_parts(body_frame) else R_FRD_FLU


def _name_parts(frame: str) -> list[str]:
    return re.split(r"[^a-z]+", frame.lower())


def quaternion_wxyz(R: Rotation) -> tuple[float, float, float, float]:
    """Unit quaternion of a rotation."""
    return quaternion_from_euler(*euler_from_rotation(R))


def triple(v: NDArray[np.float64]) -> tuple[float, float, float]:
    """The vector as a tuple."""
    return float(v[0]), float(v[1]), float(v[2])


def mount_of(base_from_optical: Rigid, base_frame: str) -> CameraMount:
    """The mount of a camera with this pose of its optical frame in the base frame."""
    to_body = to_frd(base_frame)
    roll, pitch, yaw = euler_from_rotation(to_body @ base_from_optical.R @ R_CAMFRD_OPTICAL.T)
    x, y, z = triple(to_body @ base_from_optical.t_m)
    return CameraMount(roll, pitch, yaw, x, y, z)


def rectified_camera(info: Any) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy, px, of the rectified image of a sensor_msgs/CameraInfo.

    K belongs to the raw image and P to the rectified one. Without distortion and rotation both images are one: K is taken,
    since some drivers leave P at default values."""
    rectified = any(abs(d) > 1e-6 for d in info.d) or np.abs(np.reshape(info.r, (3, 3)) - np.eye(3)).max() > 1e-6
    fx, _, cx, _, _, fy, cy, *_ = (float(v) for v in info.p)
    if rectified and fx > 0.0 and fy > 0.0:
        return fx, fy, cx, cy
    fx, _, cx, _, fy, cy, *_ = (float(v) for v in info.k)
    return fx, fy, cx, cy


def depth_from_image(message: Any) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres of a sensor_msgs/Image; UNKNOWN_MM where it holds no finite positive number or one out
    of range. Padded rows and swapped bytes are supported. Raises BadData."""
    size = DEPTH_TYPES.get(message.encoding)
    if size is None:
        raise BadData(f"image encoding {message.encoding!r}; expected 16UC1 (millimetres) or 32FC1 (metres)")
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = bytes(message.data)
    if step < width * size or len(data) < step * height or not width or not height:
        raise BadData(f"image of {width}x{height} {message.encoding} with rows of {step} bytes holds {len(data)} bytes")
    order = ">" if message.is_bigendian else "<"
    rows = np.frombuffer(data, np.uint8, step * height).reshape(height, step)[:, : width * size]
    pixels = np.ascontiguousarray(rows).view(f"{order}u2" if size == 2 else f"{order}f4")
    return millimetres(pixels, 1.0 if size == 2 else 1000.0)


class TransformTree:
    """The newest transform of each frame to its parent, from /tf and /tf_static."""

    def __init__(self) -> None:
        self._up: dict[str, tuple[str, Rigid]] = {}

    def add(self, parent: str, child: str, transform: Rigid) -> None:
        """Sets the transform of the child."""
        self._up[child.lstrip("/")] = (parent.lstrip("/"), transform)

    @property
    def frames(self) -> list[str]:
        """All frames with a parent."""
        return sorted(self._up)

    def root_from(self, frame: str) -> tuple[str, Rigid]:
        """(root, transform from the frame to the root)."""
        total, at, seen = IDENTITY, frame.lstrip("/"), set[str]()
        while at in self._up and at not in seen:
            seen.add(at)
            at, up = self._up[at][0], self._up[at][1]
            total = up.then(total)
        return at, total

    def between(self, target: str, source: str) -> Rigid | None:
        """p_target = R p_source + t; None when no chain connects the frames."""
        if target.lstrip("/") == source.lstrip("/"):
            return IDENTITY
        target_root, target_up = self.root_from(target)
        source_root, source_up = self.root_from(source)
        return target_up.inverse().then(source_up) if target_root == source_root else None
