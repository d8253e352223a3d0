"""The model of a frame, out of its message (osape.v1). Planners use this file too: it needs protobuf and numpy only.

Every function raises ValueError for a message that does not fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel, FrameStats, FreeProfile, Ground, InvalidCause, Prism
from drivers.proto import osape_v1_pb2 as pb

from .causes import cause_from_number

STATS: Final = tuple(f.name for f in dataclasses.fields(FrameStats))
"""Names of the counts of a frame."""
UNTOLD_TOLERANCE_M: Final = 0.6
"""Not tuning: the default `min_obstacle_height_m`, which is the most that the ground's noise reaches up to where the free
space above it is judged at all (`Ground.blind_beyond_m`)."""


def model_from_message(message: pb.PrismsFrame) -> FrameModel | None:
    """The model of a message, in the message's frame; None for a dropped frame, which has none."""
    if not message.HasField("stats"):
        return None
    cause = cause_from_number(message.cause, InvalidCause)
    if not isinstance(cause, InvalidCause):
        raise ValueError(f"cause {message.cause} of a frame that was extracted")
    planes = message.planes
    return FrameModel(
        valid=message.valid,
        cause=cause,
        planes=_rows(planes.corners_m, 6, "corners_m"),
        support_px=np.array(planes.support_px, dtype=np.int32),
        margin_m=np.array(planes.margin_m, dtype=np.float32),
        flags=np.array(planes.flags, dtype=np.uint8),
        cluster=np.array(planes.cluster, dtype=np.int32),
        prisms=tuple(prism_from_message(prism) for prism in message.prisms),
        free=free_from_message(message.free),
        ground=ground_from_message(message.ground),
        stats=FrameStats(**{name: getattr(message.stats, name) for name in STATS}),
        ke_per_m=message.ke_per_m,
    )


def prism_from_message(message: pb.Prism) -> Prism:
    """One prism of a message."""
    return Prism(
        cluster=message.cluster,
        top_m=message.top_m,
        bottom_m=message.bottom_m,
        closed=message.closed,
        margin_m=message.margin_m,
        vertices_m=_rows(message.vertices_m, 2, "vertices_m"),
        plane=np.array(message.plane, dtype=np.int32),
    )


def free_from_message(message: pb.FreeProfile) -> FreeProfile:
    """The free-range profile of a message. Raises ValueError where tables do not fit or edges are not finite and rising."""
    layers = max(0, len(message.layer_edges_m) - 1)
    directions = max(0, len(message.azimuth_edges_rad) - 1)
    return FreeProfile(
        azimuth_edges_rad=_rising(message.azimuth_edges_rad, "azimuth_edges_rad"),
        layer_edges_m=_rising(message.layer_edges_m, "layer_edges_m"),
        free_from_m=_table(np.array(message.free_from_m, dtype=np.float32), directions, layers, "free_from_m"),
        free_to_m=_table(np.array(message.free_to_m, dtype=np.float32), directions, layers, "free_to_m"),
        end=_table(np.frombuffer(message.end, dtype=np.uint8), directions, layers, "end"),
    )


def _rising(values: Iterable[float], name: str) -> NDArray[np.float32]:
    """Edges of a profile as (N,) float32. Raises ValueError where they are not finite and rising: a search among them would
    find a wrong direction or layer."""
    edges = np.fromiter(values, dtype=np.float32)
    if not (np.isfinite(edges).all() and (np.diff(edges) >= 0.0).all()):
        raise ValueError(f"{name}: expected finite numbers that rise; is the message damaged?")
    return edges


def ground_from_message(message: pb.Ground) -> Ground:
    """The ground of a message. One of an older version has no tolerance: it gets UNTOLD_TOLERANCE_M.

    Raises ValueError where a ground that was seen has a number that is not finite or a margin that is negative."""
    old = message.seen and not message.HasField("tolerance_m")
    tolerance_m = UNTOLD_TOLERANCE_M if old else message.tolerance_m
    if message.seen:
        _check_ground(message, tolerance_m)
    return Ground(
        seen=message.seen,
        height_m=message.height_m,
        slope_x=message.slope_x,
        slope_y=message.slope_y,
        share=message.share,
        blind_beyond_m=message.blind_beyond_m,
        tolerance_m=tolerance_m,
        noise_per_m=message.noise_per_m,
        seen_from_m=tuple(message.seen_from_m),
        seen_to_m=tuple(message.seen_to_m),
    )


def _check_ground(message: pb.Ground, tolerance_m: float) -> None:
    """Raises ValueError for a ground above which free space cannot be told."""
    for name in ("height_m", "slope_x", "slope_y", "noise_per_m", "seen_from_m", "seen_to_m"):
        if not np.isfinite(getattr(message, name)).all():
            raise ValueError(f"ground: {name} is not finite; is the message damaged?")
    for name, margin in (("tolerance_m", tolerance_m), ("noise_per_m", message.noise_per_m)):
        if not 0.0 <= margin < math.inf:
            raise ValueError(
                f"ground: {name} = {margin:g}, expected a finite number of 0 or more; is the message damaged?"
            )


def _rows(values: Iterable[float], columns: int, name: str) -> NDArray[np.float32]:
    """(N, columns) float32 of packed numbers."""
    flat = np.array(list(values), dtype=np.float32)
    if len(flat) % columns:
        raise ValueError(f"{name}: {len(flat)} numbers do not make rows of {columns}")
    return flat.reshape(-1, columns)


def _table(flat: NDArray[Any], directions: int, layers: int, name: str) -> NDArray[Any]:
    if len(flat) != directions * layers:
        raise ValueError(f"{name}: {len(flat)} numbers, expected {directions} directions x {layers} layers")
    return flat.reshape(directions, layers)
