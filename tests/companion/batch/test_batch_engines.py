"""The engines of `companion batch` with real processes: killed workers, restart, equal results."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.batch.dask_engine import DaskEngine
from companion.batch.engines import ATTEMPTS, Done
from companion.batch.flights import Flight, find_flights
from companion.batch.jobs import BatchOptions, Failure, FlightTask, Outcome
from companion.batch.local_engine import LocalEngine
from companion.batch.ray_engine import RayEngine
from companion.batch.task import run_task
from companion.cli import main
from companion.log.provenance import software
from drivers.base import DeviceLost, DeviceNotFound
from tests.waiting import until

from ..batch_processes import always_killed, defective, endless, killed_at_first
from ..fleet import flight_events, write_fleet, write_parts

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


def expected_files(fleet: Path, output: Path) -> dict[str, bytes]:
    """The files of the tables, computed in this process."""
    for flight in find_flights([str(fleet)]):
        assert isinstance(run_task(FlightTask(flight, str(output), BatchOptions(), software())), Outcome)
    return files_of(output)


def batch_command(fleet: Path, output: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "companion", "batch", str(fleet), "-o", str(output), *more]


@pytest.mark.slow
def test_a_killed_command_continues_where_it_stopped(tmp_path: Path) -> None:
    fleet = write_fleet(tmp_path / "fleet")
    for k in range(4):
        write_parts(fleet / "gamma", f"20261104-13000{k}", flight_events(10 + k, 2.0))
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
    assert not (output / ".unfinished").exists()
    assert files_of(output) == expected_files(fleet, tmp_path / "alone")
    assert Counter(name.split("/")[0] for name in files_of(output)) == {"frames": 7, "flights": 7, "events": 7}


@pytest.fixture
def dask_cluster() -> Iterator[str]:
    """The address of a scheduler with two workers, each a process with one thread."""
    distributed = pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.process
def test_dask_starts_the_tasks_of_a_killed_worker_again(dask_cluster: str, tmp_path: Path) -> None:
    done = by_name(list(DaskEngine(dask_cluster, killed_at_first).run(tasks_of(tmp_path, 4))))
    assert len(done) == 4
    assert all(isinstance(d.result, Outcome) for d in done.values())
    starts = {name: len((tmp_path / name).read_text().split()) for name in done}
    assert all(starts[f"flight{k}"] >= 1 + k % 2 for k in range(4))


@pytest.mark.slow
def test_dask_computes_the_same_files(dask_cluster: str, tmp_path: Path) -> None:
    fleet = write_fleet(tmp_path / "fleet")
    more = ("--engine", "dask", "--address", dask_cluster)
    subprocess.run(batch_command(fleet, tmp_path / "dask", *more), check=True, timeout=PATIENCE_S)
    assert files_of(tmp_path / "dask") == expected_files(fleet, tmp_path / "alone")


@pytest.mark.process
def test_a_dask_scheduler_that_is_killed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended with a traceback."""
    pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    monkeypatch.setattr("companion.batch.dask_engine._CONNECT_S", 2.0)
    place = tmp_path / "scheduler.json"

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-m", *arguments, "--no-dashboard"], stderr=subprocess.DEVNULL)

    scheduler = start("distributed.cli.dask_scheduler", "--port", "0", "--scheduler-file", str(place))
    assert until(lambda: place.exists() and place.stat().st_size)
    address = json.loads(place.read_text())["address"]
    worker = start("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny")
    killer = threading.Thread(target=lambda: until(lambda: list(tmp_path.glob("flight*"))) and scheduler.kill())
    killer.start()
    try:
        with pytest.raises(DeviceLost, match="2 of 2 flights are not done; start the cluster"):
            list(DaskEngine(address, endless).run(tasks_of(tmp_path, 2)))
    finally:
        killer.join()
        for process in (worker, scheduler):
            process.kill()
            process.wait()


@pytest.mark.parametrize(
    ("engine", "command"),
    [("dask", "'dask>=2024.8' 'distributed>=2024.8' 'pyarrow>=16'"), ("ray", "'ray>=2.30' 'pyarrow>=16'")],
)
def test_one_command_installs_all_libraries_of_a_cluster(
    engine: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """pyarrow was named first, and the engine's libraries at the next attempt."""
    for name in ("pyarrow", "distributed", "ray"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["batch", str(tmp_path), "-o", str(tmp_path / "out"), "--engine", engine, "--address", "auto"]) == 1
    assert f"pip install {command}" in capsys.readouterr().err


def test_a_dask_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    monkeypatch.setattr("companion.batch.dask_engine._CONNECT_S", 0.2)
    with pytest.raises(DeviceNotFound, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        list(DaskEngine("tcp://127.0.0.1:9", defective).run([]))


@pytest.mark.slow
def test_ray_starts_the_tasks_of_a_killed_worker_again_and_computes_the_same_files(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="the extra `ray` is not installed")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    cluster = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    try:
        done = by_name(list(RayEngine(cluster.address, killed_at_first).run(tasks_of(tmp_path, 4))))
        assert len(done) == 4
        assert all(isinstance(d.result, Outcome) for d in done.values()), done
        failed = by_name(list(RayEngine(cluster.address, always_killed).run(tasks_of(tmp_path, 2))))["flight1"]
        assert isinstance(failed.result, Failure)
        assert "give the workers more memory" in failed.result.text
        fleet = write_fleet(tmp_path / "fleet")
        more = ("--engine", "ray", "--address", cluster.address)
        subprocess.run(batch_command(fleet, tmp_path / "ray", *more), check=True, timeout=PATIENCE_S)
        assert files_of(tmp_path / "ray") == expected_files(fleet, tmp_path / "alone")
    finally:
        ray.shutdown()
        cluster.shutdown()
