"""Frozen images and stamps: what is noticed, and what of a static scene is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.cameras.frozen_frames import FrozenFrameDetector
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL
from core.params import Params
from core.types import (
    FAR_MM,
    GREATEST_MARK_MM,
    SATURATED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    CameraInfo,
    DepthFrame,
    Intrinsics,
)

pytestmark = pytest.mark.process


def frame_of(depth_mm: NDArray[np.uint16], k: int) -> DepthFrame:
    return DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=depth_mm)


def test_a_static_scene_with_noise_is_not_frozen_and_one_without_is() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    judge = FrozenFrameDetector(4)
    for k in range(20):
        depth = rng.integers(2990, 3010, (48, 64)).astype(np.uint16)
        assert judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=depth)) == ""
    same = np.full((48, 64), 3000, np.uint16)
    texts = [
        judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=same))
        for k in range(20, 26)
    ]
    assert texts == ["", "", "", "", "the same image 5 times in a row", "the same image 6 times in a row"]


@pytest.mark.parametrize("mark", [UNKNOWN_MM, TEXTURELESS_MM, GREATEST_MARK_MM, SATURATED_MM])
def test_images_without_any_measurement_are_not_frozen(mark: int) -> None:
    """A covered lens, darkness or a cloudless sky gives the same image again and again, and a restart would only make the
    camera blind for longer. Such a frame is invalid."""
    detector, blank = FrozenFrameDetector(4), np.full((48, 64), mark, np.uint16)
    assert [detector.check(frame_of(blank, k)) for k in range(20)] == [""] * 20
    blank = blank.copy()
    blank[40] = 3000
    assert detector.check(frame_of(blank, 20)) == ""


@pytest.mark.parametrize(("measured_px", "frozen"), [(61, False), (62, True)])
def test_an_image_that_is_invalid_for_lack_of_measurements_is_not_frozen(measured_px: int, frozen: bool) -> None:
    """A lamp in the dark: its depth may repeat, since nothing else is measured and its steps are coarse. Frames of which 2 %
    or less are measured are invalid, so that an old one cannot be taken for the present; a restart every few seconds would
    make the camera blind when light returns."""
    detector, image = FrozenFrameDetector(4, Params().min_measured_share), np.zeros((48, 64), np.uint16)
    image.ravel()[1000 : 1000 + measured_px] = 3000
    image.ravel()[1000] = FAR_MM
    assert any(detector.check(frame_of(image, k)) for k in range(20)) is frozen


def test_what_counts_as_too_few_measurements_is_invalid_for_the_extractor() -> None:
    info = CameraInfo("a", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))
    image = np.zeros((48, 64), np.uint16)
    image.ravel()[1000:1061] = 3000
    image.ravel()[1000] = FAR_MM
    model, _ = Extractor(Params()).extract(image, info, R_CAMFRD_OPTICAL)
    assert not model.valid


@pytest.mark.parametrize("depth_mm", [3000, FAR_MM])
def test_one_repeated_pixel_that_counts_as_measured_is_enough(depth_mm: int) -> None:
    """FAR_MM is free space: an old image of it must not pass."""
    detector, image = FrozenFrameDetector(4), np.zeros((48, 64), np.uint16)
    image[41, 5] = depth_mm
    assert [bool(detector.check(frame_of(image, k))) for k in range(6)] == [False] * 4 + [True] * 2


def test_any_pixel_that_changes_shows_a_live_image() -> None:
    detector = FrozenFrameDetector(4)
    for k in range(20):
        image = np.full((48, 64), 3000, np.uint16)
        image[41, 5] += k
        assert detector.check(frame_of(image, k)) == ""
        assert not detector.repeats


@pytest.mark.parametrize("ring", [1, 2, 4, 32])
def test_a_camera_that_delivers_its_buffers_again_is_frozen(ring: int) -> None:
    """A driver that loses count delivers a ring of old images under new stamps: each differs from the one before."""
    rng = np.random.Generator(np.random.PCG64(0))
    images = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(40)]
    detector = FrozenFrameDetector(4)
    for k, image in enumerate(images):
        assert detector.check(frame_of(image, k)) == ""
        assert not detector.repeats
    texts = []
    for k in range(12):
        texts.append(detector.check(frame_of(images[40 - ring + k % ring], 40 + k)))
        assert detector.repeats  # none of them is used
    assert texts[:3] == [""] * 3
    assert all(texts[4:])
    fresh = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(2)]
    assert [bool(detector.check(frame_of(image, 60 + k))) for k, image in enumerate(fresh)] == [True, False]
    assert not detector.repeats


def test_one_new_image_of_a_frozen_camera_is_no_sign_of_life() -> None:
    """A camera that hangs keeps its image over a restart. The host aligns the rows of both images anew, with this image alone, so that
    its depth differs from the one before: each restart passed one old image on as the present."""
    rng = np.random.Generator(np.random.PCG64(0))
    detector = FrozenFrameDetector(4)
    openings = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(4)]
    causes = [detector.check(frame_of(openings[k // 10], k)) for k in range(40)]
    used = [k for k, cause in enumerate(causes) if not cause]
    assert used == [0, 1, 2, 3]
    assert causes[10] == "fewer than 2 new images after repeated ones"
    live = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(3)]
    twice = [live[k // 2] for k in range(6)]  # a camera may deliver each image twice
    assert [bool(detector.check(frame_of(image, 40 + k))) for k, image in enumerate(twice)] == [True] * 2 + [False] * 4


def test_stamps_that_do_not_advance_four_times_are_frozen() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    detector, texts = FrozenFrameDetector(4), []
    for t_ns in (7, 7, 7, 7, 8, 8, 8, 7, 7, 9, 10):
        depth = rng.integers(2990, 3010, (48, 64)).astype(np.uint16)
        frame = DepthFrame(camera="a", sequence=0, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=depth)
        texts.append(detector.check(frame))
    assert texts == [""] * 8 + [
        "its stamps have not moved for 4 frames",
        "fewer than 2 new images after repeated ones",
        "",
    ]


@pytest.mark.parametrize(("hz", "repetitions"), [(60, 4), (15, 4), (10, 3), (5, 2), (2, 2)])
def test_a_slow_camera_is_frozen_after_fewer_repetitions(hz: int, repetitions: int) -> None:
    """At 5 Hz an image of 0.8 s ago was still used."""
    judge, same = FrozenFrameDetector(4), np.full((48, 64), 3000, np.uint16)
    texts = []
    for k in range(6):
        t_ns = k * 10**9 // hz
        texts.append(
            judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=same))
        )
    assert [bool(text) for text in texts] == [k >= repetitions for k in range(6)]
