"""The merged world in a file: replaced atomically, and readable up to the first damage."""

from __future__ import annotations

import os
from pathlib import Path

from core.world.serialize import SavedSection, bytes_of, sections_of


def write_world(path: Path, sections: tuple[SavedSection, ...]) -> None:
    """Replaces the file atomically: after a power failure it is either the old or the new one. Raises OSError."""
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(bytes_of(sections))
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def read_world(path: Path) -> tuple[tuple[SavedSection, ...], str]:
    """(sections, fault): the readable sections of a file, and the damage as text, "" if complete.

    Raises ValueError for a file that is not a world, OSError where it cannot be read."""
    try:
        sections, fault = sections_of(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected a file of write_world") from error
    return sections, f"{path}: {fault}; the part before the damage was read" if fault else ""
