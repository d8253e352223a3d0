"""Rows of a stereo pair whose right camera is rotated: measured, corrected, monitored."""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.open_air.stereo_scenes import make_stereo_scene
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.types import is_measured
from drivers.base import BadData
from drivers.cameras import row_alignment
from drivers.cameras.corner_matches import CornerMatches, match_corners, refined
from drivers.cameras.pair_video import StampedImage
from drivers.cameras.right_rotation import STRETCH_SLACK_PX, RightRotation, measure_rotation
from drivers.cameras.row_alignment import FAULTS, MEASUREMENTS, NEWEST, RowAlignment
from drivers.cameras.stereo import StereoDepth
from drivers.cameras.video_identity import VideoIdentity
from drivers.cameras.zed_calibration import EyeCalibration, StereoCalibration
from drivers.cameras.zed_uvc import ZedSettings, ZedSource, halves
from drivers.simulation.stereo.pair_renderer import PairBrightness, StereoPair, brightness, expose_pair
from drivers.simulation.stereo.shading import Light
from drivers.simulation.stereo.stereo_profiles import ZED, StereoCamera
from tests.nightly import nightly

K = ZED.view.intrinsics
PITCH_RAD = 1.0 / K.fy
"""A rotation of the right camera that lowers its image by one pixel."""
SMALL, LARGE, BENT = (RightRotation(rows_px * PITCH_RAD, 0.0) for rows_px in (0.3, 0.7, 3.0))
ROLLED = RightRotation(1.0 * PITCH_RAD, math.radians(-0.1))
"""The rotations of most tests, so that the pairs of a scene are rendered once."""
REMEDY = "calibrate it again"


@functools.cache
def pair(scene: str, pitch_rad: float, roll_rad: float, frame: int = 0) -> StereoPair:
    """A rendered pair 3 m above the ground whose right camera is rotated."""
    s, at = make_stereo_scene(scene), np.array([0.0, 0.0, -3.0])
    R = rotation_from_euler(0.0, 0.0, 0.05) @ R_CAMFRD_OPTICAL
    light = Light(sky=s.sky, fog_per_m=s.fog_per_m)
    turned = RightRotation(pitch_rad, roll_rad).R_rectified_right
    left = brightness(s.surfaces, s.panes, K, R, at, light, at)
    right = brightness(s.surfaces, s.panes, K, R @ turned, at + R[:, 0] * ZED.view.baseline_m, light, at)
    return expose_pair(PairBrightness(left=left, right=right), ZED.view.exposure, 0, frame)


def aligned(rotation: RightRotation, scene: str = "field") -> RowAlignment:
    """An alignment that has taken as many pairs of a camera as it needs."""
    alignment = RowAlignment("front", REMEDY, corrects=True)
    images = pair(scene, rotation.pitch_rad, rotation.roll_rad)
    for _ in range(MEASUREMENTS):
        assert alignment.take(images.left, alignment.rotation.turned(images.right, K), K)
    return alignment


def take(alignment: RowAlignment, rotation: RightRotation) -> bool:
    """One more pair of a camera that is rotated so now, corrected by what is known."""
    images = pair("field", rotation.pitch_rad, rotation.roll_rad)
    return alignment.take(images.left, alignment.rotation.turned(images.right, K), K)


@pytest.mark.parametrize(
    ("scene", "true"),
    [
        ("field", RightRotation()),
        ("field", SMALL),
        ("field", ROLLED),
        ("field_with_trees", ROLLED),
        *nightly(
            ("field", RightRotation(-0.6 * PITCH_RAD, math.radians(0.1))),
            ("field_with_trees", RightRotation()),
        ),
    ],
)
def test_the_rotation_of_the_right_camera_is_measured_to_a_twentieth_of_a_pixel(
    scene: str, true: RightRotation
) -> None:
    images = pair(scene, true.pitch_rad, true.roll_rad)
    found = measure_rotation(refined(match_corners(images.left, images.right), images.left, images.right), K)
    assert found is not None
    wrong = found - true
    assert wrong.error_px(K) < 0.05
    assert 0.5 * K.width * abs(wrong.stretch) < STRETCH_SLACK_PX


@pytest.mark.parametrize("angles", [(2.0 * PITCH_RAD, 0.0), (0.0, 2.0 * PITCH_RAD), (PITCH_RAD, 2.0 * PITCH_RAD)])
def test_rotations_of_both_signs_are_the_same_error(angles: tuple[float, float]) -> None:
    """Else a camera that is bent the other way would never be a fault."""
    one, other = RightRotation(*angles), RightRotation(*(-angle for angle in angles))
    assert one.error_px(K) == other.error_px(K) == pytest.approx(2.0 * K.fx / K.fy)
    assert one.greatest_row_px(K) == pytest.approx(other.greatest_row_px(K))
    assert one.greatest_row_px(K) > 0.5


def test_corners_in_one_part_of_the_image_do_not_determine_the_rotation() -> None:
    """A roll and a pitch move them alike."""
    rng = np.random.default_rng(3)
    at = rng.uniform((300.0, 100.0), (340.0, 300.0), (200, 2)).astype(np.float32)
    noise = rng.normal(0.0, 0.1, 200).astype(np.float32)
    right = at - (10.0, 0.0) + np.stack([np.zeros(200), noise], axis=1)
    near = CornerMatches(left_px=at, right_px=right.astype(np.float32))
    assert measure_rotation(near, K) is None
    spread = np.stack([np.linspace(20.0, 650.0, 200), at[:, 1]], axis=1).astype(np.float32)
    right = spread - (10.0, 0.0) + np.stack([np.zeros(200), noise], axis=1)
    assert measure_rotation(CornerMatches(left_px=spread, right_px=right.astype(np.float32)), K) is not None


def test_rows_that_contradict_each_other_do_not_determine_the_rotation() -> None:
    rng = np.random.default_rng(4)
    at = rng.uniform((20.0, 20.0), (650.0, 350.0), (300, 2)).astype(np.float32)
    rows = np.stack([np.full(300, -10.0), rng.uniform(-1.0, 1.0, 300)], axis=1)
    assert measure_rotation(CornerMatches(left_px=at, right_px=(at + rows).astype(np.float32)), K) is None


def test_an_aligned_pair_is_measured_as_one_without_an_error() -> None:
    """Rows that differ by 1 px leave less than half of the matches."""
    camera = StereoCamera(ZED)
    wrong = pair("field", ROLLED.pitch_rad, ROLLED.roll_rad)
    corrected = StereoPair(left=wrong.left, right=aligned(ROLLED).rotation.turned(wrong.right, K))
    shares = [is_measured(camera.depth_of(p)).mean() for p in (pair("field", 0.0, 0.0), wrong, corrected)]
    assert shares[1] < 0.6 * shares[0]
    assert shares[2] > 0.95 * shares[0]


def test_the_depth_of_an_aligned_pair_is_that_of_one_without_an_error() -> None:
    camera = StereoCamera(ZED)
    wrong = pair("field", ROLLED.pitch_rad, ROLLED.roll_rad)
    right = aligned(ROLLED).rotation.turned(wrong.right, K)
    exact, found = (camera.disparity(p) for p in (pair("field", 0.0, 0.0), replace(wrong, right=right)))
    both = (exact > 0) & (found > 0)
    assert both.mean() > 0.25
    assert abs(float(np.median((found - exact)[both]))) < 0.05


def test_the_rotation_is_applied_from_the_third_measurement_on() -> None:
    alignment = RowAlignment("front", REMEDY, corrects=True)
    for _ in range(MEASUREMENTS - 1):
        assert take(alignment, LARGE)
        assert alignment.rotation == RightRotation()
        assert not alignment.settled
    assert take(alignment, LARGE)
    assert alignment.settled
    assert (alignment.rotation - LARGE).error_px(K) < 0.05


def test_one_wrong_measurement_changes_nothing() -> None:
    alignment = aligned(SMALL)
    before = alignment.rotation
    assert take(alignment, ROLLED)
    assert (alignment.rotation - before).error_px(K) < 0.05


def test_a_slow_change_is_followed() -> None:
    """As the temperature changes."""
    alignment = aligned(RightRotation())
    for _ in range(NEWEST):
        assert take(alignment, SMALL)
    assert (alignment.rotation - SMALL).error_px(K) < 0.05


def test_a_view_without_corners_leaves_the_rotation() -> None:
    alignment = aligned(SMALL)
    before = alignment.rotation
    blank = np.full((K.height, K.width), 90, np.uint8)
    for _ in range(NEWEST):
        assert not alignment.take(blank, blank, K)
    assert alignment.rotation == before
    assert alignment.settled


@pytest.mark.parametrize(("rows_px", "reported"), [(0.0, False), (0.3, False), (0.7, True)])
def test_the_assumed_error_of_all_depths_grows_with_that_of_the_rows(rows_px: float, reported: bool) -> None:
    """A rotation about the vertical axis, which makes all depths wrong, may be as great and is not seen."""
    alignment = aligned(RightRotation(rows_px * PITCH_RAD, 0.0))
    alignment.opened(K)
    assert alignment.row_error_px == pytest.approx(rows_px, abs=0.05)
    notice = alignment.notice(K)
    assert bool(notice) == reported
    if reported:
        assert (
            "camera front: the rows of both images differ by up to 0.9 px; the right image is turned to fit" in notice
        )
        assert "an error of 1.0" in notice
        assert notice.endswith(REMEDY)


def test_a_camera_whose_rows_change_by_more_than_was_stated_is_opened_again() -> None:
    """Its depths may be wrong by more than every margin says."""
    alignment = aligned(RightRotation())
    alignment.opened(K)
    for _ in range(NEWEST // 2):
        take(alignment, LARGE)
    with pytest.raises(BadData, match=r"differ by up to 0\.9 px, more than when it was opened; .*; calibrate it again"):
        take(alignment, LARGE)


def test_a_camera_that_is_bent_in_flight_is_a_fault_after_three_checks() -> None:
    """A repeating texture may match a wrong row once."""
    alignment = aligned(RightRotation())
    for _ in range(FAULTS - 1):
        assert not take(alignment, BENT)
    with pytest.raises(BadData, match=r"px in height; calibrate it again"):
        take(alignment, BENT)


def test_views_without_corners_do_not_hide_that_a_camera_is_bent(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the vehicle climbs and the camera shows the sky between the faults. It is checked again soon, too."""
    now_ns = [0]
    monkeypatch.setattr(row_alignment.time, "monotonic_ns", lambda: now_ns[0])
    alignment = aligned(RightRotation())
    blank = np.full((K.height, K.width), 90, np.uint8)
    for _ in range(FAULTS - 1):
        assert not take(alignment, BENT)
        assert not alignment.take(blank, blank, K)
        now_ns[0] += row_alignment.CHECK_SOON_NS
        assert alignment.due
    with pytest.raises(BadData, match=r"px in height; calibrate it again"):
        take(alignment, BENT)


def test_checks_that_fail_now_and_then_are_no_fault() -> None:
    alignment = aligned(RightRotation())
    for _ in range(2 * FAULTS):
        assert not take(alignment, BENT)
        assert take(alignment, RightRotation())


def test_a_device_that_matches_by_itself_is_measured_and_not_corrected() -> None:
    alignment = RowAlignment("front", REMEDY, corrects=False)
    images = pair("field", LARGE.pitch_rad, 0.0)
    for _ in range(MEASUREMENTS):
        assert alignment.take(images.left, images.right, K)
    assert alignment.rotation == RightRotation()
    alignment.opened(K)
    assert alignment.row_error_px == pytest.approx(0.7, abs=0.05)
    assert "the device matches them as they are" in alignment.notice(K)


@pytest.mark.parametrize("scene", ["white_pillars", *nightly("fence", "white_room")])
def test_textures_that_look_stretched_do_not_open_a_camera_again(scene: str) -> None:
    """In these scenes the fit takes up to 0.4 px for a stretch."""
    alignment = aligned(RightRotation())
    alignment.opened(K)
    images = pair(scene, 0.1 * PITCH_RAD, 0.0)
    for _ in range(NEWEST):
        alignment.take(images.left, alignment.rotation.turned(images.right, K), K)


@pytest.mark.parametrize("stretch", [-0.005, 0.01])
def test_another_focal_length_of_the_right_eye_is_reported(stretch: float) -> None:
    """No rotation explains its rows. The disparities are wrong by as much, up to 1.7 and 3.4 px at the border."""
    images = pair("field", 0.0, 0.0)
    size = np.array([[1.0 + stretch, 0.0, -stretch * K.cx], [0.0, 1.0 + stretch, -stretch * K.cy]])
    right = np.asarray(cv2.warpAffine(images.right, size, (K.width, K.height), flags=cv2.INTER_CUBIC), np.uint8)
    alignment = RowAlignment("front", REMEDY, corrects=True)
    for _ in range(MEASUREMENTS):
        assert alignment.take(images.left, alignment.rotation.turned(right, K), K)
    alignment.opened(K)
    assert alignment.rotation.error_px(K) < 0.1
    assert alignment.row_error_px == pytest.approx(0.5 * K.width * abs(stretch) - STRETCH_SLACK_PX, abs=0.35)
    assert "the rows of both images differ by up to" in alignment.notice(K)


# ---- a ZED whose eyes are rotated -----------------------------------------------------------------------------------------

EYE = EyeCalibration(matrix=np.array([[K.fx, 0.0, K.cx], [0.0, K.fy, K.cy], [0.0, 0.0, 1.0]]), distortion=np.zeros(5))
CALIBRATION = StereoCalibration(
    width=K.width, height=K.height, left=EYE, right=EYE, R=np.eye(3), T=np.array([-ZED.view.baseline_m, 0.0, 0.0])
)
ZED_SETTINGS = ZedSettings(camera="front", device="/dev/video5", calibration=Path("SN2.conf"))
BLANK = np.clip(
    90.0 + np.random.Generator(np.random.PCG64(3)).normal(0.0, 1.0, (K.height, 2 * K.width, 3)), 0, 255
).astype(np.uint8)


@dataclass
class Video:
    """A device that delivers these images, then the last one for ever."""

    identity: ClassVar[VideoIdentity] = VideoIdentity()
    images: list[NDArray[np.uint8]]

    def read(self, timeout_s: float) -> StampedImage | None:
        image = self.images.pop(0) if len(self.images) > 1 else self.images[0]
        return image, time.monotonic_ns()

    def close(self) -> None:
        pass


def raw(true: RightRotation) -> NDArray[np.uint8]:
    """Both eyes side by side."""
    images = pair("field", true.pitch_rad, true.roll_rad)
    return np.asarray(cv2.cvtColor(np.hstack([images.left, images.right]), cv2.COLOR_GRAY2BGR), np.uint8)


def zed(*images: NDArray[np.uint8]) -> ZedSource:
    """An open camera that delivers these images."""
    source = ZedSource(ZED_SETTINGS, lambda _: Video(list(images)), CALIBRATION)
    source.open()
    return source


def measured_share(source: ZedSource) -> float:
    """Of the next frame."""
    frame = source.read(1.0)
    assert frame is not None
    return float(is_measured(frame.depth_mm).mean())


def test_a_zed_aligns_its_rows_before_its_first_frame() -> None:
    exact, bent = zed(raw(RightRotation())), zed(raw(ROLLED))
    unaligned = StereoDepth(CALIBRATION).depth(*halves(raw(ROLLED)))
    share = measured_share(exact)
    assert is_measured(unaligned).mean() < 0.6 * share
    assert measured_share(bent) > 0.95 * share
    assert exact.notice == ""
    assert "the rows of both images differ by up to 1." in bent.notice
    assert exact.info.bias_per_m == pytest.approx(0.15 * K.width / 640 / (K.fx * ZED.view.baseline_m), rel=0.05)
    assert bent.info.bias_per_m == pytest.approx(1.5 * ROLLED.error_px(K) / (K.fx * ZED.view.baseline_m), rel=0.1)


def test_a_zed_that_opened_before_a_blank_wall_aligns_its_rows_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(row_alignment, "CHECK_SOON_NS", 0)
    source = zed(BLANK, raw(RightRotation(0.14 * PITCH_RAD, 0.0)))
    assert measured_share(source) == 0.0
    assert all(source._rows.rotation == RightRotation() and measured_share(source) for _ in range(MEASUREMENTS - 1))
    assert measured_share(source) > 0.0
    assert source._rows.rotation.error_px(K) == pytest.approx(0.14, abs=0.03)
    assert source._stereo is not None
    assert source._stereo.rotation == source._rows.rotation


def test_a_zed_that_opened_before_a_blank_wall_is_opened_again_where_it_is_bent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What it had stated about its depths is too little."""
    monkeypatch.setattr(row_alignment, "CHECK_SOON_NS", 0)
    videos = iter([Video([BLANK, raw(LARGE)]), Video([raw(LARGE)])])
    source = ZedSource(ZED_SETTINGS, lambda _: next(videos), CALIBRATION)
    source.open()
    for _ in range(MEASUREMENTS):
        source.read(1.0)
    with pytest.raises(BadData, match=r"more than when it was opened; .*; SN2.conf belongs to another camera"):
        source.read(1.0)
    source.close()
    source.open()
    assert "the rows of both images differ by up to 0.9" in source.notice
    assert source.read(1.0) is not None
