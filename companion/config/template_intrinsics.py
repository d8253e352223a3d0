"""Cameras whose intrinsics are still those of the shipped configuration."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePath
from typing import Final

from .camera import CameraConfig

TEMPLATE_V4L2_PX: Final = (383.0, 383.0, 320.0, 240.0)
"""fx, fy, cx, cy in configs/v4l2.toml: typical values of a D435, not those of a device."""
TEMPLATE_ZED_CALIBRATION: Final = "SN12345678.conf"
"""Placeholder in configs/zed.toml."""


def template_texts(cameras: Iterable[CameraConfig]) -> list[tuple[str, str]]:
    """(camera, cause and remedy) of each such camera. An OAK reports its own intrinsics."""
    found = []
    for c in cameras:
        if c.kind == "v4l2" and (c.fx_px, c.fy_px, c.cx_px, c.cy_px) == TEMPLATE_V4L2_PX:
            what = "fx_px, fy_px, cx_px and cy_px are those of the shipped configs/v4l2.toml"
            remedy = "read those of this camera (`companion setup`, or the manufacturer's tool) and enter them"
        elif c.kind == "zed" and PurePath(c.calibration).name == TEMPLATE_ZED_CALIBRATION:
            what = f"calibration names {TEMPLATE_ZED_CALIBRATION}, the placeholder of the shipped configs/zed.toml"
            remedy = "download the calibration file for this camera's serial number and enter its path"
        else:
            continue
        text = (
            f"camera {c.name}: {what}; with the intrinsics of another camera, positions and heights of obstacles are "
            f"wrong: {remedy}"
        )
        found.append((c.name, text))
    return found
