"""Time of each stage of the extractor: medians over many frames of one thread, after warm-up.

Run `python -m benchmarks.stages`, or with --runs, --width, --ke, --mode. The frames are our simulator's, 640x480 uint16
with the noise and the faults of a good stereo camera: one structured (street), one of foliage (trees), each level and tilted."""

from __future__ import annotations

import argparse
import math
import os
import platform
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from benchmarks.taps import STAGES, tapped
from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState
from drivers.sensor_model import TYPICAL
from drivers.simulated import Rendered, camera_info, render

FRAMES = (
    ("street, level", "street", 0.0, 0.0),
    ("street, tilted", "street", 10.0, -10.0),
    ("trees, level", "trees", 0.0, 0.0),
    ("trees, tilted", "trees", 10.0, -10.0),
)
"""(what the column is called, scene, roll and pitch in degrees)."""


class Stopwatch:
    """A tap that adds up the time of each stage within one frame, seconds."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)

    def __call__(
        self, stage: str, name: str, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        begun = time.perf_counter()
        try:
            return function(*args, **kwargs)
        finally:
            self.spent[stage] += time.perf_counter() - begun


def frame_of(scene: str, roll_deg: float, pitch_deg: float, width: int, ke: float, seed: int) -> Rendered:
    """One frame, 2 m above the ground."""
    info = camera_info(width, width * 3 // 4, ke_per_m=ke)
    sensor = replace(TYPICAL, ke_per_m=ke).scaled_to(width)
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    return render(scene, info, roll_rad=roll, pitch_rad=pitch, sensor=sensor, seed=seed)


def time_frame(frame: Rendered, params: Params, runs: int) -> tuple[dict[str, float], float, float, int]:
    """(median ms of each stage, median ms and 99th percentile of the whole untapped call, planes)."""
    extractor = Extractor(params)
    model, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=ExtractorState())
    stages: dict[str, list[float]] = defaultdict(list)
    for _ in range(runs):
        watch = Stopwatch()
        with tapped(watch):
            extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=state)
        for stage in dict.fromkeys(stage for stage, _, _ in STAGES):
            stages[stage].append(1000.0 * watch.spent[stage])
    whole = []
    for _ in range(runs):
        begun = time.perf_counter()
        extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=state)
        whole.append(1000.0 * (time.perf_counter() - begun))
    whole.sort()
    medians = {stage: statistics.median(times) for stage, times in stages.items()}
    return medians, statistics.median(whole), whole[min(runs - 1, int(0.99 * runs))], len(model.planes)


def print_table(columns: list[tuple[str, dict[str, float], float, float, int]]) -> None:
    """A Markdown table, milliseconds."""
    print("| ms | " + " | ".join(name for name, *_ in columns) + " |")
    print("|---|" + "---:|" * len(columns))
    for stage in columns[0][1]:
        print(f"| {stage} | " + " | ".join(f"{medians[stage]:.2f}" for _, medians, *_ in columns) + " |")
    rest = [whole - sum(medians.values()) for _, medians, whole, _, _ in columns]
    print("| the rest (tables, flags, stats) | " + " | ".join(f"{max(0.0, r):.2f}" for r in rest) + " |")
    print("| **whole call, median** | " + " | ".join(f"**{whole:.2f}**" for _, _, whole, _, _ in columns) + " |")
    print("| whole call, 99th percentile | " + " | ".join(f"{p99:.2f}" for _, _, _, p99, _ in columns) + " |")
    print("| planes | " + " | ".join(str(planes) for *_, planes in columns) + " |")


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stages", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=100, help="frames of each kind (100)")
    parser.add_argument("--width", type=int, default=640, help="of the image, 4:3 (640)")
    parser.add_argument("--ke", type=float, default=0.0015, help="noise, sigma_Z = ke * Z^2 (0.0015)")
    parser.add_argument("--mode", choices=("safe", "paper"), default="safe")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.runs < 3:
        parser.error("--runs: at least 3")
    columns = []
    for name, scene, roll, pitch in FRAMES:
        print(f"{name} ...", file=sys.stderr)
        frame = frame_of(scene, roll, pitch, args.width, args.ke, args.seed)
        columns.append((name, *time_frame(frame, Params(mode=args.mode), args.runs)))
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; {args.width}x{args.width * 3 // 4}, "
        f"ke {args.ke:g}, mode {args.mode}, one thread, medians of {args.runs} runs after warm-up\n"
    )
    print_table(columns)
    return 0


if __name__ == "__main__":
    sys.exit(main())
