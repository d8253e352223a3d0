"""Configuration keys of earlier versions that are still accepted, for one release, and have no effect any more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

_CPU_IDLE: Final = "use cpupower or tuned to limit the idle states of the processor"

RETIRED: Final[Mapping[tuple[str, str], str]] = {
    ("service", "idle_latency_us"): f"it has no effect any more; {_CPU_IDLE}; remove the line",
    (
        "service",
        "second_thread_from_hz",
    ): "it has no effect any more, each frame is processed by one thread; remove the line",
}
"""(section, key) -> what to do about it."""


def without_retired(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The tables of a configuration without its retired keys, and one warning for each of these."""
    current, warnings = dict(content), []
    for (section, key), advice in RETIRED.items():
        table = current.get(section)
        if isinstance(table, Mapping) and key in table:
            current[section] = {k: v for k, v in table.items() if k != key}
            warnings.append(f"[{section}] {key} is retired: {advice}")
    return current, warnings
