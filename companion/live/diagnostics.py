"""The faults that the service reports of threads, cameras, link and recorder, and those recognised by their pattern: a stable
code, the observation, the likely cause and the remedy."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from drivers.mavlink.clock_sync import UNKNOWN_DELAY_NS, ClockSource
from drivers.mavlink.session_types import LinkStatus

from ..autopilot.clock_note import LARGE_BOUND_NS
from ..autopilot.conflict_codes import conflict_diagnostics
from ..autopilot.no_heartbeat import no_heartbeat_remedy
from ..cameras.status import CameraCondition
from ..config.camera import CameraConfig
from ..config.loader import Config
from ..config.template_intrinsics import template_texts
from ..diagnostic import Diagnostic, DiagnosticCode
from ..log.recorder import RecordStatus
from ..pipeline.results import PrismsResult
from ..self_check.exposure_offset import warning_text
from ..self_check.mount_yaw import MountYaw
from .health import AutopilotView, CameraView

NS = 1_000_000_000
ATTITUDE_OLD_NS = NS // 2
REPEATED_TEXT = (
    "the autopilot's attitude repeats an earlier one with new timestamps and is not used: cameras are blind. The estimator of the "
    "autopilot does not run (during its start and calibration this ends by itself), or a relay repeats messages: look at "
    "the horizon in the ground station, reboot the autopilot, connect it without the relay"
)
UNUSED_TEXT = (
    "attitudes arrive and are not used, because their time is not known: cameras are blind until the autopilot answers TIMESYNC "
    "within 0.5 s; where it does not answer, for 10 s; where an answer was late, for 60 s after it. Check the link if this lasts"
)
MIN_ATTITUDE_HZ = 10.0
"""Below this rate the attitudes before and after an exposure are 0.1 s or more apart: interpolation is inaccurate in a
turn, and with [sync] max_gap_s = 0.15 a frame is dropped as soon as one attitude is lost."""
MIN_RATE_SHARE = 0.8
"""Least share of a configured rate that arrives."""
_WARNINGS: Final = frozenset(
    {DiagnosticCode.UDP_FLOOD, DiagnosticCode.LINK_SLOW, DiagnosticCode.NO_TIMESYNC, DiagnosticCode.CLOCK_UNCERTAIN}
)
"""Diagnostics of the link that do not make all cameras blind."""
LOW_FOR_NS = 3 * NS
"""The rate is measured over two seconds and must stay low for longer than it takes to settle after a start."""
WELL_MEASURED_SHARE = 0.9
GROUND_FRAMES = 300
"""Number of well measured frames without ground since the start of a camera: 10 s at 30 Hz."""


def diagnostics_of(
    cameras: Iterable[CameraView], autopilot: AutopilotView | None, recording: RecordStatus | None, thread_fault: str
) -> list[Diagnostic]:
    """The diagnostics of threads, cameras, link and recorder, in this order; a camera that works comes after what takes its attitude.
    thread_fault: the required threads that have ended, or the one that does not respond, as text; empty: none."""
    views = list(cameras)
    found = [Diagnostic(DiagnosticCode.THREAD_STALLED, "", thread_fault)] if thread_fault else []
    if not views:
        text = "no camera is configured: add a [[camera]] to the configuration"
        found.append(Diagnostic(DiagnosticCode.NO_CAMERA_CONFIGURED, "", text))
    blind = sorted((v for v in views if v.blind), key=lambda v: not v.required)
    link = _autopilot_diagnostics(autopilot)
    causes = [d for d in link if d.code not in _WARNINGS]
    working = [v for v in blind if causes and v.status.condition is CameraCondition.RUNNING]
    found += [_unavailable(v) for v in blind if v not in working]
    found += [*causes, *map(_unavailable, working), *(d for d in link if d.code in _WARNINGS)]
    if recording is not None and recording.fault:
        found.append(Diagnostic(DiagnosticCode.RECORDING_FAULT, "", recording.fault))
    return found


def _unavailable(view: CameraView) -> Diagnostic:
    camera = view.status.camera
    if view.required:
        return Diagnostic(DiagnosticCode.CAMERA_UNAVAILABLE, camera, f"camera {camera} is blind: {view.blind}")
    text = f"camera {camera} (not required) is blind: {view.blind}"
    return Diagnostic(DiagnosticCode.OPTIONAL_CAMERA_UNAVAILABLE, camera, text)


def _autopilot_diagnostics(view: AutopilotView | None) -> list[Diagnostic]:
    def of(code: DiagnosticCode, text: str) -> Diagnostic:
        return Diagnostic(code, "", text)

    if view is None:
        return [of(DiagnosticCode.NO_AUTOPILOT_CONFIGURED, "no autopilot is configured: set [autopilot] address")]
    if not view.link_state.open:
        return [of(DiagnosticCode.LINK_CLOSED, f"the link to the autopilot is not open: {view.link_state.error}")]
    found = [of(DiagnosticCode.UDP_FLOOD, view.link_state.flood)] if view.link_state.flood else []
    if view.link_state.warning:
        found.append(of(DiagnosticCode.LINK_SLOW, view.link_state.warning))
    signing = view.status.signing_fault
    if signing:
        found.append(of(DiagnosticCode.SIGNING_FAULT, signing))
    found += conflict_diagnostics(view.status.conflicts)
    if view.status.vehicle is None:
        if not signing and "system id" not in view.status.conflicts:
            remedy = no_heartbeat_remedy(view.address, view.status)
            found.append(of(DiagnosticCode.NO_HEARTBEAT, f"no heartbeat of an autopilot on {view.address}: {remedy}"))
        return found
    return found + _attitude_diagnostics(view) + _clock_diagnostics(view.status)


def _attitude_diagnostics(view: AutopilotView) -> list[Diagnostic]:
    if view.status.attitude_repeated:
        return [Diagnostic(DiagnosticCode.ATTITUDE_REPEATED, "", REPEATED_TEXT)]
    if view.attitude_age_ns is not None and view.attitude_age_ns <= ATTITUDE_OLD_NS:
        return []
    if view.status.vehicle_uncertain and view.status.attitude_hz > 0.0:
        return []  # the conflict that is reported says why it is not used
    age = "was never received" if view.attitude_age_ns is None else f"is {view.attitude_age_ns / NS:.1f} s old"
    text = f"the attitude {age}: the autopilot does not send it or the link is interrupted"
    if view.status.attitude_hz > 0.0 and not view.status.stamps_used:
        text = UNUSED_TEXT
    return [Diagnostic(DiagnosticCode.ATTITUDE_STALE, "", text)]


def _clock_diagnostics(link: LinkStatus) -> list[Diagnostic]:
    clock = link.clock
    if clock.source is ClockSource.ENVELOPE:
        text = (
            "the autopilot does not answer TIMESYNC: its timestamps are estimated from arrival times and include the "
            f"delay of the link, which is assumed to be at most {UNKNOWN_DELAY_NS / 1e6:.0f} ms; a longer one displaces obstacles in turns"
        )
        return [Diagnostic(DiagnosticCode.NO_TIMESYNC, "", text)]
    if clock.bound_ns is None:
        return []
    if not link.timesync_answered:
        text = (
            f"the autopilot no longer answers TIMESYNC in time: the error bound of its timestamps is {clock.bound_ns / 1e6:.1f} "
            "ms and grows"
        )
        return [Diagnostic(DiagnosticCode.NO_TIMESYNC, "", text)]
    if clock.bound_ns > LARGE_BOUND_NS:
        return [Diagnostic(DiagnosticCode.CLOCK_UNCERTAIN, "", clock_uncertain_text(clock.bound_ns))]
    return []


def clock_uncertain_text(bound_ns: int) -> str:
    """The cause and the remedy of a large error bound of the autopilot's clock."""
    return (
        f"the autopilot's timestamps may be wrong by {bound_ns / 1e6:.0f} ms, because TIMESYNC takes that long, or because the "
        "clock of this computer is being corrected (NTP): frames in fast turns are dropped, positions in fast flight are not used; "
        "use a faster link (921600 baud), or request lower rates; synchronise the clock before the flight"
    )


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


class CameraRateCheck:
    """Reports cameras that stay slower than configured while they run. Not the simulated one: it renders as fast as the
    computer can."""

    def __init__(self, cameras: Iterable[CameraConfig]) -> None:
        self._fps = {c.name: c.fps for c in cameras if c.kind != "simulated"}
        self._low_since_ns: dict[str, int] = {}

    def check(self, views: Iterable[CameraView], now_ns: int) -> list[Diagnostic]:
        """The diagnostics of all cameras."""
        found = []
        for view in views:
            name, hz = view.status.camera, view.hz
            fps = self._fps.get(name, 0.0)
            if view.status.condition != CameraCondition.RUNNING or hz >= MIN_RATE_SHARE * fps:
                self._low_since_ns.pop(name, None)
            elif now_ns - self._low_since_ns.setdefault(name, now_ns) >= LOW_FOR_NS:
                text = (
                    f"camera {name}: {hz:.1f} Hz arrive, fps = {fps:g} is configured; check that the camera is on USB 3 and used "
                    "by this process only, and that the scene is lit: automatic exposure can lower the rate"
                )
                found.append(Diagnostic(DiagnosticCode.CAMERA_RATE_LOW, name, text))
        return found


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
