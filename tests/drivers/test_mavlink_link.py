"""The link on real lines: UDP, pty and TCP, with what happens to them."""

from __future__ import annotations

import errno
import fcntl
import os
import resource
import socket
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial

from core.types import AttitudeSample, PoseSample
from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.mavlink import commands, tcp_line, udp_line
from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.anomalies import LinkAnomaly
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import LEAD_NS, LEAST_APART_NS, LONGEST_PAUSE_S, PAUSE_S, MavlinkLink, PollScheduler
from drivers.mavlink.open_transport import open_transport
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams
from drivers.mavlink.transport import Chunk
from drivers.mavlink.udp_flood import PER_SOURCE, WINDOW_NS
from drivers.mavlink.udp_line import UdpLine
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port

pytestmark = pytest.mark.process

NS, MS = 1_000_000_000, 1_000_000
Samples = list[AttitudeSample | PoseSample]


def until(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Waits for a condition; whether it came true."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.01)
    return condition()


def next_round(link: MavlinkLink) -> None:
    """Waits until the link's thread has begun another round, and with it has ended the one at hand."""
    for _ in range(2):
        now_ns = time.monotonic_ns()
        assert until(partial(_is_alive_since, link, now_ns))


@contextmanager
def linked(address: Address, params: MavlinkParams | None = None) -> Iterator[tuple[MavlinkLink, Samples]]:
    samples: Samples = []
    link = MavlinkLink(address, MavlinkSession(params), samples.extend)
    link.open()
    try:
        yield link, samples
    finally:
        link.close()


ATTITUDE, ATTITUDE_QUATERNION = 30, 31


def synchronised(link: MavlinkLink) -> bool:
    return link.status().clock.source is ClockSource.TIMESYNC


def attitudes_flow(line: AutopilotLink, samples: Samples) -> bool:
    """Whether the autopilot was asked for the attitude at the wanted rate, and sends it. The rate that arrives depends on the
    computer."""
    asked_hz = line.change(lambda a: max(a._intervals.get(number, 0.0) for number in (ATTITUDE, ATTITUDE_QUATERNION)))
    return asked_hz == MavlinkParams().attitude_hz and len(samples) > 100


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_over_udp_the_clock_is_synchronised_and_attitudes_flow(kind: str) -> None:
    port = free_port()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, boot_at_ns=time.monotonic_ns() - 10**10))
    with (
        AutopilotLink(autopilot, UdpEnd("127.0.0.1", port), Faults(jitter_s=0.005)) as line,
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, samples),
    ):
        assert until(lambda: synchronised(link) and attitudes_flow(line, samples))
        now_ns = time.monotonic_ns()
        boot_ns = line.change(lambda a: a.boot_ns(now_ns))
        assert abs(link.status().clock.local_ns(boot_ns) - now_ns) < 5_000_000
        assert samples[-1].t_ns <= samples[-1].t_arrival_ns


def test_over_a_serial_line() -> None:
    end = PtyEnd()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT))
    address = parse_address(f"serial:{end.device}:921600")
    with AutopilotLink(autopilot, end) as line, linked(address) as (link, samples):
        assert until(lambda: synchronised(link) and attitudes_flow(line, samples))


def test_a_slow_serial_line_is_reported() -> None:
    end = PtyEnd()
    with AutopilotLink(SimulatedAutopilot(), end), linked(parse_address(f"serial:{end.device}:57600")) as (link, _):
        assert until(lambda: link.state.open)
        assert "5760 bytes/s" in link.state.warning


def test_distances_do_not_wait_in_the_buffer_of_a_slow_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pty has no buffer of its own that can be asked, so the number of its bytes is set here."""
    waiting = [0]
    monkeypatch.setattr(serial.Serial, "out_waiting", property(lambda port: waiting[0]))
    end = PtyEnd()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT))
    with AutopilotLink(autopilot, end) as line, linked(parse_address(f"serial:{end.device}:57600")) as (link, _):
        assert until(lambda: link.status().vehicle is not None)
        for late, number in ((4000, 1), (4000, 2), (0, 3)):
            waiting[0] = late
            if late:
                next_round(link)  # what is being sent
            link.post(dialect.MAVLink_obstacle_distance_message(0, 0, [number] * 72, 5, 20, 1200))
        assert until(lambda: bool(line.change(lambda a: a.of_kind("OBSTACLE_DISTANCE"))))
        received = line.change(lambda a: [m.distances[0] for m in a.of_kind("OBSTACLE_DISTANCE")])
        assert received == [3]
        waiting[0] = 4000
        assert until(lambda: "takes no messages: 4000 bytes" in link.state.warning)
        waiting[0] = 0
        assert until(lambda: "takes no messages" not in link.state.warning)


def test_a_command_does_not_wait_until_a_line_takes_messages_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was decided by a flight mode of that time: sent later, it would take control from the pilot."""
    waiting = [0]
    monkeypatch.setattr(serial.Serial, "out_waiting", property(lambda port: waiting[0]))
    end = PtyEnd()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT))
    with AutopilotLink(autopilot, end) as line, linked(parse_address(f"serial:{end.device}:57600")) as (link, _):
        assert until(lambda: link.status().vehicle is not None)
        waiting[0] = 4000
        next_round(link)  # what is being sent
        link.post(commands.set_copter_mode(1, commands.COPTER_BRAKE))
        link.post(dialect.MAVLink_obstacle_distance_message(0, 0, [1201] * 72, 5, 20, 1200))
        time.sleep(1.0)
        waiting[0] = 0
        link.post(dialect.MAVLink_statustext_message(6, b"the line is free"))
        assert until(lambda: bool(line.change(lambda a: a.of_kind("STATUSTEXT"))))
        assert line.change(lambda a: [m for m in a.of_kind("COMMAND_LONG") if m.command == commands.DO_SET_MODE]) == []
        assert line.change(lambda a: a.of_kind("OBSTACLE_DISTANCE")) == []
        link.post(commands.set_copter_mode(1, commands.COPTER_BRAKE))
        assert until(
            lambda: line.change(lambda a: any(m.command == commands.DO_SET_MODE for m in a.of_kind("COMMAND_LONG")))
        )


def test_noise_doubles_and_late_messages_on_the_line() -> None:
    port = free_port()
    faults = Faults(jitter_s=0.01, noise_share=0.2, double_share=0.1, late_share=0.05)
    with (
        AutopilotLink(SimulatedAutopilot(), UdpEnd("127.0.0.1", port), faults),
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, samples),
    ):
        assert until(lambda: synchronised(link) and len(samples) > 200)
        assert link.status().clock_restarts == 0
        assert link.status().counts["noise_bytes"] > 0


def test_a_line_that_is_not_there_yet_is_opened_when_it_comes(tmp_path: Path) -> None:
    place = tmp_path / "usb-autopilot"
    with linked(Address("serial", str(place), 921600)) as (link, _):
        assert until(lambda: "No such file" in link.state.error)
        alive_ns = link.state.alive_ns
        assert until(lambda: link.state.alive_ns > alive_ns)  # waiting is living
        end = PtyEnd()
        place.symlink_to(end.device)
        with AutopilotLink(SimulatedAutopilot(), end):
            assert until(lambda: link.state.open and link.status().vehicle is not None)


def test_an_unplugged_line_is_lost_and_found_again(tmp_path: Path) -> None:
    place = tmp_path / "usb-autopilot"
    first = PtyEnd()
    place.symlink_to(first.device)
    with linked(Address("serial", str(place), 921600)) as (link, _):
        with AutopilotLink(SimulatedAutopilot(), first):
            assert until(lambda: link.status().vehicle is not None)
        assert until(lambda: link.state.losses >= 1)  # closed with its end: unplugged
        second = PtyEnd()
        place.unlink()
        place.symlink_to(second.device)
        autopilot = SimulatedAutopilot()
        with AutopilotLink(autopilot, second) as line:
            assert until(lambda: link.state.open and line.change(lambda a: len(a.of_kind("TIMESYNC")) > 0))


def test_a_reboot_with_a_new_udp_port() -> None:
    port = free_port()
    address = parse_address(f"udpin:127.0.0.1:{port}")
    first = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, boot_at_ns=time.monotonic_ns() - 10**11))
    with linked(address) as (link, samples):
        with AutopilotLink(first, UdpEnd("127.0.0.1", port)):
            assert until(lambda: synchronised(link) and len(samples) > 50)
        again = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, boot_at_ns=time.monotonic_ns()))
        with AutopilotLink(again, UdpEnd("127.0.0.1", port)) as line:
            assert until(lambda: link.status().clock_restarts == 1 and synchronised(link))
            samples.clear()
            assert until(lambda: attitudes_flow(line, samples))


@pytest.mark.parametrize("found", [True, False])
def test_a_host_name_that_takes_long_to_resolve_does_not_stop_the_thread(
    monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    """Without a network the system tries for 10 to 20 s. The service was restarted meanwhile, as if it were hung."""
    resolve, asked, release, resolved = socket.getaddrinfo, threading.Event(), threading.Event(), threading.Event()

    def slow(*args: Any) -> Any:
        asked.set()
        release.wait(60.0)
        resolved.set()
        if not found:
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return resolve(*args)

    monkeypatch.setattr(socket, "getaddrinfo", slow)
    with linked(Address("udpout", "localhost", free_port())) as (link, _):
        assert asked.wait(60.0)
        begun_ns = time.monotonic_ns()
        assert until(lambda: link.state.alive_ns > begun_ns + NS)
        assert not link.state.open
        release.set()
        assert until(lambda: link.state.open if found else "Temporary failure" in link.state.error)
    release.clear()
    resolved.clear()
    link = MavlinkLink(Address("udpout", "localhost", free_port()), MavlinkSession(), lambda samples: None)
    asked.clear()
    link.open()
    assert asked.wait(60.0)
    link.close()
    assert not resolved.is_set(), "it does not wait for the name"
    release.set()


def test_udpout_sends_a_heartbeat_first() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind(("127.0.0.1", 0))
        router.settimeout(60.0)
        with linked(parse_address(f"udpout:127.0.0.1:{router.getsockname()[1]}")):
            data, _ = router.recvfrom(1000)
            assert dialect.MAVLink(None).parse_buffer(data)[0].get_type() == "HEARTBEAT"


def test_tcp_and_the_loss_of_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        with linked(parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}")) as (link, _):
            connection, _peer = server.accept()
            autopilot = SimulatedAutopilot()
            connection.sendall(b"".join(autopilot.due(time.monotonic_ns())))
            assert until(lambda: link.status().vehicle is not None)
            connection.close()
            assert until(lambda: link.state.losses == 1)
            server.accept()[0].close()


def test_a_connection_that_falls_silent_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a network was down, TCP itself waits about as long again before it sends the rest."""
    monkeypatch.setattr(tcp_line, "SILENT_NS", NS // 2, raising=False)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(60.0)
        with linked(parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}")) as (link, _):
            first, _ = server.accept()
            assert until(lambda: link.state.open)
            time.sleep(1.0)  # an autopilot that is switched on later is not a loss
            assert link.state.losses == 0
            first.sendall(b"\xfd")
            second, _ = server.accept()
            assert until(lambda: link.state.losses == 1 and link.state.open)
            first.close()
            second.close()


def test_distances_do_not_wait_in_the_buffer_of_a_connection() -> None:
    """The other end does not read for 3 s. Before, it then read the distances of 3 s ago."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        server.settimeout(60.0)
        with linked(parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}")) as (link, _):
            connection, _peer = server.accept()
            connection.settimeout(60.0)
            autopilot = SimulatedAutopilot()

            def post(number: int) -> None:
                connection.sendall(b"".join(autopilot.due(time.monotonic_ns())))
                link.post(dialect.MAVLink_obstacle_distance_message(0, 0, [number] * 72, 5, 20, 1200))
                time.sleep(0.005)

            post(0)
            assert until(lambda: link.status().vehicle is not None)
            for number in range(1, 601):
                post(number)
            assert until(lambda: "takes no messages" in link.state.warning)
            parser, received = dialect.MAVLink(None), [0]
            while received[-1] < 601:
                post(601)
                for message in parser.parse_buffer(connection.recv(65536)) or []:
                    if message.get_type() == "OBSTACLE_DISTANCE":
                        received.append(message.distances[0])
            assert len(received) < 100, "600 were sent"
            assert until(lambda: "takes no messages" not in link.state.warning)


def test_bytes_waiting_on_the_link_are_read_by_catch_up() -> None:
    port = free_port()
    started_ns = time.monotonic_ns() - 10**10
    place = ("127.0.0.1", port)
    with linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, samples):
        with AutopilotLink(SimulatedAutopilot(FirmwareProfile(boot_at_ns=started_ns)), UdpEnd(*place)):
            assert until(lambda: synchronised(link) and len(samples) > 20)
        link.catch_up()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            encoder = dialect.MAVLink(None, 1, 1)
            for k in range(20):  # whatever the link's own thread is at
                boot_ms = (time.monotonic_ns() - started_ns) // 1_000_000
                message = dialect.MAVLink_attitude_quaternion_message(
                    boot_ms, 1.0, 1e-4 * k, 0.0, 0.0, 0.01 * k, 0.0, 0.0
                )
                autopilot.sendto(message.pack(encoder), place)
                link.catch_up()
                newest = samples[-1]
                assert isinstance(newest, AttitudeSample)
                assert newest.rates_frd_rad_s == pytest.approx((0.01 * k, 0.0, 0.0))
        stamps = [s.t_arrival_ns for s in samples]
        assert stamps == sorted(stamps)


def looks_and_frames(apart_ns: int, jitter_ns: int, *, little: bool) -> tuple[list[int], list[int]]:
    """When a line on which little or more comes is looked at while frames come for two seconds."""
    scheduler, rng = PollScheduler(), np.random.default_rng(5)
    frames = [k * apart_ns + int(rng.integers(-jitter_ns, jitter_ns + 1)) for k in range(1, 2 * NS // apart_ns)]
    looks, now_ns, come = [], 0, 0
    while now_ns < frames[-1]:
        now_ns += round(scheduler.pause_s(now_ns, little=little) * NS)
        while come < len(frames) and frames[come] <= now_ns:
            scheduler.asked(frames[come])
            come += 1
        looks.append(now_ns)
    return looks, frames


@pytest.mark.parametrize(
    ("hz", "rate_hz", "little"),
    [
        *[(10, 30, False), (12, 25, False), (15, 30, False), (20, 40, False), (30, 30, False), (60, 30, False)],
        *[
            (6, 12, True),
            (10, 10, True),
            (12, 12, True),
            (15, 15, True),
            (20, 20, True),
            (30, 30, True),
            (60, 30, True),
        ],
    ],
)
def test_the_line_is_looked_at_shortly_before_a_frame_is_expected(hz: int, rate_hz: int, little: bool) -> None:
    looks, frames = looks_and_frames(NS // hz, 200_000, little=little)
    since_ns = [min(frame - look for look in looks if look <= frame) for frame in frames[5:]]
    met = np.mean([LEAD_NS - 2 * MS <= gap <= LEAD_NS + 2 * MS for gap in since_ns])
    assert met >= (0.45 if hz > 40 else 0.95)
    assert len(looks) <= 2 * rate_hz + 5
    assert max(np.diff(looks)) <= (LONGEST_PAUSE_S if little else PAUSE_S) * NS + 1


@pytest.mark.parametrize("apart_ns", [1, 1_000_000, LEAST_APART_NS, 7_000_000, NS, 5 * NS])
def test_the_link_is_polled_at_the_same_rate_for_any_message_rate(apart_ns: int) -> None:
    scheduler = PollScheduler()
    assert scheduler.pause_s(10 * NS) == PAUSE_S
    for k in range(3):
        scheduler.asked(10 * NS + k * apart_ns)
    last_ns = 10 * NS + 2 * apart_ns
    for later_ns in (0, 1, apart_ns // 2, apart_ns, 3 * apart_ns, 100 * NS):
        assert 0.5 * PAUSE_S <= scheduler.pause_s(last_ns + later_ns) <= PAUSE_S
        assert 0.5 * PAUSE_S <= scheduler.pause_s(last_ns + later_ns, little=True) <= LONGEST_PAUSE_S
    for little in (False, True):
        pause_s = scheduler.pause_s(last_ns + 2 * apart_ns + 1, little=little)
        assert pause_s == PAUSE_S, "frames that stopped coming are not waited for"


def test_noise_is_left_to_the_links_own_thread() -> None:
    line = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    samples: Samples = []
    link = MavlinkLink(Address("udpin", "127.0.0.1", line.port), MavlinkSession(), samples.extend)
    link._transport = line  # its thread does not run: it is busy elsewhere
    noise, heartbeat = b"\x55" * 1000, SimulatedAutopilot().due(time.monotonic_ns())
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for data in (*[noise] * 5, *heartbeat):
                sender.sendto(data, ("127.0.0.1", line.port))
            link.catch_up()
            assert link.status().counts == {}
            sender.sendto(noise, ("127.0.0.1", line.port))
            link.catch_up()  # nothing is read before what was left
            assert link.status().counts == {}
        link._round(line)
        assert link.status().counts == {"noise_bytes": 5000}
        assert link.status().vehicle is not None
        link.catch_up()
        assert link.status().counts == {"noise_bytes": 6000}
        with link._turn:
            link.catch_up()  # whoever has a frame does not wait for a thread that is at it
    finally:
        line.close()


def test_a_flood_does_not_keep_the_attitude_from_the_frame_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Real datagrams, 200 of noise before each attitude; the link's own thread does not run. A read may take any time here:
    how many datagrams 10 ms are enough for depends on the machine."""
    monkeypatch.setattr(udp_line, "_LONGEST_NS", 60 * NS)
    line = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    samples: Samples = []
    session = MavlinkSession()
    for _ in range(3):  # the autopilot's clock is the local one
        now_ns = time.monotonic_ns()
        session.clock.exchange(now_ns, now_ns, now_ns)
    link = MavlinkLink(Address("udpin", "127.0.0.1", line.port), session, samples.extend)
    link._transport = line
    place, noise = ("127.0.0.1", line.port), b"\x55" * 250
    encoder = dialect.MAVLink(None, 1, 1)
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            for data in SimulatedAutopilot().due(time.monotonic_ns()):
                autopilot.sendto(data, place)
            link.catch_up()
            with_attitude, begun_ns = 0, time.monotonic_ns()
            for k in range(60):
                for _ in range(200):
                    sender.sendto(noise, place)
                boot_ms = time.monotonic_ns() // 1_000_000
                message = dialect.MAVLink_attitude_quaternion_message(
                    boot_ms, 1.0, 1e-4 * k, 0.0, 0.0, 0.01 * k, 0.0, 0.0
                )
                autopilot.sendto(message.pack(encoder), place)
                before = len(samples)
                link.catch_up()
                with_attitude += len(samples) > before
                if link._left:
                    link._round(line)  # what is too much for a frame is the thread's
            windows = 2 + (time.monotonic_ns() - begun_ns) // WINDOW_NS
            assert with_attitude >= 60 - windows  # a new window lets some of the noise pass
            assert link.status().counts["flood_dropped"] >= 60 * 200 - windows * PER_SOURCE
            assert "are dropped unread" in line.flood.text(time.monotonic_ns())
    finally:
        line.close()


def test_a_flood_is_named_beside_the_line() -> None:
    port = free_port()
    place = ("127.0.0.1", port)
    with (
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, samples),
        AutopilotLink(SimulatedAutopilot(), UdpEnd(*place)),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        assert until(lambda: synchronised(link) and len(samples) > 20)
        assert link.state.flood == ""

        def flooded() -> bool:
            for _ in range(10):
                sender.sendto(b"\x55" * 100, place)
            return bool(link.state.flood)

        assert until(flooded)
        assert "from 127.0.0.1:" in link.state.flood
        assert until(lambda: link.state.flood == "")


def test_to_catch_up_on_a_line_that_is_lost_is_the_links_own_affair(tmp_path: Path) -> None:
    place = tmp_path / "usb-autopilot"
    end = PtyEnd()
    place.symlink_to(end.device)
    with linked(Address("serial", str(place), 921600)) as (link, samples):
        link.catch_up()  # perhaps there is no line yet
        with AutopilotLink(SimulatedAutopilot(), end):
            assert until(lambda: synchronised(link) and len(samples) > 20)
        for _ in range(50):
            link.catch_up()
        assert until(lambda: link.state.losses == 1)
        link.catch_up()


class DeafLine(UdpLine):
    """A line that brings what was sent and breaks when we speak."""

    def write(self, data: bytes) -> None:
        raise DeviceLost(f"the cable is cut before {len(data)} bytes")


def test_what_a_line_brought_before_it_broke_is_delivered() -> None:
    line = DeafLine(Address("udpin", "127.0.0.1", free_port()))
    samples: Samples = []
    session, autopilot = MavlinkSession(), SimulatedAutopilot()
    link = MavlinkLink(Address("udpin", "127.0.0.1", line.port), session, samples.extend)
    begin_ns = time.monotonic_ns() - NS
    for _ in range(3):  # the autopilot's clock is the local one
        session.clock.exchange(begin_ns, begin_ns, begin_ns)
    spoken = [data for k in range(100) for data in autopilot.due(begin_ns + k * 10_000_000)]
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for data in spoken:
                sender.sendto(data, ("127.0.0.1", line.port))
            with pytest.raises(DeviceLost, match="the cable is cut"):
                link._round(line)
    finally:
        line.close()
    assert sum(isinstance(s, AttitudeSample) for s in samples) > 20


def test_a_line_that_breaks_while_it_catches_up_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a stream, the bytes after a message that was cut short would be lost, too."""
    port, broken = free_port(), threading.Event()

    class Stuck(UdpLine):
        """A line that breaks once, when the caller of catch_up writes."""

        def write(self, data: bytes) -> None:
            if threading.current_thread() is threading.main_thread() and not broken.is_set():
                broken.set()
                raise DeviceLost("the connection is stuck")
            super().write(data)

    monkeypatch.setattr("drivers.mavlink.open_transport.open_transport", Stuck)
    with (
        AutopilotLink(SimulatedAutopilot(), UdpEnd("127.0.0.1", port)),
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, _),
    ):
        assert until(lambda: link.status().vehicle is not None)

        def caught_up() -> bool:
            link.post(dialect.MAVLink_statustext_message(2, b"OA: blind"))
            link.catch_up()
            return broken.is_set()

        assert until(caught_up)
        assert until(lambda: link.state.losses == 1 and link.state.open)


def _is_alive_since(link: MavlinkLink, t_ns: int) -> bool:
    return link.state.alive_ns > t_ns


def test_a_line_that_takes_long_to_close_does_not_stop_the_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel waits for up to 30 s for a serial device that takes no bytes: the service was restarted meanwhile."""
    port, broken, closes = free_port(), threading.Event(), threading.Event()

    class Hanging(UdpLine):
        def read(self, timeout_s: float = 0.0) -> list[Chunk]:
            if not broken.is_set():
                broken.set()
                raise DeviceLost("the device hangs")
            return super().read(timeout_s)

        def close(self) -> None:
            closes.wait(60.0)
            super().close()

    monkeypatch.setattr("drivers.mavlink.open_transport.open_transport", Hanging)
    try:
        with linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, _):
            assert until(lambda: link.state.error == "the device hangs")
            for _ in range(3):
                assert until(partial(_is_alive_since, link, link.state.alive_ns))
            assert not link.state.open
            link.catch_up()
            closes.set()
            assert until(lambda: link.state.open)
    finally:
        closes.set()


@pytest.mark.parametrize("drains", [True, False])
def test_bytes_that_a_device_does_not_take_are_discarded_at_the_end(
    drains: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the kernel waits for them. A pty has no such buffer: its size is made up."""
    end, discarded = PtyEnd(), []
    line = open_transport(Address("serial", end.device, 57600))
    left = iter([40, 20, 0]) if drains else None
    monkeypatch.setattr(serial.Serial, "out_waiting", property(lambda port: 40 if left is None else next(left, 0)))
    monkeypatch.setattr(serial.Serial, "reset_output_buffer", lambda port: discarded.append(port))
    line.close()
    end.close()
    assert bool(discarded) != drains


def test_what_was_posted_before_the_line_is_closed_still_goes_out() -> None:
    port = free_port()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT))
    with (
        AutopilotLink(autopilot, UdpEnd("127.0.0.1", port)) as line,
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, _),
    ):
        assert until(lambda: link.status().vehicle is not None)
        link.post(dialect.MAVLink_statustext_message(2, b"OA: the last words"))
        link.close()
        assert until(lambda: "OA: the last words" in line.change(lambda a: [m.text for m in a.of_kind("STATUSTEXT")]))


def test_what_we_post_reaches_the_autopilot() -> None:
    port = free_port()
    with (
        AutopilotLink(SimulatedAutopilot(), UdpEnd("127.0.0.1", port)) as line,
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, _),
    ):
        assert until(lambda: link.status().vehicle is not None)
        link.post(dialect.MAVLink_statustext_message(6, b"OA: here"))
        assert until(lambda: line.change(lambda a: [m.text for m in a.of_kind("STATUSTEXT")]) == ["OA: here"])


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("serial:/dev/serial/by-id/usb-x:57600", Address("serial", "/dev/serial/by-id/usb-x", 57600)),
        ("serial:/dev/ttyAMA0", Address("serial", "/dev/ttyAMA0", 921600)),
        (
            "serial:/dev/serial/by-path/pci-0:1.2:1.0",
            Address("serial", "/dev/serial/by-path/pci-0:1.2:1.0", 921600),
        ),
        (
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0:57600",
            Address("serial", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0", 57600),
        ),
        ("udpin:0.0.0.0:14540", Address("udpin", "0.0.0.0", 14540)),
        ("tcp:host:5760", Address("tcp", "host", 5760)),
        ("udpout:[fe80::1%eth0]:14550", Address("udpout", "[fe80::1%eth0]", 14550)),
    ],
)
def test_addresses(text: str, address: Address) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize(
    "text",
    ["", "ttyACM0", "udp:1.2.3.4:14550", "udpin:0.0.0.0", "tcp:host:0", "tcp:::1:5760", "tcp:[::1]", "serial:ttyS0"],
)
def test_a_wrong_address_names_the_forms_there_are(text: str) -> None:
    with pytest.raises(ValueError, match="expected serial:/dev/serial/by-id"):
        parse_address(text)


@pytest.mark.parametrize("baud", ["abc", "", "57600baud", "57.6k", "-1", "921600 "])
def test_a_baud_rate_that_is_no_number_is_named(baud: str) -> None:
    """It was taken for a part of the device's name: no such file, plug it in."""
    for place in ("/dev/ttyUSB0", "/dev/serial/by-id/usb-x", "/dev/serial/by-path/pci-0:1.2:1.0"):
        with pytest.raises(ValueError, match=f'the baud rate is "{baud}", expected 1200 to 12000000, such as 921600'):
            parse_address(f"serial:{place}:{baud}")


def test_failures_to_open_name_cause_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match=r"No such file or directory; plug it in"):
        open_transport(Address("serial", str(tmp_path / "none"), 57600))
    with pytest.raises(DeviceNotFound, match="the other end listens there"):
        open_transport(Address("tcp", "127.0.0.1", 1))
    held = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    try:
        with pytest.raises(DeviceNotFound, match="end the other program on this port"):
            open_transport(Address("udpin", "127.0.0.1", held.port))
    finally:
        held.close()


def test_udp_and_tcp_over_ipv6() -> None:
    listening = UdpLine(parse_address(f"udpin:[::1]:{free_port()}"))
    sending = UdpLine(parse_address(f"udpout:[::1]:{listening.port}"))
    try:
        sending.write(b"heartbeat")
        ((data, _),) = listening.read(60.0)
        listening.answer(0)
        listening.write(b"answer")
        assert (data, sending.read(60.0)[0][0]) == (b"heartbeat", b"answer")
    finally:
        listening.close()
        sending.close()
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as server:
        line = open_transport(parse_address(f"tcp:[::1]:{server.getsockname()[1]}"))
        end, _ = server.accept()
        line.write(b"heartbeat")
        assert end.recv(100) == b"heartbeat"
        end.close()
        line.close()


def test_a_port_that_another_program_holds() -> None:
    end = PtyEnd()
    first = open_transport(Address("serial", end.device, 57600))
    try:
        with pytest.raises(DeviceNotFound, match="another program holds"):
            open_transport(Address("serial", end.device, 57600))
    finally:
        first.close()
        end.close()


def test_a_message_that_a_full_buffer_cut_short_is_completed() -> None:
    """Otherwise the receiver takes the beginning of the next message for the rest of it, and loses both."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    line = open_transport(Address("serial", os.ttyname(slave), 921600))
    encoder, splitter = dialect.MAVLink(None, 1, 196), MessageSplitter()
    found = written = 0
    try:
        for k in range(4000):
            text = bytes(dialect.MAVLink_statustext_message(2, b"x" * (1 + k % 49)).pack(encoder))
            line.write(text)
            written += 1
            if k % 500 == 499 or k > 3900:  # the receiver reads late, and not all of it
                with suppress(BlockingIOError):
                    found += len(splitter.frames(os.read(master, 1000)))
        for _ in range(100):
            with suppress(BlockingIOError):
                found += len(splitter.frames(os.read(master, 65_536)))
    finally:
        line.close()
        os.close(master)
        os.close(slave)
    assert 50 < found < written, "the buffer was full"
    assert splitter.counts[LinkAnomaly.NOISE_BYTES] == 0


def waiting(descriptor: int) -> int:
    """The number of bytes that a read would return."""
    return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)


def test_bytes_that_arrive_during_a_read_are_not_stamped_before_their_arrival(monkeypatch: pytest.MonkeyPatch) -> None:
    """No message arrives before it was measured: the clock's error bound depends on it."""
    own, theirs = os.openpty()
    tty.setraw(theirs)
    line = open_transport(Address("serial", os.ttyname(theirs), 57600))
    read, sent_ns = os.read, 0

    def interrupted(descriptor: int, size: int) -> bytes:
        nonlocal sent_ns
        time.sleep(0.002)
        sent_ns = time.monotonic_ns()
        os.write(own, b"late")
        assert until(lambda: waiting(descriptor) == 9)  # a pty passes bytes on a little later
        return read(descriptor, size)

    try:
        os.write(own, b"early")
        monkeypatch.setattr("drivers.mavlink.serial_line.os.read", interrupted)
        ((data, arrival_ns),) = line.read(60.0)
        assert data == b"earlylate"
        assert arrival_ns >= sent_ns
    finally:
        line.close()
        os.close(own)
        os.close(theirs)


def test_a_pty_that_hangs_up_is_lost() -> None:
    own, theirs = os.openpty()
    line = open_transport(Address("serial", os.ttyname(theirs), 57600))
    os.close(theirs)
    os.close(own)
    with pytest.raises(DeviceLost, match="check its cable"):
        line.read(60.0)
    line.close()


def test_a_rate_that_no_port_supports() -> None:
    end = PtyEnd()
    with pytest.raises(BadData, match="choose a rate that the port supports"):
        open_transport(Address("serial", end.device, -5))
    end.close()


@pytest.fixture
def many_files() -> Iterator[None]:
    """The next file has a number beyond those that select() takes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard if hard != resource.RLIM_INFINITY else 4096, hard))
    files = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]
    yield
    for file in files:
        os.close(file)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("kind", ["serial", "tcp", "udpin"])
def test_a_line_is_read_while_many_files_are_open(kind: str, many_files: None) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        end, port = PtyEnd(), free_port()
        places = {"serial": f"{end.device}:921600", "tcp": f"127.0.0.1:{server.getsockname()[1]}"}
        transport = open_transport(parse_address(f"{kind}:{places.get(kind, f'127.0.0.1:{port}')}"))
        try:
            transport.wait(0.001)
            assert transport.read(0.001) == []
            if kind == "serial":
                end.write(b"bytes")
            elif kind == "tcp":
                server.accept()[0].sendall(b"bytes")
            else:
                sender.sendto(b"bytes", ("127.0.0.1", port))
            transport.wait(60.0)
            assert b"".join(data for data, _ in transport.read()) == b"bytes"
        finally:
            transport.close()


@pytest.mark.parametrize("failing", ["termios.tcflush", "os.pipe", "socket.socket"])
def test_a_line_that_fails_while_it_is_opened_is_tried_again(failing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A USB adapter can be unplugged between the steps of opening it, and files or memory can be used up."""
    errors = {"termios.tcflush": termios.error(errno.EIO, "Input/output error")}
    left = [3]

    def works_later(*arguments: Any) -> Any:
        if threading.current_thread().name == "mavlink open" and left[0]:
            left[0] -= 1
            raise errors.get(failing, OSError(errno.EMFILE, os.strerror(errno.EMFILE)))
        return works(*arguments)

    end = PtyEnd()
    address = f"udpin:127.0.0.1:{free_port()}" if failing == "socket.socket" else f"serial:{end.device}:921600"
    works = {"termios.tcflush": termios.tcflush, "os.pipe": os.pipe, "socket.socket": socket.socket}[failing]
    monkeypatch.setattr(failing, works_later)
    with linked(parse_address(address)) as (link, _):
        assert until(lambda: left[0] == 0)
        assert until(lambda: link.state.open)
        assert link.failure == ""
