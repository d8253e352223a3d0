"""PX4 in Position mode beside a pole that is outside of the camera's view, or at its edge.

    python -m benchmarks.autopilot.edge_px4 [every] [--blank]

Sticks at every angle from -60 to 60 degrees, poles at every bearing and at four distances, both generations of PX4, both
guide angles. The camera's view is 75 degrees wide. A collision is a pole inside of the hull's radius. `every`: fly each n-th
case only. --blank: poles of 0.5 m, 5 and 8 m away, of which only the sides are measured, sticks up to 15 degrees, CP_DIST 3 m.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.autopilot.px4_loop import Px4Loop, Values, stick_at
from benchmarks.autopilot.px4_position_mode import Px4Params, position_mode
from companion.autopilot.camera_coverage import covered, looked_into, too_near_the_edge
from companion.autopilot.failsafe import AutopilotNow, BlindPolicy, PolicyInput, braking_reach, policy_of
from companion.autopilot.obstacle_memory import Here, ObstacleMemory
from companion.autopilot.polar_histogram import scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform
from core.types import CameraInfo, CameraMount, FrameModel, FreeEnd, FreeProfile, Ground, Intrinsics

AVOID = AvoidParams(max_distance_m=12.0, rays=2, slices=4, step_m=0.5)
CP_DIST_M, POLE_RADIUS_M = 2.0, 0.06
HALF_VIEW_DEG = 37.5
CAMERA = CameraInfo(
    "front", Intrinsics(640, 480, 320.0 / math.tan(math.radians(HALF_VIEW_DEG)), 420.0, 319.5, 239.5), CameraMount()
)
LOOKS = looked_into(CAMERA, AVOID)
BLIND, (SEEING, WHOLE) = np.zeros(72, bool), covered([LOOKS])
DIRECTIONS = 75


@dataclass(frozen=True, slots=True)
class Blank:
    """A pole in whose directions nothing is free. sides: they are measured; else nothing of it is."""

    radius_m: float
    sides: bool = True


@dataclass(frozen=True, slots=True)
class Case:
    """One flight. stick_deg, bearing_deg: clockwise from the nose; range_m: to the pole's middle; blank: None, the pole is measured in
    full."""

    version: tuple[int, int]
    guide_deg: float
    round_index: bool
    stick_deg: float
    bearing_deg: float
    range_m: float
    blank: Blank | None = None
    cp_dist_m: float = CP_DIST_M


@dataclass(frozen=True, slots=True)
class Flown:
    """flown_m: from the start to the end; clearance_m: least distance of the pole from the hull, negative: collision."""

    flown_m: float
    clearance_m: float


def seen_from(pole_m: tuple[float, float] | None, empty: FrameModel, blank: Blank | None = None) -> FrameModel:
    """What an ideal camera finds: the part of the pole inside of the view as a plane, and free space up to 13 m but behind
    it. pole_m: from the vehicle, forward and right."""
    if pole_m is None:
        return empty
    radius_m = POLE_RADIUS_M if blank is None else blank.radius_m
    range_m, bearing_deg = math.hypot(*pole_m), math.degrees(math.atan2(pole_m[1], pole_m[0]))
    half_deg = math.degrees(math.asin(min(1.0, radius_m / range_m)))
    low, high = max(bearing_deg - half_deg, -HALF_VIEW_DEG), min(bearing_deg + half_deg, HALF_VIEW_DEG)
    if low >= high or range_m > 13.0:
        return empty
    near_m = range_m - radius_m
    ends = [(near_m * math.cos(math.radians(a)), near_m * math.sin(math.radians(a))) for a in (low, high)]
    free = empty.free
    edges_deg = np.degrees(free.azimuth_edges_rad)
    behind = (edges_deg[:-1] < high) & (edges_deg[1:] > low)
    to_m, end = free.free_to_m.copy(), free.end.copy()
    to_m[behind], end[behind] = near_m - 0.5, FreeEnd.OBSTACLE
    from_m = free.free_from_m.copy()
    if blank is not None:
        from_m[behind], to_m[behind], end[behind] = 0.0, 0.0, FreeEnd.UNKNOWN
    free = replace(free, free_from_m=from_m, free_to_m=to_m, end=end)
    if blank is not None and not blank.sides:
        return replace(empty, free=free)
    return replace(
        empty,
        planes=np.array([[*ends[0], *ends[1], -2.0, 2.0]], np.float32),
        support_px=np.ones(1, np.int32),
        margin_m=np.zeros(1, np.float32),
        flags=np.zeros(1, np.uint8),
        cluster=np.zeros(1, np.int32),
        free=free,
    )


def empty_model(model: FrameModel) -> FrameModel:
    """A model without planes whose view is free to 13 m. model: any, for its other fields."""
    layers = (DIRECTIONS, 3)
    half = math.radians(HALF_VIEW_DEG)
    return replace(
        model,
        planes=np.zeros((0, 6), np.float32),
        support_px=np.zeros(0, np.int32),
        margin_m=np.zeros(0, np.float32),
        flags=np.zeros(0, np.uint8),
        cluster=np.zeros(0, np.int32),
        prisms=(),
        ground=Ground(seen=False),
        free=FreeProfile(
            azimuth_edges_rad=np.linspace(-half, half, DIRECTIONS + 1).astype(np.float32),
            layer_edges_m=np.array([-3.0, -1.0, 1.0, 3.0], np.float32),
            free_from_m=np.full(layers, 1.5, np.float32),
            free_to_m=np.full(layers, 13.0, np.float32),
            end=np.full(layers, FreeEnd.MAX_RANGE, np.uint8),
        ),
    )


class Service:
    """What the service sends for a pole, from the place where the vehicle is."""

    def __init__(self, loop: Px4Loop, pole_m: tuple[float, float], empty: FrameModel, trims: bool, case: Case) -> None:
        self._loop, self._pole_m, self._empty = loop, pole_m, empty
        self._blank = case.blank
        self._memory, self._blind = ObstacleMemory(AVOID), BlindPolicy(AVOID)
        self._policy = policy_of(AVOID, AutopilotNow(kind="PX4", cp_dist_m=case.cp_dist_m))
        self._edge = too_near_the_edge([LOOKS], AVOID) if trims else BLIND
        self.clearance_m = math.inf

    def __call__(self, now_ns: int) -> Values | None:
        x, y = (float(c) for c in self._loop.vehicle.position_m)
        relative = self._pole_m[0] - x, self._pole_m[1] - y
        radius_m = POLE_RADIUS_M if self._blank is None else self._blank.radius_m
        self.clearance_m = min(self.clearance_m, math.hypot(*relative) - radius_m - AVOID.radius_m)
        model = seen_from(relative, self._empty, self._blank)
        view = View(model, LevelTransform(0.0, (0.0, 0.0, 0.0)), t_ns=now_ns)
        found = scan([view], AVOID)
        recalled = self._memory.recall(found, [view], Here(0.0, (x, y, -3.0), 1), now_ns)
        vx, vy = (float(c) for c in self._loop.vehicle.velocity_m_s)
        sight = PolicyInput(found, recalled, BLIND, SEEING, WHOLE, now_ns, self._edge, (vx, vy))
        self._loop.reach = braking_reach(sight, AVOID, self._policy)
        return self._blind.values(sight, self._policy, now_ns)


def flown(case: Case, empty: FrameModel, trims: bool = True) -> Flown:
    """One flight with the stick held at 60 %: ends when the vehicle stands after two seconds, or after seven. trims: False: as
    it would be if sectors at the edge of the view were sent like others."""
    params = Px4Params(cp_guide_ang_deg=case.guide_deg, round_index=case.round_index)
    loop = Px4Loop(position_mode(case.version, case.cp_dist_m, params), AVOID)
    angle = math.radians(case.bearing_deg)
    pole_m = case.range_m * math.cos(angle), case.range_m * math.sin(angle)
    service = Service(loop, pole_m, empty, trims, case)
    for second in range(7):
        loop.fly(1.0, stick_at(0.6, case.stick_deg), service)
        if second >= 1 and float(np.hypot(*loop.vehicle.velocity_m_s)) < 0.02:
            break
    return Flown(float(np.hypot(*loop.vehicle.position_m)), service.clearance_m)


def cases() -> Iterator[Case]:
    """All of the matrix; poles from 2 m on, farther than 45 degrees from the stick they cannot be met."""
    sticks = sorted({*np.arange(-60.0, 61.0, 5.0), *np.arange(28.0, 45.0, 1.0), *-np.arange(28.0, 45.0, 1.0)})
    readers = [((1, 15), False), ((1, 16), False), ((1, 16), True)]
    for (version, rounds), guide, stick, offset, range_m in itertools.product(
        readers, (0.0, 30.0), sticks, np.arange(-42.5, 43.0, 5.0), (2.0, 3.0, 5.0, 8.0)
    ):
        yield Case(version, guide, rounds, float(stick), float(stick + offset), range_m)


def blank(case: Case) -> Case:
    """The case with a blank pole of 0.5 m and CP_DIST 3 m."""
    return replace(case, blank=Blank(0.25), cp_dist_m=3.0)


def main() -> None:
    """Flies the matrix and prints the collisions, with the trim of the edge and without it; blank poles with it alone."""
    from tests.companion.small_recordings import easy_model

    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("every", type=int, nargs="?", default=1)
    p.add_argument("--blank", action="store_true")
    a = p.parse_args()
    empty = empty_model(easy_model(1.0, 0.0))
    chosen = [blank(c) for c in cases() if abs(c.stick_deg) <= 15.0 and c.range_m >= 5.0] if a.blank else list(cases())
    for trims in (True,) if a.blank else (True, False):
        results = [(case, flown(case, empty, trims)) for case in chosen[:: a.every]]
        hits = [(case, r) for case, r in results if r.clearance_m < 0.0]
        moved = [r.clearance_m for _, r in results if r.flown_m > 0.5]
        least = np.quantile(moved, (0.0, 0.01, 0.1)).round(2).tolist() if moved else []
        print(f"trim {trims}: {len(hits)} collisions in {len(results)} flights, {len(moved)} of which moved")
        print(f"  least distance m of those, and its 1 and 10 % quantiles: {least}")
        for case, r in hits[:40]:
            print("  ", case, r)


if __name__ == "__main__":
    main()
