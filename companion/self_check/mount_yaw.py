"""Measures the yaw of a camera's mount in straight flight.

The camera's direction of motion between two depth images (core/self_check/depth_registration.py) is compared with the
course of the autopilot's velocity. The difference is the error of the mount's yaw or of the autopilot's heading. The
result is used for diagnostics only. Equal events in equal order give equal estimates."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical, rotation_from_quaternion
from core.self_check.depth_registration import Pyramid, depth_pyramid, motion_between
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import Event
from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.masks import Mask, apply_mask
from ..pipeline.heading_jumps import HeadingJumps
from .attitude_history import AttitudeHistory

Floats = NDArray[np.float64]
NS = 1_000_000_000
WARN_RAD = math.radians(3.0)
MAX_SIGMA_RAD = math.radians(1.5)
"""Largest standard deviation of a reported yaw."""
SYSTEMATIC_RAD = math.radians(0.5)
"""Least standard deviation: systematic errors of velocity, heading and registration."""
MIN_PAIRS, MAX_PAIRS = 20, 120
CORRELATED_PAIRS = 4.0
"""Number of successive pairs with correlated errors: those of the velocity last about a second."""
PAIR_NS, PAIR_MAX_NS = 180_000_000, 400_000_000
"""Time between the images of a pair."""
MIN_SPEED_M_S = 1.0
MAX_CLIMB = 0.2
"""Largest ratio of vertical to horizontal speed."""
MAX_TURN_RAD = math.radians(3.0)
"""Largest rotation of attitude and course within a pair."""
MIN_LENGTH, MAX_LENGTH = 0.7, 1.3
"""Limits of the ratio of the measured to the flown distance; beyond them the registration or the velocity is wrong."""
ROUNDS = 5
"""Iterations of the registration from the predicted motion: a single one is biased towards its initial value."""
HISTORY_NS = NS
MAX_WAITING = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class MountYaw:
    """The yaw of one camera's mount."""

    camera: str
    yaw_rad: float  # configured
    error_rad: float | None = None  # true minus configured
    sd_rad: float | None = None  # its standard deviation; both None until known
    pairs: int = 0  # number of image pairs

    @property
    def warns(self) -> bool:
        """Whether the error is known and large."""
        if self.error_rad is None or self.sd_rad is None:
            return False
        return abs(self.error_rad) >= max(WARN_RAD, 3.0 * self.sd_rad)

    @property
    def corrected_rad(self) -> float:
        """The yaw to configure."""
        return math.remainder(self.yaw_rad + (self.error_rad or 0.0), math.tau)

    @property
    def warning(self) -> str:
        """The diagnostic with its remedy; empty: none."""
        if not self.warns or self.error_rad is None or self.sd_rad is None:
            return ""
        return (
            f"camera {self.camera}: in straight flight the camera moves {abs(math.degrees(self.error_rad)):.1f} +- "
            f"{math.degrees(self.sd_rad):.1f} deg {'left' if self.error_rad > 0.0 else 'right'} of the autopilot's velocity; "
            f"set yaw_deg = {math.degrees(self.corrected_rad):.1f}, or correct the autopilot's compass"
        )


def add_yaw(health: pb.MountHealth, yaw: MountYaw) -> None:
    """Enters a measured yaw into the mount's health, if it is known."""
    if yaw.error_rad is not None and yaw.sd_rad is not None:
        health.yaw_error_deg, health.yaw_sd_deg = math.degrees(yaw.error_rad), math.degrees(yaw.sd_rad)
        health.yaw_deg = math.degrees(yaw.corrected_rad)


class MountYawMonitor:
    """Monitors all cameras. `event` takes everything that the pipeline handles, in the same order."""

    def __init__(self, mask: Callable[[CameraInfo], Mask | None] = lambda info: None) -> None:
        """mask: pixels that show the vehicle."""
        self._mask = mask
        self._cameras: dict[str, _Camera] = {}
        self._attitudes = AttitudeHistory()
        self._velocities = _Velocities()
        self._headings = HeadingJumps()

    def announce(self, info: CameraInfo) -> None:
        """Adds an opened camera. A camera with a changed description starts again."""
        known = self._cameras.get(info.camera)
        if known is None or known.info != info:
            self._cameras[info.camera] = _Camera(info, self._mask(info))

    def event(self, event: Event) -> None:
        """Adds an attitude, a velocity or a frame."""
        if isinstance(event, AttitudeSample):
            before = self._headings.number
            self._headings.take(event)
            restarted = not self._attitudes.add(event)
            if restarted:
                self._velocities.clear()
            # after a jump of the heading its error is another one, and that of before says nothing of the mount
            if restarted or self._headings.number != before:
                self._cameras = {name: _Camera(c.info, c.mask) for name, c in self._cameras.items()}
        elif isinstance(event, PoseSample):
            self._velocities.add(event)
        elif isinstance(event, DepthFrame) and event.camera in self._cameras:
            self._cameras[event.camera].frame(event, self._attitudes, self._velocities)

    def yaws(self) -> tuple[MountYaw, ...]:
        """The present estimates."""
        return tuple(camera.yaw for camera in self._cameras.values())


class _Velocities:
    """The velocities of the last second."""

    def __init__(self) -> None:
        self._samples: deque[tuple[int, Floats]] = deque()

    def clear(self) -> None:
        self._samples.clear()

    def add(self, sample: PoseSample) -> None:
        if sample.velocity_ned_m_s is None:
            return
        if self._samples and sample.t_ns <= self._samples[-1][0]:
            if sample.t_ns > self._samples[-1][0] - NS:
                return
            self._samples.clear()
        self._samples.append((sample.t_ns, np.array(sample.velocity_ned_m_s)))
        while self._samples[0][0] < sample.t_ns - 2 * HISTORY_NS:
            self._samples.popleft()

    @property
    def newest_ns(self) -> int | None:
        return self._samples[-1][0] if self._samples else None

    def between(self, begin_ns: int, end_ns: int) -> Floats | None:
        """(n, 3) velocities from the last before begin_ns to the first after end_ns; None where they do not cover the
        interval."""
        t_ns = np.array([t for t, _ in self._samples], np.int64)
        first, last = int(np.searchsorted(t_ns, begin_ns, "right")) - 1, int(np.searchsorted(t_ns, end_ns))
        if first < 0 or last >= len(t_ns) or int(np.diff(t_ns[first : last + 1]).max(initial=0)) > HISTORY_NS // 2:
            return None
        return np.array([v for _, v in self._samples])[first : last + 1]


@dataclass(frozen=True, slots=True, eq=False)
class _Image:
    pyramid: Pyramid
    t_ns: int


class _Camera:
    """One camera: images that wait for attitudes and velocities, and the errors of its pairs."""

    def __init__(self, info: CameraInfo, mask: Mask | None) -> None:
        self.info, self.mask = info, mask
        self.yaw = MountYaw(camera=info.camera, yaw_rad=info.mount.yaw_rad)
        self._R_frd_optical = rotation_frd_optical(info.mount)
        self._waiting: deque[_Image] = deque()
        self._last: _Image | None = None
        self._errors_rad: deque[float] = deque(maxlen=MAX_PAIRS)

    def frame(self, frame: DepthFrame, attitudes: AttitudeHistory, velocities: _Velocities) -> None:
        """Keeps the image if it is due; registers one pair whose attitudes and velocities are complete."""
        k = self.info.intrinsics
        newest = self._waiting[-1] if self._waiting else self._last
        if newest is not None and frame.t_exposure_ns < newest.t_ns - NS:  # the camera restarted
            self._waiting.clear()
            self._last = newest = None
        known_ns = velocities.newest_ns
        if known_ns is None or frame.t_exposure_ns - known_ns > HISTORY_NS:
            self._waiting.clear()
            self._last = None
            return
        fits = frame.depth_mm.shape == (k.height, k.width)
        if fits and (newest is None or frame.t_exposure_ns - newest.t_ns >= PAIR_NS):
            pyramid = depth_pyramid(apply_mask(frame.depth_mm, self.mask), self.info)
            self._waiting.append(_Image(pyramid, frame.t_exposure_ns))
        if self._waiting and min(known_ns, attitudes.newest_ns or 0) > self._waiting[0].t_ns:
            image, before = self._waiting.popleft(), self._last
            self._last = image
            if before is not None and image.t_ns - before.t_ns <= PAIR_MAX_NS:
                self._pair(before, image, attitudes, velocities)
        elif len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()

    def _pair(self, a: _Image, b: _Image, attitudes: AttitudeHistory, velocities: _Velocities) -> None:
        velocity = velocities.between(a.t_ns, b.t_ns)
        q = attitudes.at(np.array([a.t_ns, b.t_ns]))
        if velocity is None or q is None or not _straight(velocity):
            return
        R_a, R_b = (rotation_from_quaternion(tuple(row)) @ self._R_frd_optical for row in q)
        R_b_a = np.ascontiguousarray(R_b.T @ R_a)
        if math.acos(max(-1.0, min(1.0, 0.5 * (float(np.trace(R_b_a)) - 1.0)))) > MAX_TURN_RAD:
            return
        expected_m = velocity.mean(axis=0) * ((b.t_ns - a.t_ns) / NS)
        motion = motion_between(a.pyramid, b.pyramid, R_b_a, -R_b.T @ expected_m, ROUNDS)
        if motion is None:
            return
        moved = R_b @ -motion.given_rotation_m  # motion of the camera in ned, assuming the configured mount
        share = math.hypot(moved[0], moved[1]) / math.hypot(expected_m[0], expected_m[1])
        if not MIN_LENGTH <= share <= MAX_LENGTH:
            return
        course_rad = math.atan2(expected_m[1], expected_m[0])
        self._errors_rad.append(math.remainder(course_rad - math.atan2(moved[1], moved[0]), math.tau))
        self._estimate()

    def _estimate(self) -> None:
        """Median, and its standard deviation from the median deviation: robust against pairs with moving objects."""
        n = len(self._errors_rad)
        if n < MIN_PAIRS:
            return
        errors = np.array(self._errors_rad)
        middle = float(np.median(errors))
        spread = 1.4826 * float(np.median(np.abs(errors - middle)))
        sd_rad = math.hypot(SYSTEMATIC_RAD, 1.25 * spread * math.sqrt(CORRELATED_PAIRS / n))
        known = sd_rad <= MAX_SIGMA_RAD
        self.yaw = MountYaw(
            camera=self.info.camera,
            yaw_rad=self.info.mount.yaw_rad,
            pairs=n,
            error_rad=middle if known else None,
            sd_rad=sd_rad if known else None,
        )


def _straight(velocity: Floats) -> bool:
    """Whether velocities (n, 3) in ned are straight, level and fast enough."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    if float(speed.min()) < MIN_SPEED_M_S or bool(np.any(np.abs(velocity[:, 2]) > MAX_CLIMB * speed)):
        return False
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    return float(np.ptp(course)) <= MAX_TURN_RAD
