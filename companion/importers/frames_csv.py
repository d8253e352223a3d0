"""Reads frames.csv: one row per depth image, with its time, attitude and position."""

from __future__ import annotations

import csv
import math
import reprlib
from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from drivers.base import BadData
from drivers.regular_file import regular

from ..pipeline.sync import NS
from .report import Report

FRAMES = "frames.csv"
ATTITUDE = ("roll_rad", "pitch_rad", "yaw_rad")
POSITION = ("x_m", "y_m", "z_m")
MAX_ANGLE_RAD = 2.0 * math.pi
"""Largest plausible angle of an attitude in radians."""
GAP_FACTOR, GAP_MIN_S = 5.0, 0.5
"""A pause of this multiple of the median interval, and of at least this length, is a warning."""
_short = reprlib.Repr()
"""Quotes content of the file, which may be binary, in few characters."""
_short.maxlist, _short.maxstring = 12, 60


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """One row of frames.csv."""

    line: int  # line number in the file, 1 is the heading
    number: int  # of the row, the frame's sequence
    file: str
    t_ns: int
    euler_rad: tuple[float, float, float] | None
    position_ned_m: tuple[float, float, float] | None
    file_right: str = ""


def read_rows(path: Path, report: Report, angles_needed: bool = True) -> tuple[list[FrameRow], int]:
    """(usable rows in order of time, number of rows). Problems with other rows are reported. Raises BadData for a file
    without the columns of image and time. angles_needed: no flight log gives the attitude."""
    try:
        with regular(path).open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            columns = list(reader.fieldnames or [])
            content = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise BadData(f"{path}: cannot be read ({error.strerror}); it lists each image with its time") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadData(f"{path}: not a CSV text ({error}); save it as CSV with commas, in UTF-8") from error
    missing = [c for c in ("file", "t_ns") if c not in columns]
    if missing:
        separator = ", separated by commas" if len(columns) == 1 else ""
        raise BadData(
            f"{path} line 1: column {', '.join(missing)} is missing (found: {_short.repr(columns)}); "
            f"expected file, t_ns, {', '.join(ATTITUDE)} and, where known, {', '.join(POSITION)}{separator}"
        )
    duplicated = [c for c in ("file", "t_ns", *ATTITUDE, *POSITION) if columns.count(c) > 1]
    if duplicated:
        raise BadData(f"{path} line 1: column {', '.join(duplicated)} is duplicated; remove one")
    missing_angles = [c for c in ATTITUDE if c not in columns]
    if missing_angles and angles_needed:
        report.problem(
            "column",
            f"{path} line 1: column {', '.join(missing_angles)} is missing: no frame has an attitude; add them, or put the "
            "autopilot's log (.tlog, .ulg, .bin) into the folder",
        )
    usable = [row for n, (line, cells) in enumerate(content) if (row := _row(path, line, n, cells, report)) is not None]
    rows = in_order(path, usable, report)
    _report_gaps(path, rows, report)
    return rows, len(content)


def in_order(path: Path, rows: list[FrameRow], report: Report) -> list[FrameRow]:
    """The largest set of rows with increasing times: a single wrong stamp removes its own row only. Longest increasing
    subsequence by patience sorting."""
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
                f"{path} line {row.line}: its time {row.t_ns} ns is out of order; row left out; correct the stamp, or "
                "sort the rows by time",
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
        report.problem(
            "row", f"{path} line {line}: t_ns {_short.repr(stamp)} is not a whole number of nanoseconds; row left out"
        )
        return None
    if not -(1 << 62) < t_ns < 1 << 62:
        report.problem("row", f"{path} line {line}: t_ns {stamp} is out of range; row left out; correct the stamp")
        return None
    file_right = cells.get("file_right") or ""
    for name in (file, file_right):
        if "\0" in name:
            report.problem("row", f"{path} line {line}: file {_short.repr(name)} is not a file name; row left out")
            return None
    return FrameRow(
        line=line,
        number=number,
        file=file,
        t_ns=t_ns,
        euler_rad=_three(cells, ATTITUDE),
        position_ned_m=_three(cells, POSITION),
        file_right=file_right,
    )


def looks_like_degrees(row: FrameRow) -> bool:
    """Whether the angles are too large for radians."""
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
            report.warning(
                "gap",
                f"{path} lines {a.line}-{b.line}: a pause of {interval:.2f} s (median: {usual:.3f} s); the recording was "
                "paused, or rows are missing",
            )
