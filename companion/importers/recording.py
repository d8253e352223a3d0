"""Converts a recording into a log, in order of arrival."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import BadData, DeviceNotFound, Event
from drivers.regular_file import regular

from ..config.loader import Config
from ..log.log_file import refuse_output
from ..log.log_writer import write_recording
from ..log.provenance import run_info
from ..pipeline.sync import NS
from ..whole_file import write_whole
from .depth_summary import DepthSummary, DepthTally
from .flight_log import FLIGHT_LOGS
from .folder import open_folder
from .frame_list import FrameListSource
from .report import ImportOptions, Report
from .ros2 import Ros2Source
from .ros2_files import is_bag
from .tum import is_tum, open_tum

REMEDY_NO_SOURCE = (
    "expected a directory with intrinsics.json, frames.csv and depth PNGs, a TUM RGB-D directory, or a ROS 2 recording "
    "(.mcap, .db3, or the bag's directory)"
)
NOTHING_MEASURED = (
    "no pixels of the images are measured from 0.1 m to 65 m: check the unit. 32FC1 is in metres, 16UC1 and PNGs in millimetres (another unit "
    "of PNGs: depth_unit_mm in intrinsics.json)"
)
LEAST_REACH_M = 0.1
"""Nearer than this no depth camera measures; metres as integers are millimetres of less than 0.065 m."""
LEAST_INTERVAL_S = 0.001
"""Median interval of images, shorter than of any camera: of 10 Hz with times in microseconds it is 0.0001 s."""
_LIST_COLUMNS = ("sequence", "file")


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """The result of an import."""

    output: Path
    frames: int  # kept frames
    frames_named: int  # frames in the recording
    attitudes: int
    poses: int
    duration_s: float
    depth: DepthSummary
    file_list: Path | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    problems: tuple[str, ...]


def import_recording(path: Path, output: Path, options: ImportOptions, config: Config, *, replace: bool) -> Imported:
    """Writes the recording as a log; replace: also where it exists. Raises DriverError when no frame can be used, OSError and
    ValueError when the log cannot be written: what was at its place is then unchanged. Problems with parts are in the result.
    """
    refuse_output(output, path, *([options.tlog] if options.tlog is not None else []), replace=replace)
    _refuse_file_list(_file_list(output))
    report = Report()
    try:
        source = open_recording(path, options, report)
    except BadData as error:
        raise _with_problems(str(error), report) from error
    counted = _Counted(source)
    try:
        write_recording(counted, output, run_info("import", config))
    except BadData as error:
        report.problem("recording", str(error))
    except KeyboardInterrupt as interrupt:
        done = f"{counted.kinds[DepthFrame]} of {source.frame_count} frames"
        raise KeyboardInterrupt(f"interrupted after {done}; {output} was not written") from interrupt
    if not counted.kinds[DepthFrame]:
        raise _with_problems(f"{path}: no frame could be used, so that {output} was not written", report)
    depth = counted.depth.summary()
    if depth.reach_m <= LEAST_REACH_M:
        report.problem("depth", f"{path}: {NOTHING_MEASURED}")
    if 0.0 < counted.interval_s < LEAST_INTERVAL_S:
        report.problem(
            "unit",
            f"{path}: the images are {counted.interval_s:.1e} s apart: their times are probably in another unit than nanoseconds; convert "
            "them (t_ns of frames.csv)",
        )
    return Imported(
        output=output,
        depth=depth,
        file_list=write_file_list(output, source.files),
        warnings=tuple(report.all_warnings()),
        frames=counted.kinds[DepthFrame],
        frames_named=source.frame_count,
        attitudes=counted.kinds[AttitudeSample],
        poses=counted.kinds[PoseSample],
        duration_s=counted.duration_s,
        notes=tuple(report.notes),
        problems=tuple(report.all_problems()),
    )


def _with_problems(text: str, report: Report) -> BadData:
    """The error, with the problems found before, which may be its cause."""
    return BadData("\n".join([text, *report.all_problems()]))


def write_file_list(output: Path, files: dict[int, str]) -> Path | None:
    """Writes OUT.files.csv, which leads from a frame's number to its file; None where frames are not files."""
    if not files:
        return None
    path = _file_list(output)
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_LIST_COLUMNS, *sorted(files.items())])
    write_whole(path, text.getvalue())
    return path


def _file_list(output: Path) -> Path:
    return output.with_suffix(".files.csv")


def _refuse_file_list(path: Path) -> None:
    """Raises ValueError where something else is at the place of the list."""
    if not path.exists():
        return
    begin = ",".join(_LIST_COLUMNS).encode() + b"\n"
    with regular(path).open("rb") as stream:
        if stream.read(len(begin)) != begin:
            raise ValueError(
                f"{path}: exists and is no list of `companion import`, which would replace it; give -o another name"
            )


def open_recording(path: Path, options: ImportOptions, report: Report) -> FrameListSource | Ros2Source:
    """The reader of a directory or file. Raises DriverError."""
    if path.is_dir():
        if is_tum(path):
            return open_tum(path, options, report)
        return Ros2Source(path, options, report) if is_bag(path) else open_folder(path, options, report)
    if not path.exists():
        raise DeviceNotFound(f"{path}: does not exist; {REMEDY_NO_SOURCE}")
    if path.suffix.lower() == ".bag":
        raise BadData(
            f"{path}: a ROS 1 bag; convert it first (rosbags-convert of the package rosbags, or the mcap tool)"
        )
    if path.suffix.lower() in FLIGHT_LOGS:
        raise BadData(
            f"{path}: a log of the flight without images; give the folder of the depth images, and this file beside them or with "
            "--tlog"
        )
    return Ros2Source(path, options, report)


class _Counted:
    """Passes the events of a source on and counts them."""

    def __init__(self, source: FrameListSource | Ros2Source) -> None:
        self._source = source
        self.kinds: Counter[type[Event]] = Counter()
        self.depth = DepthTally()
        self._exposures: list[int] = []

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        return self._source.cameras

    @property
    def duration_s(self) -> float:
        """Time from the first to the last exposure."""
        return (max(self._exposures) - min(self._exposures)) / NS if self._exposures else 0.0

    @property
    def interval_s(self) -> float:
        """Median time from one exposure to the next; 0 without two."""
        return median(b - a for a, b in pairwise(self._exposures)) / NS if len(self._exposures) > 1 else 0.0

    def events(self) -> Iterator[Event]:
        """The events of the source."""
        for event in self._source.events():
            self.kinds[type(event)] += 1
            if isinstance(event, DepthFrame):
                self._exposures.append(event.t_exposure_ns)
                self.depth.add(event.depth_mm)
            yield event
