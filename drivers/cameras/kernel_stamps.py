"""Stamps of the kernel on the buffers of a video device, which must be on CLOCK_MONOTONIC."""

from __future__ import annotations

from dataclasses import dataclass

from ..base import BadData

AHEAD_NS = 5_000_000
"""Largest accepted lead of a stamp over the present, for drivers that compute it from the device's clock."""
FIRST_NS = 2_000_000_000
"""Largest age of the first stamp. A later one may be older: the process was stopped, and the image waited in a buffer."""


@dataclass(slots=True)
class KernelStamps:
    """The stamps of one camera since its opening."""

    camera: str
    _checked: bool = False

    def accepted_ns(self, stamp_ns: int, arrival_ns: int) -> int:
        """Returns a stamp, at most the arrival. Raises BadData for one of another clock."""
        oldest_ns = 0 if self._checked else arrival_ns - FIRST_NS
        if not max(0, oldest_ns) < stamp_ns <= arrival_ns + AHEAD_NS:
            raise BadData(
                f"camera {self.camera}: a buffer is stamped {(stamp_ns - arrival_ns) / 1e9:+.3f} s from the present; its "
                "driver does not use the monotonic clock, so its frames cannot be matched with attitudes. Of a USB camera set the clock: "
                "echo CLOCK_MONOTONIC | sudo tee /sys/module/uvcvideo/parameters/clock"
            )
        self._checked = True
        return min(stamp_ns, arrival_ns)
