"""OBSTACLE_DISTANCE_3D (11037): obstacles as points, for ArduPilot only, which keeps five layers of 30 degrees of
elevation.

The middle layer has the values of OBSTACLE_DISTANCE: sectors, remembered obstacles, and the wall when blind. The
layers above and below contain only what the cameras see there now; ArduPilot takes the rest of them for clear. All
messages of one time are one scan, which takes effect when the next scan begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.ardupilot_faces import FACES, READ_BEFORE
from drivers.mavlink.dialect import dialect

from ..config.avoidance import AvoidParams
from .obstacle_distance import BODY_FRD, SENSOR_UNKNOWN, clear_cm
from .polar_histogram import centres_rad
from .view_free import View

LAYERS_RAD = tuple(
    (math.radians(a), math.radians(b)) for a, b in ((-89.0, -45.5), (-44.5, -15.5), (15.5, 44.5), (45.5, 89.0))
)
"""Elevations of the layers without the middle one, half a degree inside of their borders, so that rounding puts no
point into the next layer."""
FACE_RAD = math.tau / FACES
PLACES = 65
_ALONG = np.linspace(0.0, 1.0, PLACES)
NO_ID = 65535
"""obstacle_id: not tracked."""
NO_POINTS = np.zeros((0, 3))


def level_points(values: NDArray[np.uint16], avoid: AvoidParams) -> NDArray[np.float64]:
    """Returns a point, (N, 3) m, for each sector with an obstacle. values: (72,) cm of OBSTACLE_DISTANCE."""
    occupied = values < clear_cm(avoid)
    distance_m, azimuth = values[occupied] / 100.0, centres_rad()[occupied]
    return np.column_stack([distance_m * np.cos(azimuth), distance_m * np.sin(azimuth), np.zeros(occupied.sum())])


def other_points(views: Sequence[View], avoid: AvoidParams) -> NDArray[np.float64]:
    """Returns the nearest point of any plane in each layer except the middle one and in each of eight faces, (N, 3) m
    in level, and the farthest point in empty faces that would open ArduPilot's fence.

    The distance of a point is that from the hull, less the margin of the plane."""
    found = [_points_of(view, avoid) for view in views if view.model.valid and len(view.model.planes)]
    if not found:
        return NO_POINTS
    layer, azimuth, elevation, range_m = (np.concatenate(column) for column in zip(*found, strict=True))
    face = np.round(azimuth / FACE_RAD).astype(int) % FACES
    order = np.argsort(-range_m, kind="stable")  # the nearest one is assigned last and is kept
    nearest = np.full((len(LAYERS_RAD), FACES), -1)
    nearest[layer[order], face[order]] = order
    occupied = nearest >= 0
    occupied[occupied] = range_m[nearest[occupied]] < avoid.max_distance_m
    kept = nearest[occupied]
    sent_m = np.maximum(range_m[kept], avoid.min_distance_m + 0.01)
    return np.concatenate([_places_at(sent_m, azimuth[kept], elevation[kept]), _in_empty_faces(occupied, avoid)])


def _in_empty_faces(occupied: NDArray[np.bool_], avoid: AvoidParams) -> NDArray[np.float64]:
    """Returns the farthest point, (N, 3), in each empty face that would open ArduPilot's fence. occupied: (layers, faces)."""
    found = [
        (avoid.max_distance_m - 0.01, FACE_RAD * empty, 0.5 * (bottom + top))
        for layer, (bottom, top) in enumerate(LAYERS_RAD)
        for first, empty, third in READ_BEFORE
        if occupied[layer, [first, third]].all() and not occupied[layer, empty]
    ]
    return _places_at(*np.array(found).reshape(-1, 3).T)


def _places_at(
    range_m: NDArray[np.float64], azimuth: NDArray[np.float64], elevation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns the places, (N, 3), at ranges, azimuths and elevations, (N,) each."""
    flat_m = range_m * np.cos(elevation)
    return np.column_stack([flat_m * np.cos(azimuth), flat_m * np.sin(azimuth), -range_m * np.sin(elevation)])


def _points_of(view: View, avoid: AvoidParams) -> tuple[NDArray[np.int64], *tuple[NDArray[np.float64], ...]]:
    """Returns (layer, azimuth, elevation up, range to the hull), each (M,), of the places along each plane, in each
    layer.

    A place stands for half a step to either side, with the nearest distance that may be there."""
    planes = view.model.planes.astype(np.float64)
    share, half_m = _places(planes[:, 0:2], planes[:, 2:4], avoid.max_distance_m)
    x, y = (planes[:, i, None] + share * (planes[:, i + 2] - planes[:, i])[:, None] for i in (0, 1))
    flat_m = np.hypot(x, y)
    near_m, far_m = np.maximum(flat_m - half_m, 0.01), np.maximum(flat_m + half_m, 0.01)
    under, over = -planes[:, 5:6], -planes[:, 4:5]  # heights, upwards
    low = np.where(under > 0.0, np.arctan2(under, far_m), np.arctan2(under, near_m))
    high = np.where(over > 0.0, np.arctan2(over, near_m), np.arctan2(over, far_m))
    off_m = (avoid.radius_m + view.model.margin_m)[:, None]
    columns = []
    for layer, (bottom, top) in enumerate(LAYERS_RAD):
        first, last = np.maximum(low, bottom), np.minimum(high, top)
        inside = first <= last
        elevation = np.clip(0.0, first, np.maximum(first, last))
        range_m = np.maximum(0.0, near_m / np.cos(elevation) - off_m)
        columns.append((np.full(inside.sum(), layer), np.arctan2(y, x)[inside], elevation[inside], range_m[inside]))
    layers, *rest = (np.concatenate(column) for column in zip(*columns, strict=True))
    return layers, *rest


def _places(
    a: NDArray[np.float64], b: NDArray[np.float64], reach_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns shares of the segments a -> b, (N, PLACES), evenly over the part within reach, and half a step in m,
    (N, 1)."""
    along = b - a
    length_m = np.maximum(np.hypot(*along.T), 1e-6)
    middle = -(a * along).sum(axis=1) / length_m**2
    off2 = ((a + middle[:, None] * along) ** 2).sum(axis=1)
    half = np.sqrt(np.maximum(reach_m**2 - off2, 0.0)) / length_m
    first, last = np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)
    share = first[:, None] + _ALONG * (last - first)[:, None]
    half_m: NDArray[np.float64] = (0.5 * (last - first) * length_m / (PLACES - 1))[:, None]
    return share, half_m


def obstacle_points_messages(points_m: NDArray[np.float64], time_ms: int, avoid: AvoidParams) -> list[Any]:
    """Returns the messages of one scan, one per point.

    Without points a single message beyond the farthest distance is sent, which is no obstacle but keeps the sensor
    alive. time_ms: two scans in a row must not have the same."""
    points = points_m.tolist() or [[avoid.max_distance_m + 1.0, 0.0, 0.0]]
    return [
        dialect.MAVLink_obstacle_distance_3d_message(
            time_ms % 2**32, SENSOR_UNKNOWN, BODY_FRD, NO_ID, x, y, z, avoid.min_distance_m, avoid.max_distance_m
        )
        for x, y, z in points
    ]
