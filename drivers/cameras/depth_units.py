"""Depth units of cameras whose video device does not state them, by their ids on USB."""

from __future__ import annotations

from typing import Final

from ..base import BadData
from .video_identity import VideoIdentity

DELIVERED_MM: Final = {"8086:0b5b": 0.1}
"""idVendor:idProduct -> millimetres per unit as delivered: RealSense D405 (librealsense pull request 8946). Other D400 have 1 mm, the
default of the configuration."""


def refuse_greater_unit(camera: str, found: VideoIdentity, configured_mm: float) -> None:
    """Raises BadData where the configured unit is greater than that of the camera as delivered, so that all depths would be too great. A
    smaller one may have been set in the camera."""
    unit_mm = DELIVERED_MM.get(found.ids)
    if unit_mm is None or configured_mm <= 1.001 * unit_mm:
        return
    raise BadData(
        f"camera {camera}: {found} measures in units of {unit_mm:g} mm, depth_unit_mm = {configured_mm:g} is configured: all depths would "
        f"be {configured_mm / unit_mm:.3g} times too great. Set depth_unit_mm = {unit_mm:g}; a unit that another program has set in the "
        "camera is lost with its power"
    )
