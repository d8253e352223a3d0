"""Judges the output of a configured flight by the truth: sectors, the path of the guard, and the answers of the client."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from benchmarks.faults.field import STEP_DEG
from benchmarks.faults.judge import RANGE_M, UNKNOWN, Judge
from benchmarks.faults.loop import FaultLoop
from companion.config.loader import Config
from companion.guard.path_sight import PathSight
from companion.pipeline.results import PrismsResult
from core.types import CameraMount
from drivers.mavlink.session_types import ARDUPILOT, PX4
from drivers.simulation.flight_path import VehicleState
from osape_client.model import CameraModel
from osape_client.query.space import Occupancy, PlacedModel, Space

LEVEL_RAD, NEAR_M = math.radians(8.0), 0.3
"""The height band beside a camera that is tilted by less, and is nearer to the middle of the vehicle, is in its view."""
CORE = 0.8
"""Share of the radius in which a solid beside the path counts."""
RAY_DEG = 0.25
"""Half of the width of the wedge in which a query of the client lies."""


@dataclass(slots=True)
class ConfiguredJudge(Judge):
    """A Judge that knows the configuration. wrong: contradictions of the guard and of the client; points: queries of the client that
    were judged; paths, free_paths: decisions of the guard, and those with a free path."""

    config: Config = field(default_factory=Config)
    wrong: list[str] = field(default_factory=list)
    points: int = 0
    free_points: int = 0
    paths: int = 0
    free_paths: int = 0

    def sent(self, loop: FaultLoop, values: list[int]) -> None:
        """As that of Judge. The wall all around PX4 may replace nearer obstacles (docs/explanation/failsafe.md), which with a
        large radius_m are in the field."""
        if self.kind == PX4 and len(set(values)) == 1 and values[0] < round(100 * loop.avoid.max_distance_m):
            self.messages += 1
        else:
            Judge.sent(self, loop, values)

    def judge_time(self, loop: FaultLoop, values: list[int], clear_cm: int) -> None:
        """As that of Judge; unknown is judged where the policies and the view of a camera promise more."""
        avoid = self.config.avoid
        level = all(_is_level(c.mount) for c in loop.cameras) and all(
            c.required and not c.masks and not c.unmatched_px for c in self.config.cameras
        )
        if self.kind == ARDUPILOT and level and avoid.unseen == "stop" and avoid.blind != "unknown":
            Judge.judge_time(self, loop, values, clear_cm)
        else:
            Judge.judge_time(self, loop, [0 if v == UNKNOWN else v for v in values], clear_cm)

    def judge_path(self, loop: FaultLoop) -> None:
        """Nothing: `path` judges the guard of the flight."""

    def path(self, loop: FaultLoop, sight: PathSight) -> None:
        """Judges how far a path is called free: no solid may stand in the middle of it."""
        self.paths += 1
        if sight.free_m <= 0.0 or sight.course_rad is None:
            return
        self.free_paths += 1
        state = loop.truth()
        # the course in ned of the autopilot, which without a fault is the truth
        north, east = (loop.field.outline_m - np.array(state.position_ned_m[:2])).T
        c, s = math.cos(sight.course_rad), math.sin(sight.course_rad)
        along, across = c * north + s * east, c * east - s * north
        inside = (np.abs(across) < CORE * self.config.avoid.radius_m + 0.05) & (along > 0.0)
        nearest_m = float(along[inside].min()) if inside.any() else math.inf
        if sight.free_m > nearest_m + RANGE_M:
            self.wrong.append(
                f"{loop.flown_ns / 1e9:.2f} s: the path is free to {sight.free_m:.2f} m, a solid is {nearest_m:.2f} m away"
            )

    def model(self, loop: FaultLoop, result: PrismsResult, model: CameraModel, exposed: VehicleState) -> None:
        """Judges answers of the client: just behind the nearest solid of a direction nothing is free."""
        if result.frame != "ned":
            return
        at = np.array(exposed.position_ned_m)
        north, east = (loop.field.outline_m - at[:2]).T
        bearing_deg, range_m = np.degrees(np.arctan2(east, north)), np.hypot(north, east)
        space = Space([PlacedModel(model, exposed.position_ned_m)])
        for aim_deg in np.arange(-180.0, 180.0, STEP_DEG):
            inside = np.abs(bearing_deg - aim_deg) < RAY_DEG
            if not inside.any():
                continue
            beyond_m = float(range_m[inside].max() if inside.sum() < 3 else range_m[inside].min()) + RANGE_M
            aim = math.radians(aim_deg)
            point = at + beyond_m * np.array([math.cos(aim), math.sin(aim), 0.0])
            self.points += 1
            if space.points(point[None])[0] == Occupancy.FREE:
                self.free_points += 1
                self.wrong.append(
                    f"{loop.flown_ns / 1e9:.2f} s: the client calls {point.round(2)} free, behind a solid"
                )


def _is_level(mount: CameraMount) -> bool:
    """Whether a camera looks horizontally from the middle of the vehicle."""
    tilt_rad = max(abs(mount.pitch_rad), abs(math.asin(math.sin(mount.roll_rad))))
    return tilt_rad < LEVEL_RAD and max(abs(mount.x_m), abs(mount.y_m), abs(mount.z_m)) < NEAR_M
