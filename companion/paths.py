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
    """Of a service that starts here: those that systemd gives, else the user's own. Raises OSError where they cannot be
    made."""
    state = os.environ.get("STATE_DIRECTORY")
    run = _systemd_run_folder() or _user_run_folder()
    state_folder = Path(state) if state else Path.home() / ".local" / "state" / NAME
    run.mkdir(parents=True, exist_ok=True, mode=0o750)
    state_folder.mkdir(parents=True, exist_ok=True)
    return Folders(run, state_folder)


def run_folder() -> Path:
    """Where the service that runs has its sockets: one that this user started by hand, else the system's."""
    given = _systemd_run_folder()
    if given is not None:
        return given
    own = _user_run_folder()
    return SYSTEM_RUN if SYSTEM_RUN.is_dir() and not (own / "health").exists() else own


def _systemd_run_folder() -> Path | None:
    given = os.environ.get("RUNTIME_DIRECTORY")
    return Path(given) if given else None


def _user_run_folder() -> Path:
    """The user's; not the cache itself, which is there though no service ever ran."""
    session = os.environ.get("XDG_RUNTIME_DIR")
    return Path(session) / NAME if session else Path.home() / ".cache" / NAME / "run"


def cache_folder() -> Path:
    """Of what can be made again at any time; it may not exist, and is not made here."""
    given = os.environ.get("CACHE_DIRECTORY")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / NAME
