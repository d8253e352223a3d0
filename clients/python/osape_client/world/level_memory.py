"""Short memory of obstacles for a vehicle without a position, in its level frame.

The attitude is known, so earlier frames can be rotated with the vehicle. The distance flown since is unknown: the margin of
each remembered plane grows with the greatest speed. Free space is not remembered, because the part of it that the vehicle
has passed is unknown; query the newest frame for it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decode import model_from_message
from ..model import CameraModel
from ..proto import osape_v1_pb2 as pb
from .snapshot import WorldSnapshot

NS = 1_000_000_000
_KEPT = 6
"""Not tuning: frames of one camera that are kept beside its newest, evenly over the time of the memory. It bounds the memory
for any frame rate."""

QUATERNION_SLACK = 0.05
"""Greatest difference of the length of an attitude's quaternion from 1; an empty one has length 0."""


@dataclass(frozen=True, slots=True, eq=False)
class _Remembered:
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    flags: NDArray[np.uint8]
    heading_rad: float
    t_ns: int


class LevelMemory:
    """Obstacles of the last frames in `level`, of any number of cameras. It contains no free space: what is not occupied is
    unknown.

    memory_s: age at which a plane is removed; speed_m_s: greatest speed of the vehicle, by which margins grow. All times
    are of one clock: on another machine than the service's, first convert the time stamps to its own clock. Raises
    ValueError for a memory_s or speed_m_s that is negative or not finite."""

    def __init__(self, memory_s: float = 1.0, speed_m_s: float = 5.0) -> None:
        for name, value in (("memory_s", memory_s), ("speed_m_s", speed_m_s)):
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value:g}; expected a finite number, 0 or more")
        self._memory_ns, self._speed_m_s = round(memory_s * NS), speed_m_s
        self._newest: dict[str, _Remembered] = {}
        self._earlier: dict[str, deque[_Remembered]] = {}

    def add_message(self, message: pb.PrismsFrame) -> float | None:
        """Adds a frame without a position. Returns the vehicle's heading at its exposure, rad clockwise from north, for
        `snapshot`; None when the frame was not added: it is invalid, has a position, comes out of order, or does not fit
        together."""
        if message.frame != "level" or not message.valid or not message.HasField("attitude"):
            return None
        q = message.attitude.q_ned_frd
        if not abs(math.hypot(q.w, q.x, q.y, q.z) - 1.0) <= QUATERNION_SLACK:
            return None
        heading_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
        try:
            model = model_from_message(message)
            added = model is not None and self.add(message.camera, model, heading_rad, message.t_exposure_ns)
        except ValueError:
            return None
        return heading_rad if added else None

    def add(self, camera: str, model: CameraModel, heading_rad: float, t_ns: int) -> bool:
        """Adds the planes of a frame. Returns whether they were added. heading_rad: of the vehicle at the exposure t_ns,
        clockwise from north.

        An invalid frame removes nothing; one that comes out of order is ignored. A time stamp that steps back by more
        than a second, and by more than memory_s, means that the clock restarted: what has later time stamps is removed.

        Raises:
            ValueError: the heading is not finite.
        """
        if not math.isfinite(heading_rad):
            raise ValueError(
                f"heading {heading_rad} of camera {camera} at {t_ns} ns: expected a finite number of radians"
            )
        if not model.valid:
            return False
        newest = self._newest.get(camera)
        if newest is not None and newest.t_ns - t_ns > max(NS, self._memory_ns):
            self._remove_later(t_ns)
            newest = None
        if newest is not None and t_ns <= newest.t_ns:
            return False
        finite = np.isfinite(model.planes).all(axis=1) & np.isfinite(model.margin_m)
        self._newest[camera] = _Remembered(
            model.planes[finite], model.margin_m[finite], model.flags[finite], heading_rad, t_ns
        )
        earlier = self._earlier.setdefault(camera, deque(maxlen=_KEPT))
        if newest is not None and (not earlier or newest.t_ns - earlier[-1].t_ns >= self._memory_ns // _KEPT):
            earlier.append(newest)
        return True

    def _remove_later(self, t_ns: int) -> None:
        """Removes the cameras whose newest frame is later than t_ns."""
        for camera in [name for name, seen in self._newest.items() if seen.t_ns > t_ns]:
            del self._newest[camera]
            self._earlier.pop(camera, None)

    def snapshot(self, heading_rad: float, now_ns: int) -> WorldSnapshot:
        """The remembered obstacles in the level frame of a vehicle with that heading at now_ns. Planes older than memory_s are
        left out; margins have grown by speed_m_s times the age. A time stamp in the future counts as one of now.

        Raises:
            ValueError: the heading is not finite.
        """
        if not math.isfinite(heading_rad):
            raise ValueError(f"heading {heading_rad} at {now_ns} ns: expected a finite number of radians")
        parts = [seen for camera in sorted(self._newest) for seen in (*self._earlier[camera], self._newest[camera])]
        parts = [seen for seen in parts if now_ns - seen.t_ns <= self._memory_ns]
        if not parts:
            return WorldSnapshot.empty()
        planes = np.concatenate([_rotated(seen.planes, seen.heading_rad - heading_rad) for seen in parts])
        margins = [seen.margin_m + np.float32(self._speed_m_s * max(0, now_ns - seen.t_ns) / NS) for seen in parts]
        n = len(planes)
        return WorldSnapshot(
            section=1,
            slots=np.arange(n, dtype=np.int32),
            planes=planes,
            margin_m=np.concatenate(margins).astype(np.float32),
            flags=np.concatenate([seen.flags for seen in parts]),
            hits=np.ones(n, np.int32),
            seen_ns=np.concatenate([np.full(len(seen.planes), seen.t_ns, np.int64) for seen in parts]),
            blocks=np.zeros((0, 3), np.int32),
            masks=np.zeros((0, 256), np.uint64),
        )


def _rotated(planes: NDArray[np.float32], angle_rad: float) -> NDArray[np.float32]:
    """Planes (N, 6) rotated about the vertical by Rz(angle_rad)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    out = planes.copy()
    for x, y in ((0, 1), (2, 3)):
        out[:, x] = c * planes[:, x] - s * planes[:, y]
        out[:, y] = s * planes[:, x] + c * planes[:, y]
    return out
