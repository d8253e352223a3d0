"""Finds flights: the rotated files of a flight belong together."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from ..console import warn
from ..log.log_directory import flight_and_part, recovered_from
from ..log.log_file import ACTIVE
from .storage import StoredFile, find_logs, is_result

UNKNOWN: Final = "unknown"
"""Vehicle or date that is not in the names."""
_DATE = re.compile(r"^(\d{4})(\d{2})(\d{2})-\d{6}")
_UNSAFE = re.compile(r"[^\w.-]")
"""Letters of all alphabets are kept: names of two flights would become equal without them."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight and its log files in the order of recording."""

    vehicle: str
    date: str  # YYYY-MM-DD of the label in the file names
    name: str
    files: tuple[StoredFile, ...]

    @property
    def partition(self) -> str:
        """The folders of the hive partition."""
        return f"vehicle={self.vehicle}/date={self.date}"

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(file.size for file in self.files)

    @property
    def missing_parts(self) -> tuple[int, ...]:
        """Numbers between the first and the last file of which there is no file."""
        there = {flight_and_part(file.name)[1] for file in self.files}
        return tuple(sorted(set(range(min(there), max(there))) - there))

    def __str__(self) -> str:
        return f"{self.vehicle}/{self.name}"


def find_flights(
    inputs: Sequence[str],
    vehicle: str | None = None,
    output: str = "",
    on_unread: Callable[[str], None] = warn,
) -> list[Flight]:
    """The flights in files, folders and patterns.

    Args:
        inputs: local paths, patterns or URLs.
        vehicle: vehicle of all flights; None: the name of each file's folder.
        output: dataset that may lie in an input: its replayed logs are no flights.
        on_unread: takes the text on a file, or a folder of logs, that cannot be read and is left out.

    Raises DeviceNotFound for an input without logs, and ValueError for two flights with the same vehicle and name."""
    found = (file for text in inputs for file in find_logs(text, on_unread))
    files = {file for file in found if not (output and is_result(file.location, output))}
    groups: dict[tuple[str, str], list[StoredFile]] = {}
    for file in files:
        groups.setdefault((file.folder, flight_and_part(file.name)[0]), []).append(file)
    flights: dict[tuple[str, str], tuple[str, Flight]] = {}
    for (folder, name), parts in sorted(groups.items()):
        owner = safe_name(vehicle or folder.rpartition("/")[2])
        flight = Flight(owner, date_of(name), safe_name(name), tuple(_ordered(parts)))
        other = flights.get((owner, flight.name))
        if other is not None:
            remedy = (
                "Process the folders into separate outputs, or give one --vehicle each"
                if other[0] != folder
                else f"Rename {parts[0].name} or {other[1].files[0].name}"
            )
            raise ValueError(
                f"the flight {flight.name} of the vehicle {owner} is in {other[0]} and in {folder}: results would be mixed. {remedy}"
            )
        flights[owner, flight.name] = folder, flight
    return [flight for _, flight in flights.values()]


def _ordered(files: Iterable[StoredFile]) -> list[StoredFile]:
    """By part number. An unfinished file is left out where its finished copy is present, a damaged one where a recovered copy is."""
    by_name = {file.name: file for file in files}
    recovered = {recovered_from(name) for name in by_name}
    kept = [
        f
        for n, f in by_name.items()
        if not (n.endswith(ACTIVE) and n.removesuffix(ACTIVE) in by_name) and n not in recovered
    ]
    return sorted(kept, key=lambda f: (flight_and_part(f.name)[1], f.name))


def date_of(flight: str) -> str:
    """YYYY-MM-DD of a flight named by its date and time, otherwise "unknown"."""
    match = _DATE.match(flight)
    return "-".join(match.groups()) if match else UNKNOWN


def safe_name(text: str) -> str:
    """A name for folders and files: letters of any alphabet, digits, dot, dash and underscore."""
    name = _UNSAFE.sub("_", text).lstrip(".")
    return name or UNKNOWN
