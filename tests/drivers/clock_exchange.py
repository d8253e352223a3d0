"""Exchanges of two clocks over a line with delays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.mavlink.clock_bounds import NS
from drivers.mavlink.clock_sync import ClockFilter, ClockSource

MS = 1_000_000


@dataclass
class Link:
    """An autopilot whose clock runs `drift` fast of ours from boot_at on, behind a link with random delays."""

    drift: float = 50e-6
    boot_at_ns: int = -1_000 * NS
    least_delay_ns: int = 300_000
    jitter_ns: int = 5 * MS
    seed: int = 0

    def __post_init__(self) -> None:
        self.rng = np.random.Generator(np.random.PCG64(self.seed))

    def boot(self, local_ns: int) -> int:
        return round((local_ns - self.boot_at_ns) * (1.0 + self.drift))

    def local(self, boot_ns: int) -> float:
        return boot_ns / (1.0 + self.drift) + self.boot_at_ns

    def delay(self) -> int:
        return self.least_delay_ns + int(self.rng.exponential(0.3) * self.jitter_ns)

    def exchange(self, clock: ClockFilter, sent_ns: int) -> bool:
        there = sent_ns + self.delay()
        return clock.exchange(sent_ns, self.boot(there) // 1000 * 1000, there + self.delay())

    def attitude(self, clock: ClockFilter, measured_ns: int) -> None:
        clock.arrival(self.boot(measured_ns) // MS * MS, measured_ns + self.delay())

    def error_ns(self, clock: ClockFilter, boot_ns: int) -> float:
        return clock.estimate.local_ns(boot_ns) - self.local(boot_ns)


def run(link: Link, clock: ClockFilter, seconds: float, hz: float = 10.0, start_ns: int = 0) -> list[float]:
    errors = []
    for k in range(int(seconds * hz)):
        now = start_ns + int(k * NS / hz)
        link.exchange(clock, now)
        link.attitude(clock, now + 10 * MS)
        if clock.estimate.source is ClockSource.TIMESYNC:
            errors.append(link.error_ns(clock, link.boot(now)))
    return errors
