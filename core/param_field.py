"""Parameters that check themselves: a dataclass field with its range, unit and meaning beside its default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, field, fields
from typing import Any


def number(default: float | None, low: float, high: float, unit: str, doc: str) -> Any:
    """A number (a whole one where the field is an int) within low..high."""
    return field(default=default, metadata={"min": low, "max": high, "unit": unit, "doc": doc})


def critical(default: float | None, low: float, high: float, unit: str, doc: str) -> Any:
    """A number that is a safety key: see `is_safety_key`."""
    return field(default=default, metadata={"min": low, "max": high, "unit": unit, "doc": doc, "safety": True})


def choice(default: str, choices: tuple[str, ...], doc: str, *, safety: bool = False) -> Any:
    """One of several texts. safety: see `is_safety_key`."""
    return field(default=default, metadata={"choices": choices, "unit": "", "doc": doc, "safety": safety})


def text(default: str, doc: str) -> Any:
    """Free text."""
    return field(default=default, metadata={"unit": "", "doc": doc})


def switch(default: bool, doc: str, *, safety: bool = False) -> Any:
    """True or false. safety: see `is_safety_key`."""
    return field(default=default, metadata={"unit": "", "doc": doc, "safety": safety})


def is_safety_key(f: Field[Any]) -> bool:
    """Returns True if a field is marked as a safety key.

    A field is marked if a changed value can make occupied or unknown space be reported as free. That is the case if
    it decides when a frame, an attitude, a camera or a loop counts as unusable, or how soon that is reported; if it
    decides what counts as free, or when an obstacle is removed or forgotten; if it sets the least size or number of
    measurements of a reported obstacle, the assumed noise, or a margin; or if it sets the measured range, or hides a
    part of the image or of the vehicle's surroundings. Fields that only affect speed, the size of the log or
    smoothness, and those that describe the installation (mount, device, address), are not marked."""
    return bool(f.metadata.get("safety", False))


def check(section: str, parameters: Any) -> None:
    """Raises ValueError naming the section (where there is one), the field, its value and what it may be."""
    begin = f"{section}: " if section else ""
    for f in fields(parameters):
        value, meta = getattr(parameters, f.name), f.metadata
        wanted = _wanted(f.type, value, meta)
        if wanted:
            raise ValueError(f"{begin}{f.name} = {value!r}: expected {wanted}")


def _wanted(kind: Any, value: Any, meta: Mapping[str, Any]) -> str:
    """Returns the valid values of a field as text; empty: the value is valid. kind: the field's annotation."""
    if "choices" in meta:
        return "" if value in meta["choices"] else f"one of {', '.join(meta['choices'])}"
    if "min" in meta:
        low, high = meta["min"], meta["max"]
        if kind == "int" and (not isinstance(value, int) or isinstance(value, bool)):
            return f"a whole number {low}..{high}"
        return "" if low <= value <= high else f"{low}..{high} {meta['unit']}".rstrip()
    return "true or false" if kind == "bool" and not isinstance(value, bool) else ""
