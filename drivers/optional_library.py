"""Libraries that only some cameras and commands need, and the command that installs them."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from .base import DeviceNotFound


def install_command(*requirements: str) -> str:
    """Installs libraries into the environment of this process, whether the software came from a checkout, a wheel or a
    system package. requirements: as in pyproject.toml, such as `depthai>=3.0,<4`."""
    sudo = "" if os.access(sys.prefix, os.W_OK) else "sudo "
    quoted = " ".join(f"'{requirement}'" for requirement in requirements)
    return f"{sudo}{sys.executable} -m pip install {quoted}"


def optional_module(name: str, need: str, *requirements: str, otherwise: str = "") -> Any:
    """A module of a library that may be missing. Raises DeviceNotFound with the command that installs it.

    need: what needs the library, the beginning of the message; otherwise: its end, another remedy."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise DeviceNotFound(f"{need}: run {install_command(*requirements)}{otherwise}") from error
