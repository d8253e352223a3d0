"""Cutting a stream of bytes into messages."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from tests.nightly import examples

ENCODER = dialect.MAVLink(None, 1, 1)


def attitude(k: int) -> bytes:
    return bytes(dialect.MAVLink_attitude_message(k, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(ENCODER))


@examples(6)
@given(st.lists(st.binary(max_size=30), min_size=1, max_size=12), st.integers(1, 64))
def test_noise_hides_no_message(noises: list[bytes], step: int) -> None:
    """Whatever comes between, and however the line cuts it, every whole message is found once, in order."""
    stream = b"".join(noise + attitude(k) for k, noise in enumerate(noises)) + bytes(300)
    splitter = MessageSplitter()
    found = [m for at in range(0, len(stream), step) for m in splitter.feed(stream[at : at + step])]
    assert [m.time_boot_ms for m in found if m.get_type() == "ATTITUDE"] == list(range(len(noises)))


def test_a_flipped_bit_loses_one_message() -> None:
    frames = [bytearray(attitude(k)) for k in range(3)]
    frames[1][15] ^= 4
    splitter = MessageSplitter()
    assert [m.time_boot_ms for m in splitter.feed(b"".join(frames))] == [0, 2]
    assert splitter.counts["noise_bytes"] == len(frames[1])


def test_a_message_unknown_to_the_dialect_is_counted_and_passed_by() -> None:
    unknown = bytes([0xFD, 1, 0, 0, 0, 1, 1, 0xEE, 0xEE, 0x0E, 7, 0, 0])
    splitter = MessageSplitter()
    assert [m.time_boot_ms for m in splitter.feed(unknown + attitude(5))] == [5]
    assert splitter.counts["unknown_message"] == 1


@pytest.mark.parametrize("sequence", [0, 1, 2, 255])
def test_mavlink_1_is_understood_too(sequence: int) -> None:
    encoder = dialect.MAVLink(None, 7, 9)
    encoder.seq = sequence
    old = dialect.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(encoder, force_mavlink1=True)
    first, second = MessageSplitter().frames(bytes(old) + attitude(6))
    assert (first.id, first.get_srcSystem(), first.get_srcComponent()) == (30, 7, 9)
    assert first.fields(struct.Struct("<I3f")) == pytest.approx((5, 0.1, 0.2, 0.3))
    assert first.message().get_type() == "ATTITUDE"
    assert second.fields(struct.Struct("<I")) == (6,)


@pytest.mark.parametrize("signed", [False, True])
def test_the_header_of_mavlink_2_is_decoded(signed: bool) -> None:
    """The number of OBSTACLE_DISTANCE, 330, takes two bytes. All of the message's fields follow, and the next message."""
    encoder = dialect.MAVLink(None, 7, 9)
    encoder.signing.secret_key, encoder.signing.sign_outgoing = bytes(range(32)), signed
    distances = dialect.MAVLink_obstacle_distance_message(5, 0, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12)
    data = bytes(distances.pack(encoder))
    splitter = MessageSplitter()
    first, second = splitter.frames(data + attitude(6))
    assert (first.id, first.get_srcSystem(), first.get_srcComponent()) == (330, 7, 9)
    assert first.get_msgbuf() == data
    assert first.fields(struct.Struct("<Q72H")) == (5, *[300] * 72)
    assert second.fields(struct.Struct("<I")) == (6,)
    assert not splitter.counts


def test_a_message_begun_on_a_lost_line_is_forgotten() -> None:
    splitter = MessageSplitter()
    assert splitter.feed(attitude(1)[:20]) == []
    splitter.clear()
    assert [m.time_boot_ms for m in splitter.feed(attitude(2))] == [2]
