"""Models of frames without information: no planes, nothing free."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .types import FrameModel, FrameStats, FreeEnd, FreeProfile, Ground, InvalidCause

_SIDE_RAD = 0.1
"""Where the directions of a profile end that reports nothing."""


def unknown_profile(azimuth_edges_rad: NDArray[np.float32], layer_edges_m: NDArray[np.float32]) -> FreeProfile:
    """Returns a profile with these directions and layers, in which nothing is free."""
    nothing = np.zeros((len(azimuth_edges_rad) - 1, len(layer_edges_m) - 1), np.float32)
    return FreeProfile(
        azimuth_edges_rad=azimuth_edges_rad,
        layer_edges_m=layer_edges_m,
        free_from_m=nothing,
        free_to_m=nothing,
        end=np.full(nothing.shape, FreeEnd.NOT_SEEN, np.uint8),
    )


def unknown_model(
    cause: InvalidCause, free: FreeProfile, ground: Ground, stats: FrameStats, ke_per_m: float
) -> FrameModel:
    """Returns an invalid model without planes."""
    return FrameModel(
        valid=False,
        cause=cause,
        planes=np.zeros((0, 6), np.float32),
        support_px=np.zeros(0, np.int32),
        margin_m=np.zeros(0, np.float32),
        flags=np.zeros(0, np.uint8),
        cluster=np.zeros(0, np.int32),
        prisms=(),
        free=free,
        ground=ground,
        stats=stats,
        ke_per_m=ke_per_m,
    )


def invalid_model(model: FrameModel, cause: InvalidCause) -> FrameModel:
    """An invalid model with this cause: no planes, nothing free. Ground, counts and noise stay, as what was measured."""
    directions, layers = model.free.end.shape
    azimuths = np.linspace(-_SIDE_RAD, _SIDE_RAD, directions + 1, dtype=np.float32)
    free = unknown_profile(azimuths, np.arange(layers + 1, dtype=np.float32))
    return unknown_model(cause, free, model.ground, model.stats, model.ke_per_m)
