"""The manifest of a directory of kernels: what is compiled in it, and the SHA-256 of each file.

numba checks that a kernel's source has not changed, but not that the cached file is whole: a damaged file can end the
process or give wrong results. The manifest is written when all kernels of a group are compiled and on the disk. What
numba writes later is not checked until the manifest is written again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from ..whole_file import write_whole
from .module_folder import delete_kernels, kernels_in
from .source_state import Closure

MANIFEST: Final = "manifest.json"
"""Its first line is the SHA-256 of the others."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """Content of a manifest."""

    # the import closures of the modules, by which the folders of their kernels are named
    closures: dict[str, Closure] = field(default_factory=dict)
    groups: Sequence[str] = ()  # the groups whose kernels are all compiled
    # modification time in ns and SHA-256 of each file of kernels, by its path relative to the directory
    files: dict[str, tuple[int, str]] = field(default_factory=dict)


def read_manifest(folder: Path) -> Manifest | None:
    """Returns the manifest of a directory; None if there is none, or a damaged one."""
    try:
        digest, _, text = (folder / MANIFEST).read_bytes().partition(b"\n")
    except OSError:
        return None
    return Manifest(**json.loads(text)) if digest.decode(errors="replace") == _sha256(text) else None


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Replaces the manifest. Raises OSError."""
    text = json.dumps(asdict(manifest))
    write_whole(folder / MANIFEST, f"{_sha256(text.encode())}\n{text}")


def missing_groups(folder: Path, groups: Iterable[str]) -> list[str]:
    """Returns the groups of which kernels may be missing in a directory."""
    compiled = (read_manifest(folder) or Manifest()).groups
    return [group for group in groups if group not in compiled]


def add_groups(folder: Path, groups: Iterable[str]) -> None:
    """Enters groups of which all kernels are compiled now, and all files. Raises OSError."""
    os.sync()  # a power failure must not leave a manifest of files whose content was not written
    known = read_manifest(folder) or Manifest()
    # the time before the content: a file that replaces it meanwhile is newer
    files = {str(f.relative_to(folder)): (f.stat().st_mtime_ns, _sha256(f.read_bytes())) for f in kernels_in(folder)}
    write_manifest(folder, Manifest(known.closures, sorted({*known.groups, *groups}), files))


def discard_damaged(folder: Path) -> int:
    """Deletes all kernels of each module with a file that is missing or damaged; all kernels if the manifest is damaged.

    No group counts as compiled then. Returns the number of deleted files. Raises OSError."""
    manifest = read_manifest(folder)
    if manifest is None:
        deleted = delete_kernels(folder)
        write_manifest(folder, Manifest())
        return deleted
    damaged = {Path(name).parent for name, entry in manifest.files.items() if _is_damaged(folder / name, *entry)}
    if not damaged:
        return 0
    deleted = sum(delete_kernels(folder, module) for module in damaged)
    kept = {name: entry for name, entry in manifest.files.items() if Path(name).parent not in damaged}
    write_manifest(folder, Manifest(manifest.closures, (), kept))
    return deleted


def _is_damaged(file: Path, entered_ns: int, digest: str) -> bool:
    """True if a file is not the one that was entered, unless numba has replaced it since."""
    try:
        return _sha256(file.read_bytes()) != digest and file.stat().st_mtime_ns <= entered_ns
    except OSError:
        return True


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
