"""Simulated frame sequences and the measurement of their extraction."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from statistics import median

import numpy as np
from numpy.typing import NDArray

from core.extractor import Extractor
from core.types import CameraInfo, ExtractorState, FrameModel
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info, render

from .stage_trace import Stopwatch, in_order, traced
from .timing import Clock, Times

HEIGHT_M = 2.0
"""Height of the camera above the ground."""

MIN_RUNS = 1

Depth = NDArray[np.uint16]
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameSequence:
    """Images of one view that differ in noise only, so that consecutive frames differ."""

    name: str
    info: CameraInfo
    R_level_optical: NDArray[np.float64]  # (3, 3)
    depth_mm: tuple[Depth, ...]  # (H, W) uint16 each

    def __post_init__(self) -> None:
        if not self.depth_mm:
            raise ValueError(f"frame sequence {self.name!r}: it needs at least one image")


def render_sequence(
    name: str,
    scene: str | Scene,
    size: tuple[int, int],
    *,
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    yaw_rad: float = 0.0,
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -HEIGHT_M),
    ke_per_m: float = 0.0015,
    images: int = 4,
    seed: int = 1,
) -> FrameSequence:
    """Renders images of a scene with the typical sensor faults. size: (width, height) px; pitch is positive upwards."""
    info = camera_info(*size, ke_per_m=ke_per_m)
    sensor = replace(TYPICAL, ke_per_m=ke_per_m).scaled_to(size[0])
    scene_model = make_scene(scene, seed) if isinstance(scene, str) else scene
    pose = {"roll_rad": math.radians(roll_deg), "pitch_rad": math.radians(pitch_deg), "yaw_rad": yaw_rad}
    frames = [
        render(scene_model, info, **pose, position_ned_m=position_ned_m, sensor=sensor, seed=seed, frame=i)
        for i in range(images)
    ]
    return FrameSequence(
        name=name, info=info, R_level_optical=frames[0].R_level_optical, depth_mm=tuple(f.depth_mm for f in frames)
    )


class Flight:
    """Extracts the images of a sequence repeatedly, passing the state from frame to frame as in flight."""

    def __init__(self, extractor: Extractor, frames: FrameSequence) -> None:
        self._extractor, self._frames = extractor, frames
        self._state = ExtractorState()
        self._number = count()

    def frame(self) -> FrameModel:
        """The model of the next image."""
        frames = self._frames
        depth = frames.depth_mm[next(self._number) % len(frames.depth_mm)]
        model, self._state = self._extractor.extract(depth, frames.info, frames.R_level_optical, self._state)
        return model


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measured:
    """Times of whole calls, medians of the processor time per stage in ms (of traced calls, which are slightly slower),
    and median sizes of the models."""

    name: str
    times: Times
    stages_ms: dict[str, float]
    valid: bool
    planes: int
    strips: int

    def rest_ms(self) -> float:
        """Processor time of a call outside of all stages."""
        return max(0.0, self.times.cpu() - sum(self.stages_ms.values()))


def measure(
    frames: FrameSequence,
    extractor: Extractor,
    runs: int,
    *,
    watched: int = 0,
    budget_s: float = math.inf,
    interleaved: Sequence[Callable[[], object]] = (),
    progress: Progress = lambda share: None,
) -> Measured:
    """Measures `runs` calls after warm-up, then `watched` more by stage; fewer, but at least one, once `budget_s` has
    passed.

    interleaved: calls between the runs, outside of their time (such as a reference workload)."""
    flight, clock = Flight(extractor, frames), Clock()
    end_s = time.monotonic() + budget_s

    def out_of_time(done: int) -> bool:
        return done >= MIN_RUNS and time.monotonic() > end_s

    for i in range(2 + len(frames.depth_mm)):
        if not out_of_time(i):
            flight.frame()
    models: list[tuple[bool, int, int]] = []
    for i in range(runs):
        if out_of_time(i):
            break
        model = clock.run(flight.frame)
        models.append((model.valid, len(model.planes), model.stats.strips))
        for other in interleaved:
            other()
        progress((i + 1) / (runs + watched))
    spent: list[dict[str, float]] = []
    for i in range(watched):
        if out_of_time(i):
            break
        watch = Stopwatch()
        with traced(watch):
            flight.frame()
        spent.append(watch.spent_ms)
        progress((runs + i + 1) / (runs + watched))
    stages = in_order(stage for one in spent for stage in one)
    return Measured(
        name=frames.name,
        times=clock.times(),
        stages_ms={stage: median(one.get(stage, 0.0) for one in spent) for stage in stages},
        valid=all(valid for valid, _, _ in models),
        planes=round(median(planes for _, planes, _ in models)),
        strips=round(median(strips for _, _, strips in models)),
    )
