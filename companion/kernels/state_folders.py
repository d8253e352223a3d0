"""The directories of compiled kernels: who may use one, which are in use, which are deleted."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import IO, Final

MAX_STATES: Final = 6
"""Number of directories that are kept, including the one in use."""
_STATE: Final = re.compile("kernels-[0-9a-f]{16}")
_TEMPORARY: Final = "osape-companion-kernels-"
"""Prefix of temporary directories; the number of the process that made one follows."""
_LOCK: Final = "in-use"
_held: list[IO[str]] = []
"""Open files whose locks mark directories as in use; the system closes them with the process."""


def is_state(folder: Path) -> bool:
    """True if a directory is named as that of a state of the sources."""
    return _STATE.fullmatch(folder.name) is not None


def base_of(folder: Path) -> Path:
    """Returns the parent of the directories of states. A child process inherits the directory of its parent's state."""
    return folder.parent if is_state(folder) else folder


def is_trusted(folder: Path) -> bool:
    """False if another user has made a directory, or a link to one, in a folder that several users can write, such as
    /tmp: kernels are machine code. False also if it does not exist."""
    try:
        trusted = {os.geteuid(), 0, folder.parent.stat().st_uid}
        return {folder.lstat().st_uid, folder.stat().st_uid} <= trusted
    except OSError:
        return False


def is_writable(folder: Path) -> bool:
    """True if a directory and those in it, which another user may have made, can be written. Raises OSError."""
    return all(os.access(f, os.W_OK) for f in (folder, *folder.iterdir()) if f.is_dir())


def older_states(folder: Path) -> list[Path]:
    """Returns the other directories beside that of a state, the latest first, without those of other users. Raises
    OSError."""
    found = [f for f in folder.parent.iterdir() if is_state(f) and f != folder and is_trusted(f)]
    return sorted(found, key=_last_use, reverse=True)


def hold(folder: Path) -> None:
    """Marks a directory as used now, and as in use until this process ends. Raises OSError."""
    os.utime(folder)
    lock = (folder / _LOCK).open("a")
    _held.append(lock)
    fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)


def prune(folder: Path) -> None:
    """Deletes the directories of old states beside that of the present one, except those of other users.

    The latest MAX_STATES (including `folder`) stay, and those in use by a running process. Raises OSError."""
    for old in older_states(folder)[MAX_STATES - 1 :]:
        with contextlib.suppress(OSError), (old / _LOCK).open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(old, ignore_errors=True)


def _last_use(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except FileNotFoundError:  # another process has just deleted it
        return 0


def make_temporary(place: Path) -> Path:
    """Makes a temporary directory that is deleted at the end of this process. Deletes those of this user's processes
    that were killed. Raises OSError."""
    for folder in place.glob(f"{_TEMPORARY}*"):
        owner = folder.name.removeprefix(_TEMPORARY).partition("-")[0]
        with contextlib.suppress(FileNotFoundError):  # another start has just deleted it
            if owner.isdecimal() and not Path("/proc", owner).exists() and folder.stat().st_uid == os.geteuid():
                shutil.rmtree(folder, ignore_errors=True)
    made = Path(tempfile.mkdtemp(prefix=f"{_TEMPORARY}{os.getpid()}-", dir=place))
    atexit.register(_delete_own, made, os.getpid())
    return made


def _delete_own(folder: Path, owner: int) -> None:
    """Deletes a temporary directory, except in a fork of its owner, which may end before the owner."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)
