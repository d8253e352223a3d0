"""The depth source that a camera's section of the configuration asks for. Only that one's library is imported."""

from __future__ import annotations

import time

from core.types import CameraInfo
from drivers.base import DepthSource

from .config_camera import CameraConfig


def make_source(section: CameraConfig) -> DepthSource:
    """The source, not opened yet. Raises ValueError for a kind that is no live camera."""
    if section.kind == "simulated":
        return _simulated(section)
    raise ValueError(
        f'[[camera]] "{section.name}": kind = "{section.kind}" is no live camera; `companion replay` reads recordings'
    )


def _simulated(section: CameraConfig) -> DepthSource:
    from drivers.simulated import camera_info
    from drivers.simulated_flight import SimulatedDepthSource, SimulatedFlight

    info: CameraInfo = section.applied_to(camera_info(section.width_px, section.width_px * 3 // 4, camera=section.name))
    flight = SimulatedFlight(section.flight, cameras=(info,), seed=section.seed)
    return SimulatedDepthSource(flight, time.monotonic_ns, pace=time.sleep, repeat=True)
