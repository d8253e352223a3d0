"""Libraries that only some cameras need, and the command that installs them."""

from __future__ import annotations

import os
import sys


def install_command(requirement: str) -> str:
    """Installs a library into the environment of this process, whether the software came from a checkout, a wheel or a
    system package. requirement: as in pyproject.toml, such as `depthai>=3.0,<4`."""
    sudo = "" if os.access(sys.prefix, os.W_OK) else "sudo "
    return f"{sudo}{sys.executable} -m pip install '{requirement}'"
