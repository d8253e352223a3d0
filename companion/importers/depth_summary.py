"""What the depth images of a recording hold: share of measured pixels, and how far they reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.types import is_measured

COUNTED_PX: Final = 4096
"""Of a larger image about as many pixels are counted, from all its rows: some sensors measure every eighth row only."""
MOST: Final = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSummary:
    """What the depth images of a recording contain."""

    measured_share: float  # of the pixels
    reach_m: float  # distance below which 95 % of the measured pixels are; 0 without any

    def __str__(self) -> str:
        if not self.measured_share:
            return "depth images: no pixel is measured"
        return f"depth images: {self.measured_share:.0%} of the pixels measured, {MOST:.0%} of them nearer than {self.reach_m:.1f} m"

    def as_json(self) -> dict[str, Any]:
        """The object of `--json`."""
        return {"measured_share": round(self.measured_share, 4), "reach_m": round(self.reach_m, 3)}


class DepthTally:
    """Counts depths in steps of a decimetre."""

    def __init__(self) -> None:
        self._bins = np.zeros(1 + (1 << 16) // 100, np.int64)
        self._pixels = 0

    def add(self, depth_mm: NDArray[np.uint16]) -> None:
        """Counts an image (H, W)."""
        some = depth_mm.reshape(-1)[:: depth_mm.size // COUNTED_PX | 1]
        measured = some[is_measured(some)]
        self._pixels += some.size
        self._bins += np.bincount(measured // 100, minlength=len(self._bins))

    def summary(self) -> DepthSummary:
        """What was counted."""
        total = int(self._bins.sum())
        reach = int(np.searchsorted(np.cumsum(self._bins), MOST * total)) + 1 if total else 0
        return DepthSummary(measured_share=total / max(1, self._pixels), reach_m=reach / 10.0)
