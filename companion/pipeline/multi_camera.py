"""The newest results of all cameras as one model in one frame at one instant.

Each result is levelled at its own exposure. The common frame is ned where every result has a position of the same
section of the autopilot's estimate. Otherwise it is level at the newest exposure: the rotation of the vehicle between
the exposures is removed, its translation is not. The reader corrects for the translation with the exposure time of each
camera.

Results are not fused: an obstacle of one camera remains, whatever another camera reports as free."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from core.frames import rotation_from_quaternion
from osape_client.proto import osape_v1_pb2 as pb

from .encode import SCHEMA_VERSION, blind_message, prisms_message
from .results import PrismsResult
from .transform import LevelTransform, transform_model

HEADING_LOST: Final = "the heading may have jumped in a gap of the attitude since its newest frame"
"""Cause for which a frame is not used that can no longer be rotated into the vehicle's present heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnavailableCamera:
    """A camera without a usable frame: none of its directions is free, and none of its planes is kept."""

    camera: str
    sequence: int
    t_exposure_ns: int
    cause_text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class AllCamerasModel:
    """One model of all cameras."""

    t_ns: int  # the newest usable exposure, 0: none
    frame: str  # of all parts
    parts: tuple[PrismsResult | UnavailableCamera, ...]  # one per camera, in the order of the configuration

    def valid(self, required: frozenset[str]) -> bool:
        """Whether at least one camera and every required camera has a usable frame."""
        available = {part.camera for part in self.parts if isinstance(part, PrismsResult)}
        return bool(available) and required <= available


class AllCamerasModelBuilder:
    """Keeps the newest result of each camera. cameras: all of them; a camera without a result is unavailable."""

    def __init__(self, cameras: tuple[str, ...]) -> None:
        self._cameras = cameras
        self._newest: dict[str, PrismsResult] = {}

    def result(self, result: PrismsResult) -> None:
        """Adds the result of a frame, valid or not."""
        self._newest[result.camera] = result

    def model(self, blind: Callable[[str], str], oldest_ns: int = 0) -> AllCamerasModel:
        """The present model. blind: returns the cause why a camera is blind, "" if it is not.

        Results exposed before oldest_ns are not used, whatever `blind` returns: it may refer to a newer frame whose
        result has not arrived yet."""
        causes = {camera: blind(camera) for camera in self._cameras}
        available = [self._newest[c] for c in self._cameras if not causes[c] and self._is_available(c, oldest_ns)]
        gap_ns = max((_gap_ns(r) for r in available), default=0)
        for result in available:
            if _gap_ns(result) != gap_ns:
                causes[result.camera] = HEADING_LOST
        available = [r for r in available if _gap_ns(r) == gap_ns]
        frame, target = common_frame(available)
        parts: list[PrismsResult | UnavailableCamera] = []
        for camera in self._cameras:
            newest = self._newest.get(camera)
            if newest is not None and newest in available:
                parts.append(to_common_frame(newest, frame, target))
                continue
            cause = causes[camera] or (
                "no frame yet" if newest is None else newest.cause_text or "its newest frame is too old"
            )
            sequence, t_ns = (0, 0) if newest is None else (newest.sequence, newest.t_exposure_ns)
            parts.append(UnavailableCamera(camera=camera, sequence=sequence, t_exposure_ns=t_ns, cause_text=cause))
        newest_ns = max((r.t_exposure_ns for r in available), default=0)
        return AllCamerasModel(t_ns=newest_ns, frame=frame, parts=tuple(parts))

    def _is_available(self, camera: str, oldest_ns: int) -> bool:
        newest = self._newest.get(camera)
        return newest is not None and newest.valid and newest.t_exposure_ns >= oldest_ns


def common_frame(results: list[PrismsResult]) -> tuple[str, float]:
    """("ned", 0) where all results are in one section of ned; otherwise ("level", heading of the newest exposure, rad, by
    the estimate before its first jump)."""
    sections = {_section(r) for r in results}
    if len(sections) == 1 and None not in sections and all(r.frame == "ned" for r in results):
        return "ned", 0.0
    newest = max(results, key=lambda r: r.t_exposure_ns, default=None)
    return "level", 0.0 if newest is None else heading_rad(newest) - _turned_rad(newest)


def _section(result: PrismsResult) -> tuple[int, int, int] | None:
    """What changes when the estimate of position or heading jumps; None: no position."""
    if result.pose is None or result.attitude is None:
        return None
    return result.pose.reset_counter, result.pose.section.number, result.attitude.jump_ns


def _gap_ns(result: PrismsResult) -> int:
    """The newest gap of the attitude before a result. Across it the turn of the vehicle is not known."""
    return 0 if result.attitude is None else result.attitude.gap_ns


def _turned_rad(result: PrismsResult) -> float:
    """The jumps of the heading that are in a result's attitude, clockwise: the vehicle has not turned by them."""
    return 0.0 if result.attitude is None else result.attitude.turned_rad


def heading_rad(result: PrismsResult) -> float:
    """Heading of the vehicle at the exposure, rad, clockwise from north. Raises ValueError for a result without an
    attitude."""
    if result.attitude is None:
        raise ValueError(f"camera {result.camera}: a result without an attitude cannot be rotated")
    R_ned_frd = rotation_from_quaternion(result.attitude.q_ned_frd_wxyz)
    return math.atan2(float(R_ned_frd[1, 0]), float(R_ned_frd[0, 0]))


def to_common_frame(result: PrismsResult, frame: str, target_heading_rad: float) -> PrismsResult:
    """The result in the common frame; the same object where it is in that frame already. target_heading_rad: of
    `common_frame`."""
    target_heading_rad += _turned_rad(result)
    if result.frame == frame and (frame == "ned" or heading_rad(result) == target_heading_rad):
        return result
    step = transform_to_level(result, target_heading_rad)
    assert result.model is not None
    assert result.transform is not None
    return replace(
        result,
        frame="level",
        model=transform_model(result.model, step),
        transform=compose(step, result.transform),
        pose=None,
    )


def transform_to_level(result: PrismsResult, target_heading_rad: float) -> LevelTransform:
    """The transform from the result's frame to level with another heading; out of ned by the result's own position."""
    if result.frame == "ned":
        if result.pose is None:
            raise ValueError(f"camera {result.camera}: a result in ned without a position cannot be transformed")
        x, y, z = result.pose.position_ned_m
        return LevelTransform(target_heading_rad, (x, y, z)).inverse()
    return LevelTransform(math.remainder(heading_rad(result) - target_heading_rad, math.tau))


def compose(second: LevelTransform, first: LevelTransform) -> LevelTransform:
    """The transform that applies first, then second."""
    c, s = math.cos(second.yaw_rad), math.sin(second.yaw_rad)
    x, y, z = first.translation_m
    tx, ty, tz = second.translation_m
    return LevelTransform(second.yaw_rad + first.yaw_rad, (c * x - s * y + tx, s * x + c * y + ty, z + tz))


def all_cameras_message(surround: AllCamerasModel, required: frozenset[str]) -> pb.SurroundFrame:
    """The message for the stream. required: cameras without which the model is invalid."""
    message = pb.SurroundFrame(
        schema_version=SCHEMA_VERSION, t_ns=surround.t_ns, frame=surround.frame, valid=surround.valid(required)
    )
    for part in surround.parts:
        if isinstance(part, UnavailableCamera):
            message.cameras.append(blind_message(part.camera, part.sequence, part.t_exposure_ns, part.cause_text))
        else:
            message.cameras.append(prisms_message(part))
    return message
