"""What limits the use of a replayed log: nothing free, no ground, attitude too slow. Printed after the replay."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from core.types import FrameModel

MOSTLY: Final = 0.9
"""Share of the valid frames from which on advice is given."""
MEASURED: Final = 0.5
"""Share of measured pixels from which on a ground should have been found."""
HALF: Final = 0.5
LITTLE_FREE: Final = 0.1
MIN_FRAMES: Final = 5
_ENOUGH_M: Final = 1.0
"""A direction counts as free in a layer from this length of free space on."""


class AdviceCode(StrEnum):
    """Stable codes of the advice."""

    NOTHING_FREE = "nothing_free"
    GROUND_NEVER_SEEN = "ground_never_seen"
    ATTITUDE_TOO_SLOW = "attitude_too_slow"


@dataclass(frozen=True, slots=True)
class Advice:
    """One piece of advice."""

    code: AdviceCode
    text: str


@dataclass(slots=True)
class ViewTally:
    """Sums over the valid frames."""

    frames: int = 0
    nothing_free: int = 0
    free_share: float = 0.0  # share of the directions that are free for a metre in the layer at the camera's height
    measured_share: float = 0.0
    ground_seen: int = 0
    layer_m: float = 0.0  # its height in the last frame

    def add(self, model: FrameModel, camera_z_m: float) -> None:
        """Counts a valid model. camera_z_m: height of the camera in the model's frame, z down."""
        self.frames += 1
        share, self.layer_m = free_share(model, camera_z_m)
        self.nothing_free += share == 0.0
        self.free_share += share
        self.measured_share += model.stats.measured_share
        self.ground_seen += model.ground.seen

    @property
    def mean_free_share(self) -> float:
        """Mean share of free directions at the camera's height; 0 without frames."""
        return self.free_share / max(1, self.frames)

    @property
    def mean_measured_share(self) -> float:
        """Mean share of measured pixels; 0 without frames."""
        return self.measured_share / max(1, self.frames)


def free_share(model: FrameModel, camera_z_m: float) -> tuple[float, float]:
    """(share of the directions with at least a metre of free space in the layer at the camera's height, the layer's height
    in metres); (0, 0) where the camera is in no layer."""
    edges = model.free.layer_edges_m
    low, high = np.minimum(edges[:-1], edges[1:]), np.maximum(edges[:-1], edges[1:])
    (own,) = np.nonzero((low <= camera_z_m) & (camera_z_m <= high))
    if not len(own) or not len(model.free.free_to_m):
        return 0.0, 0.0
    length_m = model.free.free_to_m[:, own[0]] - model.free.free_from_m[:, own[0]]
    return float(np.mean(length_m >= _ENOUGH_M)), float(high[own[0]] - low[own[0]])


def advice_of(tally: ViewTally, frames: int, attitude_dropped: int, attitude_hz: float) -> list[Advice]:
    """frames: all frames; attitude_dropped: frames dropped for want of an attitude near them; attitude_hz: 0: unknown."""
    found: list[Advice] = []
    if attitude_hz and frames and attitude_dropped > 0.2 * frames:
        found.append(
            Advice(
                AdviceCode.ATTITUDE_TOO_SLOW,
                f"{attitude_dropped} of {frames} frames have no attitude close enough in time; the log has it at "
                f"{attitude_hz:.1f} Hz. Record the autopilot's attitude at 50 Hz on the vehicle",
            )
        )
    n = tally.frames
    if n < MIN_FRAMES:
        return found
    if tally.nothing_free >= HALF * n or tally.mean_free_share < LITTLE_FREE:
        found.append(
            Advice(
                AdviceCode.NOTHING_FREE,
                f"at the camera's height no direction is free for a metre in {tally.nothing_free} of {n} valid frames, and "
                f"{tally.mean_free_share:.0%} of the directions on average: a layer ({tally.layer_m:.1f} m high) is free only as "
                "a whole, and close objects hide what is behind them. For rooms: `companion configs indoor` copies a "
                "configuration for `companion replay -c indoor.toml`",
            )
        )
    if tally.ground_seen <= (1.0 - MOSTLY) * n and tally.mean_measured_share >= MEASURED:
        found.append(
            Advice(
                AdviceCode.GROUND_NEVER_SEEN,
                f"the ground was found in {tally.ground_seen} of {n} valid frames although {tally.mean_measured_share:.0%} of "
                "the pixels are measured: if ground is in view, check the attitude (signs, radians), the mount (--mount) and "
                "the clock (--tlog-epoch)",
            )
        )
    return found
