"""Judges the output of a configured flight by the truth, as benchmarks/faults/judge.py, where the configuration promises it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from benchmarks.faults.judge import UNKNOWN, Judge
from benchmarks.faults.loop import FaultLoop
from companion.config.loader import Config
from core.types import CameraMount
from drivers.mavlink.session_types import ARDUPILOT, PX4

LEVEL_RAD, NEAR_SHARE = math.radians(8.0), 0.12
"""The height band from near_m on, within twice the judge's border of the view, is in the view of a camera that is tilted by less, and
is nearer to the middle of the vehicle than this share of near_m: its border is moved by up to 7 degrees there."""
WALL_CM = 212
"""Distance of the wall for the AVOID_MARGIN of the simulated ArduPilot, 2 m."""


@dataclass(slots=True)
class ConfiguredJudge(Judge):
    """A Judge that knows the configuration."""

    config: Config = field(default_factory=Config)

    def sent(self, loop: FaultLoop, values: list[int]) -> None:
        """As that of Judge. The wall all around PX4 may replace nearer obstacles, and the wall before blind cameras of ArduPilot may be
        farther than what was never seen (docs/explanation/failsafe.md). With a large radius_m there are such solids."""
        if self.kind == ARDUPILOT:
            values = [0 if value == WALL_CM else value for value in values]
        if self.kind == PX4 and len(set(values)) == 1 and values[0] < round(100 * loop.avoid.max_distance_m):
            self.messages += 1
            self.judge_path(loop)
        else:
            Judge.sent(self, loop, values)

    def judge_time(self, loop: FaultLoop, values: list[int], clear_cm: int) -> None:
        """As that of Judge; unknown is judged where the policies and the view of a camera promise more."""
        avoid = self.config.avoid
        level = all(_is_level(c.mount, avoid.near_m) for c in loop.cameras) and all(
            c.required and not c.masks and not c.unmatched_px for c in self.config.cameras
        )
        if self.kind == ARDUPILOT and level and avoid.unseen == "stop" and avoid.blind != "unknown":
            Judge.judge_time(self, loop, values, clear_cm)
        else:
            Judge.judge_time(self, loop, [0 if v == UNKNOWN else v for v in values], clear_cm)


def _is_level(mount: CameraMount, near_m: float) -> bool:
    """Whether a camera looks horizontally from the middle of the vehicle for places from near_m on."""
    tilt_rad = max(abs(mount.pitch_rad), abs(math.asin(math.sin(mount.roll_rad))))
    return tilt_rad < LEVEL_RAD and max(abs(mount.x_m), abs(mount.y_m), abs(mount.z_m)) < NEAR_SHARE * near_m
