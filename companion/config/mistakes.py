"""The mistakes of a configuration as text: where, what is there, what is allowed, what to do."""

from __future__ import annotations

import difflib
import json
from typing import Any

from .expert import expert_fields
from .sections import SECTIONS, expected, fields_of, plain_type

TOO_DEEP = "nested deeper than can be read"
TOO_LONG = "a number has thousands of digits; correct it"
SHOWN_CHARACTERS = 200
"""Of a wrong value in a message."""
PARTS_OF_ADDRESS = ("baud", "baudrate", "baud_rate", "device", "port")
"""Keys of other programs for what is in [autopilot] address."""


def mistake_text(error: Any) -> str:
    """One mistake as text: where it is, what is there, what is allowed, what to do."""
    path: tuple[Any, ...] = error["loc"]
    section = str(path[0])
    where = _place(path)
    if error["type"] == "extra_forbidden":
        return _unknown(path, where)
    if error["type"] == "missing":
        return f"{where} is missing: {_doc(section, path[-1])}"
    if section not in SECTIONS or len(path) < (3 if section == "camera" else 2):
        form = (
            "[[camera]] with double brackets" if section == "camera" else f"a section [{section}] with single brackets"
        )
        return f"{where}: expected {form}"
    key = next(f for f in fields_of(section) if f.name == path[-1])
    if isinstance(error["input"], str) and "\0" in error["input"]:
        return f"{where} = {_shown(error['input'])}: a NUL character cannot be in a text; remove it"
    if isinstance(error["input"], str) and plain_type(key) is str and "choices" not in key.metadata:
        return f"{where} = {_shown(error['input'])}: not of the expected form ({key.metadata['doc']})"
    form = "a number without quotes and unit, " if isinstance(error["input"], str) and "min" in key.metadata else ""
    return f"{where} = {_shown(error['input'])}: expected {form}{expected(key)} ({key.metadata['doc']})"


def _shown(value: Any) -> str:
    """A wrong value as it would stand in JSON, shortened."""
    try:
        text = json.dumps(value, default=str, ensure_ascii=False)
    except RecursionError:
        return f"(a value {TOO_DEEP})"
    except ValueError:
        return "(a number of thousands of digits)"
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}..."


def _place(path: tuple[Any, ...]) -> str:
    if path[0] == "camera" and len(path) > 1 and isinstance(path[1], int):
        number = f"[[camera]] number {path[1] + 1}"
        return f"{number}: {path[2]}" if len(path) > 2 else number
    return f"[{path[0]}] {path[1]}" if len(path) > 1 else f"[{path[0]}]"


def _unknown(path: tuple[Any, ...], where: str) -> str:
    key, section = str(path[-1]), str(path[0])
    at_top = len(path) == 1
    known = list(SECTIONS) if at_top else [f.name for f in fields_of(section)]
    experts = [f.name for f in expert_fields()] if section == "extractor" else []
    if section == "autopilot" and key in PARTS_OF_ADDRESS:
        return (
            f"{where}: no such key; it is a part of address, such as serial:/dev/ttyAMA0:921600 or udpin:0.0.0.0:14540"
        )
    near = _nearest(key, known, 0.7)
    homes = [_header(name) for name in SECTIONS if any(f.name == key for f in fields_of(name))]
    if homes and not near:
        place = " or ".join(homes)
        return f"{key}: belongs under {place}; put it below that line" if at_top else f"{where}: belongs under {place}"
    if not near and (expert := _nearest(key, experts, 0.7)):
        return f"{where}: no such key; did you mean {expert} below [expert]?"
    near = near or _nearest(key, known, 0.5)
    remedy = f"did you mean {near}?" if near else f"there are: {', '.join(known)}"
    return f"{where}: no such {'section' if at_top else 'key'}; {remedy}"


def _nearest(key: str, names: list[str], cutoff: float) -> str:
    """Returns the most similar name; "" if none is similar enough."""
    return next(iter(difflib.get_close_matches(key, names, n=1, cutoff=cutoff)), "")


def _header(section: str) -> str:
    return "[[camera]]" if section == "camera" else f"[{section}]"


def _doc(section: str, key: Any) -> str:
    return str(next(f.metadata["doc"] for f in fields_of(section) if f.name == key))
