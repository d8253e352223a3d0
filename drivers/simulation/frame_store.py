"""Rendered frames kept in a file, so that a simulated camera renders each only once, also over restarts.

A file holds a mark for each frame (the checksum of its pixels), then the pixels. The marks are checked when the file is
opened: what a power cut left half written is rendered again. Several processes may fill one file; they write the same."""

from __future__ import annotations

import mmap
import os
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 1_000_000_000
"""All frames of a flight, and all files in the folder together: the oldest go first."""
SUFFIX = ".frames"
_PAGE = 4096
_RENDERED, _MISSING = 1 << 32, 1 << 33
"""Above the 32 bits of a checksum: there is a frame; there is none since the flight has none."""

DepthMm = NDArray[np.uint16]


class FrameStore:
    """count frames of (height, width) uint16. folder None, or one that cannot be written: in memory only.

    Raises ValueError where they would take more than MOST_BYTES."""

    def __init__(self, folder: Path | None, name: str, count: int, height: int, width: int) -> None:
        at = -(-8 * count // _PAGE) * _PAGE
        size = at + 2 * count * height * width
        if size > MOST_BYTES:
            raise ValueError(
                f"{count} frames of {width}x{height} pixels take {size / 1e6:.0f} MB, more than {MOST_BYTES / 1e6:.0f}; "
                "choose a smaller width_px or fps"
            )
        memory = _in_file(folder, name, size) if folder is not None else None
        self.kept = memory is not None
        """Whether the frames outlive the process."""
        self._memory = memory if memory is not None else mmap.mmap(-1, size)
        self._marks = np.ndarray((count,), np.uint64, self._memory, 0)
        self._pixels = np.ndarray((count, height, width), np.uint16, self._memory, at)
        for i in np.flatnonzero(self._marks).tolist():
            if int(self._marks[i]) not in (_MISSING, _mark(self._pixels[i])):
                self._marks[i] = 0

    def holds(self, i: int) -> bool:
        """Whether frame i was put."""
        return bool(self._marks[i])

    def get(self, i: int) -> DepthMm | None:
        """Frame i, read-only; None: it was put as None. Raises KeyError for one that was never put."""
        if not self._marks[i]:
            raise KeyError(i)
        if int(self._marks[i]) == _MISSING:
            return None
        frame: DepthMm = self._pixels[i].view()
        frame.flags.writeable = False
        return frame

    def put(self, i: int, depth_mm: DepthMm | None) -> None:
        """Keeps frame i; None: there is none."""
        if depth_mm is None:
            self._marks[i] = _MISSING
            return
        self._pixels[i] = depth_mm
        self._marks[i] = _mark(self._pixels[i])


def _mark(depth_mm: DepthMm) -> int:
    return _RENDERED | zlib.crc32(depth_mm.data)


def _in_file(folder: Path, name: str, size: int) -> mmap.mmap | None:
    """The file's memory; None where it cannot be had."""
    path = folder / (name + SUFFIX)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _make_room(folder, path, size)
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        # all of it now: a disk that fills up later would end the process at the first touch of a page
        os.posix_fallocate(fd, 0, size)
        os.utime(path)
        return mmap.mmap(fd, size)
    except OSError:
        path.unlink(missing_ok=True)
        return None
    finally:
        os.close(fd)


def _make_room(folder: Path, path: Path, size: int) -> None:
    """Deletes the files that were used longest ago until `size` fits; a process that still maps one keeps it."""
    others = [(f.stat(), f) for f in folder.glob("*" + SUFFIX) if f != path]
    others.sort(key=lambda entry: entry[0].st_mtime_ns)
    excess = sum(stat.st_size for stat, _ in others) + size - MOST_BYTES
    for stat, file in others:
        if excess <= 0:
            break
        file.unlink(missing_ok=True)
        excess -= stat.st_size
