"""The text of a configuration, with comments, from a few answers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from drivers.cameras.realsense_calibration import DepthCalibration

from ..config.camera_kinds import CAMERA_KINDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What a configuration is made of."""

    kind: str
    device: str = ""
    serial: str = ""  # of a v4l2 camera, on USB
    pitch_deg: float = 0.0  # upwards
    yaw_deg: float = 0.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # forward, right, down of the autopilot
    # width_m, height_m: of the vehicle with rotors
    width_m: float = 1.0
    height_m: float = 0.5
    autopilot: str = ""
    system_id: int = 0  # of the own autopilot; 0: not known
    send: bool = False
    record: str = "always"
    calibration: DepthCalibration | None = None  # of a v4l2 camera
    calibration_file: str = ""  # of a zed


def configuration_text(answers: Answers) -> str:
    """TOML that `companion check-config` accepts, unless the calibration of a v4l2 or zed camera is missing."""
    a = answers
    lines = [
        "# Written by `companion setup`. docs/reference/configuration.md lists every key; check a change with",
        "# `companion check-config FILE` and `companion doctor -c FILE`. Angles are in degrees.",
        "",
        "[extractor]",
        _line("passable_height_m", round(max(0.2, 2.0 * a.height_m), 2), "least height of an opening that stays open: twice the vehicle"),
        _line("passable_width_m", round(max(0.2, 2.0 * a.width_m), 2), "least width of an opening that stays open: twice the vehicle"),
        "",
        *_camera(a),
        "",
        "[autopilot]",
        _line("address", a.autopilot, "" if a.autopilot else "none: serial:/dev/serial/by-id/NAME:BAUD or udpin:HOST:PORT"),
        _line("system_id", a.system_id, "of this vehicle; 0: that of the first heartbeat, which may be of another vehicle"),
        "",
        "[avoid]",
        _line("send", a.send, "send obstacles to the autopilot; `companion doctor` names the parameters it needs"),
        _line("max_distance_m", CAMERA_KINDS[a.kind].clear_m, "a clear direction must be seen free to here; less than the camera's range"),
        _line("radius_m", round(a.width_m / 2.0, 3), "of the vehicle, rotors included"),
        _line("band_above_m", round(max(0.8, a.height_m / 2.0 + 0.5), 2), "obstacles in this band of heights stop the vehicle"),
        _line("band_below_m", round(max(0.8, a.height_m / 2.0 + 0.5), 2)),
        "",
        "[record]",
        _line("record", a.record, '"always", "armed" or "off"'),
        _line("depth_hz", 0.0, "0: every depth image; a lower rate writes less, see docs/reference/configuration.md"),
    ]  # fmt: skip
    if a.kind == "simulated":
        lines += ["", "[supervision]", _line("open_s", 300.0, "the camera renders its flight at the first start")]
    return "\n".join(lines) + "\n"


def _camera(a: Answers) -> list[str]:
    kind = CAMERA_KINDS[a.kind]
    forward, right, down = a.position_m
    lines = ["[[camera]]", _line("name", "front"), _line("kind", a.kind)]
    if a.device:
        lines.append(_line("device", a.device))
    lines += [_line("width_px", kind.width_px), _line("height_px", kind.height_px), _line("fps", kind.fps)]
    if a.kind == "zed":
        lines.append(_line("calibration", a.calibration_file, "SN<serial>.conf of this camera, from the maker's site"))
    if a.kind == "v4l2" and a.serial:
        lines.append(_line("serial", a.serial, "another camera at this port is refused"))
    if a.kind == "v4l2":
        lines += _intrinsics(a.calibration)
    if kind.exposure_latency_s:
        latency = "typical, mid-exposure to the time stamp of the kernel; `companion status` shows what is left"
        lines.append(_line("exposure_latency_s", kind.exposure_latency_s, latency))
    return [
        *lines,
        _line("pitch_deg", a.pitch_deg, "mount: upwards is positive; check it with `companion doctor --mount`"),
        _line("yaw_deg", a.yaw_deg, "mount: to the right is positive"),
        _line("x_m", forward, "position relative to the autopilot: forward, right, down"),
        _line("y_m", right),
        _line("z_m", down),
        _line("max_range_m", kind.max_range_m, "farthest depth that is used"),
    ]


def _intrinsics(calibration: DepthCalibration | None) -> list[str]:
    if calibration is None:
        remedy = "fx_px, fy_px, cx_px, cy_px and depth_unit_mm: enter those of this camera (docs/how-to/connect-realsense.md)"
        return [f"# {remedy}"]
    k = calibration.intrinsics
    values = {"fx_px": k.fx, "fy_px": k.fy, "cx_px": k.cx, "cy_px": k.cy, "depth_unit_mm": calibration.depth_unit_mm}
    return [
        _line(key, round(value, 4), "read from the device" if key == "fx_px" else "") for key, value in values.items()
    ]


def _line(key: str, value: Any, comment: str = "") -> str:
    text = f"{key} = {json.dumps(value)}"  # numbers, strings and booleans are the same in JSON and TOML
    return f"{text:<30} # {comment}" if comment else text
