"""What the autopilot is told while cameras are blind: the one decision on which the vehicle's safety hangs.

PX4 stands still in Position mode when it knows nothing, so it is told that nothing is known (`unknown`), and after a
while nothing at all. ArduPilot takes unknown, clear and silence for the same and flies on, so it is shown a wall (`stop`)
in every sector that a blind camera should look into, such that its fence comes to AVOID_MARGIN: there it was measured to
hold its place, nearer it backs away without end, farther it creeps on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config.avoidance import AvoidParams
from .obstacle_distance import PX4, UNKNOWN, always_told_cm, clear_cm, encoded, near_cm
from .obstacle_memory import Remembered
from .polar_histogram import SECTORS, SectorScan, SectorState

NS = 1_000_000_000
FENCE_SHARE = math.cos(math.pi / 8.0)
"""ArduPilot's fence before a wall in one of its faces of 45 degrees runs from corner to corner: in the middle it is nearer
than the wall by this factor. It holds its place while that middle is within AVOID_BACKUP_DZ (0.1 m) inside AVOID_MARGIN:
of the walls measured at a margin of 3 m, that is the one at 3.20 m, and neither 3.10 nor 3.35 m."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What there is to tell. scan: of the cameras that see. recalled: remembered obstacles.

    blind, seeing: (72,) the sectors that blind cameras should look into, and those that seeing ones do, with any part of
    them; whole: (72,) those that seeing ones look into all of.
    newest_ns: the newest exposure of any camera that was good; None: never."""

    scan: SectorScan
    recalled: Remembered
    blind: NDArray[np.bool_]
    seeing: NDArray[np.bool_]
    whole: NDArray[np.bool_]
    newest_ns: int | None


def policy_of(avoid: AvoidParams, autopilot: str) -> str:
    """ "unknown" or "stop". An autopilot that is not known to stand still when it knows nothing is shown a wall."""
    if avoid.blind != "auto":
        return avoid.blind
    return "unknown" if autopilot == PX4 else "stop"


class BlindPolicy:
    """`values` for each message; it remembers since when all is blind."""

    def __init__(self, avoid: AvoidParams) -> None:
        self._avoid = avoid
        self._all_blind_since_ns: int | None = None

    def values(self, sight: Sight, policy: str, avoid_margin_m: float, now_ns: int) -> NDArray[np.uint16] | None:
        """(72,) centimetres to tell, before what single readers need; None: nothing may be sent."""
        any_sees = bool(sight.seeing.any())
        if any_sees:
            self._all_blind_since_ns = None
        elif self._all_blind_since_ns is None:
            # blindness began with the newest exposure, not with our noticing it
            self._all_blind_since_ns = now_ns if sight.newest_ns is None else sight.newest_ns
        values = encoded(sight.scan, self._avoid)
        values[~sight.seeing & (values == clear_cm(self._avoid))] = UNKNOWN
        if policy == "stop":
            self._planes(values, sight.scan)
            self._wall(values, sight, avoid_margin_m)
        values = np.minimum(values, self._recalled(sight, policy))
        since_ns = self._all_blind_since_ns
        silent = since_ns is not None and now_ns - since_ns > self._avoid.silence_s * NS
        return None if silent and policy != "stop" else values

    def _planes(self, values: NDArray[np.uint16], scan: SectorScan) -> None:
        """Puts planes into unseen sectors: where unknown means clear, a plane behind something unmeasured is better than
        nothing. The wall, where there is one, is put before it."""
        behind = (scan.state == SectorState.UNSEEN) & (scan.distance_m < self._avoid.max_distance_m)
        values[behind] = near_cm(scan.distance_m[behind], self._avoid)

    def _wall(self, values: NDArray[np.uint16], sight: Sight, avoid_margin_m: float) -> None:
        """Puts the wall where a camera looks and nobody knows. Blind and seeing ones together: what one sees, counts.

        A sector at the border of all views is no reason for a wall: nobody looks into the rest of it in any case."""
        wall_m = np.full(SECTORS, (avoid_margin_m - self._avoid.stop_inside_m) / FENCE_SHARE)
        unseen = (sight.scan.state == SectorState.UNSEEN) & sight.whole
        if self._avoid.unseen == "unknown":
            unseen[:] = False
        wall_m = np.where(unseen, np.maximum(wall_m, sight.scan.free_m - self._avoid.radius_m), wall_m)
        wanted = unseen | (sight.blind & ~sight.whole & (values != clear_cm(self._avoid)))
        values[wanted] = np.minimum(values[wanted], near_cm(wall_m[wanted], self._avoid))

    def _recalled(self, sight: Sight, policy: str) -> NDArray[np.uint16]:
        """What is remembered, as centimetres: it outranks a farther wall, and what is not seen.

        Where unknown stops the vehicle, a remembered obstacle does not replace it when something nearer may stand before
        it: when the way to it was not seen, or a camera looks there now and does not see the way. A near one always
        counts."""
        all_m = sight.recalled.distance_m
        nearest = np.full(SECTORS, UNKNOWN, np.uint16)
        known = np.isfinite(all_m)
        nearest[known] = near_cm(all_m[known], self._avoid)
        if policy == "stop":
            return nearest
        way_seen_m = sight.recalled.way_seen_m
        out = np.full(SECTORS, UNKNOWN, np.uint16)
        known = np.isfinite(way_seen_m) & ~(sight.seeing & (sight.scan.state == SectorState.UNSEEN))
        out[known] = near_cm(way_seen_m[known], self._avoid)
        # beside a sector's own obstacle or clear, the nearest counts whatever is known of the way to it
        return np.where(
            (nearest <= always_told_cm(self._avoid)) | (sight.scan.state != SectorState.UNSEEN), nearest, out
        )


class Recovery:
    """A camera that was blind is believed again after some good frames in a row: one good frame between two bad ones is
    no sight. A camera that never saw must show as many at its start."""

    def __init__(self, cameras: tuple[str, ...], frames: int) -> None:
        self._need = frames
        self._good = dict.fromkeys(cameras, 0)

    def frame(self, camera: str, valid: bool) -> None:
        """A frame said something, or did not."""
        self._good[camera] = min(self._need, self._good[camera] + 1) if valid else 0

    def blind(self, causes: Mapping[str, str]) -> None:
        """causes: why each camera is blind now, empty where it is not."""
        for camera, cause in causes.items():
            if cause:
                self._good[camera] = 0

    def believed(self, camera: str) -> bool:
        """Whether it counts as seeing."""
        return self._good[camera] >= self._need
