"""A link with a thread of its own, and the samples that it delivers."""

from __future__ import annotations

import fcntl
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager

from core.types import AttitudeSample, PoseSample
from drivers.mavlink.address import Address
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams

NS, MS = 1_000_000_000, 1_000_000
Samples = list[AttitudeSample | PoseSample]


@contextmanager
def linked(address: Address, params: MavlinkParams | None = None) -> Iterator[tuple[MavlinkLink, Samples]]:
    samples: Samples = []
    link = MavlinkLink(address, MavlinkSession(params), samples.extend)
    link.open()
    try:
        yield link, samples
    finally:
        link.close()


def synchronised(link: MavlinkLink) -> bool:
    return link.status().clock.source is ClockSource.TIMESYNC


def waiting(descriptor: int) -> int:
    """The number of bytes that a read would return."""
    return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)
