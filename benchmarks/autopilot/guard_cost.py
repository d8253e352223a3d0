"""Processor time of the guard's view of the path, by the number of cameras.

python -m benchmarks.autopilot.guard_cost [--cameras 1 2 4]
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from companion.autopilot.obstacle_memory import Here, nothing_remembered
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.kept_views import KeptViews
from companion.guard.path_sight import path_sight
from companion.pipeline.transform import LevelTransform
from core.transformed import turned
from core.types import FrameModel
from drivers.simulation.scene_library import make_scene

from ..tracking.sequences import exposures, hovering

NS = 1_000_000_000
DECISIONS, WARM = 60, 20
EXPOSURE_AGE_NS = NS // 20


def main() -> None:
    """Prints one line for each number of cameras."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--cameras", type=int, nargs="+", default=[1, 2, 4])
    model = next(iter(exposures(hovering(make_scene("street")), 1, 0.0015))).model
    for count in parser.parse_args().cameras:
        print(f"{count} cameras: {median_ms(model, count):.2f} ms for each decision")


def median_ms(model: FrameModel, cameras: int) -> float:
    """Median thread time of one decision while the vehicle flies straight at 2 m/s. The cameras look all around, and are
    exposed one after another within the time between two decisions."""
    avoid, guard = AvoidParams(), GuardParams(enabled=True)
    kept = KeptViews()
    step_ns, times_ms = round(NS / avoid.rate_hz), []
    at = LevelTransform(0.0, (0.0, 0.0, 0.0))
    views = tuple(View(turned(model, k * math.tau / cameras, (0.0, 0.0, 0.0)), at) for k in range(cameras))
    for k in range(DECISIONS):
        t_ns = 100 * NS + k * step_ns
        frames = tuple((f"camera {j}", t_ns - EXPOSURE_AGE_NS - j * step_ns // cameras) for j in range(cameras))
        s = Surroundings(
            t_ns=t_ns,
            views=views,
            weak_px=(0.0,) * cameras,
            exposed_ns=min(exposed_ns for _, exposed_ns in frames),
            recall=None,
            recalled=nothing_remembered(),
            blind={},
            here=Here(0.0, (2.0 * k * step_ns / NS, 0.0, -3.0), 1),
            velocity_ned_m_s=(2.0, 0.1, 0.0),
            frames=frames,
        )
        begun_ns = time.thread_time_ns()
        path_sight(s, avoid, guard, 0.0, kept.before(s))
        times_ms.append((time.thread_time_ns() - begun_ns) / 1e6)
        kept.take(s)
    return float(np.median(times_ms[WARM:]))


if __name__ == "__main__":
    main()
