"""The OAK driver with `host_matching`: real depthai messages with rectified images, matched on the host, without a device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import cv2
import depthai as dai
import numpy as np
import pytest

from companion.cameras.factory import make_source
from companion.config.camera import CameraConfig
from core.types import TEXTURELESS_MM
from drivers.base import BadData, DeviceLost
from drivers.cameras.corner_matches import match_corners, refined
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings
from drivers.cameras.stereo import MatchParams, StereoMatcher, pair_crc

from .oak_host import PERIOD_S, HostLink, HostPairLink, depth_message, group_message, image_message, now, stamp_ns
from .test_device_matches import F_PX, HEIGHT, WALL_MM, WIDTH, scene
from .test_oak_pair import cut_short

pytestmark = pytest.mark.process

MATCH = MatchParams(disparities=32, mark_smooth=True)
SETTINGS = OakSettings(camera="front", first_frame_s=60.0, fps=1.0 / PERIOD_S, host_matching=True, match=MATCH)
MATRIX = [[F_PX, 0.0, 119.5], [0.0, F_PX, 39.5], [0.0, 0.0, 1.0]]
STREAMS = ("left", "right")
LEFT, RIGHT = scene(sky_rows=40)
DEPTH_IMAGE = np.zeros((HEIGHT, WIDTH), np.uint16)


def parts(number: int) -> dict[str, dai.ImgFrame]:
    """Rectified images; the left one has the intrinsics."""
    stamp = now() - timedelta(milliseconds=20)
    left = image_message(number, LEFT, stamp)
    transformation = dai.ImgTransformation(WIDTH, HEIGHT)
    transformation.setIntrinsicMatrix(MATRIX)
    left.setTransformation(transformation)
    return {"left": left, "right": image_message(number, RIGHT, stamp, dai.ImgFrame.Type.GRAY8)}


def stamp_of(parts: dict[str, dai.ImgFrame]) -> timedelta:
    """The exposure of both images of a pair: a stamp taken later is refused as a missing synchronisation."""
    return parts["left"].getTimestamp()


def test_the_device_sends_both_images_and_no_depth() -> None:
    assert SETTINGS.streams == STREAMS
    off = replace(MATCH, correlation=0.0, texture=0.0, period=1.0)
    assert replace(SETTINGS, match=off).streams == STREAMS
    assert replace(SETTINGS, host_matching=False).streams == ("depth", "left", "right")
    assert replace(SETTINGS, host_matching=False, match=off).streams == ("depth",)


@pytest.mark.parametrize("marks", [True, False])
def test_the_host_matches_the_rectified_images(marks: bool) -> None:
    settings = replace(SETTINGS, match=replace(MATCH, mark_smooth=marks))
    stamps_ns = {}

    def make(number: int) -> dict[str, dai.ImgFrame]:
        found = parts(number)
        stamps_ns[number] = stamp_ns(found["left"])
        return found

    begun_ns = time.monotonic_ns()
    source = OakSource(settings, HostPairLink(make, streams=STREAMS))
    source.open()
    try:
        assert source.info.marks_smooth is marks
        assert source.info.min_range_m == pytest.approx(F_PX * 0.075 / 31)  # of the greatest of 32 disparities
        assert (source.info.intrinsics.width, source.info.intrinsics.fx) == (WIDTH, F_PX)
        frame = source.read(60.0)
        assert frame is not None
        wall = frame.depth_mm[52:-10, 40:-10]
        assert np.mean(np.abs(wall.astype(float) - WALL_MM) < 0.03 * WALL_MM) > 0.9
        sky = frame.depth_mm[8:30, 40:-10]
        assert np.mean(sky == (TEXTURELESS_MM if marks else 0)) > 0.9
        assert frame.images_crc == pair_crc(LEFT, RIGHT)
        assert frame.t_exposure_ns == stamps_ns[frame.sequence]
        assert begun_ns <= frame.t_arrival_ns <= time.monotonic_ns()
    finally:
        source.close()


@pytest.mark.parametrize("missing", STREAMS)
def test_an_image_that_never_comes_is_a_lost_device(missing: str) -> None:
    def without(number: int) -> dict[str, dai.ImgFrame]:
        return {name: message for name, message in parts(number).items() if name != missing}

    source = OakSource(replace(SETTINGS, first_frame_s=0.5), HostPairLink(without, streams=STREAMS))
    with pytest.raises(DeviceLost, match=r"no pair of rectified images within 0.5 s; check that the cable"):
        source.open()


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (
            lambda p: p | {"right": image_message(0, RIGHT[:, :120].copy(), stamp_of(p))},
            r"\(80, 120\), for a frame of",
        ),
        (
            lambda p: p | {"left": depth_message(0, pixels=DEPTH_IMAGE, matrix=MATRIX, stamp=stamp_of(p))},
            "a left image of uint16",
        ),
        (
            lambda p: p | {"right": image_message(0, RIGHT, stamp_of(p) - timedelta(seconds=0.18))},
            "a right image is stamped",
        ),
        (lambda p: {"left": p["left"]}, "a frame without its right image"),
        (lambda p: p | {"left": cut_short(p["left"])}, "a left image cannot be read"),
        (lambda p: p | {"right": cut_short(p["right"])}, "a right image cannot be read"),
    ],
)
def test_groups_that_cannot_be_used_name_the_cause_and_the_remedy(
    change: Callable[[dict[str, dai.ImgFrame]], dict[str, dai.ImgFrame]], cause: str
) -> None:
    change(parts(0))  # an exception inside of a node would end this process
    with pytest.raises(BadData, match=cause) as error:
        OakSource(SETTINGS, HostLink(lambda k: group_message(change(parts(k))))).open()
    assert str(error.value).endswith("Restart the device")


def textured_pair(
    right_of: Callable[[np.ndarray], np.ndarray], blur_px: float, f_px: float, on_host: bool
) -> Callable[[int], dict[str, dai.ImgFrame]]:
    """Groups of a textured left image, the right one that `right_of` makes of it, and where the device matches a depth image of
    6 px of disparity."""
    rng = np.random.default_rng(1)
    left = cv2.GaussianBlur(rng.integers(0, 256, (200, 320)).astype(np.uint8), (0, 0), blur_px)
    right, wall_mm = right_of(left), round(1000.0 * f_px * 0.075 / 6.0)
    matrix = [[f_px, 0.0, 159.5], [0.0, f_px, 99.5], [0.0, 0.0, 1.0]]

    def make(number: int) -> dict[str, dai.ImgFrame]:
        stamp = now() - timedelta(milliseconds=20)
        depth = depth_message(number, pixels=np.full(left.shape, wall_mm, np.uint16), matrix=matrix, stamp=stamp)
        first = image_message(number, left, stamp)
        first.setTransformation(depth.getTransformation())
        found = {"left": first, "right": image_message(number, right, stamp)}
        return found if on_host else {"depth": depth, **found}

    return make


@pytest.mark.parametrize("on_host", [True, False])
def test_images_of_a_wrong_calibration_are_refused(on_host: bool) -> None:
    """The right image is shifted by three rows."""
    make = textured_pair(lambda left: np.roll(left, (3, -6), axis=(0, 1)), 1.5, 400.0, on_host)
    settings = replace(SETTINGS, host_matching=on_host)
    source = OakSource(settings, HostPairLink(make, streams=settings.streams))
    with pytest.raises(BadData, match=r"differ by 3.0 px in height; the stereo calibration of the device is wrong"):
        source.open()


def lower(left: np.ndarray) -> np.ndarray:
    """The right image of a wall, 0.9 px too low."""
    move = np.array([[1.0, 0.0, -6.0], [0.0, 1.0, 0.9]])
    return np.asarray(cv2.warpAffine(left, move, (320, 200), flags=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize("on_host", [True, False])
def test_rows_that_differ_are_corrected_where_the_host_matches(on_host: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The device's own matches stay as they are, and the notice reports it."""
    matched: list[tuple[np.ndarray, np.ndarray]] = []
    depth = StereoMatcher.depth

    def observed(
        self: StereoMatcher, left: np.ndarray, right: np.ndarray, f_px: float, baseline_m: float
    ) -> np.ndarray:
        matched.append((left, right))
        return depth(self, left, right, f_px, baseline_m)

    monkeypatch.setattr(StereoMatcher, "depth", observed)
    settings = replace(SETTINGS, host_matching=on_host)
    source = OakSource(settings, HostPairLink(textured_pair(lower, 0.8, 450.0, on_host), streams=settings.streams))
    source.open()
    try:
        assert source.read(60.0) is not None
        assert bool(matched) is on_host
        for left, right in matched:
            rows_px = refined(match_corners(left, right), left, right).rows_px
            assert abs(float(np.median(rows_px))) < 0.1
        assert ("the right image is turned to fit" in source.notice) is on_host
        assert ("the device matches them as they are" in source.notice) is not on_host
        assert source.info.bias_per_m * 450.0 * 0.075 == pytest.approx(1.5 * 0.9, rel=0.1)
    finally:
        source.close()


def test_the_configuration_chooses_where_images_are_matched() -> None:
    on_host = CameraConfig(name="front", kind="oak", match_on="host", mark_smooth=True, disparities=64)
    on_device = replace(on_host, match_on="device")
    assert (on_host.unmatched_px, on_host.marks_smooth) == (64, True)
    assert (on_device.unmatched_px, on_device.marks_smooth) == (0, False)
    for section in (on_host, on_device):
        source = make_source(section)
        assert isinstance(source, OakSource)
        assert source.settings.host_matching is (section is on_host)
        assert source.settings.match.mark_smooth is (section is on_host)
