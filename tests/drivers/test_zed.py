"""A ZED as a device: its frames, images that arrived in part, and devices that cannot be used."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.cameras import row_alignment
from drivers.cameras.pair_video import StampedImage
from drivers.cameras.row_alignment import FAULTS, MEASUREMENTS
from drivers.cameras.stereo import MatchParams, StereoDepth
from drivers.cameras.video_identity import VideoIdentity
from drivers.cameras.zed_calibration import (
    parse_zed_calibration,
)
from drivers.cameras.zed_uvc import ZedSettings, ZedSource, halves
from tests.nightly import nightly

from .zed_images import CALIBRATION, NEW, pair, side_by_side


class Video:
    """A device that delivers images, and is then unplugged. stamp_ns: of each; None: 8 ms ago."""

    identity = VideoIdentity("2b03:f780", "ZED 2", "OV0001")

    def __init__(self, images: list[np.ndarray], stamp_ns: int | None = None) -> None:
        self.images, self.stamp_ns = images, stamp_ns
        self.closed = 0

    def __call__(self, settings: ZedSettings) -> Video:
        return self

    def read(self, timeout_s: float) -> StampedImage | None:
        if not self.images:
            raise DeviceLost("camera front: /dev/video5 was lost")
        stamp_ns = time.monotonic_ns() - 8_000_000 if self.stamp_ns is None else self.stamp_ns
        return self.images.pop(0), stamp_ns

    def close(self) -> None:
        self.closed += 1


SETTINGS = ZedSettings(camera="front", device="/dev/video5", calibration=Path("SN2.conf"), exposure_latency_s=0.01)


def after_opening(*images: np.ndarray) -> Video:
    """A device that delivers these images after those by which its rows are aligned at the opening. The last of those is the first
    frame."""
    return Video([*[side_by_side()] * MEASUREMENTS, *images])


def test_frames_of_a_device() -> None:
    video = after_opening(side_by_side())
    source = ZedSource(SETTINGS, video, CALIBRATION)
    source.open()
    first = source.read(1.0)
    second = source.read(1.0)
    assert first is not None
    assert second is not None
    assert (first.sequence, second.sequence) == (1, 2)
    assert second.t_arrival_ns - second.t_exposure_ns > 18_000_000  # kernel's stamp and latency
    assert second.depth_mm.shape == (376, 672)
    with pytest.raises(DeviceLost, match="/dev/video5 was lost"):
        source.read(1.0)
    source.close()
    source.close()
    assert video.closed == 1


def test_an_image_that_arrived_in_part_is_left_out() -> None:
    """Its last rows are those of the image before, in both eyes: they match."""
    first, second = side_by_side(), cv2.flip(side_by_side(), 0)
    torn = first.copy()
    torn[:150] = second[:150]
    empty = cv2.cvtColor(np.zeros((376, 1344, 2), np.uint8), cv2.COLOR_YUV2BGR_YUYV)
    empty[:200] = second[:200]
    video = Video([empty, *[first] * MEASUREMENTS, torn, second])
    source = ZedSource(SETTINGS, video, CALIBRATION)
    source.open()
    assert len(video.images) == 2
    assert [source.read(1.0) is not None for _ in range(3)] == [True, False, True]


@pytest.mark.parametrize("lost", [1012, *nightly(2024)])
def test_an_image_that_lost_a_packet_would_be_measured_too_far_and_is_left_out(lost: int) -> None:
    """The kernel's driver moves up what follows the packet: both halves then show parts of both eyes, in the same rows."""
    sent, held = (cv2.cvtColor(side_by_side(6.0), cv2.COLOR_BGR2GRAY) for _ in range(2))
    held = np.clip(held + np.random.Generator(np.random.PCG64(9)).normal(0.0, 2.0, held.shape), 0, 255).astype(np.uint8)
    sent_bytes, held_bytes = (np.dstack([image, np.full_like(image, 128)]).tobytes() for image in (sent, held))
    begin = 100 * 2 * 1344 + 400
    data = sent_bytes[:begin] + sent_bytes[begin + lost :] + held_bytes[-lost:]
    first, mixed = (
        np.asarray(cv2.cvtColor(np.frombuffer(b, np.uint8).reshape(376, 1344, 2), cv2.COLOR_YUV2BGR_YUYV), np.uint8)
        for b in (held_bytes, data)
    )
    depth_mm = StereoDepth(CALIBRATION).depth(*halves(mixed))[110:]
    assert np.mean(depth_mm > 1.2 * 6000) > 0.01
    source = ZedSource(SETTINGS, Video([*[first] * MEASUREMENTS, mixed, first]), CALIBRATION)
    source.open()
    assert [source.read(1.0) is not None for _ in range(2)] == [True, False]


def test_an_image_that_waited_in_a_buffer_keeps_its_stamp() -> None:
    """A process that was stopped for 3 s reads a buffered image first: it does not show the present."""
    video = after_opening(side_by_side())
    source = ZedSource(SETTINGS, video, CALIBRATION)
    source.open()
    source.read(1.0)
    stamp_ns = time.monotonic_ns() - 3 * 10**9
    video.stamp_ns = stamp_ns
    frame = source.read(1.0)
    assert frame is not None
    assert frame.t_exposure_ns == stamp_ns - 10_000_000


@pytest.mark.parametrize("stamp_ns", [0, 1_800_000_000_000_000_000, 1_000_000])
def test_a_device_without_monotonic_stamps_is_refused(stamp_ns: int) -> None:
    """Its frames cannot be matched with attitudes: none, those of the wall clock, or those since its opening."""
    video = Video([side_by_side()], stamp_ns)
    with pytest.raises(BadData, match=r"its driver does not use the monotonic clock.*uvcvideo/parameters/clock"):
        ZedSource(SETTINGS, video, CALIBRATION).open()
    assert video.closed == 1


@pytest.mark.parametrize("marks", [False, True])
def test_the_description_holds_whether_it_marks(marks: bool) -> None:
    settings = replace(SETTINGS, match=MatchParams(mark_smooth=marks))
    source = ZedSource(settings, after_opening(), CALIBRATION)
    source.open()
    assert source.info.marks_smooth is marks
    width_px = source.info.intrinsics.width
    assert source.info.bias_per_m == pytest.approx(source.info.ke_per_m * 0.15 * width_px / 640 / 0.3)
    source.close()


@pytest.mark.parametrize(
    ("video", "error", "cause"),
    [
        (Video([]), DeviceLost, "/dev/video5 was lost"),
        (Video([np.zeros((720, 2560, 3), np.uint8)]), BadData, r"images of 2560x720, expected 1344x376"),
    ],
)
def test_devices_that_cannot_be_used_name_the_cause(video: Video, error: type[Exception], cause: str) -> None:
    with pytest.raises(error, match=cause):
        ZedSource(SETTINGS, video, CALIBRATION).open()
    assert video.closed == 1


def test_the_calibration_of_another_camera_is_refused() -> None:
    wrong = parse_zed_calibration(NEW.replace("cy=193.637", "cy=203.637"), "SN3.conf", 672, 376)
    with pytest.raises(BadData, match="belongs to another camera, or this camera was bent"):
        ZedSource(SETTINGS, Video([side_by_side()]), wrong).open()


BLANK = np.clip(90.0 + np.random.Generator(np.random.PCG64(3)).normal(0.0, 1.0, (376, 1344, 3)), 0, 255).astype(
    np.uint8
)


def test_after_a_view_without_corners_the_calibration_is_checked_with_a_later_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A camera that starts before a blank wall, or in the dark."""
    wrong = parse_zed_calibration(NEW.replace("cy=193.637", "cy=203.637"), "SN3.conf", 672, 376)
    monkeypatch.setattr(row_alignment, "CHECK_SOON_NS", 0)
    source = ZedSource(SETTINGS, Video([BLANK, BLANK, side_by_side()]), wrong)
    source.open()
    for _ in range(2):
        assert source.read(1.0) is not None
    with pytest.raises(BadData, match="belongs to another camera, or this camera was bent"):
        source.read(1.0)


def rows_apart(rows_px: float) -> np.ndarray:
    """A pair whose right eye is lower by so much."""
    left, right = pair(CALIBRATION, 3.0)
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, rows_px]])
    lower = np.asarray(cv2.warpAffine(right, move, (672, 376), flags=cv2.INTER_CUBIC), np.uint8)
    return cv2.cvtColor(np.hstack([left, lower]), cv2.COLOR_GRAY2BGR)


def test_a_camera_that_was_bent_after_its_opening_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once checked was for ever, before: a hard landing between two flights went unnoticed."""
    for name in ("CHECK_SOON_NS", "CHECK_AGAIN_NS"):
        monkeypatch.setattr(row_alignment, name, 0)
    source = ZedSource(SETTINGS, after_opening(*[rows_apart(3.0)] * FAULTS), CALIBRATION)
    source.open()
    for _ in range(FAULTS):
        assert source.read(1.0) is not None
    with pytest.raises(BadData, match=r"px in height; SN2.conf belongs to another camera, or this camera was bent"):
        source.read(1.0)


def test_the_arrival_of_a_frame_is_that_of_its_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was the end of the matching, tens of milliseconds later: a negative exposure_offset_ms could move the exposure there."""
    begun_ns: list[int] = []
    depth = StereoDepth.depth

    def noted(stereo: StereoDepth, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        begun_ns.append(time.monotonic_ns())
        return depth(stereo, left, right)

    monkeypatch.setattr(StereoDepth, "depth", noted)
    source = ZedSource(SETTINGS, after_opening(side_by_side()), CALIBRATION)
    source.open()
    for _ in range(2):
        asked_ns = time.monotonic_ns()
        frame = source.read(1.0)
        assert frame is not None
        assert frame.t_exposure_ns <= frame.t_arrival_ns <= begun_ns[-1]
    assert frame.t_arrival_ns >= asked_ns
    source.close()


def test_a_video_file_as_the_device(tmp_path: Path) -> None:
    path = tmp_path / "pair.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (1344, 376))
    for _ in range(MEASUREMENTS + 1):
        writer.write(side_by_side())
    writer.release()
    settings = ZedSettings(camera="front", device=str(path), calibration=Path("SN2.conf"))
    source = ZedSource(settings, calibration=CALIBRATION)
    source.open()
    frame = source.read(1.0)
    assert frame is not None
    middle = frame.depth_mm[150:220, 300:380]
    assert np.median(middle[middle > 0]) == pytest.approx(3000, rel=0.05)
    assert frame.t_exposure_ns <= frame.t_arrival_ns
    source.close()
    with pytest.raises(DeviceNotFound, match="cannot be opened"):
        ZedSource(
            ZedSettings(camera="a", device=str(tmp_path / "no.avi"), calibration=path), calibration=CALIBRATION
        ).open()


MATCHED_NARROW = textwrap.dedent("""
    import numpy as np
    from drivers.cameras.stereo import MatchParams, StereoMatcher

    rng = np.random.default_rng(0)
    for width, disparities in ((96, 96), (95, 81), (64, 512)):
        left = rng.integers(0, 256, (72, width)).astype(np.uint8)
        found = StereoMatcher(MatchParams(disparities=disparities)).disparity(left, np.roll(left, -3, axis=1))
        assert (found < 0.0).all()
""")


@pytest.mark.process
def test_an_image_no_wider_than_the_search_has_no_match() -> None:
    """The library accessed memory outside of it, which ended the process."""
    child = subprocess.run([sys.executable, "-c", MATCHED_NARROW], cwd=Path(__file__).parents[2], check=False)
    assert child.returncode == 0


@pytest.mark.parametrize(("disparities", "configured_m"), [(40, 0.5), (48, 1.2), *nightly((48, 0.5), (96, 0.3))])
def test_no_depth_that_the_search_cannot_find_is_stated_as_measurable(disparities: int, configured_m: float) -> None:
    """Free space relies on it: a thing that is too near to be measured leaves a small hole only, which ends the free range only up
    to 1.5 times the least range (core/stages/free_holes.py). Before, 0.5 m was stated for every width and number of disparities."""
    match = MatchParams(disparities=disparities)
    source = ZedSource(replace(SETTINGS, match=match, min_range_m=configured_m), after_opening(), CALIBRATION)
    source.open()
    info = source.info
    source.close()
    assert info.min_range_m >= configured_m
    stereo = StereoDepth(CALIBRATION, match)
    for z_m, can_be_measured in ((1.03 * info.min_range_m, True), (0.9 * info.min_range_m, configured_m > 1.0)):
        depth_mm = stereo.depth(*pair(CALIBRATION, z_m))[20:-20, disparities + 20 : -20]
        measured = float(np.mean(np.abs(depth_mm - 1000.0 * z_m) < 50.0 * z_m))
        assert measured > 0.2 if can_be_measured else measured < 0.01
