"""SHA-256 of every compiled kernel in a cache directory, checked before a service loads them.

numba checks that a kernel's source has not changed, but not that the cached file is complete: a damaged file can end
the process or give wrong results. The manifest is written when all kernels are compiled and on the disk. Kernels
written later are not checked until the manifest is written again."""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

MANIFEST: Final = "manifest.json"
CACHED: Final = ("*.nbi", "*.nbc")
"""Patterns of numba's index and code files: no other files are deleted."""
ENDING: Final = re.compile(r"(\.\d+)?\.nb[ic]$")
_TICK_S: Final = 0.02
"""More than the step of a file system's stamps (Linux: 1 to 10 ms)."""
Entry = tuple[int, int, str]
"""Size in bytes, modification time in ns, SHA-256."""


class UnreadableManifest(Exception):
    """The manifest exists but is damaged."""


def write_manifest(folder: Path) -> None:
    """Adds the kernels that are not in the manifest, and removes those that no longer exist. Raises OSError."""
    try:
        before = _entries(folder)
    except UnreadableManifest:
        before = {}
    os.sync()  # a power failure must not leave a manifest of files whose content was not written
    began_ns = _time_ns(folder)
    _write(folder, {str(f.relative_to(folder)): _entry(folder, f, before) for f in kernels_in(folder)}, began_ns)


def copy_entries(source: Path, target: Path, names: Iterable[str]) -> None:
    """Copies the entries of files that were linked into another directory, except of those that numba has written since
    the manifest. names: relative paths. Raises OSError."""
    try:
        there, here = _entries(source), _entries(target)
    except UnreadableManifest:
        return
    if not there:
        return
    written_ns = (source / MANIFEST).stat().st_mtime_ns
    known = [name for name in names if name in there and (source / name).stat().st_mtime_ns < written_ns]
    taken = {name: there[name] for name in known}
    if taken:
        _write(target, {**here, **taken}, _time_ns(target))


def damaged_kernels(folder: Path) -> list[Path]:
    """Kernels that differ from the manifest; all kernels where the manifest cannot be read; none without a manifest."""
    path = folder / MANIFEST
    try:
        entries = _entries(folder)
        written_ns = path.stat().st_mtime_ns if entries else 0
    except (UnreadableManifest, OSError):
        return kernels_in(folder)
    return [folder / name for name, entry in entries.items() if _is_damaged(folder / name, entry, written_ns)]


def delete_kernels(files: Iterable[Path]) -> int:
    """Deletes all files of the functions that these files belong to; returns their number."""
    deleted = 0
    for stem in {(f.parent, ENDING.sub("", f.name)) for f in files}:
        for file in [f for f in kernels_in(stem[0]) if ENDING.sub("", f.name) == stem[1]]:
            file.unlink(missing_ok=True)
            deleted += 1
    return deleted


def kernels_in(folder: Path) -> list[Path]:
    """numba's index and code files in a directory and below it."""
    return sorted(f for pattern in CACHED for f in folder.rglob(pattern))


def _is_damaged(file: Path, entry: Entry, written_ns: int) -> bool:
    size, changed_ns, digest = entry
    try:
        now = file.stat()
        if now.st_size == size and hashlib.sha256(file.read_bytes()).hexdigest() == digest:
            return False  # also in a copy of the directory, with other times
    except FileNotFoundError:
        return False  # numba compiles it again
    except OSError:
        return True
    # unless numba has written a newer one
    return now.st_mtime_ns < written_ns or now.st_mtime_ns == changed_ns


def _entry(folder: Path, file: Path, before: dict[str, Entry]) -> Entry:
    now = file.stat()
    known = before.get(str(file.relative_to(folder)))
    if known is not None and known[:2] == (now.st_size, now.st_mtime_ns):
        return known
    return now.st_size, now.st_mtime_ns, hashlib.sha256(file.read_bytes()).hexdigest()


def _entries(folder: Path) -> dict[str, Entry]:
    """Relative path -> entry; empty without a manifest. Raises UnreadableManifest."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if any("\0" in name for name in content):
            raise ValueError("no name of a file")
        return {str(name): (int(size), int(ns), str(digest)) for name, (size, ns, digest) in content.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise UnreadableManifest(str(folder / MANIFEST)) from error


def _time_ns(folder: Path) -> int:
    """The time with which the file system stamps a file that is written now. It can be a tick behind the system's time:
    the stamps of earlier files are smaller than this one, those of later files equal or greater."""
    time.sleep(_TICK_S)
    part = _part(folder)
    part.write_bytes(b"")
    return part.stat().st_mtime_ns


def _part(folder: Path) -> Path:
    return folder / f"{MANIFEST}.{os.getpid()}.part"


def _write(folder: Path, entries: dict[str, Entry], began_ns: int) -> None:
    """Writes the manifest. Its modification time is when the files began to be read, so that a file which another
    process has replaced since counts as newer and not as damaged."""
    part = _part(folder)
    with part.open("w", encoding="utf-8") as stream:
        json.dump(entries, stream)
        stream.flush()
        os.fsync(stream.fileno())
    os.utime(part, ns=(began_ns, began_ns))
    part.replace(folder / MANIFEST)
