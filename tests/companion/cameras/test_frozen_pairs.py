"""A stereo camera that repeats a pair of images while their rectification changes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from companion.cameras.frozen_frames import FrozenFrameDetector
from core.types import DepthFrame
from drivers.cameras import row_alignment
from drivers.cameras.row_alignment import MEASUREMENTS
from drivers.cameras.zed_uvc import ZedSource
from tests.drivers.test_zed import BLANK, SETTINGS, Video, rows_apart
from tests.drivers.zed_images import CALIBRATION

pytestmark = pytest.mark.process

OLD_PAIR = rows_apart(0.1)


def read(*images: np.ndarray) -> list[DepthFrame]:
    """The frames of a camera that is opened before a blank wall, then delivers these images."""
    source = ZedSource(SETTINGS, Video([BLANK, *images]), CALIBRATION)
    source.open()
    frames = [source.read(1.0) for _ in range(1 + len(images))]
    source.close()
    assert None not in frames
    return [frame for frame in frames[1:] if frame is not None]


def test_a_repeated_pair_stays_repeated_when_its_rows_are_aligned(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check of the rows changes the rectification, and with it the depth of the same images: it counted as new."""
    monkeypatch.setattr(row_alignment, "CHECK_SOON_NS", 0)
    frames = read(*[OLD_PAIR] * MEASUREMENTS)
    assert not np.array_equal(frames[0].depth_mm, frames[-1].depth_mm), "its rows are aligned meanwhile"
    detector = FrozenFrameDetector(4)
    used = []
    for frame in frames:
        detector.check(frame)
        used.append(not detector.repeats)
    assert used == [True, False, False]


def test_a_pair_from_before_a_restart_is_repeated() -> None:
    """A device may keep its image over a restart of the camera's process, which aligns the rows again."""
    detector = FrozenFrameDetector(4)
    (before,) = read(OLD_PAIR)
    source = ZedSource(SETTINGS, Video([OLD_PAIR] * MEASUREMENTS), CALIBRATION)
    source.open()
    after = source.read(1.0)
    source.close()
    assert after is not None
    assert not np.array_equal(before.depth_mm, after.depth_mm)
    detector.check(before)
    assert not detector.repeats
    detector.check(after)
    assert detector.repeats


def test_live_pairs_are_not_repeated() -> None:
    noise = np.random.Generator(np.random.PCG64(7))
    moved = [cv2.add(OLD_PAIR, noise.integers(0, 3, OLD_PAIR.shape).astype(np.uint8)) for _ in range(3)]
    detector = FrozenFrameDetector(4)
    for frame in read(OLD_PAIR, *moved):
        assert detector.check(frame) == ""
        assert not detector.repeats
