"""What a run of `companion batch` did, as counts, as text and as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from ..console import counted, fail, print_line, warn
from .engines import Done
from .flights import Flight
from .jobs import Failure

_LISTED: Final = 10


@dataclass(slots=True)
class BatchReport:
    """What a run did."""

    flights: int = 0
    skipped: int = 0  # flights whose results were present
    frames: int = 0
    damaged: dict[str, str] = field(default_factory=dict)
    unread_files: dict[str, int] = field(default_factory=dict)  # flight -> its files of which nothing can be read
    unreadable: int = 0  # flights without any other file
    unread_inputs: int = 0  # files and folders that were left out
    failed: dict[str, str] = field(default_factory=dict)
    without_frames: list[str] = field(default_factory=list)  # flights whose logs are readable and have no depth images
    different: list[str] = field(default_factory=list)
    restarted: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    peak_mb: float = 0.0

    def add(self, done: Done) -> None:
        """Counts a task that has ended."""
        name, result = str(done.task.flight), done.result
        self.restarted += done.attempts - 1
        if isinstance(result, Failure):
            self.failed[name] = result.text
            return
        self.frames += result.frames
        self.cpu_s += result.cpu_s
        self.peak_mb = max(self.peak_mb, result.peak_mb)
        if result.damage:
            self.damaged[name] = result.damage
        elif result.frames == 0:
            self.without_frames.append(name)
        if result.equals_onboard is False:
            self.different.append(name)
        self._add_unread(done.task.flight, result.unread_files)

    def add_present(self, flight: Flight, unread_files: int) -> None:
        """Counts a flight whose results were present."""
        if not self._add_unread(flight, unread_files):
            self.skipped += 1

    def _add_unread(self, flight: Flight, number: int) -> bool:
        """Counts the files that cannot be read; returns whether these are all files of the flight."""
        if number:
            self.unread_files[str(flight)] = number
        self.unreadable += number == len(flight.files)
        return number == len(flight.files)

    @property
    def processed(self) -> int:
        """Flights that this run has processed."""
        return self.flights - self.skipped - self.unreadable - len(self.failed)

    def as_json(self, output: str) -> dict[str, Any]:
        """The object of `--json`."""
        return {
            "output": output,
            "flights": self.flights,
            "already_present": self.skipped,
            "processed": self.processed,
            "unreadable": self.unreadable,
            "frames": self.frames,
            "damaged": self.damaged,
            "unread_files": self.unread_files,
            "unread_inputs": self.unread_inputs,
            "failed": self.failed,
            "without_frames": self.without_frames,
            "different_from_onboard": self.different,
            "restarted": self.restarted,
            "cpu_s": round(self.cpu_s, 3),
            "wall_s": round(self.wall_s, 3),
            "peak_mb": round(self.peak_mb, 1),
        }


def print_report(report: BatchReport, output: str) -> None:
    """Prints the results. What is missing follows with `print_failures`."""
    print_line(
        f"{counted(report.flights, 'flight')}: {report.processed} processed, {report.skipped} already present, "
        f"{len(report.failed)} failed{f', {report.unreadable} unreadable' if report.unreadable else ''}"
    )
    print_line(f"{counted(report.frames, 'frame')}; {report.cpu_s:.1f} s of processor time in {report.wall_s:.1f} s")
    if report.different:
        print_line(f"results that differ from those on board: {counted(len(report.different), 'flight')}")
    for name, text in list(report.damaged.items())[:_LISTED]:
        warn(f"{name}: {text}")
    if len(report.damaged) > _LISTED:
        warn(
            f"and {counted(len(report.damaged) - _LISTED, 'more damaged flight')} (column `damage` of the table flights)"
        )
    if names := report.without_frames:
        warn(
            f"logs without depth images, so that nothing was computed: {', '.join(names[:_LISTED])}"
            f"{', ...' if len(names) > _LISTED else ''}; record with [record] depth = true"
        )
    print_line(f"written: {output}")


def print_failures(report: BatchReport) -> None:
    """Prints what the results lack, at the end: a warning among many is overlooked."""
    for name, text in list(report.failed.items())[:_LISTED]:
        fail(f"{name}: {text}")
    if len(report.failed) > _LISTED:
        fail(f"and {counted(len(report.failed) - _LISTED, 'more flight')} (--json lists all)")
    if inputs := report.unread_inputs:
        fail(
            f"{counted(inputs, 'input')} {'was' if inputs == 1 else 'were'} not processed: "
            f"{'it' if inputs == 1 else 'they'} cannot be read (named above)"
        )
    if files := sum(report.unread_files.values()):
        names = list(report.unread_files)
        fail(
            f"{counted(files, 'log file')} {'was' if files == 1 else 'were'} not processed: nothing of "
            f"{'it' if files == 1 else 'them'} can be read. Flights: {', '.join(names[:_LISTED])}"
            f"{', ...' if len(names) > _LISTED else ''}; the column `damage` of the table flights says why"
        )
