"""Configuration keys of the release before that are constants now: accepted for one release with their value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .retired_constants import CONSTANTS_OF

_LIVE_ONLY = ("avoid", "guard", "publish", "service")
"""Sections on which no result of a frame depends: a replay uses none of them."""


def refused_values(content: Mapping[str, Any], *, in_log: bool = False) -> list[str]:
    """Values of retired keys that must not be ignored, with what to do about each. in_log: those of sections on which no result of a
    frame depends may be ignored."""
    remedy = "The log cannot be replayed with it" if in_log else "Remove the line"
    return [
        f"[{section}] {key} = {content[section][key]!r} is not available any more: it is a constant, {value:g}. {remedy}"
        for section, key, value in _given(content)
        if content[section][key] != value and not (in_log and section in _LIVE_ONLY)
    ]


def without_retired(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """The tables of a configuration without its retired keys, and one warning for each of these."""
    current = {name: dict(table) if isinstance(table, Mapping) else table for name, table in content.items()}
    warnings = []
    for section, key, _ in _given(content):
        del current[section][key]
        warnings.append(f"[{section}] {key} is retired: it is a constant now; remove the line")
    return current, warnings


def _given(content: Mapping[str, Any]) -> Iterator[tuple[str, str, float]]:
    """Section, key and constant of each retired key in a configuration."""
    for section, constants in CONSTANTS_OF.items():
        table = content.get(section)
        if isinstance(table, Mapping):
            yield from ((section, key, value) for key, value in constants.items() if key in table)
