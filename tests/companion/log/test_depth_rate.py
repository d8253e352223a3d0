"""Which depth images a limited rate of recording keeps."""

from __future__ import annotations

import numpy as np
import pytest

from companion.log.depth_rate import DepthRate

MS = 1_000_000


def kept(hz: float, stamps_ms: list[float]) -> list[float]:
    rate = DepthRate(hz)
    return [t for t in stamps_ms if rate.keeps("front", round(t * MS))]


def test_every_image_without_a_limit() -> None:
    assert kept(0.0, [0.0, 33.3, 66.7]) == [0.0, 33.3, 66.7]


@pytest.mark.parametrize(("hz", "count"), [(10.0, 100), (15.0, 150), (2.0, 20), (0.5, 5)])
def test_jitter_does_not_change_the_rate(hz: float, count: int) -> None:
    jitter_ms = np.random.default_rng(1).uniform(-2.0, 2.0, 300)
    stamps_ms = [1000.0 * k / 30.0 + float(jitter_ms[k]) for k in range(300)]
    assert abs(len(kept(hz, stamps_ms)) - count) <= 1


def test_a_slower_camera_is_kept_whole() -> None:
    stamps_ms = [100.0 * k for k in range(10)]
    assert kept(20.0, stamps_ms) == stamps_ms


def test_a_pause_and_a_restart_of_the_camera_begin_anew() -> None:
    assert kept(10.0, [0.0, 50.0, 100.0, 5000.0, 5050.0, 5100.0]) == [0.0, 100.0, 5000.0, 5100.0]
    assert kept(10.0, [5000.0, 5050.0, 10.0, 50.0, 110.0]) == [5000.0, 10.0, 110.0]


def test_cameras_have_grids_of_their_own() -> None:
    rate = DepthRate(1.0)
    assert [rate.keeps(camera, 0) for camera in ("front", "right", "front")] == [True, True, False]
