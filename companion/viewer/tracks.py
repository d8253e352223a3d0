"""Tracked obstacles of a frame, for the page: ids, confidence and velocities in `level`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.transform import LevelTransform

AHEAD_S = 1.0
"""The arrow of a moving obstacle ends where it will be after this time."""


def tracks_data(
    message: pb.Tracks, heading_rad: float, position_ned_m: tuple[float, float, float] | None
) -> dict[str, Any] | None:
    """The tracks in `level`, lengths in whole centimetres; None where there are none, where their place is not known, or
    where a number is not finite.

    planes: six numbers each; id, confidence (percent) and object (id of the moving obstacle, 0: static) of each; movers: see
    `_mover`. heading_rad, position_ned_m: of the vehicle."""
    n = len(message.id)
    columns = (message.confidence, message.unseen_ns, message.object_id)
    if n == 0 or len(message.corners_m) != 6 * n or any(len(column) != n for column in columns):
        return None
    if message.frame == "ned" and position_ned_m is None:
        return None
    angle_rad, origin_m = (-heading_rad, position_ned_m) if message.frame == "ned" else (0.0, None)
    at = np.zeros(3) if origin_m is None else np.array(origin_m)
    if not np.isfinite([heading_rad, *at, *message.corners_m, *message.confidence, *_numbers(message)]).all():
        return None
    planes = np.array(message.corners_m, np.float64).reshape(n, 6)
    planes[:, 0:2] = _turned(planes[:, 0:2] - at[:2], angle_rad)
    planes[:, 2:4] = _turned(planes[:, 2:4] - at[:2], angle_rad)
    planes[:, 4:6] -= at[2]
    return {
        "planes": np.rint(100.0 * planes).astype(int).ravel().tolist(),
        "id": list(message.id),
        "confidence": [round(100.0 * c) for c in message.confidence],
        "object": list(message.object_id),
        "movers": [_mover(o, angle_rad, at) for o in message.objects],
    }


def _numbers(message: pb.Tracks) -> list[float]:
    """All numbers of the moving obstacles that are drawn."""
    return [
        number
        for o in message.objects
        for number in (
            *(o.centre_m.x, o.centre_m.y, o.centre_m.z, o.half_size_m.x, o.half_size_m.y, o.half_size_m.z),
            *(o.velocity_x_m_s, o.velocity_y_m_s),
        )
    ]


def _mover(o: pb.MovingObstacle, angle_rad: float, at: NDArray[np.float64]) -> dict[str, Any]:
    """corners: x, y of the four corners of its box; top, bottom; from, to: its middle now and after AHEAD_S; text: id and
    speed."""
    x, y, z = o.centre_m.x - at[0], o.centre_m.y - at[1], o.centre_m.z - at[2]
    hx, hy, hz = o.half_size_m.x, o.half_size_m.y, o.half_size_m.z
    corners = np.array([[x - hx, y - hy], [x + hx, y - hy], [x + hx, y + hy], [x - hx, y + hy]])
    ends = np.array([[x, y], [x + AHEAD_S * o.velocity_x_m_s, y + AHEAD_S * o.velocity_y_m_s]])
    ends = np.rint(100.0 * _turned(ends, angle_rad)).astype(int)
    speed_m_s = math.hypot(o.velocity_x_m_s, o.velocity_y_m_s)
    return {
        "corners": np.rint(100.0 * _turned(corners, angle_rad)).astype(int).ravel().tolist(),
        "top": round(100.0 * (z - hz)),
        "bottom": round(100.0 * (z + hz)),
        "from": [*ends[0].tolist(), round(100.0 * z)],
        "to": [*ends[1].tolist(), round(100.0 * z)],
        "text": f"moving {o.id}: {speed_m_s:.1f} m/s",
    }


def _turned(xy: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """Points (N, 2) rotated about the vertical."""
    return np.stack(LevelTransform(angle_rad).places(*xy.T), axis=1)
