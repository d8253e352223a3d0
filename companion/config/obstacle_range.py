"""The range up to which a camera's obstacles are found: shorter than `max_range_m`, by what its noise takes."""

from __future__ import annotations

from core.params import Params
from core.stages.classify import clear_range_m
from core.types import CameraInfo


def obstacle_range_m(info: CameraInfo, ke_per_m: float | None = None, params: Params | None = None) -> float:
    """Depth along the optical axis up to which obstacles are found, m. ke_per_m: the noise in use, None: the camera's prior.

    Measurements beyond it count as far, because an obstacle just short of max_range_m keeps only the near part of its
    noise; see `clear_range_m`."""
    return clear_range_m(info, info.ke_per_m if ke_per_m is None else ke_per_m, params or Params())
