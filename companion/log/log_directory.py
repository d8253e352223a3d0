"""The directory of flight logs: file names and disk budget.

The files of a flight are FLIGHT.000.mcap, FLIGHT.001.mcap, ...; FLIGHT begins with the wall clock's date as a label. A
file being written ends in .active. When the budget is used, the oldest files of finished flights are deleted; files of
the running flight are kept."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from pathlib import Path

from .log_writer import ACTIVE, RECOVERING

_PART = re.compile(r"^(?P<flight>.+)\.(?P<part>\d{3,})\.mcap(?P<active>\.active)?$")


@dataclass(frozen=True, slots=True)
class LogFile:
    """One file of a flight."""

    path: Path
    flight: str
    part: int
    active: bool
    bytes: int
    modified_ns: int


def new_flight(folder: Path) -> str:
    """An unused name for a flight: the date and time of the wall clock, as a label only."""
    label = time.strftime("%Y%m%d-%H%M%S", time.gmtime(time.time_ns() / 1e9))
    taken = {f.flight for f in files_of(folder)}
    return next(name for name in (label, *(f"{label}-{k}" for k in range(2, 10_000))) if name not in taken)


def part_path(folder: Path, flight: str, part: int) -> Path:
    """The name of a finished file."""
    return folder / f"{flight}.{part:03d}.mcap"


def flight_and_part(name: str) -> tuple[str, int]:
    """The flight and the number of a file name. A log with another name, such as `flight.mcap`, is part 0 of a flight with
    its name."""
    match = _PART.match(name)
    if match is not None:
        return match["flight"], int(match["part"])
    return name.removesuffix(ACTIVE).removesuffix(".mcap"), 0


def files_of(folder: Path) -> list[LogFile]:
    """The logs in a directory, oldest first. Files with other names are not logs and are never deleted."""
    found = []
    for entry in os.scandir(folder):
        match = _PART.match(entry.name)
        if match is None or not entry.is_file(follow_symlinks=False):
            continue
        try:
            stat = entry.stat()
        except FileNotFoundError:
            continue  # the file was renamed meanwhile
        active = match["active"] is not None
        path = Path(entry.path)
        found.append(LogFile(path, match["flight"], int(match["part"]), active, stat.st_size, stat.st_mtime_ns))
    return sorted(found, key=lambda f: (f.modified_ns, f.flight, f.part))


def used_bytes(folder: Path) -> int:
    """Size of all logs, including copies that a repair is writing."""
    return sum(f.bytes for f in files_of(folder)) + sum(_size(path) for path in recovering_files(folder))


def recovering_files(folder: Path) -> list[Path]:
    """Copies that a repair is writing or has left unfinished."""
    return [path for path in folder.glob(f"*{ACTIVE}{RECOVERING}") if path.is_file()]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0  # the file was renamed meanwhile


def make_room(folder: Path, budget_bytes: int, running: str) -> list[Path]:
    """Deletes the oldest files of finished flights until all logs fit the budget; returns the deleted files."""
    files = files_of(folder)
    excess = used_bytes(folder) - budget_bytes
    gone = []
    for f in files:
        if excess <= 0:
            break
        if f.flight == running:
            continue
        f.path.unlink(missing_ok=True)
        excess -= f.bytes
        gone.append(f.path)
    return gone


def free_bytes(folder: Path) -> int:
    """Free disk space for this user, bytes."""
    stat = os.statvfs(folder)
    return stat.f_bavail * stat.f_frsize
