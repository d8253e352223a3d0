"""Position, heading and velocity of the vehicle at the moment of sending, and results of cameras relative to it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

from core.frames import rotation_frd_optical, rotation_from_quaternion, rotation_level_ned
from core.types import AttitudeSample, CameraInfo, PoseSample

from ..config.sync import SyncParams
from ..pipeline.multi_camera import compose, transform_to_level
from ..pipeline.results import PrismsResult
from ..pipeline.sample_buffer import HELD
from ..pipeline.sync import AttitudeAt, PoseAt, Synchroniser
from ..pipeline.transform import LevelTransform, transform_model
from .obstacle_memory import Here
from .view_free import View

NS = 1_000_000_000
GRAVITY_M_S2 = 9.81
STEEPEST_RAD = math.radians(75.0)
MOTION = SyncParams(max_gap_s=0.3, max_extrapolation_s=0.15, pose_max_extrapolation_s=0.3, max_clock_error_m=5.0)
"""Limits within which attitude and position are interpolated or extrapolated to the moment of sending. Outside of
them the vehicle's heading is unknown. A constant error of the timestamps cancels out in the distance flown, by which
remembered obstacles are moved: positions are used in fast flight too."""


@dataclass(slots=True)
class VehicleMotion:
    """The vehicle's motion. `samples` may be called from any thread, the other methods by one thread at a time, after
    `catch_up`."""

    last_here: Here | None = None
    newest_pose: PoseSample | None = None
    _here_ns: int = 0
    _sync: Synchroniser = field(default_factory=lambda: Synchroniser(MOTION))
    _waiting: deque[AttitudeSample | PoseSample] = field(default_factory=lambda: deque(maxlen=4 * HELD))

    def samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Adds attitudes and positions in the order in which they arrive. It never waits."""
        self._waiting.extend(samples)

    def catch_up(self, now_ns: int) -> Here | None:
        """Takes the samples that have arrived. Returns where the vehicle is now; None: its attitude is not known.

        `last_here` is then where it is, or where it was when its attitude was last known."""
        while self._waiting:
            self._sync.add(self._waiting.popleft())
        self.newest_pose = self._sync.poses.newest
        here, self._here_ns = self._here(now_ns), now_ns
        self.last_here = here or self.last_here
        return here

    def _here(self, now_ns: int) -> Here | None:
        attitude = self._sync.attitude_at(now_ns)
        if not isinstance(attitude, AttitudeAt):
            return None
        w, x, y, z = attitude.q_ned_frd_wxyz
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        headings, pose = self._sync.headings, self._sync.pose_at(now_ns)
        here = Here(
            heading,
            heading_section=headings.number,
            turned_rad=headings.turned_rad,
            velocity_ned_m_s=self.velocity_ned_m_s(now_ns),
            lean_m_s2=_lean_m_s2(attitude.q_ned_frd_wxyz),
        )
        if isinstance(pose, PoseAt):
            return replace(here, position_ned_m=pose.position_ned_m, section=self._sync.sections.number)
        return here

    def velocity_ned_m_s(self, now_ns: int) -> tuple[float, float, float] | None:
        """Returns the vehicle's velocity (north, east, down); None: not known."""
        pose = self.newest_pose
        return None if pose is None or now_ns - pose.t_ns > NS // 2 else pose.velocity_ned_m_s

    def velocity_m_s(self, now_ns: int) -> tuple[float, float] | None:
        """Returns the vehicle's horizontal velocity (forward, right); None: not known."""
        velocity, here = self.velocity_ned_m_s(now_ns), self.last_here
        if velocity is None or here is None:
            return None
        forward, right = LevelTransform(-here.heading_rad).places(*velocity[:2])
        return (forward, right) if math.isfinite(forward) and math.isfinite(right) else None

    def placed(self, result: PrismsResult, here: Here) -> bool:
        """True if a result and the vehicle have positions of the same section, and no jump of the heading is between."""
        same = seen_ns(result) >= self._sync.sections.since_ns and self._jumped_rad(result) == 0.0
        return result.frame == "ned" and here.position_ned_m is not None and same

    def _jumped_rad(self, result: PrismsResult) -> float:
        """Returns the jumps of the heading since a result, clockwise."""
        return 0.0 if result.attitude is None else self._sync.headings.since_rad(result.attitude.jump_ns)

    def moves(self, result: PrismsResult, here: Here) -> bool:
        """True if `view` moves a result by the distance flown since its exposure; False where neither position nor velocity
        is known."""
        return here.velocity_ned_m_s is not None or self.placed(result, here)

    def _flown_m(self, result: PrismsResult, here: Here) -> tuple[float, float, float]:
        """Returns the distance flown since a result at the present velocity, in level; 0 where no velocity is known."""
        north, east, down = here.velocity_ned_m_s or (0.0, 0.0, 0.0)
        forward, right = LevelTransform(-here.heading_rad).places(north, east)
        age_s = max(0, self._here_ns - seen_ns(result)) / NS
        return forward * age_s, right * age_s, down * age_s

    def heading_lost(self, result: PrismsResult) -> bool:
        """Returns whether the heading may have jumped by an unknown angle since a result, in a gap of the attitude.

        By the time of exposure: the pipeline's attitudes and these can have different gaps."""
        return seen_ns(result) < self._sync.headings.gap_ns

    def view(self, result: PrismsResult, here: Here, info: CameraInfo, ring_m: float, open_counts: bool) -> View:
        """Returns a valid result as a view in level, at the moment of sending. info: of its camera.

        It is moved by the distance flown since its exposure: by the positions where both are known and comparable,
        otherwise by the present velocity."""
        assert result.model is not None
        assert result.transform is not None
        heading_rad = here.heading_rad - self._jumped_rad(result)  # by the estimate that the result was computed with
        if self.placed(result, here):
            assert here.position_ned_m is not None
            step = LevelTransform(heading_rad, here.position_ned_m).inverse()
        else:
            step = moved_by(transform_to_level(result, heading_rad), self._flown_m(result, here))
        R_optical_level = None
        if result.attitude is not None:
            R_ned_optical = rotation_from_quaternion(result.attitude.q_ned_frd_wxyz) @ rotation_frd_optical(info.mount)
            R_optical_level = (rotation_level_ned(heading_rad) @ R_ned_optical).T
        return View(
            model=transform_model(replace(result.model, prisms=()), step),
            transform=compose(step, result.transform),
            intrinsics=info.intrinsics,
            R_optical_level=R_optical_level,
            ring_m=ring_m,
            open_counts=open_counts,
            t_ns=seen_ns(result),
        )


def moved_by(transform: LevelTransform, way_m: tuple[float, float, float]) -> LevelTransform:
    """Returns a transform to a frame whose origin has moved by this way, in its axes."""
    x, y, z = (place - way for place, way in zip(transform.translation_m, way_m, strict=True))
    return LevelTransform(transform.yaw_rad, (x, y, z))


def _lean_m_s2(q_ned_frd_wxyz: tuple[float, float, float, float]) -> tuple[float, float] | None:
    """Returns the horizontal acceleration (north, east) by a thrust that carries the weight; None: the vehicle leans by
    more than STEEPEST_RAD. The thrust acts against the axis down of frd."""
    w, x, y, z = q_ned_frd_wxyz
    north, east, down = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    if down < math.cos(STEEPEST_RAD):
        return None
    return -GRAVITY_M_S2 * north / down, -GRAVITY_M_S2 * east / down


def seen_ns(result: PrismsResult) -> int:
    """Returns the instant of exposure, at most that of arrival: a stamp in the future would never become stale."""
    return min(result.t_exposure_ns, result.t_arrival_ns)
