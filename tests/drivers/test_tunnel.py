"""Packets in TUNNEL messages: signatures, damage, and a line of their own."""

from __future__ import annotations

import os
import socket
import time
import tty
from collections.abc import Callable

import pytest

from drivers.mavlink.address import parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.signing import Signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.sharing.link import ReceivedPacket
from drivers.sharing.tunnel import FRAME_BYTES, PAYLOAD_TYPE, SIGNATURE_BYTES, TUNNEL_ID, TunnelCodec
from drivers.sharing.tunnel_line import TunnelLine
from tests.ports import free_port

COMPONENT = 196


def signing(key: int = 1) -> Signing:
    return Signing(SigningKey(bytes([key] * 32)), SigningClock(wall_ns=lambda: 1_750_000_000 * 10**9))


@pytest.mark.parametrize("packet", [b"\x11\x07", bytes(range(1, 129)), b"\x12" + b"\0" * 60])
def test_a_packet_arrives_as_it_was(packet: bytes) -> None:
    data = TunnelCodec(COMPONENT).encoded(packet, 7)
    assert len(data) <= len(packet) + FRAME_BYTES
    assert TunnelCodec(COMPONENT).decoded(data, 5) == [ReceivedPacket("tunnel", packet, 5, 7)]


def test_too_much_for_one_message() -> None:
    with pytest.raises(ValueError, match="129 bytes"):
        TunnelCodec(COMPONENT).encoded(bytes(129), 7)


def test_with_a_key_only_signed_packets_count() -> None:
    packet, ours = b"\x11\x07" * 20, TunnelCodec(COMPONENT, signing())
    signed = TunnelCodec(COMPONENT, signing()).encoded(packet, 7)
    assert len(signed) == len(packet) + FRAME_BYTES + SIGNATURE_BYTES
    assert ours.decoded(TunnelCodec(COMPONENT).encoded(packet, 7), 1) == []
    assert ours.decoded(TunnelCodec(COMPONENT, signing(2)).encoded(packet, 7), 2) == []
    assert [p.data for p in ours.decoded(signed, 3)] == [packet]
    assert ours.decoded(signed, 4) == []  # replayed
    assert ours.refused["signature"] == 3


@pytest.mark.parametrize(("later_s", "accepted"), [(59, 1), (61, 0)])
def test_after_a_start_a_recording_is_accepted_while_it_is_less_than_a_minute_old(later_s: int, accepted: int) -> None:
    """No timestamp of its sender is known yet. Each packet is accepted once."""
    recording = TunnelCodec(COMPONENT, signing()).encoded(b"\x11" * 40, 7)
    later = SigningClock(wall_ns=lambda: (1_750_000_000 + later_s) * 10**9)
    ours = TunnelCodec(COMPONENT, Signing(SigningKey(bytes([1] * 32)), later))
    assert len(ours.decoded(recording, 1)) == accepted
    assert ours.decoded(recording, 2) == []


def test_other_payloads_and_messages_are_left_out() -> None:
    encoder = dialect.MAVLink(None)
    encoder.srcSystem, encoder.srcComponent = 7, 1
    other = dialect.MAVLink_tunnel_message(0, 0, 200, 3, [1] * 128).pack(encoder)
    long = dialect.MAVLink_tunnel_message(0, 0, PAYLOAD_TYPE, 200, [1] * 128).pack(encoder)
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(encoder)
    codec = TunnelCodec(COMPONENT)
    assert codec.decoded(bytes(other) + bytes(long) + bytes(heartbeat), 1) == []
    assert codec.refused["other_payload"] == 2


def test_a_damaged_byte_loses_one_packet_alone() -> None:
    codec, receiver = TunnelCodec(COMPONENT), TunnelCodec(COMPONENT)
    first, second = codec.encoded(b"\x11" * 60, 7), codec.encoded(b"\x22" * 60, 7)
    for at in range(10, len(first)):
        damaged = bytearray(first)
        damaged[at] ^= 0x40
        assert [p.data for p in receiver.decoded(bytes(damaged) + second, 1)] == [b"\x22" * 60]


def test_the_payload_type_is_of_the_private_range() -> None:
    assert PAYLOAD_TYPE > 32767
    assert PAYLOAD_TYPE not in dialect.enums["MAV_TUNNEL_PAYLOAD_TYPE"]
    assert TUNNEL_ID == dialect.MAVLINK_MSG_ID_TUNNEL


@pytest.mark.process
def test_two_lines_over_udp() -> None:
    port = free_port()
    found: list[ReceivedPacket] = []
    back: list[ReceivedPacket] = []
    listener = TunnelLine(parse_address(f"udpin:127.0.0.1:{port}"), COMPONENT, found.append, signing())
    sender = TunnelLine(parse_address(f"udpout:127.0.0.1:{port}"), COMPONENT, back.append, signing())
    _exchange(listener, sender, found, back)


@pytest.mark.process
def test_a_listening_line_sends_to_the_member_that_was_confirmed() -> None:
    """Every sender can reach the port: the last one must not receive what is meant for the team."""
    port = free_port()
    found: list[ReceivedPacket] = []
    line = TunnelLine(parse_address(f"udpin:127.0.0.1:{port}"), COMPONENT, found.append)
    line.open()
    with _udp_sender() as member, _udp_sender() as other:
        try:
            codec = TunnelCodec(COMPONENT)

            def arrived(sender: socket.socket, vehicle: int) -> bool:
                sender.sendto(codec.encoded(b"\x11\x07", vehicle), ("127.0.0.1", port))
                time.sleep(0.01)
                return bool(found) and found[-1].sender == vehicle

            assert _until(lambda: arrived(member, 7))
            line.confirm(found[-1])
            found.clear()
            assert _until(lambda: arrived(member, 7))  # this one selects its sender
            assert _until(lambda: arrived(other, 9))
            line.send([b"\x33\x44"], 8)
            assert TunnelCodec(COMPONENT).decoded(member.recv(300), 0)[0].data == b"\x33\x44"
            other.setblocking(False)
            with pytest.raises(BlockingIOError):
                other.recv(300)
        finally:
            line.close()


def _udp_sender() -> socket.socket:
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.settimeout(60.0)
    return sender


def _until(condition: Callable[[], bool]) -> bool:
    end_s = time.monotonic() + 60.0
    while not condition() and time.monotonic() < end_s:
        pass
    return condition()


@pytest.mark.process
def test_two_lines_over_a_pty() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    found: list[ReceivedPacket] = []
    line = TunnelLine(parse_address(f"serial:{os.ttyname(slave)}:57600"), COMPONENT, found.append)
    line.open()
    try:
        codec, seen = TunnelCodec(COMPONENT), b""
        end_s = time.monotonic() + 60.0
        while (not found or not seen) and time.monotonic() < end_s:
            os.write(master, codec.encoded(b"\x11\x22", 9))
            line.send([b"\x33\x44"], 8)
            time.sleep(0.05)
            os.set_blocking(master, False)
            try:
                seen += os.read(master, 4096)
            except BlockingIOError:
                continue
        assert found[0].data == b"\x11\x22"
        assert TunnelCodec(COMPONENT).decoded(seen, 0)[0].sender == 8
    finally:
        line.close()
        os.close(master)
        os.close(slave)


@pytest.mark.process
def test_a_line_that_is_not_there_is_a_fault_and_not_an_end() -> None:
    line = TunnelLine(parse_address("serial:/dev/serial/by-id/none"), COMPONENT, lambda packet: None)
    line.open()
    try:
        end_s = time.monotonic() + 60.0
        while "none" not in line.fault and time.monotonic() < end_s:
            time.sleep(0.01)
        assert "/dev/serial/by-id/none" in line.fault
        line.send([b"\x11"], 3)
    finally:
        line.close()


def _exchange(
    listener: TunnelLine, sender: TunnelLine, found: list[ReceivedPacket], back: list[ReceivedPacket]
) -> None:
    listener.open()
    sender.open()
    try:
        end_s = time.monotonic() + 60.0
        while not (found and back) and time.monotonic() < end_s:
            sender.send([b"\x11\x22"], 9)
            listener.send([b"\x33\x44"], 8)
            time.sleep(0.02)
        assert (found[0].data, found[0].sender) == (b"\x11\x22", 9)
        assert (back[0].data, back[0].sender) == (b"\x33\x44", 8)
    finally:
        listener.close()
        sender.close()
