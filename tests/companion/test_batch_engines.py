"""The engines of `companion batch` with real processes: killed workers, restart, equal results."""

from __future__ import annotations

import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from companion.batch.engines import ATTEMPTS, Done
from companion.batch.flights import Flight
from companion.batch.jobs import BatchOptions, Failure, FlightTask, Outcome
from companion.batch.local_engine import LocalEngine

from .batch_processes import always_killed, defective, killed_at_first
from .fleet import flight_events, write_fleet, write_parts

pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")

PATIENCE_S = 240.0


def tasks_of(folder: Path, number: int) -> list[FlightTask]:
    return [
        FlightTask(Flight("v", "unknown", f"flight{k}", ()), str(folder), BatchOptions(), "none") for k in range(number)
    ]


def by_name(done: list[Done]) -> dict[str, Done]:
    assert len({d.task.flight.name for d in done}) == len(done)
    return {d.task.flight.name: d for d in done}


@pytest.mark.process
def test_a_killed_process_loses_and_doubles_no_flight(tmp_path: Path) -> None:
    done = by_name(list(LocalEngine(2, killed_at_first).run(tasks_of(tmp_path, 6))))
    assert len(done) == 6
    assert all(isinstance(d.result, Outcome) for d in done.values())
    starts = {name: len((tmp_path / name).read_text().split()) for name in done}
    assert starts == {f"flight{k}": 2 if k % 2 else 1 for k in range(6)}
    assert {name: d.attempts for name, d in done.items()} == starts


@pytest.mark.process
def test_a_flight_that_always_ends_its_process_stops_no_other(tmp_path: Path) -> None:
    done = by_name(list(LocalEngine(1, always_killed).run(tasks_of(tmp_path, 3))))
    failed = done.pop("flight1")
    assert isinstance(failed.result, Failure)
    assert "give the workers more memory" in failed.result.text
    assert len((tmp_path / "flight1").read_text().split()) == ATTEMPTS
    assert all(isinstance(d.result, Outcome) and d.attempts == 1 for d in done.values())


@pytest.mark.process
def test_a_defect_is_the_failure_of_its_flight(tmp_path: Path) -> None:
    (done,) = LocalEngine(1, defective).run(tasks_of(tmp_path, 1))
    assert isinstance(done.result, Failure)
    assert "unexpected IndexError: made up" in done.result.text


def files_of(output: Path) -> dict[str, bytes]:
    """The files of the tables."""
    return {str(p.relative_to(output)): p.read_bytes() for p in output.rglob("*.parquet")}


def batch_command(fleet: Path, output: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "companion", "batch", str(fleet), "-o", str(output), *more]


@pytest.mark.slow
def test_a_killed_command_continues_where_it_stopped(tmp_path: Path) -> None:
    fleet = write_fleet(tmp_path / "fleet")
    for k in range(4):
        write_parts(fleet / "gamma", f"20261104-13000{k}", flight_events(10 + k, 2.0))
    subprocess.run(batch_command(fleet, tmp_path / "whole"), check=True, timeout=PATIENCE_S)
    output = tmp_path / "cut"
    process = subprocess.Popen(batch_command(fleet, output, "--workers", "1"), start_new_session=True)
    flights = output / "flights"
    while not list(flights.rglob("*.parquet")) and process.poll() is None:
        time.sleep(0.01)
    process.kill()  # the driver alone: its worker ends by itself
    process.wait()
    present = files_of(output)
    complete = [name for name in present if name.startswith("flights")]
    assert 0 < len(complete) < 7
    subprocess.run(batch_command(fleet, output), check=True, timeout=PATIENCE_S)
    assert files_of(output) == files_of(tmp_path / "whole")
    assert Counter(name.split("/")[0] for name in files_of(output)) == {"frames": 7, "flights": 7, "events": 7}
