"""A world on disk: written whole or not at all, read as far as it is whole."""

from __future__ import annotations

import os
from pathlib import Path

from core.world.serialize import SavedSection, bytes_of, sections_of


def write_world(path: Path, sections: tuple[SavedSection, ...]) -> None:
    """Replaces the file by a whole new one; a loss of power leaves the old one or the new one. Raises OSError."""
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(bytes_of(sections))
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def read_world(path: Path) -> tuple[tuple[SavedSection, ...], str]:
    """(sections, trouble): what is whole of a file, and in words where it is not; empty: all of it is.

    Raises ValueError for a file that is no world, OSError where it cannot be read."""
    try:
        sections, trouble = sections_of(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; was it written by write_world?") from error
    return sections, f"{path}: {trouble}; what came before was read" if trouble else ""
