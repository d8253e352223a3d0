"""Recorded output of real autopilots, played back to a session by the recorded stamps and to the link over UDP."""

from __future__ import annotations

import threading
from itertools import takewhile
from pathlib import Path

import pytest

from core.types import AttitudeSample, PoseSample
from drivers.mavlink import clock_sync
from drivers.mavlink.address import parse_address
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.tlog import TlogRecord, read_tlog
from drivers.simulation.autopilot_link import UdpEnd
from tests.ports import free_port
from tests.waiting import until

pytestmark = pytest.mark.process

NS = 1_000_000_000
BEGIN_NS = 1_000 * NS
LOGS = ("arducopter462_sitl_50hz", "ardusub411_20hz_timesync", "sample_derived_50hz", "sample_log_small_derived_100hz")


def first_of(path: Path, seconds: float) -> list[tuple[int, TlogRecord]]:
    """(ns since the first, record) of the beginning of a log, in order of the stamps."""
    records = sorted(read_tlog(path).records, key=lambda r: r.stamp_us)
    timed = (((r.stamp_us - records[0].stamp_us) * 1000, r) for r in records)
    return list(takewhile(lambda x: x[0] < seconds * NS, timed))


@pytest.fixture(autouse=True)
def soon_without_timesync(monkeypatch: pytest.MonkeyPatch) -> None:
    """The shortest log lasts 6.5 s, and three of the autopilots did not answer TIMESYNC: stamps count after 2 s, not after 10 s."""
    monkeypatch.setattr(clock_sync, "UNANSWERED_NS", 2 * NS)


@pytest.mark.parametrize("name", LOGS)
def test_a_recorded_autopilot_is_understood(name: str, shared_data: Path) -> None:
    session = MavlinkSession()
    samples: list[AttitudeSample | PoseSample] = []
    attitudes = 0
    for after_ns, record in first_of(shared_data / "mavlink" / f"{name}.tlog", 20.0):
        now_ns = BEGIN_NS + after_ns
        samples += session.receive([(bytes(record.message.get_msgbuf()), now_ns)])
        session.due(now_ns)
        attitudes += record.message.get_type() in ("ATTITUDE", "ATTITUDE_QUATERNION") and session.clock.usable
    assert session.vehicle is not None
    assert session.vehicle.autopilot in ("ArduPilot", "PX4")
    assert session.clock.estimate.source is not ClockSource.NONE
    attitudes_read = [s for s in samples if isinstance(s, AttitudeSample)]
    assert len(attitudes_read) > 100
    assert len(attitudes_read) >= 0.45 * attitudes  # of two kinds that tell the same one is taken
    for s in attitudes_read:
        assert sum(c * c for c in s.q_ned_frd_wxyz) == pytest.approx(1.0, abs=1e-6)
    late_ns = sorted(s.t_arrival_ns - s.t_ns for s in samples)
    assert late_ns[0] >= 0
    assert late_ns[len(late_ns) // 2] < NS // 2
    assert not any("number" in cause for cause in session.status(BEGIN_NS + 20 * NS).counts)


def test_over_udp_as_it_came(shared_data: Path) -> None:
    records = first_of(shared_data / "mavlink" / "sample_log_small_derived_100hz.tlog", 4.0)
    port, samples, stop = free_port(), [], threading.Event()
    link = MavlinkLink(parse_address(f"udpin:127.0.0.1:{port}"), MavlinkSession(), samples.extend)

    def play() -> None:
        line, before_ns = UdpEnd("127.0.0.1", port), 0
        for after_ns, record in records:
            if stop.wait((after_ns - before_ns) / NS):
                break
            before_ns = after_ns
            line.write(bytes(record.message.get_msgbuf()))
        line.close()

    player = threading.Thread(target=play)
    link.open()
    try:
        assert until(lambda: link.state.open)
        player.start()
        assert until(lambda: sum(isinstance(s, AttitudeSample) for s in samples) > 50)
        assert link.status().vehicle is not None
        assert all(s.t_ns <= s.t_arrival_ns for s in samples)
    finally:
        stop.set()
        player.join()
        link.close()
