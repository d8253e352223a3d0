"""The tables of docs/reference/configuration.md, from the parameters themselves; `reference_tables` writes them."""

from __future__ import annotations

from dataclasses import MISSING, Field
from typing import Any

from companion.config.sections import SECTIONS, expected, fields_of
from core.param_field import is_safety_key

TITLES = {
    "extractor": "`[extractor]`: sizes of the vehicle and its surroundings",
    "expert": "`[expert]`: constants of the algorithm",
    "open_sky": "`[open_sky]`: unmeasured sky that is presumed free; see [open space](../explanation/open-space.md)",
    "sync": "`[sync]`: attitude of a frame",
    "mount_check": "`[mount_check]`: check of each camera's mount",
    "camera": "`[[camera]]`: one section for each camera",
    "output": "`[output]`: drawings in logs, content of replayed logs",
    "autopilot": "`[autopilot]`: MAVLink connection",
    "avoid": "`[avoid]`: obstacle output to the autopilot",
    "guard": "`[guard]`: stop in automatic flight modes",
    "publish": "`[publish]`: streams",
    "world": "`[world]`: merged world",
    "tracking": "`[tracking]`: tracked obstacles; see [tracking](../explanation/tracking.md)",
    "share": "`[share]`: obstacles shared between vehicles; see [sharing](../explanation/sharing.md)",
    "record": "`[record]`: log of the flight",
    "supervision": "`[supervision]`: failure of a camera",
    "service": "`[service]`: timeouts, metrics",
}

INTRODUCTIONS = {
    "expert": (
        "The defaults were tuned together on the benchmark scenes. Change a key only with a measurement: `check-config`, "
        "`doctor` and `run` name each key that differs, and the log contains it.",
        "",
    )
}
"""Lines between the title and the table."""

FIRST = ("camera", "extractor", "autopilot", "avoid", "guard", "publish", "record", "supervision", "service")
"""Sections that users set come first in the document, the expert section comes last."""


def settings() -> str:
    """Markdown of all sections: key, default, what may stand there, meaning, whether it is a safety key."""
    parts: list[str] = []
    for section in (*FIRST, *(s for s in SECTIONS if s not in (*FIRST, "expert")), "expert"):
        parts += [
            f"## {TITLES[section]}",
            "",
            *INTRODUCTIONS.get(section, ()),
            "| key | default | range | meaning | safety |",
            "|---|---|---|---|---|",
        ]
        parts += [_row(f) for f in fields_of(section)]
        parts.append("")
    return "\n".join(parts).rstrip()


def _row(f: Field[Any]) -> str:
    if f.default is MISSING:
        default = "required"
    elif f.default is None:
        default = "as recorded"
    elif isinstance(f.default, bool):
        default = f"`{str(f.default).lower()}`"
    else:
        default = f'`"{f.default}"`' if isinstance(f.default, str) else f"`{f.default:g}`"
    meaning = str(f.metadata["doc"]).replace("|", "\\|")
    return f"| `{f.name}` | {default} | {_range(f)} | {meaning} | {'yes' if is_safety_key(f) else ''} |"


def _range(f: Field[Any]) -> str:
    """What may stand there, shorter than in an error; nothing for a switch, whose default shows its kind."""
    text = expected(f)
    return {"true or false": "", "a text in quotes": "text"}.get(text, text.replace("a whole number", "integer"))
