"""Decoding of a camera's message (osape.v1.PrismsFrame).

Every function raises ValueError for a message whose parts do not fit together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .integers import flags, integers
from .model import MOST_M, CameraModel, FreeProfile, Ground, Prism
from .proto import osape_v1_pb2 as pb

DEFAULT_GROUND_TOLERANCE_M: Final = 0.6
"""Not tuning: tolerance of a ground whose message lacks one. It is the default `min_obstacle_height_m` of the service, the
most that the ground's noise reaches up to where free space above it is judged at all (`Ground.blind_beyond_m`)."""
MOST_TURN_RAD: Final = math.tau + 1e-5
"""Not tuning: directions of a profile are at most one turn, and the rounding of its edges to float32."""


def cause_code(number: int) -> str:
    """The code of an osape.v1.Cause: CAUSE_GAP_TOO_WIDE is gap_too_wide; "" for CAUSE_NONE, unknown_NUMBER for one of a
    newer version."""
    if number == pb.CAUSE_NONE:
        return ""
    try:
        name: str = pb.Cause.Name(number)
    except ValueError:
        return f"unknown_{number}"
    return name.removeprefix("CAUSE_").lower()


def model_from_message(message: pb.PrismsFrame) -> CameraModel | None:
    """The model of a message, in the message's frame; None for a frame that was not processed, which has none."""
    if not message.HasField("stats"):
        return None
    if message.valid and message.cause != pb.CAUSE_NONE:
        raise ValueError(f"cause {message.cause} of a valid frame; is the message damaged?")
    planes = message.planes
    _check_planes(planes)
    return CameraModel(
        valid=message.valid,
        planes=_rows(planes.corners_m, 6, "corners_m"),
        support_px=integers(planes.support_px, np.int32, "support_px"),
        margin_m=np.array(planes.margin_m, dtype=np.float32),
        flags=flags(planes.flags),
        cluster=np.array(planes.cluster, dtype=np.int32),
        prisms=tuple(prism_from_message(prism) for prism in message.prisms),
        free=free_from_message(message.free),
        ground=ground_from_message(message.ground),
    )


def _check_planes(planes: pb.Planes) -> None:
    """Raises ValueError where a plane is not of positions, or its margin is not 0..MOST_M: such a plane would touch nothing, and
    the space that it occupies would not be occupied."""
    if not (np.abs(planes.corners_m) <= MOST_M).all():
        raise ValueError(f"planes: corners_m is not finite or beyond {MOST_M:g} m; is the message damaged?")
    if not all(0.0 <= margin_m <= MOST_M for margin_m in planes.margin_m):
        raise ValueError(f"planes: margin_m is not within 0..{MOST_M:g} m; is the message damaged?")


def prism_from_message(message: pb.Prism) -> Prism:
    """One prism of a message. Raises ValueError where a number is not finite or the margin is negative: such a prism would
    contain nothing."""
    if not np.isfinite([message.top_m, message.bottom_m, *message.vertices_m]).all():
        raise ValueError("prisms: a number is not finite; is the message damaged?")
    if not 0.0 <= message.margin_m < math.inf:
        raise ValueError("prisms: margin_m is not a finite number of 0 or more; is the message damaged?")
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
    """The free-range profile of a message. Raises ValueError where tables do not fit, a range or an edge is not finite or beyond
    MOST_M, edges are not increasing, or the directions are more than one turn."""
    azimuth_edges_rad = _rising(message.azimuth_edges_rad, "azimuth_edges_rad")
    if len(azimuth_edges_rad) and float(azimuth_edges_rad[-1]) - float(azimuth_edges_rad[0]) > MOST_TURN_RAD:
        raise ValueError("azimuth_edges_rad: more than one turn; is the message damaged?")
    layers = max(0, len(message.layer_edges_m) - 1)
    directions = max(0, len(message.azimuth_edges_rad) - 1)
    return FreeProfile(
        azimuth_edges_rad=azimuth_edges_rad,
        layer_edges_m=_rising(message.layer_edges_m, "layer_edges_m"),
        free_from_m=_table(_finite(message.free_from_m, "free_from_m"), directions, layers, "free_from_m"),
        free_to_m=_table(_finite(message.free_to_m, "free_to_m"), directions, layers, "free_to_m"),
        end=_table(np.frombuffer(message.end, dtype=np.uint8), directions, layers, "end"),
        **_open_ranges(message, directions, layers),
    )


def _open_ranges(message: pb.FreeProfile, directions: int, layers: int) -> dict[str, NDArray[np.uint8]]:
    """The open ranges of a profile; none where the message has none, as those of older versions."""
    if not (message.open_from_dm or message.open_to_dm):
        return {}
    return {
        name: _table(np.frombuffer(getattr(message, name), dtype=np.uint8), directions, layers, name)
        for name in ("open_from_dm", "open_to_dm")
    }


def _finite(values: Iterable[float], name: str) -> NDArray[np.float32]:
    """Ranges of a profile as (N,) float32. Raises ValueError where one is not finite or beyond MOST_M: it would be free without an
    end."""
    ranges_m = np.fromiter(values, dtype=np.float32)
    if not (np.abs(ranges_m) <= MOST_M).all():
        raise ValueError(f"{name} is not finite or beyond {MOST_M:g} m; is the message damaged?")
    return ranges_m


def _rising(values: Iterable[float], name: str) -> NDArray[np.float32]:
    """Edges of a profile as (N,) float32. Raises ValueError where they are not finite, within MOST_M and increasing: a search among
    them would find a wrong direction or layer."""
    edges = np.fromiter(values, dtype=np.float32)
    if not ((np.abs(edges) <= MOST_M).all() and (np.diff(edges) >= 0.0).all()):
        raise ValueError(f"{name}: expected finite increasing numbers; is the message damaged?")
    return edges


def ground_from_message(message: pb.Ground) -> Ground:
    """The ground of a message. One of an older version lacks the tolerance and gets DEFAULT_GROUND_TOLERANCE_M.

    Raises ValueError where a ground that was found has a number that is not finite or beyond MOST_M, or a margin that is
    negative."""
    old = message.seen and not message.HasField("tolerance_m")
    tolerance_m = DEFAULT_GROUND_TOLERANCE_M if old else message.tolerance_m
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
    """Raises ValueError for a ground above which free space cannot be judged."""
    for name in ("height_m", "slope_x", "slope_y", "noise_per_m", "seen_from_m", "seen_to_m"):
        if not (np.abs(getattr(message, name)) <= MOST_M).all():
            raise ValueError(f"ground: {name} is not finite or beyond {MOST_M:g}; is the message damaged?")
    for name, margin in (("tolerance_m", tolerance_m), ("noise_per_m", message.noise_per_m)):
        if not 0.0 <= margin <= MOST_M:
            raise ValueError(f"ground: {name} = {margin:g}, expected 0..{MOST_M:g}; is the message damaged?")


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
