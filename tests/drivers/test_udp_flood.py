"""Foreign datagrams in excess are dropped, the autopilot's never."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.mavlink.dialect import dialect
from drivers.mavlink.udp_flood import (
    ALL_SOURCES,
    HEARTBEATS,
    NS,
    PER_SOURCE,
    SEARCHED_BYTES,
    TRUST_NS,
    WINDOW_NS,
    FloodFilter,
)

AUTOPILOT = ("10.0.0.1", 14550)
OTHER = ("10.0.0.9", 14590)


def packed(message: Any, mavlink_1: bool = False) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=2, srcComponent=1), force_mavlink1=mavlink_1))


ATTITUDE = packed(dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)


def trusting() -> FloodFilter:
    flood = FloodFilter()
    flood.trust(AUTOPILOT, NS)
    return flood


def test_all_pass_while_no_autopilot_is_known() -> None:
    flood = FloodFilter()
    assert all(flood.passes(("10.0.0.9", 1), NS) for _ in range(10 * ALL_SOURCES))
    assert flood.dropped == 0


def test_one_address_and_all_addresses_are_bounded_in_each_window() -> None:
    flood = trusting()
    assert sum(flood.passes(("10.0.0.9", 1), NS) for _ in range(1000)) == PER_SOURCE
    assert sum(flood.passes(("10.0.0.9", k), NS) for k in range(2, 1000)) == ALL_SOURCES - PER_SOURCE
    assert all(flood.passes(AUTOPILOT, NS) for _ in range(1000))
    assert flood.passes(("10.0.0.9", 1), NS + WINDOW_NS)
    assert "from 10.0.0.9:999 or others" in flood.text(NS + WINDOW_NS)
    assert flood.text(NS + 4 * WINDOW_NS) == ""
    assert flood.dropped == 1998 - ALL_SOURCES


def test_an_autopilot_that_fell_silent_may_have_a_new_address() -> None:
    flood = trusting()
    assert all(flood.passes(("10.0.0.1", 2), NS + TRUST_NS) for _ in range(1000))


def test_a_few_datagrams_of_others_are_read_beside_a_flood() -> None:
    flood = trusting()
    for k in range(1000):
        flood.passes(("10.0.0.9", 1), NS + k)
    assert all(flood.passes(("10.0.0.2", 3), NS + k) for k in range(20))


@pytest.mark.parametrize(
    "heartbeat", [packed(HEARTBEAT), packed(HEARTBEAT, mavlink_1=True), ATTITUDE + packed(HEARTBEAT)]
)
@pytest.mark.parametrize("phase", range(0, 480, 60))
def test_heartbeats_of_a_second_autopilot_pass_at_each_phase_of_the_windows(heartbeat: bytes, phase: int) -> None:
    """PX4 sends 480 datagrams a second to the port of a companion computer, and its heartbeat at the same phase of each second."""
    flood, passed = trusting(), 0
    for k in range(3 * 480):
        now_ns = NS + k * NS // 480
        flood.trust(AUTOPILOT, now_ns)
        beats = k % 480 == phase
        passed += flood.passes(OTHER, now_ns, heartbeat if beats else ATTITUDE) and beats
    assert passed == 3


def test_heartbeats_are_bounded_too() -> None:
    flood = trusting()
    assert sum(flood.passes(OTHER, NS, packed(HEARTBEAT)) for _ in range(1000)) == PER_SOURCE + HEARTBEATS
    assert sum(flood.passes(("10.0.0.9", k), NS, packed(HEARTBEAT)) for k in range(2, 1000)) < ALL_SOURCES


@pytest.mark.parametrize(("before", "passes"), [(SEARCHED_BYTES - 12, True), (60_000, False)])
def test_a_long_datagram_takes_no_longer_than_one_of_an_autopilot(before: int, passes: bool) -> None:
    """Each of 64 KiB took as long as hundreds of others."""
    flood = trusting()
    for _ in range(PER_SOURCE):
        flood.passes(OTHER, NS, ATTITUDE)
    assert flood.passes(OTHER, NS, bytes(before) + packed(HEARTBEAT)) is passes
