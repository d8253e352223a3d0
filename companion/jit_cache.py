"""Compiled kernels are kept apart by the sources they were made of.

numba asks of a cached kernel only whether the kernel's own file has changed. A kernel that calls one of another file
holds that one's machine code too, and would go on with the old code after a change there. So every state of the
sources gets a directory of its own, named by a hash of them all; a few old ones are kept, for going back and forth.

numba reads NUMBA_CACHE_DIR when it is imported: `companion/__init__.py` calls use_own_cache() before anything else.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import sys
from importlib import metadata
from pathlib import Path
from typing import Final

VARIABLE: Final = "NUMBA_CACHE_DIR"
ROOT: Final = Path(__file__).resolve().parent.parent
KEPT: Final = 3
"""Directories that stay, the one in use among them."""
_PREFIX: Final = "kernels-"
_KEYED: Final = re.compile(re.escape(_PREFIX) + "[0-9a-f]{16}")
_LOCK: Final = "in-use"

_held: list[int] = []
"""Open files whose locks tell other processes that the directory is in use; they close with the process."""


def use_own_cache() -> Path | None:
    """Names the directory of the present sources in NUMBA_CACHE_DIR, below the one that was named there, else below
    the user's cache. Returns it, or None when nothing was changed: numba is loaded already and has chosen, or there is
    no place to write."""
    if "numba" in sys.modules:
        return None
    named = os.environ.get(VARIABLE)
    for base in [base_of(Path(named))] if named else _usual_bases():
        folder = base / (_PREFIX + source_key(ROOT))
        if _open(folder):
            prune(base, folder)
            os.environ[VARIABLE] = str(folder)
            return folder
    return None  # numba then says that it cannot write, and `companion warmup` what to do


def base_of(folder: Path) -> Path:
    """The directory that holds those of all states: a child process is handed the one of its parent's."""
    return folder.parent if _KEYED.fullmatch(folder.name) else folder


def source_key(root: Path) -> str:
    """16 hex digits: the sources of every kernel of the service, and numba's version."""
    digest = hashlib.sha256(metadata.version("numba").encode())
    for path in (*sorted((root / "core").glob("*.py")), root / "drivers" / "raycast.py"):
        content = path.read_bytes()
        digest.update(f"\n{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


def prune(base: Path, current: Path) -> None:
    """Deletes the directories of old states but for the latest KEPT (with `current`) and those that a running process
    uses. Nothing else below `base` is touched."""
    others = [f for f in base.iterdir() if _KEYED.fullmatch(f.name) and f.is_dir() and f != current]
    for folder in sorted(others, key=_last_use, reverse=True)[KEPT - 1 :]:
        descriptor = _lock(folder, fcntl.LOCK_EX)
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)


def _usual_bases() -> list[Path]:
    """The user's cache; where that cannot be written, beside the sources, as numba itself would have it."""
    beside = ROOT / "core" / "__pycache__"
    home = Path(os.path.expanduser("~"))
    named = os.environ.get("XDG_CACHE_HOME")
    if not named and home in (Path("~"), Path("/"), Path()):  # a service may have no home
        return [beside]
    return [(Path(named) if named else home / ".cache") / "osape-companion", beside]


def _open(folder: Path) -> bool:
    """Makes the directory and marks it as used; False when it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = _lock(folder, fcntl.LOCK_SH)
        if not folder.is_dir() or not os.access(folder, os.W_OK):
            return False
        os.utime(folder)
    except OSError:
        return False
    if descriptor is not None:
        _held.append(descriptor)
    return True


def _lock(folder: Path, kind: int) -> int | None:
    """An open file with the lock, None when another process has the opposite one."""
    try:
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _last_use(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except FileNotFoundError:  # another process has just deleted it
        return 0
