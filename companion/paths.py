"""Where a service keeps what: the folders that systemd gives a unit, else the user's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from osape_client.run_folder import SERVICE_NAME, given_run_folder, own_run_folder

NAME = SERVICE_NAME


@dataclass(frozen=True, slots=True)
class Folders:
    """Directories of the service."""

    run: Path  # of sockets, gone with the boot
    state: Path  # of logs, kept


class FolderError(ValueError):
    """A folder of the service cannot be made; the text names it, the cause and the remedy."""


def folders() -> Folders:
    """Of a service that starts here: those that systemd gives, else the user's own. Raises FolderError."""
    state = os.environ.get("STATE_DIRECTORY")
    given = given_run_folder()
    try:
        run = given or own_run_folder()
        state_folder = Path(state) if state else _state_home() / NAME
    except RuntimeError as error:
        raise _without_home("XDG_RUNTIME_DIR and STATE_DIRECTORY") from error
    _make(run, "of the sockets", "RUNTIME_DIRECTORY" if given else "XDG_RUNTIME_DIR", mode=0o750)
    _make(state_folder, "of logs and state", "STATE_DIRECTORY", mode=0o777)
    return Folders(run, state_folder)


def _state_home() -> Path:
    """Of the user: XDG_STATE_HOME, or its default where that is not set, or relative, which is invalid. Raises RuntimeError without a
    home directory."""
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    return given if given.is_absolute() else Path.home() / ".local" / "state"


def _make(folder: Path, purpose: str, variable: str, mode: int) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=mode)
    except OSError as error:
        raise FolderError(
            f"{folder}, the folder {purpose}, cannot be made ({error.strerror}); set the environment variable {variable} to "
            "a folder that this user may write"
        ) from error


def cache_folder() -> Path:
    """Of what can be made again at any time; it may not exist, and is not made here. Raises FolderError."""
    given = os.environ.get("CACHE_DIRECTORY")
    try:
        return Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / NAME
    except RuntimeError as error:
        raise _without_home("CACHE_DIRECTORY") from error


def _without_home(variables: str) -> FolderError:
    return FolderError(
        f"this user has no home directory; set HOME, or {variables}, in the environment to folders that this user may write"
    )
