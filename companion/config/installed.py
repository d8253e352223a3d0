"""The configuration of the installed service, which commands use without `-c`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from .loader import ConfigError

INSTALLED: Final = Path("/etc/osape-companion/config.toml")


def config_path(given: Path | None) -> Path:
    """The given file, else that of the installed service. Raises ConfigError where there is neither."""
    if given is not None:
        return given
    if INSTALLED.exists():
        return INSTALLED
    raise ConfigError(
        str(INSTALLED),
        [
            "does not exist; give a configuration with -c FILE. `companion setup` writes one, `companion configs` lists examples"
        ],
    )
