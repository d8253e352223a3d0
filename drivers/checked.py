"""Parameters that check themselves: a dataclass field with its range, unit and meaning beside its default."""

from __future__ import annotations

from dataclasses import field, fields
from typing import Any


def number(default: float, low: float, high: float, unit: str, doc: str) -> Any:
    """A number (a whole one where the field is an int) within low..high."""
    return field(default=default, metadata={"min": low, "max": high, "unit": unit, "doc": doc})


def choice(default: str, choices: tuple[str, ...], doc: str) -> Any:
    """One of several words."""
    return field(default=default, metadata={"choices": choices, "unit": "", "doc": doc})


def text(default: str, doc: str) -> Any:
    """Free text."""
    return field(default=default, metadata={"unit": "", "doc": doc})


def switch(default: bool, doc: str) -> Any:
    """True or false."""
    return field(default=default, metadata={"unit": "", "doc": doc})


def check(section: str, parameters: Any) -> None:
    """Raises ValueError naming the section, the field, its value and what it may be."""
    for f in fields(parameters):
        value, meta = getattr(parameters, f.name), f.metadata
        if "choices" in meta and value not in meta["choices"]:
            raise ValueError(f"{section}: {f.name} = {value!r}, expected one of {', '.join(meta['choices'])}")
        if "min" in meta and not meta["min"] <= value <= meta["max"]:
            low, high, unit = meta["min"], meta["max"], meta["unit"]
            raise ValueError(f"{section}: {f.name} = {value}, expected {low}..{high} {unit}".rstrip())
