"""Faults that are recognised by their pattern: a stable code, what was measured, the likely cause and the remedy."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePath

from ..config.camera import CameraConfig
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.pipeline import PrismsResult

NS = 1_000_000_000
MIN_ATTITUDE_HZ = 10.0
"""Below it the attitudes before and after an exposure are 0.1 s and more apart: interpolation is coarse in a turn, and
with [sync] max_gap_s = 0.15 frames are dropped as soon as one attitude is lost."""
LOW_FOR_NS = 3 * NS
"""The rate is measured over two seconds; it must stay low for longer than it takes to settle after a start."""
WELL_MEASURED_SHARE = 0.9
GROUND_FRAMES = 300
"""Well measured frames without ground, from the start of a camera: 10 s at 30 Hz."""
TEMPLATE_V4L2_PX = (383.0, 383.0, 320.0, 240.0)
"""fx, fy, cx, cy of configs/v4l2.toml."""
TEMPLATE_ZED_CALIBRATION = "SN12345678.conf"
"""Of configs/zed.toml."""


def template_intrinsics(cameras: Iterable[CameraConfig]) -> list[Diagnostic]:
    """Cameras whose intrinsics are those of the shipped configuration, unchanged. An OAK reports its own."""
    found = []
    for c in cameras:
        if c.kind == "v4l2" and (c.fx_px, c.fy_px, c.cx_px, c.cy_px) == TEMPLATE_V4L2_PX:
            what = "fx_px, fy_px, cx_px and cy_px are those of the shipped configs/v4l2.toml"
            remedy = "read the intrinsics of this camera with its maker's tool and enter them"
        elif c.kind == "zed" and PurePath(c.calibration).name == TEMPLATE_ZED_CALIBRATION:
            what = f"calibration names {TEMPLATE_ZED_CALIBRATION}, the placeholder of the shipped configs/zed.toml"
            remedy = "download the calibration file of this camera's serial number and name it"
        else:
            continue
        text = f"camera {c.name}: {what}; positions and heights of obstacles are wrong with those of another camera: {remedy}"
        found.append(Diagnostic(DiagnosticCode.TEMPLATE_INTRINSICS, c.name, text))
    return found


def attitude_rate_low(rate_hz: float, wanted_hz: float) -> Diagnostic:
    """What a low rate of the attitude means. rate_hz: measured; wanted_hz: [autopilot] attitude_hz."""
    text = (
        f"attitude arrives at {rate_hz:.1f} Hz, at least {MIN_ATTITUDE_HZ:g} Hz are needed and {wanted_hz:g} Hz were "
        "requested; likely cause: the stream rate of this port is low, another station resets it, or the link is too slow. "
        "ArduPilot: raise SRx_EXTRA1 (MAVx_EXTRA1 in newer versions); PX4: raise MAV_x_RATE; use 921600 baud"
    )
    return Diagnostic(DiagnosticCode.ATTITUDE_RATE_LOW, "", text)


class AttitudeRateCheck:
    """Reports a rate of the attitude that stays below LEAST_ATTITUDE_HZ while attitudes arrive."""

    def __init__(self, wanted_hz: float) -> None:
        self._wanted_hz = wanted_hz
        self._low_since_ns: int | None = None

    def check(self, rate_hz: float, now_ns: int) -> list[Diagnostic]:
        """rate_hz: over the last two seconds; 0: none arrive, which is another fault."""
        if rate_hz == 0.0 or rate_hz >= MIN_ATTITUDE_HZ:
            self._low_since_ns = None
            return []
        if self._low_since_ns is None:
            self._low_since_ns = now_ns
        return [attitude_rate_low(rate_hz, self._wanted_hz)] if now_ns - self._low_since_ns >= LOW_FOR_NS else []


class GroundCheck:
    """Reports cameras that never found ground although their frames are well measured. Ground in a single frame shows
    that mount and attitude fit, and ends the check until the camera starts again. A camera that looks up, at a wall or
    from above `ground_max_height_m` has no ground either: it is reported, and the text says so."""

    def __init__(self) -> None:
        self._without: dict[str, int] = {}
        self._seen: set[str] = set()

    def started(self, camera: str) -> None:
        """A camera opened: what was seen before proves nothing of it."""
        self._without[camera] = 0
        self._seen.discard(camera)

    def result(self, result: PrismsResult) -> None:
        """One frame. Frames without a valid model count neither way."""
        model = result.model
        if model is None or not model.valid or result.camera in self._seen:
            return
        if model.ground.seen:
            self._seen.add(result.camera)
        elif model.stats.measured_share >= WELL_MEASURED_SHARE:
            self._without[result.camera] = self._without.get(result.camera, 0) + 1

    def check(self) -> list[Diagnostic]:
        """Of all cameras."""
        return [
            Diagnostic(DiagnosticCode.GROUND_NEVER_SEEN, camera, _ground_text(camera, count))
            for camera, count in self._without.items()
            if count >= GROUND_FRAMES and camera not in self._seen
        ]


def _ground_text(camera: str, frames: int) -> str:
    return (
        f"camera {camera}: no ground in any frame since it started, {frames} of them at least "
        f"{100 * WELL_MEASURED_SHARE:g} % measured; likely cause: the sign of pitch_deg or roll_deg, a camera mounted rolled "
        "by 90 or 180 degrees, or a wrong attitude. Compare the mount in the configuration with the vehicle; no fault if "
        "the camera looks up or sees only walls"
    )
