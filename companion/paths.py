"""Where a service keeps what: the folders that systemd gives a unit, else the user's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from osape_client.run_folder import SERVICE_NAME, given_run_folder, own_run_folder

NAME = SERVICE_NAME


@dataclass(frozen=True, slots=True)
class Folders:
    """run: of sockets, gone with the boot; state: of logs, kept."""

    run: Path
    state: Path


def folders() -> Folders:
    """Of a service that starts here: those that systemd gives, else the user's own. Raises OSError where they cannot be
    made."""
    state = os.environ.get("STATE_DIRECTORY")
    run = given_run_folder() or own_run_folder()
    state_folder = Path(state) if state else Path.home() / ".local" / "state" / NAME
    run.mkdir(parents=True, exist_ok=True, mode=0o750)
    state_folder.mkdir(parents=True, exist_ok=True)
    return Folders(run, state_folder)


def cache_folder() -> Path:
    """Of what can be made again at any time; it may not exist, and is not made here."""
    given = os.environ.get("CACHE_DIRECTORY")
    return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / NAME
