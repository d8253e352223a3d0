"""The simulated autopilot sleeps until its next message, to leave the processor to what is measured."""

from __future__ import annotations

import socket
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.simulation import autopilot_link as line_module
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile

pytestmark = pytest.mark.process

NS, MS = 1_000_000_000, 1_000_000


class Counted(SimulatedAutopilot):
    """Counts the looks at it, and those that brought something."""

    def __init__(self, profile: FirmwareProfile) -> None:
        super().__init__(profile)
        self.looks = self.answers = 0

    def due(self, now_ns: int) -> list[bytes]:
        out = super().due(now_ns)
        self.looks += 1
        self.answers += bool(out)
        return out


@contextmanager
def listening() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60.0)
        yield receiver


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_it_looks_when_something_is_due(kind: str) -> None:
    """On a real line, next to no look comes to nothing."""
    autopilot = Counted(FirmwareProfile(kind=kind, streams={30: 100.0, 32: 30.0}))
    got: Counter[str] = Counter()
    with listening() as receiver, AutopilotLink(autopilot, UdpEnd(*receiver.getsockname())):
        splitter = MessageSplitter()
        while got["ATTITUDE"] < 200:
            got.update(message.get_type() for message in splitter.feed(receiver.recv(65_536)))
    assert got["LOCAL_POSITION_NED"] > 0
    assert got["HEARTBEAT"] > 0
    assert autopilot.looks <= 1.2 * autopilot.answers + 5


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_asked_at_the_instants_it_names_it_sends_all_at_their_rates(kind: str) -> None:
    """And never comes to nothing."""
    autopilot = Counted(FirmwareProfile(kind=kind, streams={30: 100.0, 31: 40.0, 32: 25.0}))
    splitter, got, now_ns = MessageSplitter(), Counter[str](), NS
    while now_ns < 3 * NS:
        got.update(message.get_type() for message in splitter.feed(b"".join(autopilot.due(now_ns))))
        now_ns = autopilot.next_due_ns(now_ns)
    asks = 20 if kind == PX4 else 1
    streams = {"ATTITUDE": 200, "ATTITUDE_QUATERNION": 80, "LOCAL_POSITION_NED": 50}
    assert got == {**streams, "HEARTBEAT": 2, "TIMESYNC": asks}
    assert autopilot.looks == autopilot.answers


def test_after_a_read_the_time_of_the_next_one_is_given() -> None:
    autopilot = SimulatedAutopilot(FirmwareProfile(streams={30: 100.0, 32: 30.0}, timesync_asks_hz=2.0))
    assert len(autopilot.due(NS)) == 4
    assert autopilot.next_due_ns(NS) == NS + 10 * MS
    assert len(autopilot.due(NS + 10 * MS)) == 1
    assert autopilot.next_due_ns(NS + 10 * MS) == NS + 20 * MS
    assert autopilot.due(NS + 15 * MS) == []


def test_what_is_held_back_is_looked_at_again_soon_but_not_without_a_pause() -> None:
    hidden = [True]
    autopilot = SimulatedAutopilot(FirmwareProfile(streams={30: 100.0}, hides_attitude=lambda _: hidden[0]))
    autopilot.due(NS)
    hidden[0] = False
    autopilot.due(NS)
    hidden[0] = True
    at_ns = NS + 50 * MS  # attitudes are overdue, and hidden
    assert autopilot.due(at_ns) == []
    assert autopilot.next_due_ns(at_ns) == at_ns + MS
    hidden[0] = False
    assert len(autopilot.due(at_ns + MS)) == 1
    autopilot.silent = True
    late_ns = NS + 5 * NS
    assert autopilot.due(late_ns) == []
    assert autopilot.next_due_ns(late_ns) == late_ns + MS


def test_a_link_without_any_message_is_polled_soon() -> None:
    autopilot = SimulatedAutopilot()
    autopilot.sends_nothing = True
    assert autopilot.due(NS) == []
    assert autopilot.next_due_ns(NS) == NS + MS


def test_a_change_is_acted_on_at_once_and_may_come_after_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here nothing is due for hours: without being woken the line would sleep on."""
    monkeypatch.setattr(line_module, "_IDLE_S", 3600.0)
    monkeypatch.setattr(SimulatedAutopilot, "next_due_ns", lambda _, now_ns: now_ns + 3600 * NS)
    with listening() as receiver:
        with AutopilotLink(SimulatedAutopilot(), UdpEnd(*receiver.getsockname())) as line:
            assert receiver.recv(65_536)  # what is due at the beginning
            time.sleep(0.1)
            while receiver.recv(65_536) != b"last":
                line.change(lambda autopilot: autopilot.relay(b"last"))
        assert not line._thread.is_alive()
        assert line.change(lambda autopilot: autopilot.silent) is False
        line.close()


def test_without_messages_kept_for_tests_its_memory_does_not_grow() -> None:
    """`companion simulate-autopilot` kept each message that it received: 200 MB an hour."""
    autopilot, companion = SimulatedAutopilot(), dialect.MAVLink(None, 1, 196)
    autopilot.keeps_messages = False
    message = dialect.MAVLink_obstacle_distance_message(0, 0, [500] * 72, 5, 20, 1200)

    def receive(count: int) -> None:
        for k in range(count):
            autopilot.receive(message.pack(companion), k * 66 * MS)
            autopilot.due(k * 66 * MS)

    receive(100)
    tracemalloc.start()
    try:
        receive(100)
        before = tracemalloc.get_traced_memory()[0]
        receive(1000)
        assert tracemalloc.get_traced_memory()[0] - before < 20_000
    finally:
        tracemalloc.stop()
