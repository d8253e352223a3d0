"""Where a service keeps what: the folders that systemd gives a unit, else the user's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

NAME = "osape-companion"
SYSTEM_RUN = Path("/run") / NAME


@dataclass(frozen=True, slots=True)
class Folders:
    """run: of sockets, gone with the boot; state: of logs, kept."""

    run: Path
    state: Path


def folders() -> Folders:
    """Raises OSError where they cannot be made. A user's command finds the system's service by /run/osape-companion."""
    given, state = os.environ.get("RUNTIME_DIRECTORY"), os.environ.get("STATE_DIRECTORY")
    if given:
        run = Path(given)
    else:
        own = Path(os.environ.get("XDG_RUNTIME_DIR") or Path.home() / ".cache") / NAME
        run = own if own.exists() or not SYSTEM_RUN.is_dir() else SYSTEM_RUN
    keep = Path(state) if state else Path.home() / ".local" / "state" / NAME
    run.mkdir(parents=True, exist_ok=True, mode=0o750)
    keep.mkdir(parents=True, exist_ok=True)
    return Folders(run, keep)


def cache_folder() -> Path:
    """Of what can be made again at any time; it may not exist, and is not made here."""
    given = os.environ.get("CACHE_DIRECTORY")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / NAME
