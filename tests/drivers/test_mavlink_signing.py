"""Signatures: which messages are accepted, what is sent, and timestamps that never decrease."""

from __future__ import annotations

import hashlib
import logging
import os
from pathlib import Path
from typing import Any

import pytest

from drivers.base import BadData, DeviceNotFound
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.signing import Signing, for_the_log
from drivers.mavlink.signing_clock import AHEAD, EPOCH_UNIX_S, LAST_TICK, TICKS_PER_S, SigningClock, wall_ticks
from drivers.mavlink.signing_key import SigningKey, load_key, make_key
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.waiting import until

from .conversation import MS, NS, Conversation

KEY, OTHER, NO_KEY = bytes(range(1, 33)), bytes(range(2, 34)), bytes(32)
DAY_TICKS = 86_400 * TICKS_PER_S
NOON_NS = (EPOCH_UNIX_S + 12 * 365 * 86_400) * NS
NOW = wall_ticks(NOON_NS)


class Wall:
    """A wall clock that stands where it is put."""

    def __init__(self, unix_ns: int = NOON_NS) -> None:
        self.ns = unix_ns

    def __call__(self) -> int:
        return self.ns


def signing(key: bytes | None = KEY, wall: Wall | None = None) -> Signing:
    return Signing(SigningKey(key) if key else None, SigningClock(None, wall or Wall()))


def message(key: bytes | None, ticks: int, m: Any = None, system: int = 1, link: int = 0) -> Any:
    """A message as it comes in, signed by the library itself."""
    mav = dialect.MAVLink(None, system, 1)
    mav.signing.link_id = link
    if key is not None:
        mav.signing.secret_key, mav.signing.timestamp, mav.signing.sign_outgoing = key, ticks, True
    m = m or dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    (found,) = MessageSplitter().feed(bytes(m.pack(mav)))
    return found


def talk(kind: str, ours: bytes | None, theirs: bytes | None, **profile: Any) -> Conversation:
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, key=theirs, boot_at_ns=90 * NS, **profile))
    return Conversation(MavlinkSession(signing=signing(ours)), [autopilot])


def obstacles(c: Conversation, seconds: float = 2.0) -> int:
    """How many of our obstacles arrive in a while."""
    before = len(c.autopilots[0].of_kind("OBSTACLE_DISTANCE"))
    for _ in range(round(10 * seconds)):
        c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
        c.run(0.1)
    return len(c.autopilots[0].of_kind("OBSTACLE_DISTANCE")) - before


def fault(c: Conversation) -> str:
    return c.session.status(c.now_ns).signing_fault


# ---- both ends --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("behind", [0, DAY_TICKS, NOW], ids=["at our time", "a day behind", "without a clock"])
def test_with_one_key_messages_are_accepted_for_any_clock_of_the_autopilot(kind: str, behind: int) -> None:
    c = talk(kind, KEY, KEY, signing_ticks=NOW - behind)
    c.run(6.0)
    status = c.session.status(c.now_ns)
    assert status.vehicle is not None
    assert status.signed
    assert status.signing_fault == ""
    assert status.clock.source is ClockSource.TIMESYNC
    assert status.attitude_hz > 80.0
    assert obstacles(c) == 20
    assert c.autopilots[0].dropped == []


def test_an_autopilot_ahead_of_our_clock_takes_what_we_send() -> None:
    """A companion without a battery for its clock comes up in the past."""
    c = talk(PX4, KEY, KEY, signing_ticks=NOW + 30 * DAY_TICKS)
    c.run(3.0)
    assert obstacles(c) == 20
    assert fault(c) == ""


def test_an_autopilot_that_boots_with_an_old_time_is_accepted_again_within_seconds() -> None:
    c = talk(ARDUPILOT, KEY, KEY, signing_ticks=NOW)
    c.run(4.0)
    c.autopilots[0].reboot(c.now_ns)
    c.autopilots[0].profile.signing_ticks = NOW - DAY_TICKS
    c.autopilots[0].sign(KEY)
    c.run(7.0)
    assert fault(c) == ""
    assert obstacles(c) == 20


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_the_autopilot_signs_and_we_have_no_key(kind: str) -> None:
    c = talk(kind, None, KEY, signing_ticks=NOW)
    c.run(8.0)
    assert "signs and no key is configured: it drops all messages" in fault(c)
    assert obstacles(c) == 0
    beats = len(c.autopilots[0].of_kind("HEARTBEAT"))
    assert (beats > 3) == (kind == PX4)  # to PX4 we look alive, and are ignored


@pytest.mark.parametrize(("kind", "theirs"), [(PX4, None), (PX4, NO_KEY), (ARDUPILOT, None)])
def test_the_autopilot_does_not_sign_though_we_have_a_key(kind: str, theirs: bytes | None) -> None:
    c = talk(kind, KEY, theirs)
    c.run(4.0)
    assert c.session.vehicle is None
    assert c.samples == []
    assert "does not sign, but a key is set" in fault(c)
    assert obstacles(c) == 0
    c.session.post(dialect.MAVLink_statustext_message(4, b"why"), c.now_ns)
    c.run(2.0)
    assert [m.text for m in c.autopilots[0].of_kind("STATUSTEXT")] == ["why"]
    assert {m.get_type() for m in c.autopilots[0].received} == {"HEARTBEAT", "STATUSTEXT"}


def test_px4_without_a_key_signs_with_zeros_and_that_is_no_fault() -> None:
    """PX4 1.17 signs all messages with a key of zeros until it is given a key, and accepts unsigned ones."""
    c = talk(PX4, None, NO_KEY)
    c.run(8.0)
    assert c.session.vehicle is not None
    assert fault(c) == ""
    assert obstacles(c) == 20


def test_another_key_on_the_autopilot() -> None:
    c = talk(PX4, KEY, OTHER, signing_ticks=NOW)
    c.run(6.0)
    assert c.session.vehicle is None
    assert "signs with another key" in fault(c)
    assert c.session.status(c.now_ns).counts["signature_wrong_key"] > 100
    assert obstacles(c) == 0


def test_an_autopilot_that_takes_nothing_we_sign_is_named() -> None:
    c = talk(PX4, KEY, KEY, signing_ticks=NOW, answers_timesync=False)
    c.run(8.0)
    assert "ignores signed messages: its key is the same" in fault(c)


def test_an_autopilot_that_sends_only_heartbeats_and_takes_nothing_is_named_all_the_time() -> None:
    """It ignores the requests for other messages, too. Where a heartbeat was lost, the fault was reported as ended."""
    c = talk(ARDUPILOT, KEY, KEY, signing_ticks=NOW, answers_timesync=False)
    c.run(8.0)
    found = []
    for k in range(60):
        c.lost = None if 20 <= k < 30 else frozenset(range(1, 512))
        c.run(0.1)
        found.append("ignores signed messages: its key is the same" in fault(c))
    assert all(found)


def test_an_autopilot_that_is_switched_off_ignores_nothing() -> None:
    """Seen with PX4 1.18: for two seconds after its end the clock of this computer was named as the cause."""
    c = talk(PX4, KEY, KEY, signing_ticks=NOW)
    c.run(6.0)
    assert fault(c) == ""
    c.autopilots.clear()
    found = []
    for _ in range(80):
        c.run(0.1)
        found.append(fault(c))
    assert set(found) == {""}


def test_signing_that_ends_in_flight_is_reported_and_its_return_too() -> None:
    c = talk(ARDUPILOT, KEY, KEY, signing_ticks=NOW)
    c.run(4.0)
    c.autopilots[0].sign(None)
    c.run(4.0)
    assert "does not sign" not in fault(c), "a signature counts for 5 s"
    c.run(5.0)
    assert "does not sign, but a key is set" in fault(c)
    c.autopilots[0].sign(KEY)
    c.run(9.0)
    assert fault(c) == ""
    assert obstacles(c) == 20


# ---- what is accepted ------------------------------------------------------------------------------------------------


def test_one_forged_packet_with_a_far_timestamp_does_not_lock_out_the_true_stream() -> None:
    """pymavlink 2.4.50 does lock it out, 2.4.41 does not."""
    s = signing()
    assert s.believes(message(KEY, NOW), NS)
    assert not s.believes(message(OTHER, LAST_TICK), NS)
    assert s.believes(message(KEY, NOW + 1), NS)


def test_a_forged_first_packet_does_not_make_the_true_stream_old() -> None:
    s = signing()
    assert not s.believes(message(OTHER, NOW + DAY_TICKS), NS)
    assert s.believes(message(KEY, NOW), NS)


def test_a_replayed_packet_is_rejected() -> None:
    s = signing()
    first = message(KEY, NOW)
    assert s.believes(first, NS)
    assert not s.believes(first, NS)
    assert not s.believes(message(KEY, NOW - 1), NS)
    assert s.believes(message(KEY, NOW - 1, system=2), NS)  # another stream
    assert s.believes(message(KEY, NOW - 1, link=1), NS)  # so is another link of the same sender
    assert not s.believes(message(KEY, NOW - 1, link=1), NS)
    assert not s.believes(message(KEY, NOW - 61 * TICKS_PER_S, system=3), NS)


def test_every_bit_of_a_signed_packet_counts() -> None:
    s = signing()
    good = bytes(message(KEY, NOW).get_msgbuf())
    decoder = dialect.MAVLink(None)
    for at in range(len(good) - 13, len(good)):  # the block of the signature: elsewhere the checksum detects it
        for bit in range(8):
            bad = bytearray(good)
            bad[at] ^= 1 << bit
            assert not s.believes(decoder.decode(bad), NS)
    assert s.believes(decoder.decode(bytearray(good)), NS)


def test_a_forger_beside_the_true_autopilot_changes_nothing_and_is_reported() -> None:
    c = talk(PX4, KEY, KEY, signing_ticks=NOW)
    c.run(4.0)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, key=OTHER, signing_ticks=NOW + DAY_TICKS)))
    c.run(4.0)
    assert c.session.vehicle is not None
    assert c.session.vehicle.autopilot == PX4
    assert "another sender uses the autopilot's ids: signed with another key" in fault(c)
    c.autopilots[1].sign(None)
    c.run(6.0)
    assert c.session.vehicle.autopilot == PX4
    assert "another sender uses the autopilot's ids: unsigned" in fault(c)
    assert c.session.status(c.now_ns).clock_restarts == 0


def test_unsigned_messages_of_others_than_the_autopilot_are_no_fault() -> None:
    c = talk(PX4, KEY, KEY, signing_ticks=NOW)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=PX4, system_id=9)))
    c.run(4.0)
    assert fault(c) == ""


# ---- what is sent -----------------------------------------------------------------------------------------------------


def test_timestamps_follow_the_wall_clock_and_not_the_number_of_packets() -> None:
    wall = Wall()
    session = MavlinkSession(signing=signing(wall=wall))
    stamps: list[int] = []
    for second in range(5):
        wall.ns = NOON_NS + second * NS
        for data in session.due(second * NS + NS, sends_first=True):
            stamps.append(int.from_bytes(data[-12:-6], "little"))
            assert hashlib.sha256(KEY + data[:-6]).digest()[:6] == data[-6:]
    assert stamps == [NOW + second * TICKS_PER_S for second in range(5)]


def test_a_clock_set_back_and_a_burst_never_repeat_a_timestamp() -> None:
    wall = Wall()
    clock = SigningClock(None, wall)
    seen = [clock.next() for _ in range(10)]
    wall.ns -= 3600 * NS
    seen += [clock.next() for _ in range(10)]
    wall.ns += 3600 * NS + 1000 * MS
    seen.append(clock.next())
    assert seen == sorted(set(seen))
    assert seen[-1] == NOW + TICKS_PER_S


def test_an_older_timestamp_of_another_stream_does_not_set_the_clock_back() -> None:
    """A companion whose clock was never set has its time from what it receives."""
    clock = SigningClock(None, Wall(0))
    clock.received(NOW)
    first = clock.next()
    clock.received(NOW - TICKS_PER_S)
    assert first > NOW
    assert clock.next() > first


def test_the_past_and_the_far_future_are_no_time() -> None:
    assert wall_ticks(0) == 0
    assert wall_ticks(NOON_NS * 10) == 0
    assert SigningClock(None, Wall(0)).next() == 1


def test_a_crash_and_a_clock_in_the_past_never_bring_an_old_timestamp(tmp_path: Path) -> None:
    """Nothing is written at the end: each run stands for one that is killed."""
    file, last = tmp_path / "signing-clock", 0
    for wall in (Wall(), Wall(NOON_NS - 3600 * NS), Wall(0), Wall(NOON_NS + NS)):
        clock = SigningClock(file, wall)
        try:
            for _ in range(300):
                newest = clock.next()
                assert newest > last
                last = newest
        finally:
            clock.close()
    assert file.stat().st_size < 40


def test_starts_in_a_row_do_not_run_away_from_the_wall_clock(tmp_path: Path) -> None:
    """Others must be within a minute of us to be heard."""
    for _ in range(50):
        clock = SigningClock(tmp_path / "signing-clock", Wall())
        clock.next()
        clock.close()
    assert clock.next() < NOW + AHEAD + 6 * TICKS_PER_S


def test_the_file_stays_ahead_of_what_is_used(tmp_path: Path) -> None:
    file, wall = tmp_path / "signing-clock", Wall()
    clock = SigningClock(file, wall)
    for second in range(60):
        wall.ns = NOON_NS + second * NS
        used = clock.next()
        assert until(lambda used=used: int(file.read_bytes().split()[0]) > used)
    clock.close()


@pytest.mark.parametrize("content", [b"", b"99999999999999 00000000", b"x" * 100, b"281474976710655", b"\x00\xff 12"])
def test_a_damaged_file_is_no_time(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "signing-clock"
    file.write_bytes(content)
    clock = SigningClock(file, Wall())
    assert clock.next() == NOW
    clock.close()
    assert clock.fault == ""


def test_a_folder_that_takes_no_file_is_reported_and_the_line_goes_on(tmp_path: Path) -> None:
    clock = SigningClock(tmp_path / "none" / "signing-clock", Wall())
    s = Signing(SigningKey(KEY), clock)
    assert "cannot be kept" in s.fault(NS, answered=True)
    assert clock.next() == NOW
    (tmp_path / "none").mkdir()
    clock.next()
    assert until(lambda: s.fault(NS, answered=True) == "")
    s.close()


# ---- key and log ------------------------------------------------------------------------------------------------------


def test_keys_of_files(tmp_path: Path) -> None:
    file = tmp_path / "signing.key"
    make_key(file)
    assert file.stat().st_mode & 0o777 == 0o600
    assert len(load_key(file).secret) == 32
    with pytest.raises(ValueError, match="delete it first"):
        make_key(file)
    make_key(tmp_path / "phrase", "open sesame")
    assert load_key(tmp_path / "phrase").secret == hashlib.sha256(b"open sesame").digest()
    (tmp_path / "raw").write_bytes(KEY)
    os.chmod(tmp_path / "raw", 0o400)
    assert load_key(tmp_path / "raw").secret == KEY


@pytest.mark.parametrize(
    ("content", "mode", "text"),
    [
        (b"ab" * 32, 0o640, "others can read it"),
        (b"ab" * 31, 0o600, "neither 64"),
        (b"00" * 32, 0o600, "not all of them 0"),
    ],
)
def test_files_that_are_no_keys_name_the_cause_and_show_nothing(
    tmp_path: Path, content: bytes, mode: int, text: str
) -> None:
    file = tmp_path / "signing.key"
    file.write_bytes(content)
    file.chmod(mode)
    with pytest.raises(BadData, match=text) as failure:
        load_key(file)
    assert content.decode() not in str(failure.value)
    with pytest.raises(DeviceNotFound, match="companion keys --signing"):
        load_key(tmp_path / "none")


def test_a_key_shows_itself_nowhere(caplog: pytest.LogCaptureFixture) -> None:
    key = SigningKey(KEY)
    logging.getLogger().warning("%s %r", key, key)
    assert str(key) == "SigningKey(...)"
    assert str(list(KEY))[1:20] not in caplog.text


def test_the_log_holds_neither_key_nor_signatures() -> None:
    kept: list[bytes] = []
    session = MavlinkSession(on_frame=lambda data, _: kept.append(data), signing=signing())
    setup = dialect.MAVLink_setup_signing_message(1, 196, list(KEY), NOW)
    attitude = dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
    frames = [message(KEY, NOW + k, m).get_msgbuf() for k, m in enumerate((None, setup, attitude))]
    session.receive([(bytes(frame), NS) for frame in frames])
    again = MessageSplitter().feed(b"".join(kept))
    assert [m.get_type() for m in again] == ["HEARTBEAT", "ATTITUDE"]
    assert not any(data[2] & 1 for data in kept)
    assert bytes(message(None, 0, attitude).get_msgbuf()) == kept[1]
    assert for_the_log(message(None, 0, setup)) is None
