"""The factory calibration of a ZED, and depth measured with it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.open_air.stereo_scenes import make_stereo_scene
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.types import Intrinsics
from drivers.base import BadData, DeviceNotFound
from drivers.cameras.row_alignment import FAULTS, RowAlignment
from drivers.cameras.row_check import matched_corners
from drivers.cameras.stereo import MatchParams, StereoDepth, StereoMatcher, depth_mm
from drivers.cameras.zed_calibration import (
    load_zed_calibration,
    parse_zed_calibration,
    rotation_from_vector,
)
from drivers.cameras.zed_uvc import halves
from drivers.simulation.stereo.stereo_profiles import ZED, StereoCamera
from tests.nightly import nightly

from .zed_images import NEW, OLD, pair


def test_an_old_file_without_k3_and_with_trailing_blanks() -> None:
    c = parse_zed_calibration(OLD, "SN1.conf", 672, 376)
    assert c.left.matrix[0, 0] == 350.179
    assert c.right.distortion.tolist() == [-0.17398, 0.0272116, 0.0, 0.0, 0.0]
    assert c.T.tolist() == [-0.12, 0.0, 0.0]
    assert c.baseline_m == 0.12


def test_a_newer_file_with_k3_and_offsets() -> None:
    c = parse_zed_calibration(NEW, "SN2.conf", 672, 376)
    assert c.left.distortion[4] == -0.002
    assert c.T.tolist() == [-0.1199, 0.00005, -0.0003]


def test_offsets_of_a_resolution_are_read() -> None:
    """Some files have one for each resolution; it was taken for 0."""
    text = NEW.replace("TY=0.05", "TY_HD=9\r\nTY_VGA=0.05").replace("TZ=-0.3", "TZ_VGA=-0.3")
    assert parse_zed_calibration(text, "SN2.conf", 672, 376).T.tolist() == [-0.1199, 0.00005, -0.0003]


def test_all_coefficients_of_the_distortion_are_read() -> None:
    """Of a lens whose model has more than five: without the others the rectified images would be bent."""
    text = NEW.replace("k3=-0.002", "k3=-0.002\r\nk4=0.31\r\nk5=-0.02\r\nk6=0.004\r\ns1=0.0005")
    found = parse_zed_calibration(text, "SN2.conf", 672, 376).left
    assert found.distortion.tolist() == [
        -0.173243,
        0.0253571,
        0.0,
        0.0001,
        -0.002,
        0.31,
        -0.02,
        0.004,
        0.0005,
        0.0,
        0.0,
        0.0,
    ]
    with pytest.raises(BadData, match="invalid camera parameters"):
        parse_zed_calibration(text.replace("k5=-0.02", "k5=nan"), "SN2.conf", 672, 376)


def test_the_rotation_vector_is_read_as_opencv_reads_it() -> None:
    vector = np.array([-0.00325192, 0.0228216, -0.00116869])
    assert np.allclose(rotation_from_vector(vector), cv2.Rodrigues(vector)[0], atol=1e-12)
    assert np.array_equal(rotation_from_vector(np.zeros(3)), np.eye(3))


@pytest.mark.parametrize(
    ("text", "size", "cause"),
    [
        (OLD, (640, 480), "a ZED delivers 2208x1242, 1920x1080, 1280x720, 672x376"),
        (OLD.replace("[STEREO]", "[STERO]"), (672, 376), "not a ZED calibration"),
        (OLD.replace("Baseline=120", "Baseline=0.12"), (672, 376), "a baseline of 0.12 mm"),
        (OLD.replace("fx=350.179", "fx=nan"), (672, 376), "invalid camera parameters"),
        ("<html>", (672, 376), "not a ZED calibration"),
        (NEW.replace("RX_VGA=-0.00325192", "RX_VGA=nan"), (672, 376), "cannot be those of a ZED"),
        (NEW.replace("CV_VGA=0.0228216", "CV_VGA=inf"), (672, 376), "cannot be those of a ZED"),
        (NEW.replace("CV_VGA=0.0228216", "CV_VGA=1.3"), (672, 376), "turned by 74.5 deg .* cannot be those of a ZED"),
        (NEW.replace("TY=0.05", "TY=nan"), (672, 376), "cannot be those of a ZED"),
        (NEW.replace("TZ=-0.3", "TZ=60"), (672, 376), "60 mm .* cannot be those of a ZED"),
    ],
)
def test_files_that_cannot_be_used_name_the_cause(text: str, size: tuple[int, int], cause: str) -> None:
    with pytest.raises(BadData, match=cause):
        parse_zed_calibration(text, "SN.conf", *size)


def test_a_missing_file_shows_where_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match="manufacturer's site"):
        load_zed_calibration(tmp_path / "SN1.conf", 672, 376)


def test_a_real_factory_file(shared_data: Path) -> None:
    c = load_zed_calibration(shared_data / "zed" / "SN1267.conf", 1280, 720)
    assert c.left.matrix[0, 0] == 700.357
    assert c.R[0, 2] == pytest.approx(0.0228216, abs=1e-4)  # about y: z turns into x


@pytest.mark.parametrize("z_m", [3.0, *nightly(1.5, 6.0)])
def test_the_depth_of_a_drawn_wall_through_distortion_and_rotation(z_m: float) -> None:
    """Median error below 0.12 px of disparity, nine tenths below a quarter; most pixels measured."""
    c = parse_zed_calibration(NEW, "SN2.conf", 672, 376)
    stereo = StereoDepth(c)
    disparity = StereoMatcher().disparity(*stereo.rectified(*pair(c, z_m)))
    k = stereo.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)
    true_px = k.fx * stereo.baseline_m * (rays @ stereo.R_rectified_raw)[..., 2] / z_m
    inner = np.zeros(u.shape, bool)
    inner[40:-40, 120:-40] = True
    measured = inner & (disparity > 0)
    assert measured.sum() > 0.85 * inner.sum()
    off = np.abs(disparity - true_px)[measured]
    assert np.median(off) < 0.12
    assert np.percentile(off, 90) < 0.25


def test_both_images_agree_in_height_and_a_wrong_calibration_is_found() -> None:
    c = parse_zed_calibration(NEW, "SN2.conf", 672, 376)
    raw = pair(c, 3.0)
    found = matched_corners(*StereoDepth(c).rectified(*raw))
    assert found.corners > 50
    assert found.rows_px < 0.5
    assert found.fault == ""
    wrong = parse_zed_calibration(NEW.replace("cy=193.637", "cy=203.637"), "SN3.conf", 672, 376)
    found = matched_corners(*StereoDepth(wrong).rectified(*raw))
    assert found.rows_px > 5.0
    assert "px in height" in found.fault


K = Intrinsics(640, 400, 441.0, 441.0, 319.5, 199.5)


def alignment() -> RowAlignment:
    """Of a camera that was just opened."""
    return RowAlignment("front", "calibrate it again", corrects=True)


@pytest.mark.parametrize("roll_deg", [-2.0, -0.5, 0.5, 1.0, 2.0])
def test_a_camera_that_has_rolled_is_found(roll_deg: float) -> None:
    """The row differences on both sides are opposite: their median is 0."""
    rng = np.random.default_rng(2)
    left = cv2.GaussianBlur(rng.integers(0, 256, (400, 640)).astype(np.uint8), (0, 0), 2.0)
    right = np.roll(left, -6, axis=1)
    turn = cv2.getRotationMatrix2D((319.5, 199.5), roll_deg, 1.0)
    rolled = np.asarray(cv2.warpAffine(right, turn, (640, 400)), np.uint8)
    alignment().take(left, right, K)
    with pytest.raises(BadData, match=r"px in height.*; calibrate it again"):
        alignment().take(left, rolled, K)


def test_another_focal_length_is_found() -> None:
    """The row differences at the upper and the lower border are opposite."""
    rng = np.random.default_rng(2)
    left = cv2.GaussianBlur(rng.integers(0, 256, (400, 640)).astype(np.uint8), (0, 0), 2.0)
    scale = np.array([[1.0, 0.0, -6.0], [0.0, 1.02, -0.02 * 199.5]])
    right = np.asarray(cv2.warpAffine(left, scale, (640, 400)), np.uint8)
    found = matched_corners(left, right)
    assert found.rows_px < 1.5
    assert "upper and lower" in found.fault


@pytest.mark.parametrize("scene", ["field", *nightly("street", "hill_crest")])
def test_a_rolled_camera_is_found_over_open_ground(scene: str) -> None:
    """Corners lie in the middle of the image there: with a roll of 1 degree their median difference is 1.2 to 1.4 px."""
    camera = StereoCamera(ZED)
    R = rotation_from_euler(0.0, 0.0, 0.05) @ R_CAMFRD_OPTICAL
    pair = camera.pair(make_stereo_scene(scene), R, np.array([0.0, 0.0, -5.0]), 0, 0)
    assert matched_corners(pair.left, pair.right).fault == ""
    height, width = pair.right.shape
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 1.0, 1.0)
    rolled = np.asarray(cv2.warpAffine(pair.right, turn, (width, height)), np.uint8)
    found = matched_corners(pair.left, rolled)
    assert found.roll_px > 5.0
    assert "px in height" in found.fault


def test_a_view_with_corners_on_one_side_only_does_not_pass() -> None:
    """A rolled camera that has passed such a view is a fault at the next one, and not after several."""
    rng = np.random.default_rng(2)
    left = cv2.GaussianBlur(rng.integers(0, 256, (400, 640)).astype(np.uint8), (0, 0), 2.0)
    half = left.copy()
    half[:, 200:] = 90
    rolled = np.roll(cv2.warpAffine(left, cv2.getRotationMatrix2D((319.5, 199.5), 2.0, 1.0), (640, 400)), -6, axis=1)
    check = alignment()
    check.take(half, np.roll(half, -6, axis=1), K)
    with pytest.raises(BadData, match=r"px in height"):
        check.take(left, rolled, K)
    passed = alignment()
    passed.take(left, np.roll(left, -6, axis=1), K)
    for _ in range(FAULTS - 1):
        passed.take(left, rolled, K)
    with pytest.raises(BadData, match=r"px in height"):
        passed.take(left, rolled, K)


def test_exchanged_images_are_found() -> None:
    """Each disparity is then negative, and no pixel is measured."""
    c = parse_zed_calibration(NEW, "SN2.conf", 672, 376)
    left, right = StereoDepth(c).rectified(*pair(c, 3.0))
    with pytest.raises(BadData, match=r"left and right are exchanged.*calibrate it again"):
        alignment().take(right, left, StereoDepth(c).intrinsics)


def test_what_only_one_image_shows_has_no_depth() -> None:
    """A near board in front of a far wall: the band that it hides from the right eye is unknown, not smeared."""
    width, height, near_px, far_px = 480, 120, 40, 10
    shape = (height, width + far_px)
    rng = np.random.Generator(np.random.PCG64(3))
    # blurred noise: waves of one length would repeat, and what repeats is not measured
    wall = cv2.GaussianBlur(rng.integers(0, 256, shape, np.uint8), (0, 0), 1.2)
    board = cv2.GaussianBlur(rng.integers(0, 256, (height, 100), np.uint8), (0, 0), 1.2)
    left, right = wall[:, :width].copy(), wall[:, far_px : far_px + width].copy()
    left[:, 220:320] = board
    right[:, 220 - near_px : 320 - near_px] = board
    params = MatchParams(disparities=64, edge_px=0)
    disparity = StereoMatcher(params).disparity(left, right)
    assert np.median(disparity[20:-20, 240:300]) == pytest.approx(near_px, abs=0.5)
    assert np.median(disparity[20:-20, 360:440]) == pytest.approx(far_px, abs=0.5)
    hidden = disparity[20:-20, 192:216]  # left of the board by the difference of both disparities
    assert np.mean(hidden < 0) > 0.8


def test_no_match_and_what_is_beyond_the_range_of_millimetres_is_unknown() -> None:
    disparity = np.array([[-1.0, 0.0, 0.0001, 30.0]], np.float32)
    assert depth_mm(disparity, 300.0 * 0.1).tolist() == [[0, 0, 0, 1000]]


def test_a_real_pair_gives_plausible_depths(shared_data: Path) -> None:
    """Rectified already by its maker: no calibration is applied to it."""
    image = cv2.imread(str(shared_data / "zed" / "zed2i_side_by_side_3840x1080.jpg"))
    small = cv2.resize(image, (1920, 540), interpolation=cv2.INTER_AREA)
    left, right = halves(small)
    found = matched_corners(left, right)
    assert found.corners > 100
    assert found.rows_px < 0.6
    assert found.fault == ""
    depth = depth_mm(StereoMatcher(MatchParams(disparities=128)).disparity(left, right), 534.04 * 0.11998737) / 1000.0
    seen = depth[depth > 0]
    # walls and table top are blank to within the noise: only their borders are measured
    assert 0.15 * depth.size < len(seen) < 0.25 * depth.size
    assert 0.5 < np.percentile(seen, 1) < np.percentile(seen, 99) < 5.0
    bottles = depth[300:420, 480:740]
    assert np.mean(bottles[(bottles > 0)] < 1.2) > 0.8
