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
    ("extractor", "mode"): "there is one form of the extractor; remove the line",
    ("extractor", "paper_roll_deg"): "only the paper's form used it; remove the line",
    ("extractor", "paper_line_tolerance_m"): "only the paper's form used it; remove the line",
}
"""(section, key) -> what to do about it."""

_PAPER: Final = (
    '[extractor] mode = "paper" is not available any more: the paper\'s form misses obstacles. Remove the line; '
    "benchmarks/paper compares both forms. A log recorded with it can be replayed by the version that recorded it"
)


def refused_values(content: Mapping[str, Any]) -> list[str]:
    """Values of retired keys that must not be ignored, with what to do about each."""
    extractor = content.get("extractor")
    mode = extractor.get("mode", "safe") if isinstance(extractor, Mapping) else "safe"
    if mode == "paper":
        return [_PAPER]
    return [] if mode == "safe" else ["[extractor] mode is retired; remove the line"]


def without_retired(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The tables of a configuration without its retired keys, and one warning for each of these."""
    current, warnings = dict(content), []
    for (section, key), advice in RETIRED.items():
        table = current.get(section)
        if isinstance(table, Mapping) and key in table:
            current[section] = {k: v for k, v in table.items() if k != key}
            warnings.append(f"[{section}] {key} is retired: {advice}")
    return current, warnings
