"""The merged world at one instant, as plain arrays, for planners and queries. It needs numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import store_readonly


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WorldSnapshot:
    """Planes and free space of one section, in ned, in metres."""

    section: int  # number of the section
    slots: NDArray[np.int32]  # (N,), number of each plane as long as it exists
    # (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom. Free space is on the right of a -> b, seen from above.
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]  # (N,)
    flags: NDArray[np.uint8]  # (N,) uint8 PlaneFlags
    hits: NDArray[np.int32]  # (N,), observations
    seen_ns: NDArray[np.int64]  # (N,), newest observation
    blocks: NDArray[np.int32]  # (B, 3), indices of blocks of 8 x 8 x 32 m
    masks: NDArray[np.uint64]  # (B, 256), a bit per cell of 0.5 m in each column: 1, free (free_grid.py)
    # (B, 256, 2) float32, z of the highest point of the ground in each column and its noise, nan where it is not known
    # (ground.py); None: known nowhere
    ground: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        n, b = len(self.slots), len(self.blocks)
        store_readonly(self, np.int32, (n,), "slots", "hits")
        store_readonly(self, np.float32, (n, 6), "planes")
        store_readonly(self, np.float32, (n,), "margin_m")
        store_readonly(self, np.uint8, (n,), "flags")
        store_readonly(self, np.int64, (n,), "seen_ns")
        store_readonly(self, np.int32, (b, 3), "blocks")
        store_readonly(self, np.uint64, (b, 256), "masks")
        if self.ground is not None:
            store_readonly(self, np.float32, (b, 256, 2), "ground")

    @classmethod
    def empty(cls) -> WorldSnapshot:
        """Returns a world of which nothing is known."""
        return cls(
            section=0,
            slots=np.zeros(0, np.int32),
            planes=np.zeros((0, 6), np.float32),
            margin_m=np.zeros(0, np.float32),
            flags=np.zeros(0, np.uint8),
            hits=np.zeros(0, np.int32),
            seen_ns=np.zeros(0, np.int64),
            blocks=np.zeros((0, 3), np.int32),
            masks=np.zeros((0, 256), np.uint64),
        )
