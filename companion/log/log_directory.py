"""The directory of flight logs: file names and disk budget.

The files of a flight are FLIGHT.000.mcap, FLIGHT.001.mcap, ...; FLIGHT is the wall clock's date and time, and from 2 on the
number of times that this clock was behind an earlier flight and one: flights are in the order of this number, then of the
date. A file that begins while the autopilot reports a disarmed vehicle is FLIGHT.000.idle.mcap; it ends when
the vehicle is armed. A file being written ends in .active, an original that a repair could not copy completely in .damaged.
When the budget is used, idle files are deleted first, then the oldest files of finished flights; other files of a flight that
is being recorded are kept, also those of another process."""

from __future__ import annotations

import contextlib
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path

from drivers.logs.written import is_being_written, seems_written

from .log_file import ACTIVE, RECOVERED, RECOVERING

_FLIGHT = re.compile(r"(?P<label>[0-9]{8}-[0-9]{6})(?:-(?P<number>[0-9]{1,9}))?")
_PART = re.compile(r"^(?P<flight>.+)\.(?P<part>\d{3,})(?P<idle>\.idle)?\.mcap(?P<suffix>\.active|\.damaged)?$")


@dataclass(frozen=True, slots=True)
class LogFile:
    """One file of a flight."""

    path: Path
    flight: str
    part: int
    idle: bool  # recorded before the vehicle was armed
    active: bool
    bytes: int

    @property
    def order(self) -> tuple[int, str, int]:
        """Sorts files in the order of recording, by their names: copies and repairs change the times of files."""
        return *_number_and_label(self.flight), self.part


def _number_and_label(flight: str) -> tuple[int, str]:
    match = _FLIGHT.fullmatch(flight)
    assert match is not None
    return int(match["number"] or 1), match["label"]


def new_flight(folder: Path) -> str:
    """A name for a flight that sorts after all others: the date and time of the wall clock, as a label only, with the number
    of the newest flight. A clock that is behind that flight, as one without a battery after a start, or one that was in the
    future then, begins the next number."""
    label = time.strftime("%Y%m%d-%H%M%S", time.gmtime(time.time_ns() / 1e9))
    number, newest = max((_number_and_label(f.flight) for f in files_of(folder)), default=(1, ""))
    number += label <= newest
    return label if number == 1 else f"{label}-{number}"


def part_path(folder: Path, flight: str, part: int, idle: bool = False) -> Path:
    """The name of a finished file."""
    return folder / f"{flight}.{part:03d}{'.idle' if idle else ''}.mcap"


def flight_and_part(name: str) -> tuple[str, int]:
    """The flight and the number of a file name, also of a recovered log. A log with another name, such as `flight.mcap`, is part 0
    of a flight with its name."""
    name = recovered_from(name) or name
    match = _PART.match(name)
    if match is not None:
        return match["flight"], int(match["part"])
    return name.removesuffix(ACTIVE).removesuffix(".mcap"), 0


def recovered_from(name: str) -> str | None:
    """The name of the log from which `companion recover` has made this one by default; None: another name."""
    return f"{name.removesuffix(RECOVERED)}.mcap" if name.endswith(RECOVERED) else None


def files_of(folder: Path) -> list[LogFile]:
    """The recorded logs in a directory, oldest first. Files with other names were not recorded and are never deleted."""
    found = []
    for entry in os.scandir(folder):
        match = _PART.fullmatch(entry.name)
        if match is None or _FLIGHT.fullmatch(match["flight"]) is None:
            continue
        try:
            if not entry.is_file(follow_symlinks=False):
                continue
            size = entry.stat().st_size
        except OSError:
            continue  # the file was renamed meanwhile, or its entry is damaged
        idle, active = match["idle"] is not None, match["suffix"] == ACTIVE
        found.append(LogFile(Path(entry.path), match["flight"], int(match["part"]), idle, active, size))
    return sorted(found, key=lambda f: f.order)


def used_bytes(folder: Path) -> int:
    """Size of all logs, including copies that a repair is writing."""
    return sum(f.bytes for f in files_of(folder)) + sum(_size(path) for path in recovering_files(folder))


def recovering_files(folder: Path) -> list[Path]:
    """Copies that a repair is writing or has left unfinished."""
    return [path for path in folder.glob(f"*{ACTIVE}{RECOVERING}") if path.is_file()]


def delete_unfinished_copies(folder: Path) -> None:
    """Deletes copies that no process is writing; one that cannot be deleted stays."""
    for path in recovering_files(folder):
        with contextlib.suppress(OSError):
            if not is_being_written(path):
                path.unlink()


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0  # the file was renamed meanwhile, or its entry is damaged


def make_room(folder: Path, budget_bytes: int, running: str) -> list[Path]:
    """Deletes idle files, the oldest first, and then the oldest files of finished flights, until all logs fit the budget;
    returns the deleted files. A file that cannot be deleted is passed over."""
    files = files_of(folder)
    excess = used_bytes(folder) - budget_bytes
    gone: list[Path] = []
    if excess <= 0:
        return gone
    kept = {running, *(f.flight for f in files if f.active and seems_written(f.path))}
    for f in sorted(files, key=lambda f: not f.idle):
        if excess <= 0:
            break
        if f.flight in kept and (f.active or not f.idle):
            continue
        try:
            f.path.unlink(missing_ok=True)
        except OSError:
            continue
        excess -= f.bytes
        gone.append(f.path)
    return gone


def free_bytes(folder: Path) -> int:
    """Free disk space for this user, bytes."""
    stat = os.statvfs(folder)
    return stat.f_bavail * stat.f_frsize
