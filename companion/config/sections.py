"""The sections of a configuration file: the dataclass that each fills, its keys and their types."""

from __future__ import annotations

import functools
import types
import typing
from dataclasses import Field, fields
from typing import Any, Union

from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.self_check.mount_params import MountCheckParams
from core.tracking.params import TrackingParams
from core.world.params import WorldParams

from .avoidance import AvoidParams
from .camera import CameraConfig, OutputConfig
from .expert import expert_fields, public_fields
from .guard import GuardParams
from .service import AutopilotConfig, PublishConfig, RecordParams, ServiceParams, SupervisorParams
from .share import ShareConfig
from .sync import SyncParams

SECTIONS: dict[str, type] = {
    "extractor": Params,
    "expert": Params,
    "open_sky": OpenSkyParams,
    "sync": SyncParams,
    "mount_check": MountCheckParams,
    "camera": CameraConfig,
    "output": OutputConfig,
    "autopilot": AutopilotConfig,
    "avoid": AvoidParams,
    "guard": GuardParams,
    "publish": PublishConfig,
    "world": WorldParams,
    "tracking": TrackingParams,
    "share": ShareConfig,
    "record": RecordParams,
    "supervision": SupervisorParams,
    "service": ServiceParams,
}
"""TOML section -> the dataclass it fills; `camera` may stand several times, `extractor` and `expert` fill one together."""


def expected(f: Field[Any]) -> str:
    """What a key may hold, as text."""
    meta, kind = f.metadata, plain_type(f)
    if "choices" in meta:
        return "one of " + ", ".join(f'"{c}"' for c in meta["choices"])
    if "min" in meta:
        unit = f" {meta['unit']}" if meta["unit"] else ""
        whole = "a whole number " if kind is int else ""
        low, high = (str(v) if isinstance(v, int) else f"{v:g}" for v in (meta["min"], meta["max"]))
        return f"{whole}{low}..{high}{unit}"
    return {bool: "true or false", str: "a text in quotes"}.get(kind, "a number")


def fields_of(section: str) -> tuple[Field[Any], ...]:
    """The keys of a section, in order."""
    if section in ("extractor", "expert"):
        return public_fields() if section == "extractor" else expert_fields()
    return fields(SECTIONS[section])


def plain_type(f: Field[Any]) -> Any:
    """int of `int`, float of `float | None`."""
    owner = next(c for c in SECTIONS.values() if any(g is f for g in fields(c)))
    hint = _hints(owner)[f.name]
    if typing.get_origin(hint) in (Union, types.UnionType):
        return next(a for a in typing.get_args(hint) if a is not types.NoneType)
    return hint


@functools.cache
def _hints(owner: type) -> dict[str, Any]:
    """Types of a dataclass's fields: kept, since each key asks for all of them, and a start must be quick."""
    return typing.get_type_hints(owner)
