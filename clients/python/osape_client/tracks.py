"""Tracked obstacles of one camera (osape.v1.Tracks): decoding, and the place of a moving obstacle at another time.

They are additional information: where no track is, nothing is known to be free. Ask `Subscriber` for that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from .integers import flags, integers
from .proto import osape_v1_pb2 as pb

NS = 1_000_000_000


class TrackState(StrEnum):
    """How the newest frame observed a track. UNKNOWN: of a newer version of the service."""

    UNKNOWN = "unknown"
    NEW = "new"
    DETECTED = "detected"
    MISSED = "missed"
    HIDDEN = "hidden"
    OUT_OF_VIEW = "out_of_view"


STATES = tuple(TrackState)
"""By number of osape.v1.Tracks.State."""


@dataclass(frozen=True, slots=True)
class MovingObstacle:
    """A group of tracks with a velocity. centre_m: middle of the box of its planes; half_size_m:
    half of its box; velocity_m_s: horizontal; sigmas: standard deviations on each axis; covariance_m2_s: of position and
    velocity; age_s, unseen_s: since the first and the newest observation."""

    id: int
    centre_m: tuple[float, float, float]
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]
    position_sigma_m: float
    velocity_sigma_m_s: float
    covariance_m2_s: float
    hits: int
    age_s: float
    unseen_s: float

    def predicted(self, after_s: float) -> tuple[tuple[float, float, float], float]:
        """(centre_m, its standard deviation on each axis) after_s seconds after the exposure, at constant velocity."""
        x, y, z = self.centre_m
        vx, vy = self.velocity_m_s
        p, v = self.position_sigma_m**2, self.velocity_sigma_m_s**2
        variance = p + 2.0 * after_s * self.covariance_m2_s + after_s**2 * v
        return (x + after_s * vx, y + after_s * vy, z), max(variance, 0.0) ** 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The tracks after one frame, N of each. ids: (N,) int64; planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, m;
    margin_m, sigma_m, confidence: (N,) float32; states: N TrackStates; hits: (N,) int32; age_s, unseen_s: (N,) float64;
    flags: (N,) uint8 PlaneFlags; object_id: (N,) int64, 0: static. frame: of all coordinates; valid: whether the newest
    frame was evidence. left_out: detections of that frame without a track, evicted: tracks removed in it, both because the service
    had no room ([tracking] most_tracks): take the obstacles of the frame itself."""

    frame: str
    valid: bool
    ids: NDArray[np.int64]
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    confidence: NDArray[np.float32]
    states: tuple[TrackState, ...]
    hits: NDArray[np.int32]
    age_s: NDArray[np.float64]
    unseen_s: NDArray[np.float64]
    flags: NDArray[np.uint8]
    object_id: NDArray[np.int64]
    objects: tuple[MovingObstacle, ...]
    left_out: int = 0
    evicted: int = 0


def tracks_from_message(message: pb.Tracks) -> Tracks:
    """The tracks of a message. Raises ValueError where its parts do not fit together."""
    n = len(message.id)
    for name in ("margin_m", "sigma_m", "confidence", "state", "hits", "age_ns", "unseen_ns", "flags", "object_id"):
        if len(getattr(message, name)) != n:
            raise ValueError(f"tracks: {len(getattr(message, name))} entries of {name}, expected {n}; is it damaged?")
    if len(message.corners_m) != 6 * n:
        raise ValueError(f"tracks: {len(message.corners_m)} entries of corners_m, expected {6 * n}; is it damaged?")
    planes = np.array(message.corners_m, dtype=np.float32).reshape(n, 6)
    _check_numbers(message)
    return Tracks(
        frame=message.frame,
        valid=message.valid,
        ids=integers(message.id, np.int64, "id"),
        planes=planes,
        margin_m=np.array(message.margin_m, dtype=np.float32),
        sigma_m=np.array(message.sigma_m, dtype=np.float32),
        confidence=np.array(message.confidence, dtype=np.float32),
        states=tuple(STATES[k] if 0 <= k < len(STATES) else TrackState.UNKNOWN for k in message.state),
        hits=integers(message.hits, np.int32, "hits"),
        age_s=np.array(message.age_ns, dtype=np.float64) / NS,
        unseen_s=np.array(message.unseen_ns, dtype=np.float64) / NS,
        flags=flags(message.flags),
        object_id=integers(message.object_id, np.int64, "object_id"),
        objects=tuple(_object(o) for o in message.objects),
        left_out=message.left_out,
        evicted=message.evicted,
    )


def _check_numbers(message: pb.Tracks) -> None:
    """Raises ValueError where a track has a corner that is not finite, or a margin or standard deviation that is not a finite
    number of 0 or more."""
    if not np.isfinite(message.corners_m).all():
        raise ValueError("tracks: corners_m is not finite; is the message damaged?")
    for name in ("margin_m", "sigma_m"):
        if not all(0.0 <= value < math.inf for value in getattr(message, name)):
            raise ValueError(f"tracks: {name} is not a finite number of 0 or more; is the message damaged?")


def _check_object(m: pb.MovingObstacle) -> None:
    """Raises ValueError where a number that places or moves it is not finite, or its size or a standard deviation is
    negative."""
    place = (m.centre_m.x, m.centre_m.y, m.centre_m.z, m.velocity_x_m_s, m.velocity_y_m_s, m.covariance_m2_s)
    sizes = (m.half_size_m.x, m.half_size_m.y, m.half_size_m.z, m.position_sigma_m, m.velocity_sigma_m_s)
    if not all(map(math.isfinite, (*place, *sizes))) or min(sizes) < 0.0:
        raise ValueError(
            "tracks: a moving obstacle has a number that is not finite or a negative size; is the message damaged?"
        )


def _object(m: pb.MovingObstacle) -> MovingObstacle:
    _check_object(m)
    return MovingObstacle(
        id=m.id,
        centre_m=(m.centre_m.x, m.centre_m.y, m.centre_m.z),
        half_size_m=(m.half_size_m.x, m.half_size_m.y, m.half_size_m.z),
        velocity_m_s=(m.velocity_x_m_s, m.velocity_y_m_s),
        position_sigma_m=m.position_sigma_m,
        velocity_sigma_m_s=m.velocity_sigma_m_s,
        covariance_m2_s=m.covariance_m2_s,
        hits=m.hits,
        age_s=m.age_ns / NS,
        unseen_s=m.unseen_ns / NS,
    )
