"""`companion doctor --mount`: measures roll, pitch and height of each camera while the vehicle is turned and tilted by
hand."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from core.frames import level_cam_at, rotation_from_quaternion
from core.self_check.mount_check import MountState, checked
from core.self_check.mount_cues import cues_of
from core.self_check.mount_params import MountCheckParams
from core.self_check.surfaces import find_surfaces
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import Event
from drivers.mavlink.address import parse_address
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession

from ..autopilot.session_factory import params_of, signing_of
from ..cameras.masks import Mask, apply_mask, configured_mask
from ..cameras.supervisor import CameraSupervisor
from ..config.camera import CameraConfig
from ..config.loader import Config
from ..config.sync import SyncParams
from ..console import counted
from ..paths import folders
from ..pipeline.sync import AttitudeAt, Synchroniser

MIN_TURN_RAD = math.radians(60.0)
MIN_FRAMES = 30
MAX_SD_RAD = math.radians(0.3)
"""Largest standard deviation of roll and pitch of a result."""
TARGET_SD_RAD = math.radians(0.25)
"""The same at which the measurement ends early."""
PARAMS = MountCheckParams(interval_s=0.05, terrain_deg_per_sqrt_s=0.05)
Incoming = queue.SimpleQueue[Event | CameraInfo]


@dataclass(slots=True)
class MountMeasurement:
    """The measurement of one camera from a sequence of events."""

    info: CameraInfo
    sync: SyncParams
    config: CameraConfig
    state: MountState = field(default_factory=MountState)
    frames: int = 0
    without_attitude: int = 0
    heights_m: list[float] = field(default_factory=list)
    headings_rad: list[float] = field(default_factory=list)
    _synchroniser: Synchroniser = field(init=False)
    _mask: Mask | None = field(init=False)

    def __post_init__(self) -> None:
        self._synchroniser = Synchroniser(self.sync)
        self._mask = configured_mask(self.config, self.info)

    def add(self, event: Event) -> None:
        """Adds an attitude or a frame, in order of arrival; positions are not used."""
        if isinstance(event, AttitudeSample):
            self._synchroniser.add(event)
        elif isinstance(event, DepthFrame):
            self._frame(event)

    def _frame(self, frame: DepthFrame) -> None:
        attitude = self._synchroniser.attitude_at(frame.t_exposure_ns)
        if not isinstance(attitude, AttitudeAt):
            self.without_attitude += 1
            return
        self.frames += 1
        R_level_optical, heading_rad, _, _ = level_cam_at(attitude.q_ned_frd_wxyz, self.info.mount)
        depth_mm = apply_mask(frame.depth_mm, self._mask)
        cues = cues_of(find_surfaces(depth_mm, self.info, R_level_optical, self.info.ke_per_m))
        if cues.ground:
            self.heights_m.append(cues.distance_m)
            self.headings_rad.append(heading_rad - attitude.turned_rad)
        R_ned_frd = rotation_from_quaternion(attitude.q_ned_frd_wxyz)
        self.state = checked(self.state, frame.t_exposure_ns, cues, R_ned_frd, heading_rad, PARAMS, attitude.jump_ns)

    @property
    def turned_rad(self) -> float:
        """Angle between the outermost headings with measured ground."""
        if not self.headings_rad:
            return 0.0
        turns = np.unwrap(self.headings_rad)
        return min(float(np.ptp(turns)), math.tau)

    @property
    def done(self) -> bool:
        """Whether the result cannot be improved by more frames."""
        sure = max(self.state.error_sd_rad) <= TARGET_SD_RAD
        return sure and len(self.heights_m) >= MIN_FRAMES and self.turned_rad >= MIN_TURN_RAD

    def refusal(self) -> str:
        """Why there is no result, with the remedy; empty: there is one."""
        if not self.frames:
            if self.without_attitude:
                return (
                    f"{counted(self.without_attitude, 'frame')} arrived, none with an attitude: check the autopilot with "
                    "`companion doctor`"
                )
            return "no frame arrived: check the camera with `companion doctor`"
        if len(self.heights_m) < MIN_FRAMES:
            return (
                f"ground in only {len(self.heights_m)} of {self.frames} frames, {MIN_FRAMES} are needed: hold the "
                "vehicle above level, textured ground that fills the lower half of the image"
            )
        if self.turned_rad < MIN_TURN_RAD:
            return (
                f"turned by only {math.degrees(self.turned_rad):.0f} degrees: turn the vehicle slowly by "
                f"{math.degrees(MIN_TURN_RAD):.0f} degrees or more to both sides, and tilt it by about 15 degrees"
            )
        sd_deg = math.degrees(max(self.state.error_sd_rad))
        if max(self.state.error_sd_rad) > MAX_SD_RAD:
            return (
                f"standard deviation of {sd_deg:.1f} degrees: the ground is uneven or the turn was too fast; repeat "
                "it on level ground"
            )
        return ""

    def lines(self) -> list[str]:
        """The configuration lines."""
        roll, pitch, yaw = self.state.corrected(self.info.mount)
        lines = [
            "[[camera]]",
            f'name = "{self.config.name}"',
            f"roll_deg = {math.degrees(roll):z.1f}",
            f"pitch_deg = {math.degrees(pitch):z.1f}",
        ]
        if self.info.mount.yaw_rad or abs(yaw) > math.radians(0.05):
            lines.append(f"yaw_deg = {math.degrees(yaw):z.1f}")
        return lines

    def text(self) -> str:
        """The result in one line."""
        roll, pitch = (math.degrees(v) for v in self.state.error_rad)
        roll_sd, pitch_sd = (math.degrees(v) for v in self.state.error_sd_rad)
        return (
            f"{float(np.median(self.heights_m)):.2f} m above the ground; true minus configured: roll {roll:+z.2f} +- {roll_sd:.2f} "
            f"deg, pitch {pitch:+z.2f} +- {pitch_sd:.2f} deg ({counted(len(self.heights_m), 'frame')}, turned by "
            f"{math.degrees(self.turned_rad):.0f} deg)"
        )


@dataclass(frozen=True, slots=True)
class MountFinding:
    """The result of one camera."""

    camera: str
    ok: bool
    text: str
    lines: tuple[str, ...] = ()  # for the configuration; empty: there is no result


def finding_of(measurement: MountMeasurement) -> MountFinding:
    """The result of a measurement, or why there is none."""
    name = measurement.config.name
    if refusal := measurement.refusal():
        return MountFinding(name, False, refusal)
    wrong = max(abs(v) for v in measurement.state.error_rad) >= math.radians(PARAMS.degraded_deg)
    return MountFinding(name, not wrong, measurement.text(), tuple(measurement.lines()))


def measured_mounts(config: Config, seconds: float, print_line: Callable[[str], None]) -> Iterator[MountFinding]:
    """Measures all cameras at once, with the autopilot's attitude. Raises DriverError."""
    if not config.autopilot.address:
        yield MountFinding("all", False, "the attitude is needed: set [autopilot] address")
        return
    if not config.cameras:
        yield MountFinding("all", False, "none is configured: add a [[camera]] to the configuration")
        return
    events: Incoming = queue.SimpleQueue()
    signing = signing_of(config.autopilot, folders().state)
    session = MavlinkSession(params_of(config), signing=signing)
    link = MavlinkLink(parse_address(config.autopilot.address), session, lambda samples: _put(events, samples))

    def take_frame(frame: DepthFrame) -> None:
        link.catch_up()  # the attitudes that arrived before the frame
        events.put(frame)

    least_share = config.extractor.min_measured_share
    cameras = [
        CameraSupervisor(c, events.put, take_frame, config.supervision, least_share=least_share) for c in config.cameras
    ]
    measurements: dict[str, MountMeasurement] = {}
    try:
        link.open()
        for camera in cameras:
            camera.open()
        print_line(
            f"Hold the vehicle above level ground. Turn it slowly by 90 degrees to both sides and tilt it by about 15 degrees, "
            f"for up to {seconds:g} s."
        )
        _collect(events, measurements, config, seconds)
    finally:
        for camera in cameras:
            camera.close()
        link.close()
        signing.close()
    for section in config.cameras:
        measurement = measurements.get(section.name)
        if measurement is None:
            yield MountFinding(section.name, False, "the camera did not open: check it with `companion doctor`")
        else:
            yield finding_of(measurement)


def _put(events: Incoming, samples: list[AttitudeSample | PoseSample]) -> None:
    for sample in samples:
        events.put(sample)


def _collect(events: Incoming, measurements: dict[str, MountMeasurement], config: Config, seconds: float) -> None:
    """Processes events until every camera is measured or the time has passed."""
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0.0:
        try:
            event = events.get(timeout=left_s)
        except queue.Empty:
            return
        if isinstance(event, CameraInfo):
            measurement = MountMeasurement(event, config.sync, config.camera(event.camera))
            measurements[event.camera] = measurement
        elif isinstance(event, DepthFrame):
            if event.camera in measurements:
                measurements[event.camera].add(event)
        else:
            for measurement in measurements.values():
                measurement.add(event)
        if len(measurements) == len(config.cameras) and all(m.done for m in measurements.values()):
            return
