"""Heartbeats that have waited in the buffer of the line while the process was stopped. The kernel keeps the oldest bytes and drops the
newest."""

from __future__ import annotations

import pytest

from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import Vehicle
from drivers.simulation.autopilot import PX4

from .conversation import talk, turning

MS, NS = 1_000_000, 1_000_000_000
AUTO, LOITER = 3, 5


class Autopilot:
    """Heartbeats at 5 Hz, attitudes at 50 Hz, with their times of sending."""

    def __init__(self) -> None:
        self._encoder = dialect.MAVLink(None, 1, 1)
        self.mode = AUTO

    def sent(self, begin_ns: int, end_ns: int) -> list[tuple[bytes, int]]:
        out = []
        for t_ns in range(begin_ns, end_ns, 20 * MS):
            messages = [dialect.MAVLink_attitude_message(t_ns // MS, 0.001, 1e-8 * (t_ns / NS), 0.0, 0.0, 0.0, 0.0)]
            if t_ns % (200 * MS) == 0:
                messages.append(dialect.MAVLink_heartbeat_message(2, 3, 128, self.mode, 4, 3))
            for message in messages:
                out.append((bytes(message.pack(self._encoder)), t_ns))
                self._encoder.seq = (self._encoder.seq + 1) % 256
        return out


def received(session: MavlinkSession) -> Vehicle:
    assert session.vehicle is not None
    return session.vehicle


@pytest.mark.parametrize("reads", [1, 3])
def test_a_heartbeat_that_waited_in_the_buffer_counts_as_of_before_the_pause(reads: int) -> None:
    """The pilot changes to LOITER while the service is stopped. The heartbeats that it then reads show AUTO."""
    session, autopilot = MavlinkSession(), Autopilot()
    for data, t_ns in autopilot.sent(10 * NS, 12 * NS):
        session.receive([(data, t_ns)])
    before_ns = received(session).heartbeat_ns
    waited = [data for data, _ in autopilot.sent(12 * NS, 14 * NS)]  # then the buffer is full
    for number in range(reads):
        share = waited[number * len(waited) // reads : (number + 1) * len(waited) // reads]
        session.receive([(data, 20 * NS + number * 10 * MS) for data in share])
    assert received(session).custom_mode == AUTO
    assert before_ns <= received(session).heartbeat_ns < 12 * NS
    autopilot.mode = LOITER
    for data, t_ns in autopilot.sent(20 * NS + 40 * MS, 21 * NS):
        session.receive([(data, t_ns)])
    assert received(session).custom_mode == LOITER
    assert received(session).heartbeat_ns == 20 * NS + 800 * MS


def test_a_second_pause_before_the_buffer_is_empty_makes_no_old_heartbeat_new() -> None:
    session, autopilot = MavlinkSession(), Autopilot()
    for data, t_ns in autopilot.sent(10 * NS, 12 * NS):
        session.receive([(data, t_ns)])
    for read_ns, begin_ns in ((20 * NS, 12 * NS), (22 * NS, 13 * NS)):
        session.receive([(data, read_ns) for data, _ in autopilot.sent(begin_ns, begin_ns + NS)])
        assert received(session).heartbeat_ns < 12 * NS


def test_without_a_pause_a_heartbeat_counts_as_of_its_arrival() -> None:
    session, autopilot = MavlinkSession(), Autopilot()
    for data, t_ns in autopilot.sent(10 * NS, 12 * NS):
        session.receive([(data, t_ns)])
    assert received(session).heartbeat_ns == 12 * NS - 200 * MS


@pytest.mark.parametrize("sources", [("quick", "slow"), ("router", "router")])
def test_after_silence_a_heartbeat_of_a_slower_route_is_not_as_new_as_the_motion_before_it(
    sources: tuple[str, str],
) -> None:
    """The quick route fell silent and transmits again; a slow one then delivers a heartbeat from during the silence."""
    c = talk(PX4, motion=turning, boot_at_ns=0)
    c.run(3.0)
    autopilot, old = c.autopilots[0], b""
    sent_ns = 0
    for step in range(2600):
        t_ns = c.now_ns + (step + 1) * MS
        for data in autopilot.due(t_ns):
            if data[7] == 0 and data[0] == 0xFD and not old:  # HEARTBEAT
                old, sent_ns = data, t_ns
            elif step >= 2500:
                c.session.receive([(data, t_ns + MS)], [sources[0]])
    arrival_ns = c.now_ns + 2600 * MS
    c.session.receive([(old, arrival_ns)], [sources[1]])
    assert received(c.session).heartbeat_ns <= sent_ns
