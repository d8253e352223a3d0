"""Reads a folder in the format of the TUM RGB-D benchmark: depth.txt, depth/*.png and groundtruth.txt.

depth.txt: `stamp file`, seconds. groundtruth.txt: `stamp tx ty tz qx qy qz qw`, the pose of the camera's optical frame in a
world with z up. Depth is 5000 per metre. The camera takes the place of the vehicle: its mount is level and forward, and the
attitude is that of its axes (frd). Without intrinsics.json the benchmark's default camera is used."""

from __future__ import annotations

from contextlib import suppress
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Final

import numpy as np

from core.frames import R_CAMFRD_OPTICAL
from core.types import AttitudeSample, CameraInfo, Intrinsics, PoseSample
from drivers.base import BadData
from drivers.regular_file import regular

from ..pipeline.sync import NS
from .frame_list import FrameListSource, Samples
from .frames_csv import FrameRow, in_order
from .images import PngImages
from .intrinsics_json import DepthCoding, read_intrinsics
from .report import ImportOptions, Report, attitude_rate_problem, uncovered
from .ros2_frames import R_NED_ENU, quaternion_wxyz, rotation_of_unit, triple

DEPTH_LIST: Final = "depth.txt"
GROUND_TRUTH: Final = "groundtruth.txt"
DEPTH_UNIT_MM: Final = 0.2
DEFAULT: Final = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
"""Of the benchmark's registered depth images."""


def is_tum(folder: Path) -> bool:
    """Whether the folder has this format."""
    return (folder / DEPTH_LIST).is_file() and not (folder / "frames.csv").exists()


def open_tum(folder: Path, options: ImportOptions, report: Report) -> FrameListSource:
    """The recording. Raises BadData where nothing can be delivered."""
    rows, count = _rows(folder / DEPTH_LIST, report)
    if not rows:
        raise BadData(f"{folder / DEPTH_LIST}: no usable line; expected `stamp file`")
    info, coding = _camera(folder, options, report)
    samples = _samples(folder / GROUND_TRUTH, report)
    exposures, stamps = [r.t_ns for r in rows], [a.t_ns for a in samples[0]]
    too_slow = attitude_rate_problem(exposures, stamps, options.sync)
    missing = uncovered(exposures, stamps, options.sync)
    if too_slow or missing:
        text = too_slow or f"{len(missing)} of {len(rows)} frames have no pose near them and are kept without attitude"
        report.warning("attitude", f"{folder / GROUND_TRUTH}: {text}")
    return FrameListSource(PngImages(folder, info, coding), rows, samples, options, report, count, DEPTH_LIST)


def _camera(folder: Path, options: ImportOptions, report: Report) -> tuple[CameraInfo, DepthCoding]:
    path = folder / "intrinsics.json"
    if path.exists():
        return read_intrinsics(path, options, DEPTH_UNIT_MM)
    report.note(
        f"no intrinsics.json: the benchmark's default camera (fx {DEFAULT.fx:g}, cx {DEFAULT.cx:g}) is used; depth is "
        "5000 per metre"
    )
    try:
        info = options.camera.applied_to(CameraInfo(options.camera.name, DEFAULT))
    except ValueError as error:
        raise BadData(f"the camera's values on the command line: {error}") from error
    return info, DepthCoding(unit_mm=DEPTH_UNIT_MM)


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """(line number, words) of each line that is not a comment. Raises BadData."""
    try:
        text = regular(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not a text file"
        raise BadData(f"{path}: cannot be read ({reason})") from error
    lines = enumerate(text.splitlines(), start=1)
    return [
        (n, line.replace(",", " ").split()) for n, line in lines if line.strip() and not line.lstrip().startswith("#")
    ]


def _stamp_ns(text: str) -> int | None:
    """Exact nanoseconds of decimal seconds: a float has only microseconds left at unix times."""
    try:
        value = Decimal(text)
        return int(value * NS) if value.is_finite() and -(1 << 32) < value < 1 << 32 else None
    except InvalidOperation:
        return None


def _rows(path: Path, report: Report) -> tuple[list[FrameRow], int]:
    """(the images in order of time, number of lines)."""
    rows: list[FrameRow] = []
    lines = _lines(path)
    for number, (line, words) in enumerate(lines):
        t_ns = _stamp_ns(words[0])
        if len(words) < 2 or t_ns is None or "\0" in words[1]:
            report.problem("row", f"{path} line {line}: expected a stamp in seconds and a file; line left out")
            continue
        rows.append(FrameRow(line=line, number=number, file=words[1], t_ns=t_ns, euler_rad=None, position_ned_m=None))
    return in_order(path, rows, report), len(lines)


def _samples(path: Path, report: Report) -> Samples:
    """Attitude and position of the camera's frd axes in ned, with z up taken as ENU."""
    attitudes: list[AttitudeSample] = []
    poses: list[PoseSample] = []
    for line, words in _lines(path):
        t_ns = _stamp_ns(words[0])
        R_world_optical = None
        with suppress(ValueError):
            x, y, z, qx, qy, qz, qw = (float(word) for word in words[1:8])
            R_world_optical = rotation_of_unit((qw, qx, qy, qz))
        if t_ns is None or R_world_optical is None or not np.isfinite([x, y, z]).all():
            report.problem("pose", f"{path} line {line}: expected stamp tx ty tz qx qy qz qw; line left out")
            continue
        attitudes.append(AttitudeSample(t_ns, t_ns, quaternion_wxyz(R_NED_ENU @ R_world_optical @ R_CAMFRD_OPTICAL.T)))
        poses.append(PoseSample(t_ns, t_ns, triple(R_NED_ENU @ np.array([x, y, z]))))
    return attitudes, poses
