"""Which parameters of the algorithm stand under [extractor] and which under [expert].

Both tables fill one `core.params.Params`. The public keys describe the vehicle and its surroundings. The others are constants
of the algorithm: their defaults were tuned together, and a change needs a measurement.
"""

from __future__ import annotations

from dataclasses import Field, fields
from typing import Any, Final

from core.params import Params

PUBLIC_KEYS: Final = (
    "min_obstacle_height_m",
    "passable_height_m",
    "passable_width_m",
    "segment_height_m",
    "safe_distance_m",
    "max_tilt_deg",
    "ground_tolerance_m",
    "ground_max_slope",
    "ground_max_height_m",
    "profile_layer_m",
    "profile_layers",
    "column_step",
)
"""Keys of [extractor]."""


def public_fields() -> tuple[Field[Any], ...]:
    """The fields of [extractor], in the order of PUBLIC_KEYS."""
    by_name = {f.name: f for f in fields(Params)}
    return tuple(by_name[name] for name in PUBLIC_KEYS)


def expert_fields() -> tuple[Field[Any], ...]:
    """The fields of [expert], in the order of `Params`."""
    return tuple(f for f in fields(Params) if f.name not in PUBLIC_KEYS)
