"""The folder of the sockets of a service on this machine."""

from __future__ import annotations

import os
from pathlib import Path

SERVICE_NAME = "osape-companion"
SYSTEM_RUN = Path("/run") / SERVICE_NAME


def run_folder() -> Path:
    """Folder of the sockets of the running service: one that this user started by hand, else the system's service. It need
    not exist."""
    given = given_run_folder()
    if given is not None:
        return given
    own = own_run_folder()
    return SYSTEM_RUN if SYSTEM_RUN.is_dir() and not (own / "health").exists() else own


def given_run_folder() -> Path | None:
    """The folder that systemd gives a unit."""
    given = os.environ.get("RUNTIME_DIRECTORY")
    return Path(given) if given else None


def own_run_folder() -> Path:
    """The user's own folder; not the cache folder itself, which exists even if no service was ever started."""
    session = os.environ.get("XDG_RUNTIME_DIR")
    return Path(session) / SERVICE_NAME if session else Path.home() / ".cache" / SERVICE_NAME / "run"
