"""Frames and attitudes through the pipeline to the report of obstacles, in time that the test makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_report import CameraUse, ObstacleReport
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, CameraMount, ExtractorState, FrameModel, Intrinsics, PoseSample

from .sector_models import model
from .small_recordings import MS, frame

NS = 1_000_000_000
CAMERA = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5), CameraMount())
AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, recover_frames=3, avoid_margin_m=2.0)
PX4, ARDUPILOT = AutopilotNow(kind="PX4"), AutopilotNow(kind="ArduPilot", margin_m=3.0)
WALL = 320
"""Its fence comes to AVOID_MARGIN less 4 cm; cm."""


class Sees:
    """An extractor that returns given models."""

    def __init__(self, found: FrameModel) -> None:
        self.found = found

    def extract(
        self,
        depth: np.ndarray,
        info: CameraInfo,
        R_level_optical: np.ndarray,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        return self.found, state or ExtractorState()


class Chain:
    """Frames at 10 Hz and attitudes at 100 Hz through the pipeline to a builder, in time that the test makes."""

    def __init__(self, found: FrameModel, avoid: AvoidParams = AVOID) -> None:
        self.sees = Sees(found)
        self.pipeline = Pipeline((CAMERA,), lambda info: self.sees)
        self.builder = ObstacleReportBuilder(avoid, CameraUse(cameras=("front",), timeout_s=0.3))
        self.builder.announce(CAMERA)
        self.now_ns, self.sequence, self.yaw_rad = 10 * NS, 0, 0.0
        self.position: tuple[float, float, float] | None = None
        self.speed, self.turn_rad_s = (0.0, 0.0, 0.0), 0.0

    def fly(self, seconds: float, frames: bool = True, attitudes: bool = True, deliver: bool = True) -> None:
        for _ in range(round(100 * seconds)):
            self.now_ns += 10 * MS
            if attitudes:
                self.yaw_rad += 0.01 * self.turn_rad_s
                q = quaternion_from_euler(0.0, 0.0, self.yaw_rad)
                samples: list[AttitudeSample | PoseSample] = [
                    AttitudeSample(self.now_ns, self.now_ns, q, (0.0, 0.0, self.turn_rad_s))
                ]
                if self.position is not None:
                    x, y, z = self.position
                    self.position = (x + 0.01 * self.speed[0], y + 0.01 * self.speed[1], z)
                    samples.append(PoseSample(self.now_ns, self.now_ns, self.position, self.speed, 1))
                for sample in samples:
                    self.pipeline.handle(sample)
                self.builder.samples(samples)
            if frames and self.now_ns // (10 * MS) % 10 == 0:
                self.expose(deliver=deliver)

    def expose(self, late_ns: int = 0, deliver: bool = True) -> None:
        """A frame arrives, exposed late_ns before. deliver: its result reaches the builder."""
        for result in self.results(late_ns):
            if deliver:
                self.builder.result(result)

    def results(self, late_ns: int = 0) -> list[PrismsResult]:
        """The results of a frame that arrives, exposed late_ns before."""
        self.sequence += 1
        outputs = self.pipeline.handle(frame(self.sequence, self.now_ns - late_ns, self.now_ns))
        return [output for output in outputs if isinstance(output, PrismsResult)]

    def newest(self) -> PrismsResult:
        """The newest result that has arrived."""
        self.builder.catch_up()
        return self.builder._newest["front"]

    def report(self, autopilot: AutopilotNow = PX4) -> ObstacleReport:
        return self.builder.decide(autopilot, self.now_ns)

    def ahead(self, autopilot: AutopilotNow = PX4) -> int | None:
        values = self.report(autopilot).values
        return None if values is None else int(values[0])


CLEAR = model(free_to_m=13.0, view_deg=72.0)


def broken(chain: Chain, fault: str, seconds: float) -> None:
    if fault == "no frames":
        chain.fly(seconds, frames=False)
    elif fault == "results are lost":
        chain.fly(seconds, deliver=False)
    elif fault == "no attitude":
        chain.fly(seconds, attitudes=False)
    elif fault == "everything stands still":
        chain.now_ns += round(seconds * NS)
    else:
        chain.sees.found = replace(CLEAR, valid=False)
        chain.fly(seconds)


FAULTS = ["no frames", "results are lost", "no attitude", "everything stands still", "invalid frames"]
