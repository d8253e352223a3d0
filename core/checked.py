"""Parameters that check themselves: a dataclass field with its range, unit and meaning beside its default."""

from __future__ import annotations

from collections.abc import Mapping
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
    """Raises ValueError naming the section (where there is one), the field, its value and what it may be."""
    begin = f"{section}: " if section else ""
    for f in fields(parameters):
        value, meta = getattr(parameters, f.name), f.metadata
        wanted = _wanted(f.type, value, meta)
        if wanted:
            raise ValueError(f"{begin}{f.name} = {value!r}: expected {wanted}")


def _wanted(kind: Any, value: Any, meta: Mapping[str, Any]) -> str:
    """What a value of this field may be, empty if it is that. kind: the field's annotation."""
    if "choices" in meta:
        return "" if value in meta["choices"] else f"one of {', '.join(meta['choices'])}"
    if "min" in meta:
        low, high = meta["min"], meta["max"]
        if kind == "int" and (not isinstance(value, int) or isinstance(value, bool)):
            return f"a whole number {low}..{high}"
        return "" if low <= value <= high else f"{low}..{high} {meta['unit']}".rstrip()
    return "true or false" if kind == "bool" and not isinstance(value, bool) else ""
