"""A folder of depth PNGs, intrinsics.json and frames.csv, with a .tlog beside them where there is one.

frames.csv: `file`, `t_ns` (mid-exposure), `roll_rad`, `pitch_rad`, `yaw_rad` (frd to ned, ZYX, as in MAVLink), and, where
known, `x_m`, `y_m`, `z_m` (ned). Further columns are ignored. With a .tlog the attitude (and position) is the log's.
"""

from __future__ import annotations

import csv
import json
import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, DepthFrame, Intrinsics, PoseSample
from drivers.base import BadData, Event

from ..pipeline.sync import NS
from .png import read_depth_png
from .report import ImportOptions, Report, spans, uncovered
from .tlog import TiltRow, tlog_samples

ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")
POSITION = ("x_m", "y_m", "z_m")
MAX_ANGLE_RAD = 2.0 * math.pi
"""No angle of an attitude in radians is more than a turn."""
GAP_FACTOR, GAP_MIN_S = 5.0, 0.5
"""A pause this many times the usual interval, and at least this long, is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """One row of frames.csv. line: in the file, 1 being the heading; number: of the row, the frame's sequence."""

    line: int
    number: int
    file: str
    t_ns: int
    euler_rad: tuple[float, float, float] | None
    position_ned_m: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCoding:
    """How the PNGs hold depth: millimetres of one step, and the values that mean no measurement."""

    unit_mm: float = 1.0
    invalid: tuple[int, ...] = (0, 65535)


class FolderSource:
    """A recording in a folder (EventSource). What is wrong with single rows and images is told in `report`, and the rest
    is delivered. Raises BadData where nothing can be delivered. An attribute `frame_count` holds the rows that there are."""

    def __init__(self, folder: Path, options: ImportOptions, report: Report) -> None:
        self._folder, self._options, self._report = folder, options, report
        self._info, self._coding = read_intrinsics(folder / "intrinsics.json", options)
        self._rows, self.frame_count = read_rows(folder / "frames.csv", report)
        if not self._rows:
            raise BadData(f"{folder / 'frames.csv'}: no usable row; expected one for each depth image")
        self._report_unlisted()
        self._attitudes, self._poses = self._samples()
        self.shift_ns = self._shift()

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The one camera."""
        return (self._info,)

    def close(self) -> None:
        """Nothing is held open."""

    def events(self) -> Iterator[Event]:
        """Everything in order of arrival; images are read when their turn comes."""

        def arrival(item: AttitudeSample | PoseSample | FrameRow) -> int:
            return self._arrival_ns(item) if isinstance(item, FrameRow) else item.t_arrival_ns

        # of equal arrivals the samples come first: a frame may use them
        items: list[AttitudeSample | PoseSample | FrameRow] = [*self._attitudes, *self._poses, *self._rows]
        for item in sorted(items, key=arrival):
            if not isinstance(item, FrameRow):
                yield self._shifted(item)
                continue
            try:
                yield self._frame(item)
            except BadData as error:
                self._report.problem("image", f"frames.csv line {item.line}: {error}")

    def _arrival_ns(self, row: FrameRow) -> int:
        return row.t_ns + round(self._options.frame_latency_s * NS)

    def _frame(self, row: FrameRow) -> DepthFrame:
        k = self._info.intrinsics
        depth_mm = read_depth_png(
            self._folder / row.file, (k.width, k.height), self._coding.unit_mm, self._coding.invalid
        )
        return DepthFrame(
            camera=self._info.camera,
            sequence=row.number,
            t_exposure_ns=row.t_ns + self.shift_ns,
            t_arrival_ns=self._arrival_ns(row) + self.shift_ns,
            depth_mm=depth_mm,
        )

    def _shifted(self, s: AttitudeSample | PoseSample) -> AttitudeSample | PoseSample:
        t_ns, arrival_ns = s.t_ns + self.shift_ns, s.t_arrival_ns + self.shift_ns
        if isinstance(s, AttitudeSample):
            return AttitudeSample(t_ns, arrival_ns, s.q_ned_frd_wxyz, s.rates_frd_rad_s)
        return PoseSample(t_ns, arrival_ns, s.position_ned_m, s.velocity_ned_m_s, s.reset_counter)

    def _shift(self) -> int:
        """Whole seconds that bring the first stamp to 0 or later: a log cannot hold negative ones."""
        samples: list[AttitudeSample | PoseSample] = [*self._attitudes, *self._poses]
        first = min([r.t_ns for r in self._rows] + [s.t_ns for s in samples])
        shift_ns = -(first // NS) * NS if first < 0 else 0
        if shift_ns:
            self._report.note(f"the clock was moved by {shift_ns // NS} s, so that no stamp is negative")
        return shift_ns

    def _samples(self) -> tuple[list[AttitudeSample], list[PoseSample]]:
        log = self._tlog()
        exposures = [r.t_ns for r in self._rows]
        if log is not None:
            rows = [TiltRow(r.t_ns, r.euler_rad[0], r.euler_rad[1]) for r in self._rows if r.euler_rad is not None]
            attitudes, poses = tlog_samples(log, (min(exposures), max(exposures)), rows, self._options, self._report)
        else:
            attitudes = [
                AttitudeSample(r.t_ns, r.t_ns, quaternion_from_euler(*r.euler_rad))
                for r in self._rows
                if r.euler_rad is not None and not _looks_like_degrees(r)
            ]
            poses = [PoseSample(r.t_ns, r.t_ns, r.position_ned_m) for r in self._rows if r.position_ned_m is not None]
            self._report_unusable()
        missing = uncovered(exposures, [a.t_ns for a in attitudes], self._options.sync)
        if missing and log is not None:
            missing_ns = set(missing)
            lines = spans(r.line for r in self._rows if r.t_ns in missing_ns)
            self._report.problem(
                "attitude",
                f"{log.name}: no attitude near the frames of frames.csv line {lines}; they are kept without one",
            )
        return attitudes, poses

    def _report_unusable(self) -> None:
        """Attitudes and positions of frames.csv that are left out."""
        path = self._folder / "frames.csv"
        without_attitude = [r.line for r in self._rows if r.euler_rad is None]
        if without_attitude:
            self._report.problem(
                "attitude",
                f"{path}: {len(without_attitude)} rows without a usable attitude (line {spans(without_attitude)}): the frames are kept, their "
                "attitude is left out; fill in roll_rad, pitch_rad and yaw_rad, or put a .tlog beside it",
            )
        too_large = [r.line for r in self._rows if _looks_like_degrees(r)]
        if too_large:
            self._report.problem(
                "attitude",
                f"{path}: {len(too_large)} rows with angles of more than a full turn (line {spans(too_large)}): the frames are "
                "kept, their attitude is left out; roll_rad, pitch_rad and yaw_rad are radians, these look like degrees",
            )
        without_position = [r.line for r in self._rows if r.position_ned_m is None]
        if 0 < len(without_position) < len(self._rows):
            self._report.problem(
                "position",
                f"{path}: {len(without_position)} rows without a usable position (line {spans(without_position)}): the frames are kept, their "
                "position is left out; fill in x_m, y_m and z_m",
            )

    def _tlog(self) -> Path | None:
        if self._options.tlog is not None or not self._options.use_tlog:
            return self._options.tlog
        found = sorted(self._folder.glob("*.tlog"))
        if len(found) > 1:
            names = ", ".join(f.name for f in found)
            raise BadData(
                f"{self._folder}: several logs ({names}); choose with --tlog FILE or leave out with --no-tlog"
            )
        return found[0] if found else None

    def _report_unlisted(self) -> None:
        """Images that no row names have no time and cannot be used."""
        listed = {(self._folder / r.file).resolve() for r in self._rows}
        for parent in sorted({p.parent for p in listed}):
            unlisted = [p.name for p in sorted(parent.glob("*.png")) if p not in listed]
            if unlisted:
                shown = ", ".join(unlisted[:3]) + (", ..." if len(unlisted) > 3 else "")
                self._report.problem(
                    "gap",
                    f"{self._folder / 'frames.csv'}: {len(unlisted)} images in {parent.name}/ have no row ({shown}): without "
                    "a time they are left out; add their rows, or move the images away",
                )


def read_intrinsics(path: Path, options: ImportOptions) -> tuple[CameraInfo, DepthCoding]:
    """The camera and how its images hold depth. Raises BadData."""
    content = _json_object(path)
    numbers: dict[str, float] = {}
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        value = content.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadData(f"{path}: {key} is {'missing' if value is None else repr(value)}; expected a number (pixels)")
        numbers[key] = value
    unit_mm = content.get("depth_unit_mm", 1.0)
    if isinstance(unit_mm, bool) or not isinstance(unit_mm, int | float) or not 1e-3 <= unit_mm <= 1000.0:
        raise BadData(f"{path}: depth_unit_mm = {unit_mm!r}; expected the millimetres of one step, 0.001..1000")
    invalid = content.get("invalid", [0, 65535])
    if not isinstance(invalid, list) or not all(type(v) is int and 0 <= v <= 65535 for v in invalid):
        raise BadData(f"{path}: invalid = {invalid!r}; expected a list of pixel values 0..65535")
    for key in ("width", "height"):
        if not 16 <= numbers[key] <= 4096 or numbers[key] % 1:  # also NaN
            raise BadData(f"{path}: {key} is {numbers[key]}; expected a whole number of pixels, 16..4096")
    try:
        size = int(numbers["width"]), int(numbers["height"])
        intrinsics = Intrinsics(*size, *(float(numbers[key]) for key in ("fx", "fy", "cx", "cy")))
        info = options.camera.applied_to(CameraInfo(options.camera.name, intrinsics))
    except OverflowError as error:
        raise BadData(f"{path}: a number of pixels is far too large; expected fx, fy, cx, cy in pixels") from error
    except ValueError as error:
        raise BadData(f"{path}, or what overrides it on the command line: {error}") from error
    return info, DepthCoding(unit_mm=float(unit_mm), invalid=tuple(invalid))


def _json_object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadData(f"{path}: cannot be read ({error.strerror}); it holds width, height, fx, fy, cx, cy") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadData(f"{path}: not valid JSON ({error})") from error
    except RecursionError as error:
        raise BadData(f"{path}: nested deeper than can be read; it holds width, height, fx, fy, cx, cy") from error
    if not isinstance(content, dict):
        raise BadData(f'{path}: expected an object such as {{"width": 640, "height": 480, "fx": 383.5, ...}}')
    return content


def read_rows(path: Path, report: Report) -> tuple[list[FrameRow], int]:
    """(the usable rows of frames.csv in order of time, how many rows there are); what is wrong with the others is told.
    Raises BadData for a file without the columns that give each frame its image and its time."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            columns = list(reader.fieldnames or [])
            content = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise BadData(f"{path}: cannot be read ({error.strerror}); it lists each image with its time") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadData(f"{path}: not a CSV text ({error})") from error
    missing = [c for c in ("file", "t_ns") if c not in columns]
    if missing:
        raise BadData(
            f"{path} line 1: column {', '.join(missing)} is missing (found: {', '.join(columns) or 'nothing'}); "
            f"expected file, t_ns, {', '.join(ATTITUDE)} and, where known, {', '.join(POSITION)}"
        )
    duplicated = [c for c in ("file", "t_ns", *ATTITUDE, *POSITION) if columns.count(c) > 1]
    if duplicated:
        raise BadData(f"{path} line 1: column {', '.join(duplicated)} stands there more than once; keep the right one")
    missing_angles = [c for c in ATTITUDE if c not in columns]
    if missing_angles:
        report.problem(
            "column", f"{path} line 1: column {', '.join(missing_angles)} is missing, hence no frame has an attitude"
        )
    usable = [row for n, (line, cells) in enumerate(content) if (row := _row(path, line, n, cells, report)) is not None]
    rows = _in_order(path, usable, report)
    _report_gaps(path, rows, report)
    return rows, len(content)


def _in_order(path: Path, rows: list[FrameRow], report: Report) -> list[FrameRow]:
    """Most rows whose times increase: a single wrong stamp costs its own row, not all that follow it. The longest
    increasing subsequence, by patience sorting."""
    tails: list[int] = []
    ends: list[int] = []
    before: list[int | None] = []
    for i, row in enumerate(rows):
        place = bisect_left(tails, row.t_ns)
        before.append(ends[place - 1] if place else None)
        tails[place : place + 1], ends[place : place + 1] = [row.t_ns], [i]
    kept: set[int] = set()
    at = ends[-1] if ends else None
    while at is not None:
        kept.add(at)
        at = before[at]
    for i, row in enumerate(rows):
        if i not in kept:
            report.problem(
                "order",
                f"{path} line {row.line}: t_ns {row.t_ns} does not come after the rows before and ahead of those after it; "
                "row left out; correct the stamp, or sort the rows by t_ns",
            )
    return [row for i, row in enumerate(rows) if i in kept]


def _row(path: Path, line: int, number: int, cells: dict[str | None, Any], report: Report) -> FrameRow | None:
    file, stamp = cells.get("file"), cells.get("t_ns")
    if not file or not stamp:
        what = "file" if not file else "t_ns"
        report.problem("row", f"{path} line {line}: {what} is empty; row left out")
        return None
    try:
        t_ns = int(stamp)
    except ValueError:
        report.problem("row", f"{path} line {line}: t_ns {stamp!r} is no whole number of nanoseconds; row left out")
        return None
    if not -(1 << 62) < t_ns < 1 << 62:
        report.problem("row", f"{path} line {line}: t_ns {stamp} is out of range; row left out")
        return None
    if "\0" in file:
        report.problem("row", f"{path} line {line}: file {file!r} is no file name; row left out")
        return None
    return FrameRow(
        line=line,
        number=number,
        file=file,
        t_ns=t_ns,
        euler_rad=_three(cells, ATTITUDE),
        position_ned_m=_three(cells, POSITION),
    )


def _looks_like_degrees(row: FrameRow) -> bool:
    """Whether its angles cannot be radians."""
    return row.euler_rad is not None and max(map(abs, row.euler_rad)) > MAX_ANGLE_RAD


def _three(cells: dict[str | None, Any], names: tuple[str, str, str]) -> tuple[float, float, float] | None:
    """Three finite numbers, or None."""
    try:
        a, b, c = (float(cells.get(name) or "nan") for name in names)
    except ValueError:
        return None
    return (a, b, c) if math.isfinite(a + b + c) else None


def _report_gaps(path: Path, rows: list[FrameRow], report: Report) -> None:
    if len(rows) < 3:
        return
    intervals = [(b.t_ns - a.t_ns) / NS for a, b in pairwise(rows)]
    usual = median(intervals)
    for (a, b), interval in zip(pairwise(rows), intervals, strict=True):
        if interval > max(GAP_FACTOR * usual, GAP_MIN_S):
            report.problem(
                "gap",
                f"{path} lines {a.line}-{b.line}: a gap of {interval:.2f} s (usual: {usual:.3f} s); rows are missing or the "
                "camera stood still, and nothing is known of that time",
            )
