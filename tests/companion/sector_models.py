"""Models of frames with walls and free space, and their sectors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform
from core.types import FrameModel, FreeEnd, FreeProfile, Ground

from .small_recordings import easy_model

AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, min_distance_m=0.2)
HERE = LevelTransform(0.0, (0.0, 0.0, 0.0))
NS = 1_000_000_000


def model(
    *planes: tuple[float, ...], free_to_m: float = 0.0, view_deg: float = 360.0, margin: float = 0.0
) -> FrameModel:
    """Planes and a profile that is free to one range over a view around the nose."""
    half = math.radians(view_deg) / 2
    edges = np.linspace(-half, half, 37).astype(np.float32)
    n = len(planes)
    return replace(
        easy_model(1.0, 0.0),
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.ones(n, np.int32),
        margin_m=np.full(n, margin, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
        prisms=(),
        ground=Ground(seen=False),
        free=FreeProfile(
            azimuth_edges_rad=edges,
            layer_edges_m=np.array([-3.0, -1.0, 1.0, 3.0], np.float32),
            free_from_m=np.full((36, 3), 1.5, np.float32),
            free_to_m=np.full((36, 3), free_to_m, np.float32),
            end=np.full((36, 3), FreeEnd.MAX_RANGE, np.uint8),
        ),
    )


def wall_at(angle_deg: float, distance_m: float, width_m: float = 0.12) -> tuple[float, ...]:
    """A narrow plane square to a direction; its nearest point at the distance, give or take its width."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    x, y, w = distance_m * c, distance_m * s, width_m / 2
    return (x + w * s, y - w * c, x - w * s, y + w * c, -2.0, 2.0)
