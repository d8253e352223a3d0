"""Which keys have no effect: each key alone is set to other values, and recordings are processed with them."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable
from dataclasses import Field
from pathlib import Path
from typing import Any

from companion.config.loader import Config, ConfigError, config_of
from companion.config.sections import fields_of, plain_type
from companion.pipeline.configured import make_pipeline
from companion.pipeline.encode import prisms_message, wire_bytes
from companion.pipeline.results import PrismsResult
from drivers.base import Event
from drivers.logs.reader import McapRecording

SECTIONS = ("extractor", "expert", "sync", "mount_check")
"""Sections whose keys act on the frames of a recording."""


@functools.cache
def _events(path: Path) -> tuple[tuple[Any, ...], tuple[Event, ...]]:
    recording = McapRecording(path)
    return tuple(recording.cameras), tuple(recording.events())


def digest(config: Config, path: Path) -> bytes:
    """A digest of all results of a recording with a configuration."""
    cameras, events = _events(path)
    pipeline, out = make_pipeline(config, cameras), hashlib.sha256()
    for event in events:
        for result in pipeline.handle(event):
            if isinstance(result, PrismsResult):
                out.update(wire_bytes(prisms_message(result)))
    return out.digest()


def other_values(key: Field[Any]) -> list[Any]:
    """Values of a key that differ from its default: the ends of its range and between them, or its other choices."""
    meta, kind = key.metadata, plain_type(key)
    if kind is bool:
        return [not key.default]
    if "choices" in meta:
        return [c for c in meta["choices"] if c != key.default]
    low, high = kind(meta["min"]), kind(meta["max"])
    middle = [kind(low + share * (high - low)) for share in (0.25, 0.75)]
    return [v for v in dict.fromkeys([high, low, *middle]) if v != key.default]


def without_effect(paths: Iterable[Path], sections: Iterable[str] = SECTIONS) -> list[str]:
    """The keys with which every result stays the same at each of their values."""
    before = {path: digest(Config(), path) for path in paths}
    return [
        f"[{section}] {key.name}"
        for section in sections
        for key in fields_of(section)
        if not any(_changes(section, key, value, before) for value in other_values(key))
    ]


def _changes(section: str, key: Field[Any], value: Any, before: dict[Path, bytes]) -> bool:
    try:
        config = config_of({section: {key.name: value}}, "effects")
    except ConfigError:
        return False
    return any(digest(config, path) != old for path, old in before.items())
