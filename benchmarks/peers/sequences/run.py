"""Runs every method over one flight, under every pose, on the same frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.peers.octomap import NAME as OCTOMAP
from benchmarks.peers.open3d_patches import NAME as OPEN3D
from benchmarks.peers.sequences import octomap, tsdf, wavemap
from benchmarks.peers.sequences.frame_input import POSES, FrameInput, frame_input, sorted_depth_m
from benchmarks.peers.sequences.judge import Figures, Subject, View, figures, newest_view, views_aside
from benchmarks.peers.sequences.mapper import Mapper
from benchmarks.peers.sequences.ours import Frames, Merged, Tracks
from benchmarks.tracking.sequences import HZ, Pose, along, exposures
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.source import Rendered

Maker = Callable[[], Mapper]
OURS: Final[tuple[Maker, ...]] = (Frames, Tracks, Merged)
SPEED_M_S: Final = 1.5
JUDGED: Final = (10, 50)
"""Numbers of frames after which the maps are judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One flight. judged: numbers of frames, rising; width: of the image, pixels; left_out: names of methods that are not
    run."""

    scene: str
    ke_per_m: float
    seed: int
    judged: tuple[int, ...] = JUDGED
    width: int = 640
    left_out: tuple[str, ...] = ()

    @property
    def plan(self) -> FlightPlan:
        """Northwards through the scene, with a swaying attitude."""
        return along(make_scene(self.scene, self.seed), SPEED_M_S, self.judged[-1] / HZ)


def makers() -> tuple[list[Maker], list[tuple[str, str]]]:
    """All methods that can run here, ours first, and (name, why not) of the others."""
    found, absent = list(OURS), []
    for name, others in (
        (OCTOMAP, octomap.makers()),
        (f"{OPEN3D} TSDF", tsdf.makers()),
        (wavemap.NAME, wavemap.makers()),
    ):
        if isinstance(others, str):
            absent.append((name, others))
        else:
            found += others
    return found, absent


class Lane:
    """One method under one pose, and the times of its frames since it was judged."""

    def __init__(self, pose: str, mapper: Mapper) -> None:
        self.pose, self._mapper = pose, mapper
        self._ms: list[float] = []

    def add(self, frame: FrameInput) -> None:
        """Merges and times a frame: processor time of the whole process."""
        begun = time.process_time_ns()
        self._mapper.add(frame)
        self._ms.append(1e-6 * (time.process_time_ns() - begun))

    def judge(self, case: Case, frame: FrameInput, newest: View, aside: Sequence[View]) -> Figures:
        """The figures after a frame."""
        subject = Subject(
            method=self._mapper.name,
            unit=self._mapper.unit,
            scene=case.scene,
            ke_per_m=case.ke_per_m,
            pose=self.pose,
            cpu_ms=float(np.median(self._ms)),
        )
        self._ms.clear()
        return figures(subject, self._mapper.model(frame), frame, newest, aside)


def run_case(case: Case, methods: Sequence[Maker], poses: Mapping[str, Pose] | None = None) -> list[Figures]:
    """All methods under all poses (default POSES) over one flight."""
    given = POSES if poses is None else poses
    made = [(pose, make()) for pose in given for make in methods]
    lanes = [Lane(pose, mapper) for pose, mapper in made if mapper.name not in case.left_out]
    flown: list[Rendered] = []
    found: list[Figures] = []
    for e in exposures(case.plan, case.judged[-1], case.ke_per_m, seed=case.seed, width=case.width):
        flown.append(e.rendered)
        depth_m = sorted_depth_m(e.rendered, case.ke_per_m)
        frames = {name: frame_input(e, depth_m, pose) for name, pose in given.items()}
        for lane in lanes:
            lane.add(frames[lane.pose])
        if e.k + 1 in case.judged:
            newest, aside = newest_view(e, case.ke_per_m), views_aside(e, case.ke_per_m, flown)
            found += [lane.judge(case, frames[lane.pose], newest, aside) for lane in lanes]
    return found
