"""OBSTACLE_DISTANCE (330): the sectors as values that PX4 (up to v1.15 and from v1.16 on) and ArduPilot interpret
correctly.

Values in centimetres: 65535, unknown; max + 1, seen clear; min + 1 .. max - 1, an obstacle, because ArduPilot drops
values outside of min .. max and PX4 brakes only for values above min."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.ardupilot_faces import READ_BEFORE, face_of
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import ARDUPILOT, PX4

from ..config.avoidance import AvoidParams
from .polar_histogram import SECTORS, SectorScan, SectorState

UNKNOWN = 65535
BODY_FRD = dialect.MAV_FRAME_BODY_FRD
FACE = np.array([face_of(360.0 / SECTORS * i) for i in range(SECTORS)])
"""(72,) ArduPilot's face of each element."""
SENSOR_UNKNOWN = dialect.MAV_DISTANCE_SENSOR_UNKNOWN
"""There is no value for stereo."""


def encoded(scan: SectorScan, avoid: AvoidParams) -> NDArray[np.uint16]:
    """Returns the centimetres of a scan, (72,)."""
    values = np.full(SECTORS, UNKNOWN, np.uint16)
    values[scan.state == SectorState.CLEAR] = clear_cm(avoid)
    obstacle = scan.state == SectorState.OBSTACLE
    values[obstacle] = near_cm(scan.distance_m[obstacle], avoid)
    return values


def limits_cm(avoid: AvoidParams) -> tuple[int, int]:
    """Returns min_distance and max_distance. They must not change in flight: PX4 keeps the range of the first
    message."""
    return round(100 * avoid.min_distance_m), round(100 * avoid.max_distance_m)


def clear_cm(avoid: AvoidParams) -> int:
    """Returns the value of a clear sector."""
    return limits_cm(avoid)[1] + 1


def always_sent_cm(avoid: AvoidParams) -> int:
    """Returns the distance from the hull up to which an obstacle is sent even if the way to it was not seen free.

    Sectors need not be seen free nearer than near_m."""
    return round(100 * max(0.0, avoid.near_m - avoid.radius_m))


def near_cm(distance_m: NDArray[np.float64], avoid: AvoidParams) -> NDArray[np.uint16]:
    """Returns the centimetres of obstacles, rounded towards the vehicle, in the range that both autopilots use."""
    low, high = limits_cm(avoid)
    return np.clip(np.floor(100.0 * distance_m), low + 1, high - 1).astype(np.uint16)


@dataclass(frozen=True, slots=True, eq=False)
class BrakingReach:
    """Obstacles that are sent to PX4 although an unknown sector is beside them."""

    always_cm: NDArray[np.float64]  # (72,) an obstacle up to this distance is sent as it is
    # (72,) one up to this distance is sent at `wall_cm`, by which PX4 brakes and does not move into the sector
    approach_cm: NDArray[np.float64]
    wall_cm: int = 0  # distance of the wall of the policy `brake`; 0: none


def only_near(distance_cm: float) -> BrakingReach:
    """Returns the reach by which obstacles up to a distance are sent, and no farther ones."""
    return BrakingReach(np.full(SECTORS, float(distance_cm)), np.zeros(SECTORS))


def beside_unknown(nearest: NDArray[np.uint16], clear: int, reach: BrakingReach) -> NDArray[np.uint16]:
    """Returns what becomes of the nearest values, (72,), of elements whose bin reaches into an unknown sector."""
    obstacle = nearest < clear
    braked = obstacle & (nearest <= reach.approach_cm)
    out = np.where(braked, np.minimum(nearest, np.uint16(reach.wall_cm)), UNKNOWN)
    return np.where(obstacle & (nearest <= reach.always_cm), nearest, out).astype(np.uint16)


def for_coarse_bins(values: NDArray[np.uint16], clear: int, reach: BrakingReach) -> NDArray[np.uint16]:
    """Returns the values for PX4 up to v1.15, which has bins of 10 degrees and reads only the even elements.

    Each even element becomes the least of itself and its neighbours. If one of the three is unknown it becomes
    unknown, since a bin stands for all its sectors, unless the least is an obstacle within `reach`."""
    three = np.stack([np.roll(values, 1), values, np.roll(values, -1)])
    nearest = three.min(axis=0)
    coarse = np.where((three == UNKNOWN).any(axis=0), beside_unknown(nearest, clear, reach), nearest)
    out = values.copy()
    out[::2] = coarse[::2]
    return out


def for_empty_faces(values: NDArray[np.uint16], clear: int, unknown_cm: int) -> NDArray[np.uint16]:
    """Returns the values for ArduPilot, with a distance in an empty face that would open its fence.

    Its fence is then nowhere beyond an obstacle. A clear element of the face gets the farthest distance; where there is none, an
    unknown one gets unknown_cm. 0: it stays unknown."""
    out = values.copy()
    occupied = values < clear
    for first, empty, third in READ_BEFORE:
        beside = occupied[first == FACE].any() and occupied[third == FACE].any()
        if not beside or occupied[empty == FACE].any():
            continue
        places = np.flatnonzero((empty == FACE) & (values == clear))
        if len(places):
            out[places[len(places) // 2]] = clear - 2
        elif unknown_cm:
            places = np.flatnonzero(empty == FACE)
            out[places[len(places) // 2]] = unknown_cm
    return out


def for_front_face(values: NDArray[np.uint16], clear: int) -> NDArray[np.uint16]:
    """Returns the values for ArduPilot, which reads the sectors in one pass.

    Its front face consists of the elements 0 to 4, which are read first, and 68 to 71, which are read last and
    replace the former. Its low pass (PRX_FILT) takes the former only, because the latter follow within the same
    millisecond. Both parts therefore contain the nearest distance of the whole face: the one without it gets it in its obstacle
    next to the other part. No unknown element gets it: the autopilot may be PX4, which moves into sectors with a value."""
    right, left = (part[values[part] < clear] for part in (np.arange(5), np.arange(SECTORS - 4, SECTORS)))
    out = values.copy()
    if len(right) and len(left):
        nearest = min(values[right].min(), values[left].min())
        if values[right].min() > nearest:
            out[right[0]] = nearest
        if values[left].min() > nearest:
            out[left[-1]] = nearest
    return out


def for_reader(
    values: NDArray[np.uint16],
    avoid: AvoidParams,
    autopilot: str,
    reach: BrakingReach | None = None,
    wall_cm: int = 0,
) -> NDArray[np.uint16]:
    """Returns the values in the form that this kind of autopilot needs; for an unknown kind in the form that suits
    each kind.

    An unknown kind may take unknown for clear, so that no obstacle is replaced by unknown for it. It may also move into sectors
    with a value, so that none farther than the wall replaces unknown.

    Args:
        values: (72,) cm.
        avoid: parameters.
        autopilot: kind of the autopilot.
        reach: obstacles that are sent to PX4 beside unknown; None: only near ones.
        wall_cm: distance of the artificial wall of the policy `stop`; 0: none."""
    clear = clear_cm(avoid)
    if autopilot != ARDUPILOT:
        near = only_near(always_sent_cm(avoid)) if reach is None else reach
        values = for_coarse_bins(values, clear, near if autopilot == PX4 else only_near(clear))
    if autopilot == PX4:
        return values
    unknown_cm = clear - 2 if autopilot == ARDUPILOT else min(wall_cm, clear - 2)
    return for_front_face(for_empty_faces(values, clear, unknown_cm), clear)


def obstacle_distance_message(values: NDArray[np.uint16], time_us: int, avoid: AvoidParams) -> Any:
    """Returns the message. values: (72,) uint16, element i centred on i * 5 degrees clockwise from the nose.

    `increment` and `increment_f` are equal, because autopilots differ in which one they read."""
    low, high = limits_cm(avoid)
    return dialect.MAVLink_obstacle_distance_message(
        time_us, SENSOR_UNKNOWN, [int(v) for v in values], 5, low, high, 5.0, 0.0, BODY_FRD
    )
