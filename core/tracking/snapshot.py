"""What the tracker publishes, and what it passes from one frame to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from ..types import FrameModel
from .losses import Losses

STATE_VERSION = 6
"""Of the layout of the tracker's tables; to be raised when it changes."""
S_NEW, S_DETECTED, S_MISSED, S_HIDDEN, S_OUT_OF_VIEW = 1, 2, 3, 4, 5
"""TrackState as kernels and messages use it."""


class TrackState(Code):
    """How the newest frame observed a track."""

    NEW = "new", "detected, in fewer than three frames so far"
    DETECTED = "detected", "detected in this frame"
    MISSED = "missed", "in view and not detected; removed when this continues"
    HIDDEN = "hidden", "behind a nearer obstacle or where nothing was measured"
    OUT_OF_VIEW = "out_of_view", "outside the observed directions"


STATES = {
    S_NEW: TrackState.NEW,
    S_DETECTED: TrackState.DETECTED,
    S_MISSED: TrackState.MISSED,
    S_HIDDEN: TrackState.HIDDEN,
    S_OUT_OF_VIEW: TrackState.OUT_OF_VIEW,
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackingFrame:
    """The model of one frame for the tracker, with north-aligned axes (z down).

    positioned: the axes are those of ned; otherwise their origin is the vehicle. camera_m: the camera's place in them;
    origin_m: that of the vehicle (zeros without a position). What jumps of the vehicle's estimate are in the frame:
    reset_counter: of the position; position_jump_ns: first stamp after the newest jump of the position, 0: none;
    heading_jumps: of the newest jumps of the heading, the oldest first, the first stamp after each, ns, and its angle,
    clockwise, rad."""

    model: FrameModel
    camera_m: tuple[float, float, float]
    t_ns: int
    positioned: bool
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reset_counter: int = 0
    position_jump_ns: int = 0
    heading_jumps: tuple[tuple[int, float], ...] = ()

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.camera_m, *self.origin_m))):
            raise ValueError(f"tracking: the camera at {self.t_ns} ns is at {self.camera_m}: expected finite numbers")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackSnapshot:
    """The tracks after one frame, N of each, in the frame's axes.

    ids: (N,) int64; planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, m; margin_m: (N,) float32, what a consumer
    subtracts; sigma_m: (N,) float32, standard deviation of the filtered place across the plane; confidence: (N,) float32
    0..1; state: (N,) int32, key of STATES; hits: (N,) int32; age_ns, unseen_ns: (N,) int64 since the first and the newest
    observation; flags: (N,) uint8 PlaneFlags; object_id: (N,) int64 of the moving object, 0: static.
    objects: the moving obstacles. left_out: detections of this frame without a track, evicted: tracks removed in this frame, both
    for want of slots."""

    ids: NDArray[np.int64]
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    confidence: NDArray[np.float32]
    state: NDArray[np.int32]
    hits: NDArray[np.int32]
    age_ns: NDArray[np.int64]
    unseen_ns: NDArray[np.int64]
    flags: NDArray[np.uint8]
    object_id: NDArray[np.int64]
    objects: tuple[MovingObject, ...] = ()
    left_out: int = 0
    evicted: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingObject:
    """A moving obstacle. centre_m: middle of the box of its planes; half_size_m: half of that box along x, y and z;
    velocity_m_s: horizontal; position_sigma_m, velocity_sigma_m_s: standard deviations of the face that is followed, on the
    less exact axis; cov_m2_s: covariance of position and velocity on it; age_ns, unseen_ns: since the first and newest
    observation."""

    id: int
    centre_m: tuple[float, float, float]
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]
    position_sigma_m: float
    velocity_sigma_m_s: float
    cov_m2_s: float
    hits: int
    age_ns: int
    unseen_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerState:
    """What one frame passes to the next: rows of the tables as little-endian bytes, bit for bit.

    version: of the tables' layout; next_id, next_object_id: of the next track and moving object. last_ns: of the newest frame,
    None: none; positioned, reset_counter, origin_m: of that frame, see TrackingFrame; position_jump_ns, heading_jump_ns: first
    stamp after the newest jump of the vehicle's estimate that is in the place of the tracks, 0: none; losses: of the position;
    velocity_m_s: of the vehicle, horizontal. slots: int32 slot of each of N tracks; tracks: (N,) TRACK; cells: (N, CELLS) CELL;
    objects: OBJECT; history: float64, earlier places of the objects; views: earlier free ranges, each of
    `core.free_view.view_bytes`."""

    version: int = STATE_VERSION
    next_id: int = 1
    next_object_id: int = 1
    last_ns: int | None = None
    positioned: bool = False
    reset_counter: int = 0
    position_jump_ns: int = 0
    heading_jump_ns: int = 0
    losses: Losses = ()
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    slots: bytes = b""
    tracks: bytes = b""
    cells: bytes = b""
    objects: bytes = b""
    history: bytes = b""
    views: tuple[bytes, ...] = field(default=())
