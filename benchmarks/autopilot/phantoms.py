"""How often something near is sent to the autopilot in a hover before a bare wall, by single mismatches of the camera.

python -m benchmarks.autopilot.phantoms [frames] [seed ...]
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info, render

NS = 1_000_000_000
FRAME_NS = NS // 12
HEIGHT_M = 2.0
CAMERA = camera_info(320, 240)
SENSOR = replace(TYPICAL.scaled_to(320), sky_is_far=True)
NEAR_M = 4.0


def bare_wall(at_m: float) -> Scene:
    """A wall 40 m wide and 8 m high across the way."""
    b = SceneBuilder("bare wall")
    b.ground()
    b.box("wall", at_m + 0.15, 0.0, 0.3, 40.0, 8.0)
    return b.build()


@dataclass(frozen=True, slots=True)
class Hover:
    """frames: shown; weak: frames with a plane nearer than NEAR_M; messages: sent; near: those with anything nearer."""

    frames: int
    weak: int
    messages: int
    near: int


def hover(frames: int, confirm_px: int, kind: str = "ArduPilot", wall_m: float = 8.0, seed: int = 3) -> Hover:
    """Hovers before the wall; a frame at 12 Hz, and a message after each."""
    avoid = AvoidParams(confirm_px=confirm_px, avoid_margin_m=2.0)
    builder = ObstacleReportBuilder(avoid, CameraUse(cameras=(CAMERA.camera,), timeout_s=0.3))
    builder.announce(CAMERA)
    weak, messages, near = 0, 0, 0
    for n, result in enumerate(_results(frames, wall_m, seed)):
        builder.samples(_samples(result.t_exposure_ns))
        builder.result(result)
        weak += result.model is not None and _has_near(result.model.planes)
        values = builder.decide(AutopilotNow(kind=kind, margin_m=2.0), result.t_exposure_ns).values
        if n >= 10 and values is not None:  # after the start
            messages += 1
            near += bool((values < 100.0 * NEAR_M).any())
    return Hover(frames, weak, messages, near)


@lru_cache(maxsize=1)
def _results(frames: int, wall_m: float, seed: int) -> tuple[PrismsResult, ...]:
    """The result of each frame, which no parameter of avoidance changes."""
    scene, extractor = bare_wall(wall_m), Extractor()
    pipeline = Pipeline((CAMERA,), lambda info: extractor)
    results = []
    for n in range(frames):
        now_ns = 100 * NS + (n + 1) * FRAME_NS
        for sample in _samples(now_ns):
            pipeline.handle(sample)
        seen = render(scene, CAMERA, position_ned_m=(0.0, 0.0, -HEIGHT_M), sensor=SENSOR, seed=seed, frame=n)
        frame = DepthFrame(
            camera=CAMERA.camera, sequence=n, t_exposure_ns=now_ns, t_arrival_ns=now_ns, depth_mm=seen.depth_mm
        )
        results += [output for output in pipeline.handle(frame) if isinstance(output, PrismsResult)]
    return tuple(results)


def _samples(t_ns: int) -> list[AttitudeSample | PoseSample]:
    """Attitude and position of the hover."""
    return [
        AttitudeSample(t_ns, t_ns, quaternion_from_euler(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        PoseSample(t_ns, t_ns, (0.0, 0.0, -HEIGHT_M), (0.0, 0.0, 0.0)),
    ]


def _has_near(planes: np.ndarray) -> bool:
    middle = 0.5 * (planes[:, 0:2] + planes[:, 2:4])
    height_m = (planes[:, 4] < HEIGHT_M - 0.8 + 1.6) & (planes[:, 5] > -HEIGHT_M - 0.8)
    return bool((height_m & (np.hypot(*middle.T) < NEAR_M)).any())


def main() -> None:
    """Prints the shares with and without confirmation, for each seed of the sensor's noise."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 600
    seeds = [int(seed) for seed in sys.argv[2:]] or [3]
    for seed, kind in itertools.product(seeds, ("ArduPilot", "PX4")):
        for confirm_px in (0, AvoidParams().confirm_px):
            h = hover(frames, confirm_px, kind, seed=seed)
            print(
                f"seed {seed}, {kind}, confirm_px = {confirm_px}: {100 * h.weak / h.frames:.1f} % of {h.frames} frames with a near plane, "
                f"{100 * h.near / h.messages:.1f} % of {h.messages} messages with anything nearer than {NEAR_M:g} m"
            )


if __name__ == "__main__":
    main()
