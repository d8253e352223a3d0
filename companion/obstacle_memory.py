"""Near obstacles that have left the view: a camera looks over what stands beside the vehicle and below its own image.

An obstacle is remembered as a point of ned, or, without a position, of level as it was turned since. It is forgotten
when a camera sees through its place, when the autopilot's estimate of the position jumps, and after a while.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config_avoid import AvoidParams
from .reframe import LevelTransform
from .sectors import SECTORS, SectorScan, SectorState, View, centres_rad, points_free

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Here:
    """Where the vehicle is at the moment of sending. heading_rad: clockwise from north; position_ned_m None: unknown;
    section: of the autopilot's estimate, which changes when that jumps."""

    heading_rad: float
    position_ned_m: tuple[float, float, float] | None = None
    section: int | None = None

    def from_world(self) -> LevelTransform:
        """ned, or north-aligned axes around the vehicle, to level."""
        return LevelTransform(self.heading_rad, self.position_ned_m or (0.0, 0.0, 0.0)).inverse()


class ObstacleMemory:
    """`recall` with each scan: adds what is seen now and gives what is remembered besides."""

    def __init__(self, avoid: AvoidParams) -> None:
        self._avoid = avoid
        self._points = np.zeros((0, 3))  # x, y of the world, instant in s
        self._section: tuple[bool, int | None] = (False, None)

    def recall(self, scan: SectorScan, views: Sequence[View], here: Here, now_ns: int) -> NDArray[np.float64]:
        """(72,) distances from the hull to what is remembered and not seen now; inf where nothing is."""
        section = (here.position_ned_m is not None, here.section)
        if section != self._section:  # other axes: what was remembered stands nowhere in them
            self._points, self._section = np.zeros((0, 3)), section
        now_s = now_ns / NS
        points = self._points[now_s - self._points[:, 2] <= self._avoid.remember_s]
        xy = _moved(points[:, :2], here.from_world())
        kept = ~self._seen_through(xy, views)
        points, xy = points[kept], xy[kept]
        recalled = np.full(SECTORS, np.inf)
        if len(xy):
            sector = np.round(np.arctan2(xy[:, 1], xy[:, 0]) / (math.tau / SECTORS)).astype(int) % SECTORS
            hull = np.maximum(0.0, np.hypot(xy[:, 0], xy[:, 1]) - self._avoid.radius_m)
            np.minimum.at(recalled, sector, hull)
        self._points = np.concatenate([points, self._seen_now(scan, here, now_s)])
        return recalled

    def _seen_now(self, scan: SectorScan, here: Here, now_s: float) -> NDArray[np.float64]:
        """(N, 3) points of the world: the near obstacles of a scan."""
        near = (scan.state == SectorState.OBSTACLE) & (scan.distance_m < self._avoid.remember_m)
        middle_m = scan.distance_m[near] + self._avoid.radius_m
        azimuth = centres_rad()[near]
        xy = np.stack([middle_m * np.cos(azimuth), middle_m * np.sin(azimuth)], axis=1)
        world = _moved(xy, LevelTransform(here.heading_rad, here.position_ned_m or (0.0, 0.0, 0.0)))
        return np.column_stack([world, np.full(len(world), now_s)])

    def _seen_through(self, xy: NDArray[np.float64], views: Sequence[View]) -> NDArray[np.bool_]:
        """(N,) which places a view calls free over the whole band."""
        half = np.linspace(-self._avoid.band_above_m, self._avoid.band_below_m, self._avoid.slices + 2)[1:-1]
        free = np.zeros((len(half), len(xy)), bool)
        for view in views:
            if view.model.valid:
                free |= points_free(view, xy[:, 0], xy[:, 1], half)
        return np.asarray(free.all(axis=0))


def _moved(xy: NDArray[np.float64], transform: LevelTransform) -> NDArray[np.float64]:
    c, s = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad)
    tx, ty, _ = transform.translation_m
    return np.stack([c * xy[:, 0] - s * xy[:, 1] + tx, s * xy[:, 0] + c * xy[:, 1] + ty], axis=1)
