"""A frame's model made invalid after its extraction."""

from __future__ import annotations

import numpy as np

from .types import FrameModel, FreeEnd, FreeProfile, InvalidCause

_SIDE_RAD = 0.1
"""Where the directions of a profile end that reports nothing."""


def invalid_model(model: FrameModel, cause: InvalidCause) -> FrameModel:
    """An invalid model with this cause: no planes, nothing free. Ground, counts and noise stay, as what was measured."""
    directions, layers = model.free.end.shape
    nothing = np.zeros((directions, layers), np.float32)
    return FrameModel(
        valid=False,
        cause=cause,
        planes=model.planes[:0],
        support_px=model.support_px[:0],
        margin_m=model.margin_m[:0],
        flags=model.flags[:0],
        cluster=model.cluster[:0],
        prisms=(),
        free=FreeProfile(
            azimuth_edges_rad=np.linspace(-_SIDE_RAD, _SIDE_RAD, directions + 1, dtype=np.float32),
            layer_edges_m=np.arange(layers + 1, dtype=np.float32),
            free_from_m=nothing,
            free_to_m=nothing,
            end=np.full((directions, layers), FreeEnd.NOT_SEEN, np.uint8),
        ),
        ground=model.ground,
        stats=model.stats,
        ke_per_m=model.ke_per_m,
        strips=None,
    )
