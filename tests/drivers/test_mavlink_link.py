"""A link over real lines: synchronisation, losses, floods, and what is sent."""

from __future__ import annotations

import errno
import os
import resource
import socket
import termios
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import serial

from drivers.base import DeviceLost
from drivers.mavlink import commands, tcp_line
from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.anomalies import LinkAnomaly
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.open_transport import open_transport
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams
from drivers.mavlink.transport import Chunk
from drivers.mavlink.udp_line import UdpLine
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port
from tests.waiting import until

from .linked import NS, Samples, linked, synchronised

pytestmark = pytest.mark.process


def next_round(link: MavlinkLink) -> None:
    """Waits until the link's thread has begun another round, and with it has ended the one at hand."""
    for _ in range(2):
        now_ns = time.monotonic_ns()
        assert until(partial(_is_alive_since, link, now_ns))


ATTITUDE, ATTITUDE_QUATERNION = 30, 31


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


def test_a_pty_that_hangs_up_is_lost() -> None:
    own, theirs = os.openpty()
    line = open_transport(Address("serial", os.ttyname(theirs), 57600))
    os.close(theirs)
    os.close(own)
    with pytest.raises(DeviceLost, match="check its cable"):
        line.read(60.0)
    line.close()


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
