"""ONBOARD_COMPUTER_STATUS: the reported values. Sent by the service: test_service.py."""

from __future__ import annotations

import os
import time
from pathlib import Path

from companion.live.onboard_computer_status import NONE_I8, NONE_U8, NONE_U32, ComputerStatus
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from osape_client.proto import osape_v1_pb2 as pb

STAT = "cpu  9 9 9 9 9 9 9 9 0 0\ncpu0 {0} 0 0 {1} 0 0 0 0 0 0\ncpu1 50 10 10 {1} 20 5 5 0 0 0\nintr 5\n"


def report() -> pb.Health:
    health = pb.Health(t_ns=5_000_000_000, uptime_ns=90_000_000_000)
    health.temperatures.append(pb.Temperature(sensor="cpu", celsius=61.6))
    health.temperatures.append(pb.Temperature(sensor="odd", celsius=4000.0))
    return health


def received(status: ComputerStatus) -> object:
    """The message as it arrives."""
    (message,) = MessageSplitter().feed(bytes(status.message(report()).pack(dialect.MAVLink(None, 1, 196))))
    return message


def test_the_figures_are_those_of_the_computer(tmp_path: Path) -> None:
    stat, meminfo = tmp_path / "stat", tmp_path / "meminfo"
    stat.write_text(STAT.format(100, 1000))
    meminfo.write_text("MemTotal:  8388608 kB\nMemFree: 1 kB\nMemAvailable:  6291456 kB\n")
    status = ComputerStatus(tmp_path, stat, meminfo)
    stat.write_text(STAT.format(175, 1025))
    m = received(status)
    assert (m.uptime, m.time_usec, m.type) == (90_000, 5_000_000, 0)
    assert list(m.cpu_cores) == [75, 0] + [NONE_U8] * 6
    assert list(m.cpu_combined) == [38] + [NONE_U8] * 9
    assert list(m.temperature_core) == [62, 126] + [NONE_I8] * 6
    assert (m.ram_usage, m.ram_total) == (2048, 8192)
    assert 0 < m.storage_usage[0] <= m.storage_total[0]
    assert m.storage_usage[1] == m.link_type[0] == NONE_U32


def test_what_cannot_be_measured_is_reported_as_such(tmp_path: Path) -> None:
    none = tmp_path / "none"
    m = received(ComputerStatus(none, none, none))
    assert list(m.cpu_cores) == [NONE_U8] * 8
    assert m.cpu_combined[0] == NONE_U8
    assert (m.ram_usage, m.ram_total, m.storage_usage[0]) == (NONE_U32,) * 3


def test_the_figures_of_this_computer_are_read() -> None:
    status = ComputerStatus(Path("/"))
    begun_s = time.process_time()
    while time.process_time() - begun_s < 0.1:
        pass  # a core has something to do
    m = received(status)
    known = [share for share in m.cpu_cores if share != NONE_U8]
    assert len(known) == min(8, os.cpu_count() or 1)
    assert 0 < max(known) <= 100
    assert 0 < m.ram_usage < m.ram_total
