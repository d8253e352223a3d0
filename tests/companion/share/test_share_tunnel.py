"""Packets between vehicles over the link to the autopilot: a real link over UDP."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from companion.share.autopilot_tunnel import AutopilotTunnel
from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.parser import Frame, MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.sharing.link import ReceivedPacket
from drivers.sharing.tunnel import FRAME_BYTES, PAYLOAD_TYPE, SIGNATURE_BYTES, TUNNEL_ID, tunnel_message
from drivers.simulation.autopilot import SimulatedAutopilot
from tests.ports import free_port

pytestmark = pytest.mark.process


@contextmanager
def tunnel(port: int, signed: bool = False) -> Iterator[tuple[AutopilotTunnel, list[ReceivedPacket]]]:
    """A tunnel over a link that listens at a port of the loopback."""
    received: list[ReceivedPacket] = []
    link = MavlinkLink(parse_address(f"udpin:127.0.0.1:{port}"), MavlinkSession(), lambda _: None)
    link.open()
    try:
        yield AutopilotTunnel(link, received.append, signed=signed), received
    finally:
        link.close()


def frame_of(message: dialect.MAVLink_message, system: int) -> Frame:
    """A message as a system sends it."""
    encoder = dialect.MAVLink(None, system, 1)
    (frame,) = MessageSplitter().frames(bytes(message.pack(encoder)))
    return frame


def test_packets_leave_over_the_link_of_the_autopilot() -> None:
    port, packets = free_port(), [b"first", bytes(range(128))]
    found: list[bytes] = []
    with (
        tunnel(port) as (link, _),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
    ):
        autopilot.settimeout(0.1)
        splitter, end_s = MessageSplitter(), time.monotonic() + 30.0
        while len(found) < 2 and time.monotonic() < end_s:
            for data in SimulatedAutopilot().due(time.monotonic_ns()):
                autopilot.sendto(data, ("127.0.0.1", port))
            if not found:
                link.send(packets, 7)
            try:
                frames = splitter.frames(autopilot.recv(2048))
            except TimeoutError:
                continue
            messages = [f.message() for f in frames if f.id == TUNNEL_ID]
            found += [bytes(m.payload[: m.payload_length]) for m in messages if m.payload_type == PAYLOAD_TYPE]
    assert found[:2] == packets


def test_a_link_that_is_not_open_is_named() -> None:
    link = MavlinkLink(Address("udpin", "127.0.0.1", free_port()), MavlinkSession(), lambda _: None)
    assert AutopilotTunnel(link, lambda _: None, signed=False).fault == (
        "the link to the autopilot is not open: not opened yet"
    )
    with tunnel(free_port()) as (there, _):
        end_s = time.monotonic() + 30.0
        while there.fault and time.monotonic() < end_s:
            time.sleep(0.01)
        assert there.fault == ""


@pytest.mark.parametrize("signed", [False, True])
def test_a_signature_counts_as_overhead(signed: bool) -> None:
    with tunnel(free_port(), signed) as (link, _):
        assert link.overhead_bytes == FRAME_BYTES + SIGNATURE_BYTES * signed
    message = tunnel_message(bytes([1]) * link.packet_bytes)
    assert len(message.pack(dialect.MAVLink(None))) == link.packet_bytes + FRAME_BYTES


def test_packets_of_other_vehicles_are_delivered_and_other_tunnels_counted() -> None:
    with tunnel(free_port()) as (link, received):
        link.take(frame_of(tunnel_message(b"abc"), 9), 123)
        assert received == [ReceivedPacket("tunnel", b"abc", 123, 9, None)]
        assert link.refused == {}
        other = dialect.MAVLink_tunnel_message(0, 0, PAYLOAD_TYPE + 1, 3, [1, 2, 3, *[0] * 125])
        link.take(frame_of(other, 9), 124)
        assert len(received) == 1
        assert link.refused == {"other_payload": 1}
