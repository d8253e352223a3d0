"""The ZED driver: calibration files, a drawn pair of known depth, a real pair, a video file as the device."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.types import Intrinsics
from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.cameras import row_alignment
from drivers.cameras.pair_video import StampedImage
from drivers.cameras.row_alignment import FAULTS, MEASUREMENTS, RowAlignment
from drivers.cameras.row_check import matched_corners
from drivers.cameras.stereo import MatchParams, StereoDepth, StereoMatcher, depth_mm
from drivers.cameras.zed_calibration import (
    EyeCalibration,
    StereoCalibration,
    load_zed_calibration,
    parse_zed_calibration,
    rotation_from_vector,
)
from drivers.cameras.zed_uvc import ZedSettings, ZedSource, halves
from drivers.simulation.stereo.stereo_profiles import ZED, StereoCamera
from drivers.simulation.stereo.stereo_scenes import make_stereo_scene

OLD = "\r\n".join(
    [
        "", "[LEFT_CAM_VGA] ", "fx=350.179 ", "fy=350.179 ", "cx=349.218 ", "cy=190.017 ", "k1=-0.173243 ", "k2=0.0253571 ",
        "p1=0 ", "p2=0 ", "", "[RIGHT_CAM_VGA] ", "fx=349.791 ", "fy=349.791 ", "cx=348.013 ", "cy=193.637 ",
        "k1=-0.17398 ", "k2=0.0272116 ", "p1=0 ", "p2=0 ", "", "[STEREO] ", "Baseline=120 ", "CV_VGA=0.0228216 ",
        "RX_VGA=-0.00325192 ", "RZ_VGA=-0.00116869",
    ]
)  # fmt: skip
NEW = OLD.replace("p2=0 ", "p2=0.0001\r\nk3=-0.002").replace("Baseline=120 ", "Baseline=119.9\r\nTY=0.05\r\nTZ=-0.3")


def texture(points: np.ndarray) -> np.ndarray:
    """(...,) 0..255 gray of points (..., 2) on a plane, metres: structure at many scales, the same from everywhere."""
    rng = np.random.Generator(np.random.PCG64(5))
    value = np.zeros(points.shape[:-1])
    for scale_m in (0.6, 0.25, 0.11, 0.05):
        for _ in range(6):
            angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            along = points[..., 0] * np.cos(angle) + points[..., 1] * np.sin(angle)
            value += np.sin(2.0 * np.pi * along / scale_m + phase)
    return np.asarray(np.clip(128.0 + 18.0 * value, 0, 255))


def eye_image(
    eye: EyeCalibration, size: tuple[int, int], R: np.ndarray, T: np.ndarray, z_m: float, seed: int
) -> np.ndarray:
    """What a real, distorted eye sees of a wall at depth z_m of the left eye; p_eye = R p_left + T."""
    width, height = size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None, :]
    rays = cv2.undistortPoints(pixels, eye.matrix, eye.distortion)[:, 0, :]
    in_left = np.hstack([rays, np.ones((len(rays), 1))]) @ R  # R^T, row by row
    centre = -R.T @ T
    scale = (z_m - centre[2]) / in_left[:, 2]
    hit = centre[None, :2] + scale[:, None] * in_left[:, :2]
    noise = np.random.Generator(np.random.PCG64(seed)).normal(0.0, 2.0, len(hit))
    return np.clip(texture(hit) + noise, 0, 255).astype(np.uint8).reshape(height, width)


def pair(c: StereoCalibration, z_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A raw pair of a wall at z_m."""
    size = (c.width, c.height)
    left = eye_image(c.left, size, np.eye(3), np.zeros(3), z_m, 1)
    return left, eye_image(c.right, size, c.R, c.T, z_m, 2)


# ---- calibration ------------------------------------------------------------------------------------------------------


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


# ---- matching ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("z_m", [1.5, 3.0, 6.0])
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


@pytest.mark.parametrize("scene", ["field", "street", "hill_crest"])
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


# ---- the device -------------------------------------------------------------------------------------------------------


class Video:
    """A device that delivers images, and is then unplugged. stamp_ns: of each; None: 8 ms ago."""

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


CALIBRATION = parse_zed_calibration(NEW, "SN2.conf", 672, 376)
SETTINGS = ZedSettings(camera="front", device="/dev/video5", calibration=Path("SN2.conf"), exposure_latency_s=0.01)


def side_by_side(z_m: float = 3.0) -> np.ndarray:
    return cv2.cvtColor(np.hstack(pair(CALIBRATION, z_m)), cv2.COLOR_GRAY2BGR)


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


@pytest.mark.parametrize("lost", [1012, 2024])
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


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"stereo: disparities = 0: expected 16..512 px"):
        MatchParams(disparities=0)
