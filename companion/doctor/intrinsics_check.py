"""Compares the configured intrinsics of a RealSense with those that the device reports."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from drivers.base import DriverError
from drivers.cameras.realsense_calibration import LIBRARY, read_calibration
from drivers.cameras.usb_devices import text_of

from ..config.camera import CameraConfig
from ..diagnostic import DiagnosticCode
from .finding import Finding

FOCAL_SHARE = 0.005
"""Largest relative difference of focal lengths: half a percent of each distance to the side."""
CENTRE_PX = 2.0
UNIT_SHARE = 0.001
NODES: Final = Path("/sys/class/video4linux")


def intrinsics_findings(cameras: Iterable[CameraConfig], nodes: Path = NODES) -> Iterator[Finding]:
    """One finding per RealSense on V4L2; none without its library, which the service does not need."""
    if importlib.util.find_spec(LIBRARY) is None:
        return
    for camera in cameras:
        node = nodes / Path(camera.device).resolve().name
        if camera.kind == "v4l2" and "realsense" in (camera.device + text_of(node / "name")).lower():
            yield _finding(camera, text_of((node / "device").resolve().parent / "serial"))


def _finding(camera: CameraConfig, serial: str) -> Finding:
    """serial: of the device on USB, empty: unknown."""
    part = f"camera {camera.name}"
    try:
        device = read_calibration(camera.width_px, camera.height_px, serial)
    except DriverError as error:
        return Finding(part, True, f"its intrinsics cannot be compared: {error}")
    k = device.intrinsics
    pairs = (
        ("fx_px", camera.fx_px, k.fx, FOCAL_SHARE * k.fx),
        ("fy_px", camera.fy_px, k.fy, FOCAL_SHARE * k.fy),
        ("cx_px", camera.cx_px, k.cx, CENTRE_PX),
        ("cy_px", camera.cy_px, k.cy, CENTRE_PX),
        ("depth_unit_mm", camera.depth_unit_mm, device.depth_unit_mm, UNIT_SHARE * device.depth_unit_mm),
    )
    wrong = [
        f"{key} = {value:.4f}"
        for key, configured, value, near in pairs
        if configured is None or abs(configured - value) > near
    ]
    if wrong:
        text = f"RealSense {device.serial} reports other values than the configuration: set {', '.join(wrong)}"
        return Finding(part, False, text, DiagnosticCode.INTRINSICS_DIFFER)
    text = f"intrinsics and depth unit are those of RealSense {device.serial}; dot projector: {device.dot_projector}"
    return Finding(part, True, text)
