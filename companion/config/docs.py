"""The tables of docs/reference/configuration.md, made from the parameters themselves (`make config-docs`)."""

from __future__ import annotations

import sys
from dataclasses import MISSING, Field
from pathlib import Path
from typing import Any

from core.param_field import is_safety_key

from .loader import SECTIONS, expected, fields_of

BEGIN, END = "<!-- tables: made by `make config-docs` -->", "<!-- end of the tables -->"
TITLES = {
    "extractor": "`[extractor]`: the algorithm",
    "sync": "`[sync]`: which attitude belongs to a frame",
    "mount_check": "`[mount_check]`: whether each camera is mounted as configured",
    "camera": "`[[camera]]`: one for each camera",
    "output": "`[output]`: what a replay writes",
    "autopilot": "`[autopilot]`: the line to it",
    "avoid": "`[avoid]`: what the autopilot is told of obstacles",
    "publish": "`[publish]`: the streams for planners",
    "world": "`[world]`: what the frames say together",
    "record": "`[record]`: the flight's log",
    "supervision": "`[supervision]`: when a camera is ill",
    "service": "`[service]`: blindness, hangs, metrics",
}


def tables() -> str:
    """Markdown of all sections: key, default, what may stand there, meaning, whether it is a safety key."""
    parts: list[str] = []
    for section in SECTIONS:
        parts += [f"## {TITLES[section]}", "", "| key | default | may be | meaning | safety |", "|---|---|---|---|---|"]
        parts += [_row(f) for f in fields_of(section)]
        parts.append("")
    return "\n".join(parts)


def _row(f: Field[Any]) -> str:
    if f.default is MISSING:
        default = "must be given"
    elif f.default is None:
        default = "as recorded"
    elif isinstance(f.default, bool):
        default = f"`{str(f.default).lower()}`"
    else:
        default = f'`"{f.default}"`' if isinstance(f.default, str) else f"`{f.default:g}`"
    meaning = str(f.metadata["doc"]).replace("|", "\\|")
    return f"| `{f.name}` | {default} | {expected(f)} | {meaning} | {'yes' if is_safety_key(f) else ''} |"


def with_tables(text: str) -> str:
    """A document with the tables between its two marks made anew. Raises ValueError where the marks are missing."""
    if BEGIN not in text or END not in text:
        raise ValueError(f"the document needs the lines {BEGIN} and {END}")
    head, rest = text.split(BEGIN, 1)
    return f"{head}{BEGIN}\n\n{tables()}\n{END}{rest.split(END, 1)[1]}"


if __name__ == "__main__":
    document = Path(sys.argv[1])
    document.write_text(with_tables(document.read_text(encoding="utf-8")), encoding="utf-8")
