"""What `companion doctor` says of the frames of a camera."""

from __future__ import annotations

import numpy as np
import pytest

from companion.config.camera import CameraConfig
from companion.doctor.camera_check import frames_finding, middle_depth_m
from core.types import DepthFrame

NS = 1_000_000_000
SECTION = CameraConfig(name="front", kind="oak")


def frames_of(depth_mm: np.ndarray) -> list[DepthFrame]:
    """Four frames of one image at 30 Hz."""
    stamps = [k * NS // 30 for k in range(4)]
    return [
        DepthFrame(
            camera="front",
            sequence=k,
            t_exposure_ns=t,
            t_arrival_ns=t + 1_000_000,
            depth_mm=depth_mm.astype(np.uint16),
        )
        for k, t in enumerate(stamps)
    ]


def test_the_depth_in_the_middle_is_the_median_of_what_is_measured_there() -> None:
    depth = np.full((60, 80), 1500)
    depth[26:34, 34:46] = 4070
    depth[30, 34:46] = 0
    frames = frames_of(depth)
    assert middle_depth_m(frames) == pytest.approx(4.07)
    finding = frames_finding("camera front", SECTION, frames)
    assert finding.ok
    assert finding.text.endswith("% of the pixels measured, 4.07 m in the middle of the image")


def test_where_the_middle_is_not_measured_no_depth_is_stated() -> None:
    depth = np.full((60, 80), 1500)
    depth[20:40, 20:60] = 0
    frames = frames_of(depth)
    assert middle_depth_m(frames) is None
    assert frames_finding("camera front", SECTION, frames).text.endswith("% of the pixels measured")
