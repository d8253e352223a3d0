"""Remembered free space ends where a frame shows an obstacle, whether or not that frame decides what is sent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, FrameModel, PoseSample

from ..report_chain import ARDUPILOT, AVOID, CAMERA, MS, NS, Sees
from ..sector_models import model
from ..small_recordings import frame

CLEAR_CM = 1201
AHEAD = [71, 0, 1]


def in_layers(
    found: FrameModel, from_m: tuple[float, float, float] = (1.5, 1.5, 1.5), to_m: float = 13.0
) -> FrameModel:
    """A model with free ranges of its own in three layers, which are the upper part of the height band."""
    near, far = np.full((36, 6), 1.5, np.float32), np.full((36, 6), 13.0, np.float32)
    near[:, 1:4], far[:, 1:4], far[:, 0] = from_m, to_m, 0.0
    free = replace(
        found.free,
        layer_edges_m=np.array([-3.0, -1.0, -0.64, -0.48, -0.32, 1.0, 3.0], np.float32),
        free_from_m=near,
        free_to_m=far,
        end=np.full((36, 6), found.free.end[0, 0], np.uint8),
    )
    return replace(found, free=free)


FREE = in_layers(model(free_to_m=13.0, view_deg=72.0))
BRANCH = in_layers(model((3.2, -1.5, 3.2, 1.5, -1.0, -0.33), free_to_m=13.0, view_deg=72.0), to_m=2.7)
LEANT = in_layers(model(free_to_m=13.0, view_deg=72.0), from_m=(8.1, 6.3, 4.5))
"""By a camera that leans forward: the upper part of the band is in its image from farther away on."""


class Flight:
    """A hover at 5 m with a camera of 10 Hz and a decision after each frame."""

    def __init__(self, *others: str) -> None:
        """others: names of further cameras at the same place, which give no frames by themselves."""
        self.sees = Sees(FREE)
        infos = (CAMERA, *(replace(CAMERA, camera=name) for name in others))
        self.pipeline = Pipeline(infos, lambda info: self.sees)
        self.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", *others), timeout_s=0.3))
        for info in infos:
            self.builder.announce(info)
        self.now_ns, self.sequence, self.pitch_rad = 10 * NS, 0, 0.0
        self.cm: list[int] = []

    def send_motion(self, time_ms: int, position: bool = True) -> None:
        """Attitudes and positions at 100 Hz."""
        for _ in range(time_ms // 10):
            self.now_ns += 10 * MS
            q, still = quaternion_from_euler(0.0, self.pitch_rad, 0.0), (0.0, 0.0, 0.0)
            samples: list[AttitudeSample | PoseSample] = [AttitudeSample(self.now_ns, self.now_ns, q, still)]
            if position:
                samples.append(PoseSample(self.now_ns, self.now_ns, (0.0, 0.0, -5.0), still, 1))
            for sample in samples:
                self.pipeline.handle(sample)
            self.builder.samples(samples)

    def take_frame(self, found: FrameModel, camera: str = "front") -> None:
        self.sees.found = found
        self.sequence += 1
        image = replace(frame(self.sequence, self.now_ns, self.now_ns), camera=camera)
        for output in self.pipeline.handle(image):
            if isinstance(output, PrismsResult):
                self.builder.result(output)

    def decide(self) -> None:
        values = self.builder.decide(ARDUPILOT, self.now_ns).values
        assert values is not None
        self.cm = [int(v) for v in values[AHEAD]]

    def fly(self, frames: int, found: FrameModel, position: bool = True) -> None:
        for _ in range(frames):
            self.send_motion(100, position)
            self.take_frame(found)
            self.decide()

    def without_frames(self, decisions: int) -> None:
        for _ in range(decisions):
            self.send_motion(100)
            self.decide()

    def lean(self) -> list[int]:
        """Leans forward and returns what is sent for the sectors ahead."""
        self.pitch_rad = math.radians(-20.0)
        self.fly(7, LEANT)
        return self.cm


def test_what_was_seen_free_before_leaning_is_clear() -> None:
    flight = Flight()
    flight.fly(15, FREE)
    assert flight.lean() == [CLEAR_CM] * 3


def test_free_space_of_a_camera_that_was_blind_is_not_remembered() -> None:
    flight = Flight()
    flight.fly(15, FREE)
    flight.without_frames(20)
    assert max(flight.lean()) < CLEAR_CM


def test_an_obstacle_of_a_frame_that_does_not_count_yet_ends_free_space() -> None:
    """The camera has recovered and has delivered two good frames in a row; three are needed."""
    flight = Flight()
    flight.fly(15, FREE)
    flight.without_frames(4)
    flight.fly(2, BRANCH)
    assert max(flight.lean()) < CLEAR_CM


@pytest.mark.parametrize("second", [BRANCH, FREE], ids=["obstacle", "free"])
def test_an_obstacle_of_another_camera_that_does_not_count_yet_ends_free_space(second: FrameModel) -> None:
    """The other camera gives two good frames, after which it fails again; three are needed."""
    flight = Flight("other")
    flight.fly(15, FREE)
    for _ in range(2):
        flight.send_motion(90)
        flight.take_frame(second, "other")
        flight.send_motion(10)
        flight.take_frame(FREE)
        flight.decide()
    assert (max(flight.lean()) < CLEAR_CM) == (second is BRANCH)


@pytest.mark.parametrize("first", [BRANCH, FREE], ids=["between two decisions", "never"])
def test_an_obstacle_of_a_frame_between_two_decisions_ends_free_space(first: FrameModel) -> None:
    """30 frames a second, 15 decisions: the second frame is the newest one of the decision."""
    flight = Flight()
    for _ in range(25):
        for _ in range(2):
            flight.send_motion(30)
            flight.take_frame(FREE)
        flight.decide()
    flight.send_motion(30)
    flight.take_frame(first)
    flight.pitch_rad = math.radians(-20.0)
    for _ in range(24):
        flight.send_motion(30)
        flight.take_frame(LEANT)
        flight.decide()
    assert (max(flight.cm) < CLEAR_CM) == (first is BRANCH)


def test_an_obstacle_in_a_pause_of_the_position_ends_free_space() -> None:
    """The pause is too short for a new section of the position."""
    flight = Flight()
    flight.fly(15, FREE)
    flight.fly(4, FREE, position=False)
    flight.fly(1, BRANCH, position=False)
    flight.pitch_rad = math.radians(-20.0)
    flight.fly(2, LEANT, position=False)
    flight.fly(4, LEANT)
    assert max(flight.cm) < CLEAR_CM
