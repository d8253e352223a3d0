"""Random configurations: each key within its declared range or choices, in combinations that a user could write."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import Field
from typing import Any

import numpy as np

from companion.config.loader import Config, ConfigError, config_of
from companion.config.sections import SECTIONS, fields_of, plain_type
from core.param_field import is_safety_key

Content = dict[str, Any]
"""Section -> key -> value, as TOML gives it; `camera` is a list of such tables."""
Wanted = Callable[[str, Field[Any]], bool]
"""Whether a key of a section may differ from its default."""

NAMES = ("front", "right", "rear", "left")
WIDEST_PX, MOST_HZ = 4096, 120.0
TEXTS: dict[tuple[str, str], tuple[str, ...]] = {
    ("camera", "masks"): (
        "",
        "0,0 20,15",
        "0,0 40,30 0,30; 140,100 159,119",
        "5000,5000 5001,5001",
        "-20,-20 10.5,10.25",
    ),
    ("camera", "follow"): ("", "udpin:127.0.0.1:14551"),
    ("camera", "device"): ("", "/dev/v4l/by-path/a", "14442C10D13D0CD000"),
    ("camera", "serial"): ("", "909522060223"),
    ("camera", "calibration"): ("", "/tmp/SN1.conf"),
    ("autopilot", "address"): ("", "udpin:127.0.0.1:14540", "serial:/dev/ttyAMA0:115200", "tcp:[::1]:5760"),
    ("autopilot", "signing_key"): ("", "/tmp/key"),
    ("publish", "world"): ("", "ipc://{run}/world"),
    ("publish", "world_requests"): ("", "ipc://{run}/world-snapshot"),
    ("publish", "keys"): ("", "/tmp/keys"),
    ("record", "folder"): ("", "~/logs", "/tmp/logs"),
    ("share", "members"): ("", "2,3,5", " 7 "),
    ("share", "origin"): ("", "47.3977, 8.5456, 488", "-90,180,-20000"),
    ("share", "tunnel"): ("", "autopilot", "udpout:127.0.0.1:14600"),
    ("share", "zenoh"): ("", "/tmp/zenoh.json5"),
    ("share", "zenoh_team"): ("team", "a b"),
}
"""Texts of each key with free text; those that are not here keep their default, except for addresses of streams."""
LEVER_SHARE = 0.05
"""Of the positions of cameras that are valid: at most 0.5 m from the autopilot."""
JUDGED_KEYS = {
    "avoid": [
        "rate_hz",
        "radius_m",
        "band_above_m",
        "band_below_m",
        "min_distance_m",
        "max_distance_m",
        "near_m",
        "rays",
        "slices",
        "step_m",
        "remember_s",
        "remember_m",
        "silence_s",
        "stop_hold_s",
        "remember_up_s",
        "recover_frames",
    ],
    "guard": [
        "mission",
        "return_home",
        "guided",
        "limit_speed",
        "deceleration_m_s2",
        "reaction_s",
        "margin_m",
        "side_m",
        "horizon_m",
    ],
}
"""Safety keys of which every value is judged by the truth: the judge reads them, or they may only delay what is clear."""


def any_key(section: str, key: Field[Any]) -> bool:
    """Every key."""
    return True


def judged_key(section: str, key: Field[Any]) -> bool:
    """Keys that by their description cannot report occupied or unknown space as free (`core.param_field`), and those whose
    meaning the judge knows."""
    return not is_safety_key(key) or key.name in JUDGED_KEYS.get(section, ())


def random_value(section: str, key: Field[Any], rng: np.random.Generator) -> Any:
    """A valid value of a key: often an end of its range, otherwise uniform, or uniform in its logarithm."""
    meta, kind = key.metadata, plain_type(key)
    if "choices" in meta:
        return str(rng.choice(meta["choices"]))
    if "min" in meta:
        return _number(kind, meta["min"], meta["max"], rng)
    if kind is bool:
        return bool(rng.random() < 0.5)
    if section == "publish" and key.name not in ("world", "world_requests", "keys"):
        return str(rng.choice([f"ipc://{{run}}/{key.name}", "", f"tcp://127.0.0.1:{5600 + len(key.name)}"]))
    return str(rng.choice(TEXTS.get((section, key.name), (str(key.default),))))


def _number(kind: type, low: float, high: float, rng: np.random.Generator) -> float | int:
    way = rng.random()
    if way < 0.25:
        value = low if rng.random() < 0.5 else high
    elif way < 0.6 or low <= 0.0:
        value = rng.uniform(low, high)
    else:
        value = math.exp(rng.uniform(math.log(low), math.log(high)))
    return int(min(max(round(value), low), high)) if kind is int else float(min(max(value, low), high))


def random_content(rng: np.random.Generator, share: float, wanted: Wanted = any_key) -> Content:
    """The tables of a file in which about this share of the keys are set. They may contradict each other."""
    content: Content = {}
    for section in SECTIONS:
        if section == "camera":
            content[section] = [
                _camera(name, rng, share, wanted) for name in NAMES[: int(rng.choice([1, 1, 2, 2, 3, 4]))]
            ]
        elif table := _table(section, rng, share, wanted):
            content[section] = table
    return content


def _table(section: str, rng: np.random.Generator, share: float, wanted: Wanted) -> Content:
    chosen = [f for f in fields_of(section) if rng.random() < share and wanted(section, f)]
    return {f.name: random_value(section, f, rng) for f in chosen}


def _camera(name: str, rng: np.random.Generator, share: float, wanted: Wanted) -> Content:
    return {"name": name} | {k: v for k, v in _table("camera", rng, share, wanted).items() if k != "name"}


def random_config(
    rng: np.random.Generator, share: float, wanted: Wanted = any_key, *, flies: bool = False
) -> tuple[Content, Config, int]:
    """A file that the configuration accepts, its configuration, and the number of those that it refused before it. flies: with
    obstacles sent to an autopilot, and in half of the files the guard."""

    def for_flight(section: str, key: Field[Any]) -> bool:
        return section != "open_sky" and (section, key.name) != ("camera", "kind") and wanted(section, key)

    for refused in range(10_000):
        content = random_content(rng, share * rng.random(), for_flight if flies else wanted)
        if flies:
            _prepare_flight(content, rng)
        try:
            return content, config_of(content, "drawn"), refused
        except ConfigError:
            continue
    raise RuntimeError("10,000 configurations were refused")


def _prepare_flight(content: Content, rng: np.random.Generator) -> None:
    for camera in content["camera"]:  # on the vehicle, not in the ground or behind the solids
        camera |= {key: camera[key] * LEVER_SHARE for key in ("x_m", "y_m", "z_m") if key in camera}
    content["autopilot"] = content.get("autopilot", {}) | {"address": "udpin:127.0.0.1:14540"}
    content["avoid"] = content.get("avoid", {}) | {"send": True}
    content["guard"] = content.get("guard", {}) | {"enabled": bool(rng.random() < 0.5)}


def toml(content: Mapping[str, Any]) -> str:
    """The text of a file with these tables."""
    lines: list[str] = []
    for section, table in content.items():
        for rows in table if isinstance(table, list) else [table]:
            lines.append(f"[[{section}]]" if isinstance(table, list) else f"[{section}]")
            lines += [f"{key} = {_literal(value)}" for key, value in rows.items()]
    return "\n".join(lines) + "\n"


def _literal(value: Any) -> str:
    return repr(value) if isinstance(value, float) else json.dumps(value)
