"""The folder of flight logs: names and the budget of the disk.

A flight's files are named FLIGHT.000.mcap, FLIGHT.001.mcap, ...; FLIGHT begins with the wall clock's date as a label.
A file being written ends in .active. Of finished flights the oldest files go first when the budget is spent; those of
the running flight are never touched."""

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
    """One file of a flight in the folder."""

    path: Path
    flight: str
    part: int
    active: bool
    bytes: int
    modified_ns: int


def new_flight(folder: Path) -> str:
    """A name that no flight in the folder has: the wall clock's date and time, a label and no more."""
    label = time.strftime("%Y%m%d-%H%M%S", time.gmtime(time.time_ns() / 1e9))
    taken = {f.flight for f in files_of(folder)}
    return next(name for name in (label, *(f"{label}-{k}" for k in range(2, 10_000))) if name not in taken)


def part_path(folder: Path, flight: str, part: int) -> Path:
    """The name of a flight's file when it is finished."""
    return folder / f"{flight}.{part:03d}.mcap"


def files_of(folder: Path) -> list[LogFile]:
    """The logs in a folder, oldest first. What has another name is not ours and never touched."""
    found = []
    for entry in os.scandir(folder):
        match = _PART.match(entry.name)
        if match is None or not entry.is_file(follow_symlinks=False):
            continue
        try:
            stat = entry.stat()
        except FileNotFoundError:
            continue  # renamed meanwhile
        active = match["active"] is not None
        path = Path(entry.path)
        found.append(LogFile(path, match["flight"], int(match["part"]), active, stat.st_size, stat.st_mtime_ns))
    return sorted(found, key=lambda f: (f.modified_ns, f.flight, f.part))


def used_bytes(folder: Path) -> int:
    """What all logs take together, with the copies that a repair is writing."""
    return sum(f.bytes for f in files_of(folder)) + sum(_size(path) for path in recovering_files(folder))


def recovering_files(folder: Path) -> list[Path]:
    """Copies that a repair is writing, or that one left which was killed."""
    return [path for path in folder.glob(f"*{ACTIVE}{RECOVERING}") if path.is_file()]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0  # renamed meanwhile


def make_room(folder: Path, budget_bytes: int, running: str) -> list[Path]:
    """Deletes the oldest files of finished flights until all logs together fit the budget; returns what went."""
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
    """Free space of the folder's disk, for us."""
    stat = os.statvfs(folder)
    return stat.f_bavail * stat.f_frsize
