"""Files that a configuration names."""

from __future__ import annotations

from pathlib import Path

from .loader import Config


def named_files(config: Config) -> dict[str, str]:
    """Section and key -> file or directory that the service reads at its start."""
    named = {
        "[autopilot] signing_key": config.autopilot.signing_key,
        "[publish] keys": config.publish.keys,
        "[share] zenoh": config.share.zenoh,
    }
    return {key: name for key, name in named.items() if name}


def is_missing(place: Path) -> bool:
    """Whether it is known that nothing is at a path."""
    try:
        place.stat()  # exists() answers no, from Python 3.14 on, where only root can look
    except PermissionError:
        return False
    except (OSError, ValueError):  # also a name that no file can have
        return True
    return False
