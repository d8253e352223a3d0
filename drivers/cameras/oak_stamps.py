"""Checks the stamps of a Luxonis OAK, which the device gives on the host's clock.

The device compares its own clock with that of the host every 5 s, and its stamps are as wrong as that comparison. A correction of the
host's clock makes it wrong until the next one; a comparison that was delayed moves all stamps until a better one moves them back. Each
frame states the device's own clock as well, which is never corrected: the difference of both stamps shows such a move."""

from __future__ import annotations

import time
from datetime import timedelta
from typing import Any, Final

from ..base import BadData
from .clock_correction import SPAN_NS, ClockCorrection, RecentValues
from .kernel_stamps import FIRST_NS
from .oak_images import middle_ns, nanoseconds

MOST_CORRECTED_NS: Final = 10_000_000
"""Greatest correction of the host's clock within SPAN_NS: stamps may be wrong by it, 1 degree in a turn of 100 degrees a second.
The kernel itself corrects the rate of a clock by up to 5 ms in that time."""
MOST_MOVED_NS: Final = 10_000_000
"""Greatest move of the stamps against the device's own clock within SPAN_NS. The maker states 0.2 ms (USB) and 0.5 ms (network) as the
standard deviation of the comparison, and jumps of a few milliseconds (depthai-shared pull request 44); the kernel's 5 ms are in it."""
_NO_STAMP: Final = timedelta(0)


class OakStamps:
    """The stamps of one camera since its opening."""

    def __init__(self, camera: str, correction: ClockCorrection) -> None:
        self._camera, self._correction = camera, correction
        self._apart_ns = RecentValues()
        self._stamped = False
        self._correction.take(time.monotonic_ns())

    def check_clock(self) -> None:
        """Raises BadData where the host's clock was corrected so much that the device's stamps are wrong."""
        corrected_ns = self._correction.take(time.monotonic_ns())
        if corrected_ns > MOST_CORRECTED_NS:
            raise BadData(
                f"camera {self._camera}: the clock of this computer was corrected by {corrected_ns / 1e6:.0f} ms within "
                f"{SPAN_NS / 1e9:.0f} s (NTP), the device compares its clock with it every 5 s, so its stamps are wrong; "
                "synchronise the clock before the flight, and limit corrections in flight (chrony: maxslewrate 100)"
            )

    def exposure_ns(self, image: Any, half_exposure_ns: int, arrival_ns: int) -> int:
        """The middle of the exposure of a dai.ImgFrame. half_exposure_ns: what the image does not state. Raises BadData for a stamp of
        another clock, and for one that jumped."""
        exposure_ns = middle_ns(image) - half_exposure_ns
        # a later frame may be older: the process was stopped, and the frame waited
        oldest_ns = 0 if self._stamped else arrival_ns - FIRST_NS
        if not max(0, oldest_ns) < exposure_ns <= arrival_ns:
            raise BadData(
                f"camera {self._camera}: a frame is stamped {(exposure_ns - arrival_ns) / 1e9:+.3f} s from "
                "its arrival; the device's clock is not synchronised with the host's. Restart the device"
            )
        self._check_move(image, arrival_ns)
        self._stamped = True
        return exposure_ns

    def _check_move(self, image: Any, now_ns: int) -> None:
        own: timedelta = image.getTimestampDevice()
        if own == _NO_STAMP:
            return
        moved_ns = self._apart_ns.take(now_ns, nanoseconds(image.getTimestamp() - own))
        if moved_ns > MOST_MOVED_NS:
            raise BadData(
                f"camera {self._camera}: its stamps jumped by {moved_ns / 1e6:.0f} ms within {SPAN_NS / 1e9:.0f} s against the device's "
                "own clock, so they do not fit the attitudes; it is opened again and compares the clocks. If this is repeated, use a "
                "USB 3 port or a network of its own for the camera"
            )
