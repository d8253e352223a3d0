"""What a camera process reports of an opened camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from companion.cameras.worker import description
from companion.config.camera import CameraConfig
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import DeviceLost

INFO = CameraInfo("front", Intrinsics(640, 400, 450.0, 450.0, 320.0, 200.0), bias_per_m=0.03)


@dataclass
class Source:
    """A camera that is lost after its opening."""

    notice: str
    info: CameraInfo = INFO

    def open(self) -> None:
        pass

    def read(self, timeout_s: float) -> DepthFrame | None:
        raise DeviceLost("camera front: unplugged")

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("configured_per_m", "notice", "expected_per_m"),
    [
        (None, "", 0.03),
        (0.01, "", 0.01),
        (0.05, "", 0.05),
        (0.01, "camera front: the rows differ", 0.03),
        (0.05, "camera front: the rows differ", 0.05),
    ],
)
def test_a_configured_bias_does_not_hide_that_a_camera_is_misaligned(
    configured_per_m: float | None, notice: str, expected_per_m: float
) -> None:
    """It was measured before the camera was bent."""
    section = replace(CameraConfig(name="front", kind="oak"), bias_per_m=configured_per_m)
    assert description(section, Source(notice)).bias_per_m == expected_per_m
