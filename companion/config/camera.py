"""The sections `[[camera]]` and `[output]`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from core.param_field import choice, critical, number, switch, text
from core.types import MOST_BIAS_PER_M, CameraInfo, CameraMount
from drivers.mavlink.address import parse_address

from .camera_kinds import CAMERA_KINDS, RECORDED

_CORNER = r"-?\d+(?:\.\d+)?,-?\d+(?:\.\d+)?"
_POLYGON = rf"{_CORNER}(?: +{_CORNER})+"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """The configuration of one camera. A missing value (None) stays as the camera or the recording has it. Raises
    ValueError when the ranges contradict each other."""

    name: str = field(
        metadata={"pattern": r"^[A-Za-z0-9._-]+$", "unit": "", "doc": "letters, digits, dot, dash, underscore"}
    )
    kind: str = choice(
        RECORDED,
        (RECORDED, *CAMERA_KINDS),
        "source of the frames: a recording, the simulator, or a camera",
    )
    required: bool = switch(
        True, "true: the service is blind while this camera is; false: it works on without it", safety=True
    )
    roll_deg: float | None = number(None, -180.0, 180.0, "deg", "roll of the mount; right side down is positive")
    pitch_deg: float | None = number(None, -90.0, 90.0, "deg", "pitch of the mount; looking up is positive")
    yaw_deg: float | None = number(None, -180.0, 180.0, "deg", "yaw of the mount; looking to the right is positive")
    x_m: float | None = number(None, -10.0, 10.0, "m", "position relative to the autopilot, forward")
    y_m: float | None = number(None, -10.0, 10.0, "m", "position relative to the autopilot, to the right")
    z_m: float | None = number(None, -10.0, 10.0, "m", "position relative to the autopilot, down")
    min_range_m: float | None = critical(
        None, 0.01, 10.0, "m", "nearest depth that the camera measures; nearer pixels are unknown"
    )
    max_range_m: float | None = critical(
        None,
        0.5,
        65.0,
        "m",
        "greatest depth that is trusted; pixels beyond count as free up to it. Larger: more noise",
    )
    ke_per_m: float | None = critical(
        None,
        1e-5,
        0.05,
        "1/m",
        "depth noise: standard deviation = ke_per_m * depth^2; where the noise is measured, its start value",
    )
    bias_per_m: float | None = critical(
        None,
        0.0,
        MOST_BIAS_PER_M,
        "1/m",
        "error of the calibration that is assumed: bias_per_m * depth^2, part of every margin; free space ends earlier "
        "(docs/how-to/connect-a-camera.md)",
    )
    masks: str = field(
        default="",
        metadata={
            "safety": True,
            "pattern": rf"^(?:{_POLYGON}(?: *; *{_POLYGON})*)?$",
            "unit": "",
            "doc": 'parts of the vehicle in the image, which are unknown: polygons of corners u,v in px, separated by ";"; '
            'two corners are a rectangle: "0,0 80,60; 600,0 639,0 639,50"',
        },
    )
    unmatched_left_px: int | None = critical(
        None,
        0,
        1024,
        "px",
        'columns at the left without stereo matches (default: disparities for a zed, for match_on = "host" and '
        "rendered stereo, else 0)",
    )
    flight: str = choice(
        "demo",
        ("demo", "movers", "street", "trees", "alley", "window", "tilted", "by_hand", "broken"),
        "simulated only: the flight",
    )
    follow: str = text(
        "",
        "simulated only: a second link to an autopilot, such as udpin:127.0.0.1:14551, at whose attitude and position "
        "the scene is rendered (docs/how-to/fly-in-simulation.md)",
    )
    device: str = text(
        "",
        "oak: its id (empty: the only one); zed, v4l2: a path, best in /dev/v4l/by-id or by-path; simulated: a file "
        "that stands for its cable, unplugged while it is missing (empty: plugged in)",
    )
    serial: str = text(
        "",
        "v4l2 only: serial number that the camera must state on USB (`companion setup` writes it); empty: any camera at "
        "this path, with the intrinsics and the mount of this one",
    )
    width_px: int = number(640, 16, 4096, "px", "width of the depth image; of a zed, of one eye")
    height_px: int = number(
        480, 16, 4096, "px", "height of the depth image; simulated: always three quarters of the width"
    )
    fps: float = number(30.0, 1.0, 120.0, "Hz", "frames per second that are requested from the camera")
    exposure_latency_s: float = number(
        0.0,
        0.0,
        0.2,
        "s",
        "middle of the exposure to the kernel's timestamp (zed, v4l2) or to the arrival (simulated)",
    )
    exposure_offset_ms: float = number(
        0.0,
        -100.0,
        200.0,
        "ms",
        "subtracted from each exposure timestamp of a live camera; positive: they are late "
        "(docs/how-to/measure-exposure-offset.md)",
    )
    calibration: str = text("", "zed only: path of its calibration file SN<serial>.conf")
    match_on: str = choice(
        "device",
        ("device", "host"),
        "oak only: where images are matched. host: as a zed's; more edges and far ground, permits mark_smooth, five "
        "times the processor time",
    )
    disparities: int = number(
        96,
        16,
        512,
        "px",
        'zed, match_on = "host" and rendered stereo: number of disparities that are searched; larger: nearer objects, '
        "more time",
    )
    match_correlation: float = critical(
        0.7,
        0.0,
        0.99,
        "",
        "zed and oak: least correlation of both images around a match; lower: more depth, more false obstacles; 0 "
        "accepts every match",
    )
    match_texture: float = critical(
        3.0,
        0.0,
        100.0,
        "",
        "zed and oak: least variance of the texture, relative to the sensor noise; lower: more depth, more false "
        "obstacles; 0: off",
    )
    match_period: float = critical(
        0.9,
        0.3,
        1.0,
        "",
        "zed and oak: correlation of the image with itself above which it is repetitive and not measured; 1: off",
    )
    mark_smooth: bool = switch(
        False,
        'zed, match_on = "host" and rendered stereo: mark unmeasured pixels whose image is smooth, which `[open_sky]` '
        "needs; 25 ms a frame",
        safety=True,
    )
    confidence: int = critical(
        55,
        0,
        255,
        "",
        "oak only: least confidence of a pixel; higher: fewer, more reliable pixels",
    )
    emitter: float = number(0.0, 0.0, 1.0, "", "oak only: brightness of the dot projector, where there is one; 0: off")
    depth_unit_mm: float = number(
        1.0, 0.001, 10.0, "mm", "v4l2 only: one unit of the depth image: 1.0 for a RealSense D400, 0.1 for a D405"
    )
    fx_px: float | None = number(None, 10.0, 20_000.0, "px", "v4l2 only: focal length; the device does not report it")
    fy_px: float | None = number(None, 10.0, 20_000.0, "px", "v4l2 only: vertical focal length")
    cx_px: float | None = number(None, -4096.0, 8192.0, "px", "v4l2 only: principal point")
    cy_px: float | None = number(None, -4096.0, 8192.0, "px", "v4l2 only: principal point")
    seed: int = number(0, 0, 1_000_000, "", "simulated only: seed of scene and noise")
    render: str = choice(
        "depth",
        ("depth", "stereo"),
        "simulated only: exact depth with a noise model, or stereo matching of rendered images (0.8 s a frame at 640 px)",
    )
    sky_is_far: bool = switch(
        False,
        'simulated with render = "depth" only: the sky is measured as far, which makes it free, instead of unmeasured',
    )

    def __post_init__(self) -> None:
        if self.min_range_m is not None and self.max_range_m is not None and self.min_range_m >= self.max_range_m:
            raise ValueError(
                f'[[camera]] "{self.name}": min_range_m = {self.min_range_m:g} must be less than '
                f"max_range_m = {self.max_range_m:g}"
            )
        try:
            if self.follow:
                parse_address(self.follow)
        except ValueError as error:
            raise ValueError(f'[[camera]] "{self.name}": follow: {error}') from error
        if self.follow and self.render == "stereo":
            raise ValueError(
                f'[[camera]] "{self.name}": render = "stereo" is not available with follow: the camera that follows an '
                "autopilot renders depth with the noise model; remove render"
            )
        if self.sky_is_far and (self.kind != "simulated" or self.render == "stereo"):
            raise ValueError(
                f'[[camera]] "{self.name}": sky_is_far = true is for kind "simulated" with render = "depth"; remove it'
            )
        if self.serial and self.kind != "v4l2":
            raise ValueError(
                f'[[camera]] "{self.name}": serial is for kind "v4l2"; remove it (oak: set device to its id; zed: its video '
                "device states none)"
            )
        if self.can_mark and self._searched_px >= self.width_px:
            raise ValueError(
                f'[[camera]] "{self.name}": disparities = {self.disparities}, rounded up to a multiple of 16, must be less than '
                f"width_px = {self.width_px}: in so many columns at the left nothing is matched"
            )
        if self.kind != RECORDED and (self.unmatched_left_px or 0) >= self.width_px:
            raise ValueError(
                f'[[camera]] "{self.name}": unmatched_left_px = {self.unmatched_left_px} must be less than '
                f"width_px = {self.width_px}: nothing would be measured; lower it"
            )
        kind = CAMERA_KINDS.get(self.kind)
        missing = [key for key in kind.needs if getattr(self, key) in ("", None)] if kind is not None else []
        if missing:
            raise ValueError(f'[[camera]] "{self.name}" of kind "{self.kind}" needs {", ".join(missing)}')

    def applied_to(self, info: CameraInfo) -> CameraInfo:
        """The camera's description with the configured values. Raises ValueError if they contradict it or each other."""
        angles = {"roll_rad": self.roll_deg, "pitch_rad": self.pitch_deg, "yaw_rad": self.yaw_deg}
        mount: dict[str, Any] = {k: math.radians(v) for k, v in angles.items() if v is not None}
        mount |= {k: getattr(self, k) for k in ("x_m", "y_m", "z_m") if getattr(self, k) is not None}
        optional: dict[str, Any] = {
            k: getattr(self, k) for k in ("min_range_m", "max_range_m", "ke_per_m", "bias_per_m")
        }
        given = {k: v for k, v in optional.items() if v is not None}
        try:
            return replace(info, mount=replace(info.mount, **mount), **given)
        except ValueError as error:
            raise ValueError(
                f'[[camera]] "{self.name}": with min_range_m and max_range_m as the camera or the recording has them: {error}; '
                "set both, min_range_m less than max_range_m"
            ) from error

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the depth images of a live camera, to which its masks refer."""
        return self.width_px, self.width_px * 3 // 4 if self.kind == "simulated" else self.height_px

    @property
    def matched_on_host(self) -> bool:
        """Whether the driver of such a camera matches both images of a stereo pair itself."""
        return self.kind == "zed" or (self.kind == "oak" and self.match_on == "host")

    @property
    def can_mark(self) -> bool:
        """Whether the driver of such a camera marks pixels."""
        return self.matched_on_host or (self.kind == "simulated" and self.render == "stereo")

    @property
    def marks_smooth(self) -> bool:
        """Whether the driver marks unmeasured pixels whose image is smooth."""
        return self.can_mark and self.mark_smooth

    @property
    def _searched_px(self) -> int:
        """Number of disparities that the matcher searches, see `MatchParams.searched`."""
        return -(-self.disparities // 16) * 16

    @property
    def unmatched_px(self) -> int:
        """Columns at the left of the depth image in which nothing is ever matched."""
        if self.unmatched_left_px is not None:
            return self.unmatched_left_px
        rendered = self.kind == "simulated" and self.render == "stereo"
        return self._searched_px if self.matched_on_host or rendered else 0

    @property
    def mount(self) -> CameraMount:
        """The mount, with 0 for missing values."""
        roll, pitch, yaw = (math.radians(a or 0.0) for a in (self.roll_deg, self.pitch_deg, self.yaw_deg))
        return CameraMount(roll, pitch, yaw, self.x_m or 0.0, self.y_m or 0.0, self.z_m or 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputConfig:
    """What is written into logs beside the prisms, by the service and by a replay."""

    scene: bool = switch(True, "write drawings of the prisms for viewers (foxglove.SceneUpdate)")
    transforms: bool = switch(True, "write the transforms between frames for viewers")
    copy_input: bool = switch(True, "a replay copies the depth images, so that one file holds everything")
