"""The directory of logs: which files are deleted for the budget, and names of flights."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.log import current_file as log_current
from companion.log.current_file import Begin, CurrentLog
from companion.log.log_directory import files_of, make_room, new_flight, part_path
from companion.log.log_file import FileInUseError
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import Repairs
from companion.pipeline.configured import make_pipeline
from companion.pipeline.state import PipelineState
from tests.waiting import until

from ..recorded import SMALL, A, B, C, fake_log, flight, recorded, repair

pytestmark = pytest.mark.process


def test_the_oldest_flights_go_first_and_the_running_one_never(tmp_path: Path) -> None:
    running = fake_log(tmp_path, C, 0, 5000, 900)
    old = fake_log(tmp_path, A, 0, 3000, 500)
    newer = fake_log(tmp_path, B, 0, 3000, 100)
    (tmp_path / "notes.txt").write_bytes(bytes(9000))
    assert make_room(tmp_path, 9000, C) == [old]
    assert make_room(tmp_path, 1000, C) == [newer]
    assert running.exists()
    assert (tmp_path / "notes.txt").exists()


def test_what_was_recorded_before_arming_goes_before_any_flight(tmp_path: Path) -> None:
    """Also that of the running flight: a vehicle that waits for hours deletes no flight."""
    armed = fake_log(tmp_path, A, 1, 3000, 0)
    idle = [fake_log(tmp_path, flight, 0, 3000, 0, idle=True) for flight in (B, C)]
    open_file = LogWriter(part_path(tmp_path, C, 1, idle=True))
    open_file.sync()
    assert make_room(tmp_path, 6500, C) == idle[:1]
    assert make_room(tmp_path, 3500, C) == idle[1:]
    assert make_room(tmp_path, 0, C) == [armed]
    assert open_file.in_place


@pytest.mark.parametrize(
    "name", ["survey.2024.mcap", "bag.001.mcap", "20260101-000000.mcap", "my 20260101-000000.000.mcap"]
)
def test_logs_of_others_are_neither_deleted_nor_repaired(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bytes(9000))
    (tmp_path / (name + ".active")).write_bytes(b"")
    assert make_room(tmp_path, 0, C) == []
    assert repair(tmp_path, C) == []
    assert len(list(tmp_path.iterdir())) == 2


def test_the_flight_that_another_service_records_is_not_deleted(tmp_path: Path) -> None:
    finished = fake_log(tmp_path, A, 0, 3000, 900)
    other = LogWriter(part_path(tmp_path, A, 1))
    other.begin(run_info("live"), flight().cameras)
    other.sync()
    assert make_room(tmp_path, 0, C) == []
    assert other.in_place
    other.abandon()
    assert make_room(tmp_path, 0, C) == [finished, other.active_path]


def test_a_flight_recorded_before_the_clock_was_set_is_not_taken_for_the_oldest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a battery the clock begins at the same date after each start."""
    monkeypatch.setattr(time, "time_ns", lambda: 1_800_000_000 * 10**9)
    before = fake_log(tmp_path, new_flight(tmp_path), 0, 3000, 0)
    monkeypatch.setattr(time, "time_ns", lambda: 12 * 10**9)
    names = []
    for _ in range(11):
        names.append(new_flight(tmp_path))
        path = fake_log(tmp_path, names[-1], 0, 3000, 0)
        os.utime(path, (12, 12))
    assert len(set(names)) == len(names)
    assert [f.flight for f in files_of(tmp_path)] == [before.name.partition(".")[0], *names]
    assert make_room(tmp_path, 12 * 3000 - 1, "") == [before]


def test_a_flight_named_by_a_clock_in_the_future_does_not_name_the_later_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They have the date of their own clock, and stay in order."""
    names = []
    for seconds in (4_000_000_000, 1_800_000_000, 1_800_000_060, 1_800_000_060, 4_000_000_000):
        monkeypatch.setattr(time, "time_ns", lambda s=seconds: s * 10**9)
        names.append(new_flight(tmp_path))
        fake_log(tmp_path, names[-1], 0, 3000, 0)
    future, present, later = "20961002-070640", "20270115-080000", "20270115-080100"
    assert names == [future, f"{present}-2", f"{later}-2", f"{later}-3", f"{future}-3"]
    assert [f.flight for f in files_of(tmp_path)] == names


def test_a_file_that_cannot_be_deleted_does_not_keep_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A damaged disk, or a file that belongs to somebody else in a directory with the sticky bit."""
    stuck = fake_log(tmp_path, A, 0, 3000, 0)
    newer = fake_log(tmp_path, B, 0, 3000, 0)
    unlink = Path.unlink

    def fails(path: Path, missing_ok: bool = False) -> None:
        if path == stuck:
            raise OSError(5, "Input/output error", str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", fails)
    assert make_room(tmp_path, 3000, C) == [newer]


def test_two_writers_of_one_file_exclude_each_other(tmp_path: Path) -> None:
    first = LogWriter(tmp_path / "a.mcap")
    first.begin(run_info("live"), flight().cameras)
    first.sync()
    content = first.active_path.read_bytes()
    with pytest.raises(FileInUseError, match="another process writes it"):
        LogWriter(tmp_path / "a.mcap")
    assert first.active_path.read_bytes() == content
    first.finish()
    LogWriter(tmp_path / "a.mcap").abandon()  # a new file: the finished one stays
    assert (tmp_path / "a.mcap").read_bytes()[: len(content)] == content


def test_two_services_of_one_second_record_two_flights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both found the name unused, and wrote into one file."""
    names = iter([A, A, B])
    monkeypatch.setattr(log_current, "new_flight", lambda folder: next(names))
    logs = [CurrentLog(tmp_path, "", run_info("live"), SMALL, Repairs(tmp_path)) for _ in range(2)]
    for log in logs:
        log.begin(Begin(1, flight().cameras, PipelineState()))
    for log in logs:
        log.finish()
    assert [f.flight for f in files_of(tmp_path)] == [A, B]


def test_a_flight_that_has_spent_the_budget_stops_being_recorded(tmp_path: Path) -> None:
    recorder = recorded(tmp_path, RecordParams(file_mb=9.0, budget_mb=10.0, least_free_mb=1.0))
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    again = Recorder(tmp_path, run_info("live"), RecordParams(file_mb=9.9, budget_mb=10.0, least_free_mb=1.0))
    again.flight = recorder.flight  # the same flight goes on
    fake_log(tmp_path, recorder.flight, 1, 5_000_000, 0)
    again._thread.start()
    again.begin(0, pipeline.cameras, pipeline.state())
    assert until(lambda: bool(again.status.fault))
    again.close()


def test_two_flights_in_one_second_have_two_names(tmp_path: Path) -> None:
    first = new_flight(tmp_path)
    fake_log(tmp_path, first, 0, 1, 0)
    assert new_flight(tmp_path) != first
