"""Detects an attitude that is sent again with new timestamps.

The estimator of a vehicle never gives the same angles twice: its gyroscopes have noise, and float32 resolves 0.00001 degrees. In
recordings of PX4, ArduSub and ArduCopter (SITL, on the ground too) none of 30,000 messages repeats the angles of the one
before. Repeated angles are those of an earlier time. ArduPilot stamps ATTITUDE with the time of sending, so that it repeats
while its estimator does not run (`mavlink_delay_cb`), and between two attitudes of an external one, which gives 50 a second
(EAHRS_RATE). A relay may send the newest message again with a stamp of its own. PX4 sends an attitude only when there is a
new one."""

from __future__ import annotations

from collections import deque
from typing import Final

NS: Final = 1_000_000_000
UPDATE_NS: Final = 35_000_000
"""For this time after a message its angles may be sent again: an external estimator gives new ones every 20 ms, with jitter."""
WINDOW_NS: Final = NS
"""Later repetitions are counted for this time. So long there must be none until the attitude is used again."""
LONGEST_NS: Final = NS // 10
"""Sum of the times between counted repetitions and the messages before them within the window from which on no attitude is used."""
FEWEST: Final = 2
"""Counted repetitions in the window: one alone is no evidence."""
REBOOT_NS: Final = NS
"""A stamp that lies so far back is of an autopilot that has rebooted."""

Numbers = tuple[float, ...]


class RepeatedAttitude:
    """Takes the messages of one kind in order of arrival. repeated: whether none of the newest attitudes must be used, also where the
    angles differ from those before."""

    def __init__(self) -> None:
        self.repeated = False
        self._angles: Numbers = ()
        self._newest_ns = 0  # stamp
        self._first_ns = 0  # stamp of the first message in a row with the newest angles
        self._repeats: deque[tuple[int, int]] = deque()  # counted: stamp, time since the message before

    def take(self, boot_ns: int, angles: Numbers) -> bool:
        """Takes a message; returns whether it must not be used: it has the angles of the one before, or `repeated`. A copy with
        the same stamp and one that arrives late change nothing.

        Args:
            boot_ns: its timestamp.
            angles: Euler angles or quaternion as received."""
        if self._angles and self._newest_ns - REBOOT_NS < boot_ns <= self._newest_ns:
            return self.repeated or (angles == self._angles and boot_ns > self._first_ns)
        since_ns = boot_ns - self._newest_ns
        same = angles == self._angles and since_ns > 0
        if not same:
            self._first_ns = boot_ns
        elif boot_ns - self._first_ns > UPDATE_NS:
            self._repeats.append((boot_ns, since_ns))
        self._angles, self._newest_ns = angles, boot_ns
        while self._repeats and not 0 <= boot_ns - self._repeats[0][0] < WINDOW_NS:
            self._repeats.popleft()
        self.repeated = self._judge()
        return self.repeated or same

    def _judge(self) -> bool:
        if self.repeated or not self._repeats:
            return bool(self._repeats)
        return len(self._repeats) >= FEWEST and sum(since_ns for _, since_ns in self._repeats) >= LONGEST_NS
