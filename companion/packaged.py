"""Files that come with this software."""

from __future__ import annotations

import sysconfig
from pathlib import Path

from .paths import NAME


def packaged_file(part: str, name: str) -> Path:
    """A file of this software: in the checkout, or in the share directory of an installed package. Raises ValueError."""
    for folder in (Path(__file__).resolve().parents[1], Path(sysconfig.get_path("data")) / "share" / NAME):
        if (folder / part / name).is_file():
            return folder / part / name
    raise ValueError(f"{part}/{name} is missing from this installation; install osape-companion again")


def shipped_configs() -> dict[str, Path]:
    """Name -> file of each shipped configuration. Raises ValueError."""
    return {f.stem: f for f in sorted(packaged_file("configs", "default.toml").parent.glob("*.toml"))}
