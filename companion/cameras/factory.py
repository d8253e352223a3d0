"""Creates the depth source of a camera section. Only the library of that source is imported."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from core.types import CameraInfo, Intrinsics
from drivers.base import DepthSource

from ..config.camera import CameraConfig
from ..paths import cache_folder

if TYPE_CHECKING:
    from drivers.cameras.stereo import MatchParams


def make_source(section: CameraConfig) -> DepthSource:
    """The source, not yet opened. Raises ValueError for a kind that is not a live camera."""
    make = MAKERS.get(section.kind)
    if make is None:
        raise ValueError(
            f'[[camera]] "{section.name}": kind = "{section.kind}" is not a live camera; use `companion replay` for '
            "recordings"
        )
    return make(section)


def _oak(section: CameraConfig) -> DepthSource:
    from drivers.cameras.oak import OakSource
    from drivers.cameras.oak_pipeline import OakSettings

    return OakSource(
        OakSettings(
            camera=section.name,
            device=section.device,
            width=section.width_px,
            height=section.height_px,
            fps=section.fps,
            host_matching=section.matched_on_host,
            confidence=section.confidence,
            match=_match(section),
            emitter=section.emitter,
            **_range(section),
        )
    )


def _zed(section: CameraConfig) -> DepthSource:
    from drivers.cameras.zed_uvc import ZedSettings, ZedSource

    return ZedSource(
        ZedSettings(
            camera=section.name,
            device=section.device,
            calibration=Path(section.calibration),
            width=section.width_px,
            height=section.height_px,
            fps=section.fps,
            exposure_latency_s=section.exposure_latency_s,
            match=_match(section),
            **_range(section),
        )
    )


def _match(section: CameraConfig) -> MatchParams:
    from drivers.cameras.stereo import MatchParams

    return MatchParams(
        disparities=section.disparities,
        correlation=section.match_correlation,
        texture=section.match_texture,
        period=section.match_period,
        mark_smooth=section.marks_smooth,
    )


def _v4l2(section: CameraConfig) -> DepthSource:
    from drivers.cameras.v4l2_depth import V4l2Settings, V4l2Source

    fx, fy, cx, cy = (float(v or 0.0) for v in (section.fx_px, section.fy_px, section.cx_px, section.cy_px))
    return V4l2Source(
        V4l2Settings(
            camera=section.name,
            device=section.device,
            intrinsics=Intrinsics(section.width_px, section.height_px, fx, fy, cx, cy),
            serial=section.serial,
            fps=section.fps,
            depth_unit_mm=section.depth_unit_mm,
            exposure_latency_s=section.exposure_latency_s,
            **_range(section),
        )
    )


def _range(section: CameraConfig) -> dict[str, Any]:
    """The configured range limits; the driver's defaults apply to the others."""
    ranges = {key: getattr(section, key) for key in ("min_range_m", "max_range_m")}
    return {key: value for key, value in ranges.items() if value is not None}


def _simulated(section: CameraConfig) -> DepthSource:
    from drivers.simulation.camera import SimulatedDepthSource, Simulation
    from drivers.simulation.flights import flight_plan
    from drivers.simulation.looping_flight import LoopingFlight
    from drivers.simulation.source import camera_info

    described = camera_info(*section.size_px, camera=section.name)
    if section.render == "stereo":
        from drivers.simulation.stereo.flight_depth import stereo_camera_info

        described = stereo_camera_info(described.intrinsics, section.name, mark_smooth=section.marks_smooth)
    info: CameraInfo = section.applied_to(described)
    plan = flight_plan(section.flight, section.seed)
    if section.sky_is_far:
        plan = replace(plan, sensor=replace(plan.sensor, sky_is_far=True))
    if section.follow:
        from drivers.simulation.following_camera import FollowingDepthSource, FollowSettings

        settings = FollowSettings(address=section.follow, fps=section.fps, seed=section.seed)
        return FollowingDepthSource(plan, info, settings, time.monotonic_ns)
    simulation = Simulation(
        fps=section.fps,
        seed=section.seed,
        latency_s=section.exposure_latency_s,
        cable=Path(section.device) if section.device else None,
        folder=cache_folder() / "simulated",
        render=section.render,
        disparities=section.disparities,
        mark_smooth=section.mark_smooth,
    )
    flight = LoopingFlight(plan)
    return SimulatedDepthSource(flight, info, simulation, time.monotonic_ns, time.sleep)


MAKERS: Final[dict[str, Callable[[CameraConfig], DepthSource]]] = {
    "oak": _oak,
    "zed": _zed,
    "v4l2": _v4l2,
    "simulated": _simulated,
}
"""Kind, as in `companion/config/camera_kinds.py` -> what creates its source."""
