"""Folders of other kinds: TUM RGB-D, and raw stereo pairs that are matched at the import."""

from __future__ import annotations

import json
import math
import struct
import zlib
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from companion.cli import main
from companion.importers.ros2_decode import COMPRESSED
from companion.importers.ros2_depth import depth_of
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_from_quaternion
from core.types import AttitudeSample, CameraInfo, PoseSample
from drivers.base import BadData
from drivers.logs.reader import McapRecording

from ..recordings import events_of, frames_of

STAMP_S = 1305031102


def imported(source: Path, *arguments: str) -> tuple[int, Path]:
    out = source.parent / "out.mcap"
    return main(["import", str(source), "-o", str(out), *arguments]), out


def camera_of(path: Path) -> CameraInfo:
    with McapRecording(path) as recording:
        return recording.cameras[0]


# ---- TUM RGB-D ------------------------------------------------------------------------------------------------------


def quaternion_xyzw(R: np.ndarray) -> list[float]:
    w = math.sqrt(max(1e-12, 1 + np.trace(R))) / 2
    return [(R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w), w]


def write_tum(folder: Path, frames: int = 5, pose_hz: int = 100) -> Path:
    """A camera that looks north-east, 0.2 rad down, in a world with x east, y north, z up."""
    (folder / "depth").mkdir(parents=True)
    lines = ["# depth maps", "# timestamp filename"]
    for i in range(frames):
        name = f"depth/{STAMP_S}.{160000 + 30000 * i:06d}.png"
        assert cv2.imwrite(str(folder / name), np.full((480, 640), 5000 + 500 * i, np.uint16))
        lines.append(f"{STAMP_S}.{160000 + 30000 * i:06d} {name}")
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    R_ned_frd = rotation_from_euler(0.0, -0.2, math.pi / 4)
    R_enu_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    q = quaternion_xyzw(R_enu_ned @ R_ned_frd @ R_CAMFRD_OPTICAL)
    poses = ["# timestamp tx ty tz qx qy qz qw"]
    for i in range(pose_hz):
        pose = [1.0, 2.0, 3.0, *q]
        poses.append(f"{STAMP_S}.{i * 1_000_000 // pose_hz:06d} " + " ".join(f"{v:.6f}" for v in pose))
    (folder / "groundtruth.txt").write_text("\n".join(poses) + "\n")
    return folder


def test_a_tum_folder_with_its_scale_stamps_and_poses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(write_tum(tmp_path / "rgbd_dataset_freiburg1_xyz"))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "default camera" in captured.out
    assert camera_of(out).intrinsics.fx == 525.0
    frames = frames_of(out)
    assert [int(f.depth_mm[9, 9]) for f in frames] == [1000, 1100, 1200, 1300, 1400]
    assert frames[1].t_exposure_ns == STAMP_S * 10**9 + 190_000_000
    events = events_of(out)
    attitude = next(e for e in events if isinstance(e, AttitudeSample))
    R = rotation_from_quaternion(attitude.q_ned_frd_wxyz)
    np.testing.assert_allclose(R, rotation_from_euler(0.0, -0.2, math.pi / 4), atol=1e-5)
    assert next(e for e in events if isinstance(e, PoseSample)).position_ned_m == pytest.approx((2.0, 1.0, -3.0))


@pytest.mark.parametrize(
    ("unit", "expected_mm"), [({}, 1000), ({"depth_unit_mm": 1.0}, 5000), ({"depth_unit_mm": 0.5}, 2500)]
)
def test_a_tum_folder_with_intrinsics_has_the_depth_unit_that_they_state(
    unit: dict[str, float], expected_mm: int, tmp_path: Path
) -> None:
    folder = write_tum(tmp_path / "rgbd", frames=1)
    camera = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "invalid": [0, 7]}
    (folder / "intrinsics.json").write_text(json.dumps(camera | unit))
    image = np.full((480, 640), 5000, np.uint16)
    image[0, 0] = 7
    assert cv2.imwrite(str(next((folder / "depth").iterdir())), image)
    status, out = imported(folder)
    assert status == 0
    assert camera_of(out).intrinsics.fx == 500.0
    (frame,) = frames_of(out)
    assert frame.depth_mm[9, 9] == expected_mm
    assert frame.depth_mm[0, 0] == 0


def test_slow_or_missing_poses_are_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(write_tum(tmp_path / "rgbd", pose_hz=4))[0] == 0
    assert "the attitude comes at 4.0 Hz" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "stamp"), [(4, "1999999999.5"), (5, "1.0"), (2, "1999999999.5"), (3, "1e99999999999999999")]
)
def test_one_wrong_stamp_in_a_tum_folder_removes_its_own_frame_only(
    line: int, stamp: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_tum(tmp_path / "rgbd")
    lines = (folder / "depth.txt").read_text().splitlines()
    lines[line] = f"{stamp}{lines[line][17:]}"
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    status, out = imported(folder)
    assert status == 1
    assert f"depth.txt line {line + 1}: " in capsys.readouterr().err
    frames = frames_of(out)
    assert len(frames) == 4
    assert [int(f.depth_mm[9, 9]) for f in frames] == [1000 + 100 * k for k in range(5) if k != line - 2]


def test_a_tum_name_with_nul_costs_its_own_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_tum(tmp_path / "rgbd")
    lines = (folder / "depth.txt").read_text().splitlines()
    lines[-1] += "\0"
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    status, out = imported(folder)
    assert status == 1
    assert "expected a stamp in seconds and a file; line left out" in capsys.readouterr().err
    assert len(frames_of(out)) == 4


@pytest.mark.parametrize("size", [(40_000, 30_000), (1 << 30, 1 << 30), (0, 0)])
def test_a_png_of_an_impossible_size_is_damaged(size: tuple[int, int]) -> None:
    """OpenCV raises for more than 2^30 pixels, and returns None for other damages."""
    header = b"IHDR" + struct.pack(">IIBBBBB", *size, 16, 0, 0, 0, 0)
    pixels = b"IDAT" + zlib.compress(bytes(100))
    chunks = [struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (header, pixels, b"IEND")]
    data = b"\x89PNG\r\n\x1a\n" + b"".join(chunks)
    message = SimpleNamespace(data=data, format="16UC1; compressedDepth png")
    with pytest.raises(BadData, match="damaged"):
        depth_of(COMPRESSED, message)


def test_a_png_that_needs_gigabytes_is_not_decoded() -> None:
    """Half a megabyte of PNG took 5 GB: 16000 x 16000 pixels."""
    done, png = cv2.imencode(".png", np.zeros((5000, 3000), np.uint16))
    assert done
    message = SimpleNamespace(data=png.tobytes(), format="16UC1; compressedDepth png")
    with pytest.raises(BadData, match="3000 x 5000 pixels; at most 4096 x 4096 are read"):
        depth_of(COMPRESSED, message)


def test_a_missing_image_and_a_left_out_line_of_a_tum_folder_are_counted_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message named frames.csv, and the line that was left out did not count."""
    folder = write_tum(tmp_path / "rgbd")
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / lines[3].split()[1]).unlink()
    lines[5] = "no stamp"
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    assert imported(folder)[0] == 1
    err = capsys.readouterr().err
    assert f"depth.txt line 4: {folder / lines[3].split()[1]}: cannot be read (No such file or directory)" in err
    assert "frames.csv" not in err
    assert "3 of 5 frames kept" in err


def test_options_for_the_log_of_an_autopilot_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The attitude of a TUM folder is in its own list of poses: they had no effect."""
    folder = write_tum(tmp_path / "rgbd_dataset_freiburg1_xyz")
    for option in ("--tlog-epoch 0", "--system-id 1", "--no-tlog", f"--tlog {folder / 'depth.txt'}"):
        status, out = imported(folder, *option.split())
        assert status == 2
        assert f"{option.split()[0]} is for the log of an autopilot" in capsys.readouterr().err
        assert not out.exists()


def test_a_tum_folder_without_poses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_tum(tmp_path / "rgbd")
    (folder / "groundtruth.txt").unlink()
    assert imported(folder)[0] == 1
    assert "groundtruth.txt: cannot be read" in capsys.readouterr().err


# ---- stereo ---------------------------------------------------------------------------------------------------------

WIDTH, HEIGHT, F_PX, BASELINE_M, DISPARITY_PX = 672, 376, 350.0, 0.12, 20
EYE = f"fx={F_PX}\nfy={F_PX}\ncx={(WIDTH - 1) / 2}\ncy={(HEIGHT - 1) / 2}\nk1=0\nk2=0\np1=0\np2=0\nk3=0\n"
CALIBRATION = (
    f"[LEFT_CAM_VGA]\n{EYE}\n[RIGHT_CAM_VGA]\n{EYE}\n[STEREO]\nBaseline={1000 * BASELINE_M}\nTY=0\nTZ=0\n"
    "CV_VGA=0\nRX_VGA=0\nRZ_VGA=0\n"
)


def write_pairs(folder: Path, apart: bool, rows_px: float = 0.0, pairs: int = 2) -> Path:
    """A textured wall at f B / disparity, as side-by-side images or as two. rows_px: by how much lower the right one is."""
    folder.mkdir(parents=True)
    noise = np.random.default_rng(5).integers(0, 255, (HEIGHT, WIDTH + DISPARITY_PX), np.uint8)
    wall = cv2.GaussianBlur(noise, (0, 0), 1.2)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    left, right = wall[:, :WIDTH], wall[:, DISPARITY_PX:]
    if rows_px:
        move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, rows_px]])
        right = cv2.warpAffine(right, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    (folder / "SN1.conf").write_text(CALIBRATION)
    rows = []
    for i in range(pairs):
        names = (f"l{i}.png", f"r{i}.png") if apart else (f"p{i}.png",)
        for name, image in zip(names, (left, right) if apart else (np.hstack([left, right]),), strict=True):
            assert cv2.imwrite(str(folder / name), image)
        rows.append(f"{names[0]},{i * 100_000_000},0,0,0{',' + names[1] if apart else ''}")
    heading = "file,t_ns,roll_rad,pitch_rad,yaw_rad" + (",file_right" if apart else "")
    (folder / "frames.csv").write_text("\n".join([heading, *rows]) + "\n")
    return folder


@pytest.mark.parametrize("apart", [False, True])
def test_stereo_pairs_become_depth(apart: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(write_pairs(tmp_path / "rec", apart))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "stereo pairs matched with SN1.conf: 672x376 px, baseline 120 mm" in captured.out
    assert camera_of(out).intrinsics.fx == pytest.approx(F_PX, rel=0.02)
    frames = frames_of(out)
    assert len(frames) == 2
    found = frames[0].depth_mm[20:-20, 150:-40]
    measured = found[found > 0]
    assert measured.size > 0.5 * found.size
    assert np.median(measured) == pytest.approx(1000 * F_PX * BASELINE_M / DISPARITY_PX, rel=0.02)


def test_the_rows_of_stereo_pairs_are_aligned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An image that cannot be read does not hinder it."""
    folder = write_pairs(tmp_path / "rec", apart=True, rows_px=0.8, pairs=4)
    (folder / "r1.png").unlink()
    _, out = imported(folder)
    assert "rows of the images aligned by up to 0.9" in capsys.readouterr().out
    assert camera_of(out).bias_per_m == pytest.approx(1.5 * 0.8 / (F_PX * BASELINE_M), rel=0.1)


def test_a_foreign_calibration_is_noticed_after_a_first_pair_without_corners(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its depths would be wrong."""
    folder = write_pairs(tmp_path / "rec", apart=True, rows_px=3.0, pairs=4)
    for name in ("l0.png", "r0.png"):
        assert cv2.imwrite(str(folder / name), np.full((HEIGHT, WIDTH), 90, np.uint8))
    status, _ = imported(folder)
    assert status != 0
    error = capsys.readouterr().err
    assert "camera front: the rectified images differ by 3.0 px in height" in error
    assert "SN1.conf belongs to another camera" in error


def test_exchanged_or_foreign_images_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_pairs(tmp_path / "rec", apart=True)
    (folder / "r1.png").unlink()
    status, out = imported(folder)
    assert status == 1
    assert "r1.png: cannot be read (No such file or directory)" in capsys.readouterr().err
    assert len(frames_of(out)) == 1
    text = (folder / "frames.csv").read_text().replace(",file_right", ",other")
    (folder / "frames.csv").write_text(text)
    assert imported(folder, "--replace")[0] == 1
    assert "file_right" in capsys.readouterr().err
