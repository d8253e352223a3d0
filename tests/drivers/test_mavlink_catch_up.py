"""Bytes that wait on a link: when it is read, and what a frame finds."""

from __future__ import annotations

import os
import socket
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from core.types import AttitudeSample
from drivers.base import DeviceLost
from drivers.mavlink import udp_line
from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import LEAD_NS, LEAST_APART_NS, LONGEST_PAUSE_S, PAUSE_S, MavlinkLink, PollScheduler
from drivers.mavlink.open_transport import open_transport
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.udp_flood import PER_SOURCE, WINDOW_NS
from drivers.mavlink.udp_line import UdpLine
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, PtyEnd, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port
from tests.waiting import until

from .linked import MS, NS, Samples, linked, synchronised, waiting

pytestmark = pytest.mark.process


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
                    boot_ms, 1.0, 1e-4 * k, 0.0, 0.0, 0.01 * (k + 1), 0.0, 0.0
                )
                autopilot.sendto(message.pack(encoder), place)
                link.catch_up()
                newest = samples[-1]
                assert isinstance(newest, AttitudeSample)
                assert newest.rates_frd_rad_s == pytest.approx((0.01 * (k + 1), 0.0, 0.0))
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
            link.catch_up()  # does not wait for a thread that reads the link
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
                    boot_ms, 1.0, 1e-4 * k, 0.0, 0.0, 0.01 * (k + 1), 0.0, 0.0
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
