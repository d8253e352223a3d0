"""The state of the cameras' mounts and grounds for the health report."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from core.self_check.mount_check import MountState
from core.types import CameraInfo
from osape_client.proto import osape_v1_pb2 as pb

from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.mount_messages import mount_diagnostic, mount_health
from ..pipeline.results import PrismsResult

AT_LIMIT = 0.98
"""Share of the largest allowed slope above which the fitted ground counts as limited by it."""
MIN_MEASURED_SHARE = 0.5
"""Least share of measured pixels for which a missing ground is reported."""
LOST_NS = 1_000_000_000
"""Time without ground after which it is reported: single frames of a level flight show none."""


@dataclass(slots=True)
class _Newest:
    state: MountState
    slope: float
    lost_since_ns: int | None
    t_ns: int

    @property
    def lost(self) -> bool:
        """Whether the ground has been missing for LOST_NS."""
        return self.lost_since_ns is not None and self.t_ns - self.lost_since_ns >= LOST_NS


class MountWatch:
    """Keeps the newest mount state of each camera. max_slope: the largest allowed slope of the ground, m/m
    ([extractor])."""

    def __init__(self, max_slope: float) -> None:
        self._max_slope = max_slope
        self._newest: dict[str, _Newest] = {}

    def result(self, result: PrismsResult) -> None:
        """Adds a frame's result; a dropped frame is ignored."""
        if result.mount is None or result.model is None:
            return
        ground, stats = result.model.ground, result.model.stats
        slope = math.hypot(ground.slope_x, ground.slope_y) if ground.seen else 0.0
        lost = result.mount.ground and not ground.seen and stats.measured_share >= MIN_MEASURED_SHARE
        before, t_ns = self._newest.get(result.camera), result.t_exposure_ns
        since_ns = t_ns if before is None or before.lost_since_ns is None else before.lost_since_ns
        self._newest[result.camera] = _Newest(result.mount, slope, since_ns if lost else None, t_ns)

    def health(self, camera: str, info: CameraInfo | None) -> pb.MountHealth | None:
        """The mount health of a camera; None: nothing was measured, or its description is unknown."""
        newest = self._newest.get(camera)
        if newest is None or info is None or newest.state.t_ns is None:
            return None
        return mount_health(newest.state, info.mount)

    def diagnostics(self, infos: Iterable[tuple[str, CameraInfo | None]]) -> list[Diagnostic]:
        """The diagnostics of mounts and grounds."""
        found: list[Diagnostic] = []
        for camera, info in infos:
            health = self.health(camera, info)
            if health is not None and (mount := mount_diagnostic(camera, health)):
                found.append(mount)
            found += self._ground_diagnostics(camera)
        return found

    def _ground_diagnostics(self, camera: str) -> list[Diagnostic]:
        newest = self._newest.get(camera)
        if newest is None:
            return []
        if newest.slope >= AT_LIMIT * self._max_slope > 0.0:
            text = (
                f"camera {camera}: the slope of the ground is at its limit ({100 * self._max_slope:.0f} %): "
                "steep terrain, or a wrong mount"
            )
            return [Diagnostic(DiagnosticCode.GROUND_SLOPE_LIMIT, camera, text)]
        if newest.lost:
            slope_deg = math.degrees(newest.state.slope_rad)
            text = (
                f"camera {camera}: no ground is found though most pixels are measured; the lowest large "
                f"surface is inclined by {slope_deg:.1f} deg: steep terrain, or a wrong mount"
            )
            return [Diagnostic(DiagnosticCode.GROUND_LOST, camera, text)]
        return []
