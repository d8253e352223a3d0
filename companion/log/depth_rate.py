"""Which depth images are recorded where `[record] depth_hz` limits their rate."""

from __future__ import annotations

NS = 1_000_000_000
EARLY_NS = 5_000_000
"""By this an image may be early, as exposures have jitter."""


class DepthRate:
    """Chooses images on a grid per camera. hz 0: every image."""

    def __init__(self, hz: float) -> None:
        self.limited = hz > 0.0
        self._period_ns = round(NS / hz) if self.limited else 0
        self._due_ns: dict[str, int] = {}

    def keeps(self, camera: str, t_exposure_ns: int) -> bool:
        """Whether to record this image. An exposure far back means that the camera restarted: its grid begins again."""
        if not self.limited:
            return True
        due_ns = self._due_ns.get(camera, t_exposure_ns)
        early_ns = due_ns - t_exposure_ns
        if EARLY_NS < early_ns <= 2 * self._period_ns:
            return False
        on_grid = abs(early_ns) < self._period_ns
        self._due_ns[camera] = (due_ns if on_grid else t_exposure_ns) + self._period_ns
        return True
