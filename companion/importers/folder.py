"""Reads a directory with depth PNGs (or raw stereo pairs), frames.csv and optionally the log of the flight.

frames.csv: `file`, `t_ns` (mid-exposure), `roll_rad`, `pitch_rad`, `yaw_rad` (frd to ned, ZYX, as in MAVLink), and
optionally `x_m`, `y_m`, `z_m` (ned). Other columns are ignored. With a .tlog, .ulg or .bin, attitude and position are taken
from it. Depth PNGs need intrinsics.json; stereo pairs the camera's SN<serial>.conf, see stereo.py.
"""

from __future__ import annotations

import os
from pathlib import Path

from core.frames import quaternion_from_euler
from core.types import AttitudeSample, PoseSample
from drivers.base import BadData

from ..console import counted
from .clock_match import TiltRow
from .flight_log import find_flight_log, flight_log_samples
from .frame_list import FrameListSource, Samples
from .frames_csv import FRAMES, FrameRow, looks_like_degrees, read_rows
from .images import DepthImages, PngImages
from .intrinsics_json import read_intrinsics
from .report import ImportOptions, Report, attitude_rate_problem, spans, uncovered
from .stereo import StereoImages, find_calibration


def open_folder(folder: Path, options: ImportOptions, report: Report) -> FrameListSource:
    """The recording of a directory. Problems with single rows and images are added to `report`; the rest is delivered.
    Raises BadData where nothing can be delivered."""
    log = find_flight_log(folder, options)
    calibration = None if (folder / "intrinsics.json").exists() else find_calibration(folder)
    described = None if calibration is not None else read_intrinsics(folder / "intrinsics.json", options)
    rows, count = read_rows(folder / FRAMES, report, angles_needed=log is None)
    if not rows:
        raise BadData(f"{folder / 'frames.csv'}: no usable row; expected one for each depth image")
    images: DepthImages
    if calibration is not None:
        images = StereoImages(folder, calibration, rows, options, report)
    else:
        assert described is not None
        images = PngImages(folder, *described)
    folder_rows = _FolderRows(folder, rows, report)
    folder_rows.report_unlisted()
    samples = folder_rows.from_log(log, options) if log is not None else folder_rows.from_rows()
    return FrameListSource(images, rows, samples, options, report, count, FRAMES)


class _FolderRows:
    """The rows of frames.csv, and what is wrong with them."""

    def __init__(self, folder: Path, rows: list[FrameRow], report: Report) -> None:
        self._folder, self._rows, self._report = folder, rows, report

    def from_log(self, log: Path, options: ImportOptions) -> Samples:
        """Attitudes and positions of the flight log."""
        exposures = [r.t_ns for r in self._rows]
        rows = [TiltRow(r.t_ns, r.euler_rad[0], r.euler_rad[1]) for r in self._rows if r.euler_rad is not None]
        found = flight_log_samples(log, (min(exposures), max(exposures)), rows, options, self._report)
        stamps = [a.t_ns for a in found[0]]
        too_slow = attitude_rate_problem(exposures, stamps, options.sync)
        missing = set(uncovered(exposures, stamps, options.sync))
        if too_slow:
            self._report.problem("attitude", f"{log.name}: {too_slow}")
        elif missing:
            lines = spans(r.line for r in self._rows if r.t_ns in missing)
            self._report.problem(
                "attitude",
                f"{log.name}: no attitude near the frames of frames.csv line {lines}; these frames are kept without "
                "attitude",
            )
        return found

    def from_rows(self) -> Samples:
        """Attitudes and positions of frames.csv."""
        self._report_unusable()
        # of a file in degrees the small angles would pass as radians
        in_degrees = any(looks_like_degrees(r) for r in self._rows)
        attitudes = [
            AttitudeSample(r.t_ns, r.t_ns, quaternion_from_euler(*r.euler_rad))
            for r in self._rows
            if r.euler_rad is not None and not in_degrees
        ]
        poses = [PoseSample(r.t_ns, r.t_ns, r.position_ned_m) for r in self._rows if r.position_ned_m is not None]
        return attitudes, poses

    def _report_unusable(self) -> None:
        """Reports attitudes and positions of frames.csv that are not used."""
        path = self._folder / FRAMES
        without_attitude = [r.line for r in self._rows if r.euler_rad is None]
        if without_attitude:
            self._report.problem(
                "attitude",
                f"{path}: {counted(len(without_attitude), 'row')} without a usable attitude (line {spans(without_attitude)}): "
                "the frames are kept without attitude; fill in roll_rad, pitch_rad and yaw_rad, or add the autopilot's log (.tlog, .ulg, .bin)",
            )
        too_large = [r.line for r in self._rows if looks_like_degrees(r)]
        if too_large:
            self._report.problem(
                "attitude",
                f"{path}: {counted(len(too_large), 'row')} with angles of more than a full turn (line {spans(too_large)}), which look "
                "like degrees: no attitude of the file is used, since small angles in degrees cannot be distinguished from "
                "radians; correct these rows, or convert roll_rad, pitch_rad and yaw_rad to radians",
            )
        without_position = [r.line for r in self._rows if r.position_ned_m is None]
        if 0 < len(without_position) < len(self._rows):
            self._report.problem(
                "position",
                f"{path}: {counted(len(without_position), 'row')} without a usable position (line {spans(without_position)}): "
                "the frames are kept without position; fill in x_m, y_m and z_m",
            )

    def report_unlisted(self) -> None:
        """Reports images without a row: they have no time and are not used."""
        # Path.resolve raises RuntimeError for a link to itself
        listed = {
            Path(os.path.realpath(self._folder / name)) for r in self._rows for name in (r.file, r.file_right) if name
        }
        for parent in sorted({p.parent for p in listed}):
            unlisted = [p.name for p in sorted(parent.glob("*.png")) if p not in listed]
            if unlisted:
                shown = ", ".join(unlisted[:3]) + (", ..." if len(unlisted) > 3 else "")
                self._report.problem(
                    "gap",
                    f"{self._folder / 'frames.csv'}: {counted(len(unlisted), 'image')} in {parent.name}/ without a usable row ({shown}): "
                    "they have no time and are left out; add or correct their rows, or move the images away",
                )
