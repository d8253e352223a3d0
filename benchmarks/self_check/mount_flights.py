"""Flights with a wrongly configured mount through the pipeline, compared with the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.fidelity.free_truth import in_free
from benchmarks.fidelity.metrics import MISSED_M
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import quaternion_from_euler, rotation_frd_optical, rotation_from_euler
from core.self_check.mount_check import MountVerdict
from core.self_check.mount_params import MountCheckParams
from core.types import AttitudeSample, CameraInfo, CameraMount, DepthFrame
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import TYPICAL, SensorModel, measure
from drivers.simulation.source import Truth, camera_info, look

Floats = NDArray[np.float64]
NS = 1_000_000_000
START_NS = 10 * NS


@dataclass(frozen=True, slots=True)
class Pose:
    """The vehicle at one exposure: position in ned, m, and roll, pitch, yaw in rad."""

    position_m: tuple[float, float, float]
    euler_rad: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Configured minus true, in degrees, of the camera's mount."""

    roll_deg: float = 0.0
    pitch_deg: float = 0.0

    def __str__(self) -> str:
        return f"roll {self.roll_deg:+g}, pitch {self.pitch_deg:+g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """What came of one frame. false_free: share of the obstacle rays whose true point lies in what is called free."""

    t_s: float
    valid: bool
    cause: str
    verdict: MountVerdict
    error_deg: tuple[float, float]
    false_free: float


Rates = tuple[float, float, float]


class MountFlight:
    """A camera in a scene with a wrongly configured mount. true: the mount used for rendering."""

    def __init__(
        self,
        scene: Scene,
        errors: Errors,
        *,
        width: int = 320,
        true: CameraMount | None = None,
        ke_per_m: float = 0.0015,
        seed: int = 0,
        frame_hz: float = 10.0,
        check: MountCheckParams | None = None,
    ) -> None:
        self._scene, self._seed, self._frame_hz = scene, seed, frame_hz
        info = camera_info(width, width * 3 // 4, ke_per_m=ke_per_m)
        self._true = true or CameraMount()
        configured = replace(
            self._true,
            roll_rad=self._true.roll_rad + math.radians(errors.roll_deg),
            pitch_rad=self._true.pitch_rad + math.radians(errors.pitch_deg),
        )
        self.info: CameraInfo = replace(info, mount=configured)
        self._sensor: SensorModel = replace(TYPICAL.scaled_to(width), ke_per_m=ke_per_m)
        self.pipeline = Pipeline((self.info,), lambda info: Extractor(), mount_check=check)
        self._looked: tuple[Pose, Truth] | None = None

    def fly(self, poses: Sequence[Pose], judge: bool = True) -> list[Frame]:
        """A frame at each pose. judge: compare what is free with the truth."""
        rates = [body_rates_rad_s(poses[max(0, i - 1) : i + 2], self._frame_hz) for i in range(len(poses))]
        return [self._frame(i, pose, rates[i], judge) for i, pose in enumerate(poses)]

    def _frame(self, i: int, pose: Pose, rates_rad_s: Rates, judge: bool) -> Frame:
        t_ns = START_NS + round(i / self._frame_hz * NS)
        q = quaternion_from_euler(*pose.euler_rad)
        for dt_ns in (-NS // 100, NS // 100):
            self.pipeline.handle(AttitudeSample(t_ns + dt_ns, t_ns + dt_ns, q, rates_rad_s))
        truth = self._truth(pose)
        depth = measure(truth.depth_m, self.info, self._sensor, self._seed, i)
        frame = DepthFrame(camera="front", sequence=i, t_exposure_ns=t_ns, t_arrival_ns=t_ns + NS // 50, depth_mm=depth)
        result = self.pipeline.handle(frame)[-1]
        assert isinstance(result, PrismsResult)
        assert result.mount is not None
        error = tuple(math.degrees(v) for v in result.mount.error_rad)
        wrong = self._false_free(result, truth, pose) if judge and result.valid else 0.0
        return Frame(
            t_s=i / self._frame_hz,
            valid=result.valid,
            cause=result.cause_text,
            verdict=result.mount.verdict,
            error_deg=(error[0], error[1]),
            false_free=wrong,
        )

    def _truth(self, pose: Pose) -> Truth:
        if self._looked is None or self._looked[0] != pose:  # a vehicle that stands still sees the same again
            R = rotation_from_euler(*pose.euler_rad) @ rotation_frd_optical(self._true)
            self._looked = pose, look(self._scene, self.info, R, np.array(pose.position_m))
        return self._looked[1]

    def _false_free(self, result: PrismsResult, truth: Truth, pose: Pose) -> float:
        """In the published frame, level with the vehicle's heading: the camera has no lever arm here."""
        assert result.model is not None
        obstacle = truth.obstacle()
        sigma = self.info.ke_per_m * truth.depth_m**2
        obstacle &= truth.depth_m < self.info.max_range_m - 3.0 * sigma
        if not obstacle.any():
            return 0.0
        R = rotation_from_euler(*pose.euler_rad) @ rotation_frd_optical(self._true)
        heading = math.atan2(R[1, 2], R[0, 2]) - pose.euler_rad[2]
        points = truth.points_level_cam_m[obstacle] @ rotation_from_euler(0.0, 0.0, heading).T
        slack = np.fmax(MISSED_M, 2.0 * sigma[obstacle])
        return float(in_free(result.model.free, points, slack).mean())


def body_rates_rad_s(poses: Sequence[Pose], hz: float) -> Rates:
    """Mean body rates (frd) from the first to the last of successive poses, hz of them a second. Turns that the rates do not
    explain would count as jumps of the heading."""
    if len(poses) < 2:
        return 0.0, 0.0, 0.0
    first, last = (Rotation.from_matrix(rotation_from_euler(*p.euler_rad)) for p in (poses[0], poses[-1]))
    x, y, z = (first.inv() * last).as_rotvec() * hz / (len(poses) - 1)
    return float(x), float(y), float(z)


def hover(position_m: tuple[float, float, float], yaw_rad: float, frames: int) -> list[Pose]:
    """The same pose again and again."""
    return [Pose(position_m, (0.0, 0.0, yaw_rad))] * frames


def turning(
    position_m: tuple[float, float, float],
    yaw_rad: float,
    *,
    turn_deg: float = 90.0,
    seconds: float = 10.0,
    hz: float = 10.0,
    ground: Callable[[float, float], float] = lambda x, y: 0.0,
) -> list[Pose]:
    """A slow flight that weaves by turn_deg to either side and sways by a few degrees. ground: height (z, down) under a place;
    the vehicle keeps its height above it."""
    poses = []
    x, y, z = position_m
    for i in range(round(seconds * hz) + 1):
        t_s = i / hz
        turn = math.radians(turn_deg) * 0.5 * math.sin(math.tau * t_s / 10.0)
        sway = (0.05 * math.sin(2.0 * t_s), 0.04 * math.cos(1.7 * t_s))
        poses.append(Pose((x, y, z + ground(x, y)), (*sway, yaw_rad + turn)))
        x, y = x + 0.3 / hz * math.cos(yaw_rad + turn), y + 0.3 / hz * math.sin(yaw_rad + turn)
    return poses
