"""Without a position: the newest frame and what was seen a moment before, in the vehicle's level frame.

Attitude is known then, so that what was seen before can be turned with the vehicle; how far it went meanwhile is not.
Each plane stands in every place where it may be by now: its margin grows by the greatest speed. Of free space nothing is
remembered, since nobody knows how much of it has been flown through: ask the newest frame itself (queries.py).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import FrameModel
from .params import WorldParams
from .snapshot import WorldPicture

NS = 1_000_000_000
_KEPT = 6
"""Not tuning: frames of one camera that are kept beside its newest, evenly over the time of the memory: more of them say
nothing new. It bounds the memory, whatever the camera's rate."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    flags: NDArray[np.uint8]
    heading_rad: float
    t_ns: int


class LevelMemory:
    """Frames in `level` go in, in any order of cameras; a picture for `WorldSpace` comes out, in the level frame of the heading
    that is asked for. Free is nowhere in it: what is no obstacle is unknown.
    All instants are of one clock: on another machine than the service's, add its stamps' distance to the own clock first, or
    nothing grows, or all is gone at once."""

    def __init__(self, params: WorldParams | None = None) -> None:
        p = params or WorldParams()
        self._memory_ns, self._speed_m_s = round(p.level_memory_s * NS), p.level_speed_m_s
        self._newest: dict[str, _Seen] = {}
        self._before: dict[str, deque[_Seen]] = {}

    def add(self, camera: str, model: FrameModel, heading_rad: float, t_ns: int) -> None:
        """Takes a frame in. heading_rad: the vehicle's at the exposure t_ns, clockwise from north. A frame that says nothing
        takes nothing away, and one that comes out of order is left out.

        Raises:
            ValueError: the heading is no number.
        """
        if not math.isfinite(heading_rad):
            raise ValueError(f"heading {heading_rad} of camera {camera} at {t_ns} ns: expected a number of radians")
        newest = self._newest.get(camera)
        if not model.valid or (newest is not None and t_ns <= newest.t_ns):
            return
        numbers = np.isfinite(model.planes).all(axis=1) & np.isfinite(model.margin_m)
        seen = _Seen(model.planes[numbers], model.margin_m[numbers], model.flags[numbers], heading_rad, t_ns)
        self._newest[camera] = seen
        before = self._before.setdefault(camera, deque(maxlen=_KEPT))
        if newest is not None and (not before or newest.t_ns - before[-1].t_ns >= self._memory_ns // _KEPT):
            before.append(newest)

    def picture(self, heading_rad: float, now_ns: int) -> WorldPicture:
        """What may stand where, in the level frame of a vehicle of that heading at now_ns. Planes older than level_memory_s
        are gone; margins have grown by level_speed_m_s for as long as the planes are old. A stamp in the future is as old
        as one of now."""
        parts = [seen for camera in sorted(self._newest) for seen in (*self._before[camera], self._newest[camera])]
        parts = [seen for seen in parts if now_ns - seen.t_ns <= self._memory_ns]
        if not parts:
            return WorldPicture.empty()
        planes = np.concatenate([_turned(seen.planes, seen.heading_rad - heading_rad) for seen in parts])
        grown = [seen.margin_m + np.float32(self._speed_m_s * max(0, now_ns - seen.t_ns) / NS) for seen in parts]
        n = len(planes)
        return WorldPicture(
            section=1, slots=np.arange(n, dtype=np.int32), planes=planes, margin_m=np.concatenate(grown).astype(np.float32),
            flags=np.concatenate([seen.flags for seen in parts]), hits=np.ones(n, np.int32),
            seen_ns=np.concatenate([np.full(len(seen.planes), seen.t_ns, np.int64) for seen in parts]),
            blocks=np.zeros((0, 3), np.int32), masks=np.zeros((0, 256), np.uint64),
        )  # fmt: skip


def _turned(planes: NDArray[np.float32], angle_rad: float) -> NDArray[np.float32]:
    """Planes (N, 6) turned about the vertical, by Rz(angle_rad)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    out = planes.copy()
    for x, y in ((0, 1), (2, 3)):
        out[:, x] = c * planes[:, x] - s * planes[:, y]
        out[:, y] = s * planes[:, x] + c * planes[:, y]
    return out
