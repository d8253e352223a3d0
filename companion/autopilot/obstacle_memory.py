"""Memory of near obstacles that have left the view, such as those beside the vehicle and below the image.

An obstacle is kept as a point in ned, or without a position in level, turned with the heading. It is deleted if two
frames in a row see its place and both sides of it free, since a thin obstacle is not found in every frame, and after
remember_s. If the position estimate jumps, begins or ends, or the heading jumps, the point keeps its place relative to
the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config.avoidance import AvoidParams
from ..pipeline.transform import LevelTransform
from .polar_histogram import SECTORS, STEP_RAD, SectorScan, SectorState
from .view_free import View, points_free

NS = 1_000_000_000
NEVER = -1


@dataclass(frozen=True, slots=True)
class Here:
    """The vehicle at the moment of sending."""

    heading_rad: float  # clockwise from north
    position_ned_m: tuple[float, float, float] | None = None  # None: not known
    section: int | None = None  # number of the section of the position estimate; it changes when the estimate jumps
    heading_section: int = 0  # changes when the heading jumps, or may have jumped
    turned_rad: float = 0.0  # sum of the known jumps of the heading, clockwise
    velocity_ned_m_s: tuple[float, float, float] | None = None  # None: not known
    # acceleration (north, east) of a multirotor with this attitude in still air, without vertical acceleration; None:
    # not known
    lean_m_s2: tuple[float, float] | None = None

    @property
    def estimate(self) -> tuple[int | None, int]:
        """Sections of the estimate, within which places in ned can be compared."""
        return self.section, self.heading_section

    def to_world(self) -> LevelTransform:
        """Returns the transform from level to ned, without a position to north-aligned axes at the vehicle."""
        return LevelTransform(self.heading_rad, self.position_ned_m or (0.0, 0.0, 0.0))

    def from_world(self) -> LevelTransform:
        """Returns the inverse of `to_world`."""
        return self.to_world().inverse()


@dataclass(frozen=True, slots=True, eq=False)
class Remembered:
    """Remembered obstacles, (72,) each, in metres from the hull; inf: none."""

    distance_m: NDArray[np.float64]  # the nearest one
    # the nearest one of those to which the way was seen (SectorState.OBSTACLE), from a place from which that way is the
    # same as from here
    way_seen_m: NDArray[np.float64]


def nothing_remembered() -> Remembered:
    """Returns a memory without obstacles."""
    return Remembered(np.full(SECTORS, np.inf), np.full(SECTORS, np.inf))


class ObstacleMemory:
    """Remembers near obstacles. `recall` must be called with each scan."""

    def __init__(self, avoid: AvoidParams) -> None:
        self._avoid = avoid
        # x, y of the world, instant in s, 1 where the way was seen, x, y of the place that it was seen from
        self._points = np.zeros((0, 6))
        self._free_ns = np.zeros(0, np.int64)  # exposure of the frame that saw the place of the point free; NEVER: none
        self._same_way_m = avoid.near_m * math.tan(0.5 * STEP_RAD)
        self._section: tuple[bool, int | None] = (False, None)
        self._place_m = np.zeros(2)
        self._turned_rad = 0.0
        self._heading_section = 0
        self._velocity_m_s = np.zeros(2)
        self._recalled_ns = 0

    def recall(self, scan: SectorScan, views: Sequence[View], here: Here, now_ns: int) -> Remembered:
        """Returns the obstacles remembered before, and adds those that are seen now."""
        section = (here.position_ned_m is not None, here.section)
        place_m = np.array((here.position_ned_m or (0.0, 0.0, 0.0))[:2])
        if here.turned_rad != self._turned_rad:  # the heading has changed, not the direction of the vehicle
            self._points[:, :2] = rotated(self._points[:, :2], self._place_m, here.turned_rad - self._turned_rad)
        if here.heading_section != self._heading_section:
            self._points[:, 3] = 0.0  # the direction is not known exactly, after a gap not at all
        velocity_m_s = np.array((here.velocity_ned_m_s or (0.0, 0.0))[:2])
        if section != self._section:  # the origin of the estimate has changed, not the place of the vehicle
            way_m = (self._velocity_m_s if here.velocity_ned_m_s is None else velocity_m_s) * (
                (now_ns - self._recalled_ns) / NS
            )
            self._points[:, :2] += place_m - self._place_m - way_m
            self._points[:, 3] = 0.0  # the distance flown is not known exactly
        self._section, self._place_m = section, place_m
        self._turned_rad, self._heading_section = here.turned_rad, here.heading_section
        self._velocity_m_s, self._recalled_ns = velocity_m_s, now_ns
        now_s = now_ns / NS
        young = now_s - self._points[:, 2] <= self._avoid.remember_s
        points, before_ns = self._points[young], self._free_ns[young]
        xy = np.stack(here.from_world().places(points[:, 0], points[:, 1]), axis=1)
        free_ns = self._seen_free_ns(xy, views)
        kept = (free_ns == NEVER) | (before_ns == NEVER) | (free_ns <= before_ns)
        points, xy = points[kept], xy[kept]
        again = (free_ns != NEVER) & (before_ns != NEVER)  # the same frame in another decision
        free_ns = np.where(again, before_ns, free_ns)[kept]
        recalled = nothing_remembered()
        if len(xy):
            sector = np.round(np.arctan2(xy[:, 1], xy[:, 0]) / STEP_RAD).astype(int) % SECTORS
            hull = np.maximum(0.0, np.hypot(xy[:, 0], xy[:, 1]) - self._avoid.radius_m)
            np.minimum.at(recalled.distance_m, sector, hull)
            way_seen = (points[:, 3] > 0.0) & self._same_way(points, place_m)
            np.minimum.at(recalled.way_seen_m, sector[way_seen], hull[way_seen])
        seen = self._seen_now(scan, here, now_s)
        self._points = np.concatenate([points, seen])
        self._free_ns = np.concatenate([free_ns, np.full(len(seen), NEVER)])
        return recalled

    def _seen_now(self, scan: SectorScan, here: Here, now_s: float) -> NDArray[np.float64]:
        """Returns the near planes of a scan as rows of _points, whether the way to them was seen or not."""
        near = scan.distance_m < self._avoid.remember_m
        middle_m = scan.distance_m[near] + self._avoid.radius_m
        azimuth = scan.azimuth_rad[near]
        world = np.stack(here.to_world().places(middle_m * np.cos(azimuth), middle_m * np.sin(azimuth)), axis=1)
        way_seen = scan.state[near] == SectorState.OBSTACLE
        if here.position_ned_m is None:
            way_seen = np.zeros_like(way_seen)  # the vehicle may move, and the memory cannot follow
        place_m = np.tile((here.position_ned_m or (0.0, 0.0, 0.0))[:2], (len(world), 1))
        return np.column_stack([world, np.full(len(world), now_s), way_seen, place_m])

    def _same_way(self, points: NDArray[np.float64], place_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns (N,): the line from the place from which a point was seen to the point passes within half a
        sector's width of here.

        From elsewhere the way to the point leads through space that was not seen. The width is that at near_m."""
        line = points[:, :2] - points[:, 4:6]
        aside = line[:, 0] * (place_m[1] - points[:, 5]) - line[:, 1] * (place_m[0] - points[:, 4])
        return np.asarray(np.abs(aside) <= self._same_way_m * np.hypot(line[:, 0], line[:, 1]))

    def _seen_free_ns(self, xy: NDArray[np.float64], views: Sequence[View]) -> NDArray[np.int64]:
        """Returns the exposure, (N,), of the frame that shows a place free over the whole band, together with half a
        sector on either side; of several frames that do so together, of the oldest one. NEVER: none does.

        The sides are tested so that a pole just outside of the view is not deleted by free space beside it."""
        half = np.linspace(-self._avoid.band_above_m, self._avoid.band_below_m, self._avoid.slices + 2)[1:-1]
        c, s = math.cos(0.5 * STEP_RAD), math.sin(0.5 * STEP_RAD)
        x = np.stack([c * xy[:, 0] + s * xy[:, 1], xy[:, 0], c * xy[:, 0] - s * xy[:, 1]])
        y = np.stack([c * xy[:, 1] - s * xy[:, 0], xy[:, 1], c * xy[:, 1] + s * xy[:, 0]])
        free_ns = np.full((len(half), *x.shape), NEVER)
        for view in views:
            free = points_free(view, x, y, half, measured=True)  # of an invalid model none is
            free_ns[free] = np.maximum(free_ns[free], view.t_ns)
        return np.asarray(free_ns.min(axis=(0, 1)))


def rotated(xy: NDArray[np.float64], middle: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """Returns places (north, east), (N, 2), turned clockwise about one of them, (2,)."""
    return np.stack(LevelTransform(angle_rad).places(*(xy - middle).T), axis=1) + middle
