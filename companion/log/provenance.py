"""The provenance of a log: the first message of every log."""

from __future__ import annotations

import platform
from importlib import metadata
from typing import Final

from osape_client.proto import osape_v1_pb2 as pb

from ..config.differences import expert_lines, safety_lines
from ..config.loader import Config, config_text
from ..pipeline.encode import SCHEMA_VERSION

_NUMBERS_DEPEND_ON: Final = ("numpy", "numba", "llvmlite", "scipy", "opencv-python-headless")


def software() -> str:
    """Name and version of this software."""
    return f"osape-companion {_version('osape-companion')}"


def run_info(source: str, config: Config | None = None) -> pb.RunInfo:
    """The provenance message. source: "replay", "import", "simulated" or "live"; config: the effective configuration."""
    return pb.RunInfo(
        schema_version=SCHEMA_VERSION,
        software=software(),
        config_json="" if config is None else config_text(config),
        changed_safety_keys=[] if config is None else safety_lines(config),
        changed_expert_keys=[] if config is None else expert_lines(config),
        packages=[f"{name} {version}" for name, version in package_versions().items()],
        processor=platform.machine(),
        source=source,
    )


def package_versions() -> dict[str, str]:
    """Versions of the packages on which results and times depend."""
    return {name: _version(name) for name in _NUMBERS_DEPEND_ON}


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "unknown"
