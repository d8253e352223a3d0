"""The folder of the sockets of a service on this machine."""

from __future__ import annotations

import os
import socket
from pathlib import Path

SERVICE_NAME = "osape-companion"
SYSTEM_RUN = Path("/run") / SERVICE_NAME
PROBE_S = 0.2


def run_folder() -> Path:
    """Folder of the sockets of the running service: one that this user started by hand, else the system's service. It need
    not exist. Sockets that a service left behind when it was killed do not count: each is asked for a connection."""
    given = given_run_folder()
    if given is not None:
        return given
    try:
        own = own_run_folder()
    except RuntimeError:  # no service of a user without a home directory
        return SYSTEM_RUN
    return own if is_served(own) or not SYSTEM_RUN.is_dir() else SYSTEM_RUN


def is_served(folder: Path) -> bool:
    """Whether a process listens on a socket in a folder."""
    try:
        return any(_accepts(path) for path in folder.iterdir() if path.is_socket())
    except OSError:  # there is no such folder, or this user may not read it
        return False


def _accepts(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(PROBE_S)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:  # a full queue, or no permission: whether a process listens is unknown
            return True
    return True


def given_run_folder() -> Path | None:
    """The folder that systemd gives a unit."""
    given = os.environ.get("RUNTIME_DIRECTORY")
    return Path(given) if given else None


def own_run_folder() -> Path:
    """The user's own folder; not the cache folder itself, which exists even if no service was ever started. Raises
    RuntimeError for a user without a home directory."""
    session = os.environ.get("XDG_RUNTIME_DIR")
    return Path(session) / SERVICE_NAME if session else Path.home() / ".cache" / SERVICE_NAME / "run"
