"""Detects an attitude that is sent again with new timestamps.

The estimator of a vehicle never gives the same angles twice: its gyroscopes have noise, and float32 resolves 0.00001 degrees. In
recordings of PX4, ArduSub and ArduCopter (SITL, on the ground too) none of 30,000 messages repeats the angles of the one
before. Repeated angles are those of an earlier time. ArduPilot stamps ATTITUDE with the time of sending, so that it repeats while its estimator
does not run (`mavlink_delay_cb`), and a relay may send the newest message again with a stamp of its own. PX4 sends an
attitude only when there is a new one."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

NS: Final = 1_000_000_000
WINDOW_NS: Final = NS
"""Repetitions are counted for this time. So long the attitude must change with every message until it is used again."""
LONGEST_NS: Final = NS // 10
"""Sum of the times between equal messages within the window from which on the attitude is not used."""
LARGEST_TURN_RAD: Final = math.radians(0.5)
"""The same for the turn that the body rates state for these times."""
FEWEST: Final = 2
"""Equal messages in the window: one alone is no evidence."""
REBOOT_NS: Final = NS
"""A stamp that lies so far back is of an autopilot that has rebooted."""

Numbers = tuple[float, ...]


class RepeatedAttitude:
    """Takes the messages of one kind in order of arrival. repeated: whether the newest attitude must not be used."""

    def __init__(self) -> None:
        self.repeated = False
        self._angles: Numbers = ()
        self._newest_ns = 0  # stamp
        self._repeats: deque[tuple[int, int, float]] = (
            deque()
        )  # stamp, time since the message before, turn by the rates

    def take(self, boot_ns: int, angles: Numbers, rates_rad_s: Numbers) -> bool:
        """Takes a message; returns `repeated`. A copy with the same stamp and one that arrives late change nothing.

        Args:
            boot_ns: its timestamp.
            angles: Euler angles or quaternion as received.
            rates_rad_s: body rates as received."""
        if self._angles and self._newest_ns - REBOOT_NS < boot_ns <= self._newest_ns:
            return self.repeated
        since_ns = boot_ns - self._newest_ns
        if angles == self._angles and since_ns > 0:
            rate_rad_s = math.hypot(*rates_rad_s)
            self._repeats.append((boot_ns, since_ns, rate_rad_s * since_ns / NS if math.isfinite(rate_rad_s) else 0.0))
        self._angles, self._newest_ns = angles, boot_ns
        while self._repeats and not 0 <= boot_ns - self._repeats[0][0] < WINDOW_NS:
            self._repeats.popleft()
        self.repeated = self._judge()
        return self.repeated

    def _judge(self) -> bool:
        if not self._repeats:
            return False
        if self.repeated:
            return True
        return len(self._repeats) >= FEWEST and (
            sum(since_ns for _, since_ns, _ in self._repeats) >= LONGEST_NS
            or sum(turn_rad for _, _, turn_rad in self._repeats) >= LARGEST_TURN_RAD
        )
