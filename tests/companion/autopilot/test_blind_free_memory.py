"""Free space that a camera saw before it became blind does not complete what another one sees."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.types import AttitudeSample, CameraMount, PoseSample

from ..report_chain import ARDUPILOT, AVOID, CAMERA, NS, Sees, frame
from ..sector_models import model

CLEAR_CM = 1201
PX4_UNKNOWN = AutopilotNow(kind="PX4")


SEEN_FREE = model(free_to_m=13.0, view_deg=72.0)
"""In axes that are turned with the camera."""


class Pair:
    """Two cameras that look 30 degrees to the left and to the right; a hover with a position."""

    def __init__(self) -> None:
        self.infos = tuple(
            replace(CAMERA, camera=c, mount=CameraMount(yaw_rad=math.radians(yaw)))
            for c, yaw in (("a", -30), ("b", 30))
        )
        self.sees = {info.camera: Sees(SEEN_FREE) for info in self.infos}
        self.pipeline = Pipeline(self.infos, lambda info: self.sees[info.camera])
        self.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("a", "b"), timeout_s=0.3))
        for info in self.infos:
            self.builder.announce(info)
        self.now_ns, self.sequence = 10 * NS, 0

    def fly(self, frames: int, *cameras: str) -> None:
        for _ in range(frames):
            self.now_ns += NS // 10
            self.sequence += 1
            still = (0.0, 0.0, 0.0)
            for sample in (
                AttitudeSample(self.now_ns, self.now_ns, (1.0, 0.0, 0.0, 0.0), still),
                PoseSample(self.now_ns, self.now_ns, (0.0, 0.0, -2.0), still, 1),
            ):
                self.pipeline.handle(sample)
                self.builder.samples([sample])
            for camera in cameras:
                image = replace(frame(self.sequence, self.now_ns, self.now_ns), camera=camera)
                for output in self.pipeline.handle(image):
                    if isinstance(output, PrismsResult):
                        self.builder.result(output)
            self.values(ARDUPILOT)

    def values(self, autopilot: AutopilotNow) -> list[int]:
        values = self.builder.decide(autopilot, self.now_ns).values
        assert values is not None
        return values.tolist()


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4_UNKNOWN])
def test_a_sector_that_a_blind_camera_shares_is_not_completed_by_what_it_saw(autopilot: AutopilotNow) -> None:
    pair = Pair()
    pair.fly(10, "a", "b")
    assert pair.values(ARDUPILOT)[:3] == [CLEAR_CM] * 3
    pair.fly(4, "a")
    after = pair.values(autopilot)
    assert after[1] != CLEAR_CM
    assert after[2] != CLEAR_CM
    assert after[68] == CLEAR_CM
