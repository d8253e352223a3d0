"""Configuration keys of earlier versions that are accepted for one release: renamed, moved, or without effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from .expert import expert_fields
from .retired_constants import CONSTANTS_OF

_CPU_IDLE: Final = "use cpupower or tuned to limit the idle states of the processor"
_LEVEL_MEMORY: Final = "it has no effect any more; a planner gives it to osape_client.LevelMemory; remove the line"

RETIRED: Final[Mapping[tuple[str, str], str]] = {
    ("service", "idle_latency_us"): f"it has no effect any more; {_CPU_IDLE}; remove the line",
    (
        "service",
        "second_thread_from_hz",
    ): "it has no effect any more, each frame is processed by one thread; remove the line",
    ("extractor", "mode"): "there is one form of the extractor; remove the line",
    ("extractor", "paper_roll_deg"): "only the paper's form used it; remove the line",
    ("extractor", "paper_line_tolerance_m"): "only the paper's form used it; remove the line",
    ("record", "drawings"): "[output] scene and transforms decide what each log holds; remove the line",
    ("world", "level_memory_s"): _LEVEL_MEMORY,
    ("world", "level_speed_m_s"): _LEVEL_MEMORY,
    **{
        (section, key): "it is a constant now; remove the line"
        for section, constants in CONSTANTS_OF.items()
        for key in constants
    },
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
    changed = [
        f"[{section}] {key} = {table[key]!r} is not available any more: it is a constant, {value:g}. "
        "Remove the line. A log recorded with it can be replayed by the version that recorded it"
        for section, constants in CONSTANTS_OF.items()
        if isinstance(table := content.get(section), Mapping)
        for key, value in constants.items()
        if table.get(key, value) != value
    ]
    return changed if mode == "safe" else [*changed, "[extractor] mode is retired; remove the line"]


RENAMED: Final[Mapping[tuple[str, str], tuple[str, str]]] = {
    ("service", "stale_s"): ("service", "timeout_s"),
    **{("extractor", f.name): ("expert", f.name) for f in expert_fields()},
}
"""(section, key) -> (section, key) of today."""


def without_retired(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The tables of a configuration with today's keys, and one warning for each retired, renamed or moved key.

    A key of an earlier version stays where it is when today's key is given as well: the check of keys then refuses it."""
    current = {name: dict(table) if isinstance(table, Mapping) else table for name, table in content.items()}
    warnings = []
    for (section, key), advice in RETIRED.items():
        table = current.get(section)
        if isinstance(table, dict) and key in table:
            del table[key]
            warnings.append(f"[{section}] {key} is retired: {advice}")
    for (section, key), (new_section, new_key) in RENAMED.items():
        table, target = current.get(section), current.get(new_section, {})
        if isinstance(table, dict) and key in table and isinstance(target, dict) and new_key not in target:
            target[new_key] = table.pop(key)
            current[new_section] = target
            moved = f"move the line below [{new_section}]" if section != new_section else f"write {new_key} instead"
            warnings.append(f"[{section}] {key} is now [{new_section}] {new_key}: {moved}")
    return current, warnings
