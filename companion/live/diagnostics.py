"""Faults recognised by their pattern: a stable code, the observation, the likely cause and the remedy."""

from __future__ import annotations

from collections.abc import Iterable

from ..config.camera import CameraConfig
from ..config.loader import Config
from ..config.template_intrinsics import template_texts
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.results import PrismsResult
from ..self_check.exposure_offset import warning_text
from ..self_check.mount_yaw import MountYaw
from .health import CameraView

NS = 1_000_000_000
MIN_ATTITUDE_HZ = 10.0
"""Below this rate the attitudes before and after an exposure are 0.1 s or more apart: interpolation is inaccurate in a
turn, and with [sync] max_gap_s = 0.15 a frame is dropped as soon as one attitude is lost."""
LOW_FOR_NS = 3 * NS
"""The rate is measured over two seconds and must stay low for longer than it takes to settle after a start."""
WELL_MEASURED_SHARE = 0.9
GROUND_FRAMES = 300
"""Number of well measured frames without ground since the start of a camera: 10 s at 30 Hz."""


def template_intrinsics(cameras: Iterable[CameraConfig]) -> list[Diagnostic]:
    """Cameras whose intrinsics are those of the shipped configuration."""
    return [Diagnostic(DiagnosticCode.TEMPLATE_INTRINSICS, name, text) for name, text in template_texts(cameras)]


def attitude_rate_low(rate_hz: float, wanted_hz: float) -> Diagnostic:
    """The diagnostic of a low attitude rate. rate_hz: measured; wanted_hz: [autopilot] attitude_hz."""
    text = (
        f"attitude arrives at {rate_hz:.1f} Hz, at least {MIN_ATTITUDE_HZ:g} Hz are needed and {wanted_hz:g} Hz were "
        "requested; likely cause: the stream rate of this port is low, another station resets it, or the link is too slow. "
        "ArduPilot: raise SRx_EXTRA1 (MAVx_EXTRA1 in newer versions); PX4: raise MAV_x_RATE; use 921600 baud"
    )
    return Diagnostic(DiagnosticCode.ATTITUDE_RATE_LOW, "", text)


def yaw_warnings(yaws: Iterable[MountYaw]) -> list[Diagnostic]:
    """Cameras whose direction of motion does not fit the vehicle's velocity."""
    return [Diagnostic(DiagnosticCode.MOUNT_YAW_ERROR, yaw.camera, yaw.warning) for yaw in yaws if yaw.warns]


def offset_warnings(config: Config, views: Iterable[CameraView]) -> list[Diagnostic]:
    """Cameras whose exposure stamps do not fit the attitude."""
    offsets = [view.exposure_offset for view in views if view.exposure_offset is not None]
    texts = {o.camera: warning_text(o, config.camera(o.camera).exposure_offset_ms) for o in offsets}
    return [Diagnostic(DiagnosticCode.EXPOSURE_TIME_OFFSET, camera, text) for camera, text in texts.items() if text]


def misaligned(views: Iterable[CameraView]) -> list[Diagnostic]:
    """Cameras whose driver found their calibration inaccurate."""
    return [
        Diagnostic(DiagnosticCode.CAMERA_MISALIGNED, view.status.camera, view.status.notice)
        for view in views
        if view.status.notice
    ]


class AttitudeRateCheck:
    """Reports an attitude rate that stays below MIN_ATTITUDE_HZ while attitudes arrive."""

    def __init__(self, wanted_hz: float) -> None:
        self._wanted_hz = wanted_hz
        self._low_since_ns: int | None = None

    def check(self, rate_hz: float, now_ns: int) -> list[Diagnostic]:
        """rate_hz: over the last two seconds; 0 means that no attitude arrives, which is a fault of its own."""
        if rate_hz == 0.0 or rate_hz >= MIN_ATTITUDE_HZ:
            self._low_since_ns = None
            return []
        if self._low_since_ns is None:
            self._low_since_ns = now_ns
        return [attitude_rate_low(rate_hz, self._wanted_hz)] if now_ns - self._low_since_ns >= LOW_FOR_NS else []


class GroundCheck:
    """Reports cameras without ground in any frame although most pixels are measured. A single frame with ground shows
    that mount and attitude fit, and ends the check until the camera restarts. A camera that looks up, at a wall, or
    flies above `ground_max_height_m` sees no ground either; the text names these cases."""

    def __init__(self) -> None:
        self._without: dict[str, int] = {}
        self._seen: set[str] = set()

    def started(self, camera: str) -> None:
        """Restarts the check: a camera opened."""
        self._without[camera] = 0
        self._seen.discard(camera)

    def result(self, result: PrismsResult) -> None:
        """Adds a frame. Frames without a valid model are not counted."""
        model = result.model
        if model is None or not model.valid or result.camera in self._seen:
            return
        if model.ground.seen:
            self._seen.add(result.camera)
        elif model.stats.measured_share >= WELL_MEASURED_SHARE:
            self._without[result.camera] = self._without.get(result.camera, 0) + 1

    def check(self) -> list[Diagnostic]:
        """The diagnostics of all cameras."""
        return [
            Diagnostic(DiagnosticCode.GROUND_NEVER_SEEN, camera, _ground_text(camera, count))
            for camera, count in self._without.items()
            if count >= GROUND_FRAMES and camera not in self._seen
        ]


def _ground_text(camera: str, frames: int) -> str:
    return (
        f"camera {camera}: no ground in any frame since it started, {frames} of them at least "
        f"{100 * WELL_MEASURED_SHARE:g} % measured; likely cause: the sign of pitch_deg or roll_deg, a camera mounted "
        "rolled by 90 or 180 degrees, or a wrong attitude. Compare the mount in the configuration with the vehicle; "
        "not a fault if the camera looks up or sees only walls"
    )
