"""A simulated camera on a vehicle that an autopilot flies, such as one in SITL: each frame is rendered at the attitude and the
position that the autopilot reports on a link of the camera's own.

A frame is stamped with the instant of the attitude it was rendered for, so that no attitude is interpolated; the position is
carried to that instant by the velocity. In a turn no frame is given while the clock of the autopilot is uncertain. The
origin of the autopilot's local frame is the origin of the scene, on its ground. Of the flight's plan the scene and the sensor
are used; things that move stand at their places of time 0, and nothing fails.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from core.frames import rotation_frd_optical, rotation_from_quaternion
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample

from ..base import DeviceLost, DeviceNotFound
from ..mavlink.address import parse_address
from ..mavlink.clock_sync import UNANSWERED_NS
from ..mavlink.dialect import dialect
from ..mavlink.link import MavlinkLink
from ..mavlink.session import MavlinkSession
from ..mavlink.session_types import MavlinkParams
from .flights import FlightPlan
from .sensor_model import measure
from .source import look

NS = 1_000_000_000
OPEN_S = UNANSWERED_NS / NS + 4.0
"""So long after the first one attitudes are not used where TIMESYNC is not answered."""
STALE_NS = NS // 2
"""Without newer attitude and position for so long the camera gives no frame."""
POLL_S = 0.002
LARGEST_ERROR_RAD = math.radians(0.5)
"""No frame is given where the vehicle turns by more within the error of the attitude's timestamp."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """Options of the camera."""

    address: str  # link to the autopilot, such as udpin:127.0.0.1:14551
    fps: float = 12.0  # most frames per second
    seed: int = 0  # of the noise


class FollowingDepthSource:
    """DepthSource. `deliver` receives the samples of the link; with no address of its own (tests) they are given to it."""

    notice = identity = ""

    def __init__(
        self, plan: FlightPlan, info: CameraInfo, settings: FollowSettings, clock_ns: Callable[[], int]
    ) -> None:
        self._plan, self._info, self._settings, self._clock_ns = plan, info, settings, clock_ns
        self._lock = threading.Lock()
        self._attitude: AttitudeSample | None = None
        self._pose: PoseSample | None = None
        self._link: MavlinkLink | None = None
        self._next_ns = 0
        self._sequence = -1
        self._last_ns = 0

    @property
    def info(self) -> CameraInfo:
        """The camera."""
        return self._info

    def open(self) -> None:
        """Opens the link and waits for attitude and position. Raises DeviceNotFound when none arrive within OPEN_S."""
        # not the companion's own id
        params = MavlinkParams(component_id=dialect.MAV_COMP_ID_CAMERA, attitude_hz=50.0, position_hz=30.0)
        self._link = MavlinkLink(parse_address(self._settings.address), MavlinkSession(params), self.deliver)
        self._link.open()
        end_ns = self._clock_ns() + round(OPEN_S * NS)
        while self._clock_ns() < end_ns:
            if self._state() is not None:
                return
            time.sleep(POLL_S)
        error = self._link.state.error or "no attitude or no position is received"
        self.close()
        raise DeviceNotFound(f"simulated camera {self._info.camera}: follow {self._settings.address}: {error}")

    def close(self) -> None:
        """May be called twice."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def __enter__(self) -> FollowingDepthSource:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def deliver(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Attitudes and positions of the autopilot."""
        with self._lock:
            for sample in samples:
                if isinstance(sample, AttitudeSample):
                    self._attitude = sample
                else:
                    self._pose = sample

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The next frame, or None within timeout_s. Raises DeviceLost when the link has failed."""
        end_ns = self._clock_ns() + round(timeout_s * NS)
        while True:
            if self._link is not None and self._link.failure:
                raise DeviceLost(f"simulated camera {self._info.camera}: {self._link.failure}")
            state = self._state() if self._clock_ns() >= self._next_ns else None
            if state is not None and state[0].t_ns > self._last_ns:
                return self._frame(*state)
            if self._clock_ns() >= end_ns:
                return None
            time.sleep(POLL_S)

    def _state(self) -> tuple[AttitudeSample, PoseSample] | None:
        """The newest attitude and position, if both are fresh."""
        with self._lock:
            attitude, pose = self._attitude, self._pose
        if attitude is None or pose is None:
            return None
        if math.hypot(*attitude.rates_frd_rad_s or ()) * attitude.stamp_error_ns / NS > LARGEST_ERROR_RAD:
            return None  # the exposure would not be that of this attitude to others
        oldest_ns = min(attitude.t_ns, pose.t_ns)
        return (attitude, pose) if self._clock_ns() - oldest_ns <= STALE_NS else None

    def _frame(self, attitude: AttitudeSample, pose: PoseSample) -> DepthFrame:
        self._next_ns = max(self._next_ns + round(NS / self._settings.fps), self._clock_ns())
        self._sequence, self._last_ns = self._sequence + 1, attitude.t_ns
        R_ned_frd = rotation_from_quaternion(attitude.q_ned_frd_wxyz)
        dt_s = (attitude.t_ns - pose.t_ns) / NS
        velocity = np.array(pose.velocity_ned_m_s or (0.0, 0.0, 0.0), np.float64)
        mount = self._info.mount
        lever_m = np.array([mount.x_m, mount.y_m, mount.z_m], np.float64)
        at = np.array(pose.position_ned_m, np.float64) + dt_s * velocity + R_ned_frd @ lever_m
        truth = look(self._plan.scene, self._info, R_ned_frd @ rotation_frd_optical(mount), at)
        sensor = self._plan.sensor.scaled_to(self._info.intrinsics.width)
        depth_mm = measure(truth.depth_m, self._info, sensor, self._settings.seed, self._sequence)
        return DepthFrame(
            camera=self._info.camera,
            sequence=self._sequence,
            t_exposure_ns=attitude.t_ns,
            t_arrival_ns=self._clock_ns(),
            depth_mm=depth_mm,
        )
