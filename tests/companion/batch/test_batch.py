"""`companion batch`: the tables of a fleet, equality with `companion replay`, damaged logs, restart."""

from __future__ import annotations

import errno
import json
import os
import resource
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.batch import task
from companion.batch.comparison import Dataset, compare_flight
from companion.batch.conditions import find_hits
from companion.batch.dataset import begin_run, finished, open_table
from companion.batch.engines import Done
from companion.batch.find import plan_clips
from companion.batch.flights import find_flights
from companion.batch.frame_rows import digest_of
from companion.batch.jobs import BatchOptions, Failure, FlightTask, Outcome
from companion.batch.local_engine import LocalEngine
from companion.batch.schema import TABLES
from companion.batch.task import run_task
from companion.cli import main
from companion.config.loader import Config
from companion.log.log_writer import LogWriter
from companion.log.provenance import software
from companion.log.recover import recover
from core.params import Params
from core.tracking.params import TrackingParams
from core.types import CameraInfo, DepthFrame
from drivers.base import BadData, DeviceNotFound, Event
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb

from ..fleet import NS, SMALL, flight_events, write_fleet, write_parts
from ..replay.test_replay import log_of_a_newer_version
from ..replay.test_replay_recovered import with_damaged_chunk

pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet(tmp_path_factory.mktemp("fleet"))


def process_all(folder: Path, output: Path, options: BatchOptions) -> list[Outcome]:
    """Processes a fleet in this process."""
    done = [run_task(FlightTask(f, str(output), options, software())) for f in find_flights([str(folder)])]
    assert all(isinstance(outcome, Outcome) for outcome in done), done
    return [outcome for outcome in done if isinstance(outcome, Outcome)]


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """`companion batch` without processes of its own, each of which imports the service anew (1 s)."""
    monkeypatch.setattr(LocalEngine, "run", lambda self, tasks: (Done(task, run_task(task)) for task in tasks))


@pytest.fixture(scope="module")
def dataset(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("dataset")
    process_all(fleet, output, BatchOptions(planes=True, logs=True))
    return output


def rows(dataset: Path, table: str) -> list[dict[str, Any]]:
    return open_table(str(dataset), table).to_table().to_pylist()


def flight_rows(dataset: Path) -> dict[str, dict[str, Any]]:
    return {row["flight"]: row for row in rows(dataset, "flights")}


# ---- tables -------------------------------------------------------------------------------------------------------------


def test_every_documented_column_is_written(dataset: Path) -> None:
    for table, columns in TABLES.items():
        schema = open_table(str(dataset), table).schema
        assert schema.names == [c.name for c in columns] + ["vehicle", "date"]
        found = rows(dataset, table)
        assert found
        missing = {c.name for c in columns} - {
            name for row in found for name, value in row.items() if value is not None
        }
        assert missing <= {"first_difference"}


def test_the_flights_have_one_row_each(dataset: Path) -> None:
    flights = flight_rows(dataset)
    assert [(row["vehicle"], row["date"]) for row in flights.values()] == [
        ("alpha", "2026-11-01"),
        ("beta", "2026-11-02"),
        ("beta", "2026-11-03"),
    ]
    rotated, blind, cut = flights.values()
    assert [row["equals_onboard"] for row in flights.values()] == [True, True, True]
    assert (rotated["frames"], rotated["compared"], len(rotated["files"]), rotated["blind_s"]) == (11, 11, 2, 0.0)
    assert (blind["valid"], blind["blind_s"]) == (8, pytest.approx(0.3))
    assert blind["armed_s"] == pytest.approx(1.0, abs=0.1)
    assert "damaged at byte" in cut["damage"]
    assert rotated["damage"] is None


def test_frames_have_the_values_of_the_log(dataset: Path) -> None:
    frames = [row for row in rows(dataset, "frames") if row["flight"] == "20261101-100000"]
    assert {row["file"] for row in frames} == {0, 1}
    with McapRecording(Path(flight_rows(dataset)["20261101-100000"]["files"][0])) as source:
        logged = {item.message.sequence: item.message for item in source.messages("prisms")}
    for row in frames:
        if row["file"] == 0:
            message = logged[row["sequence"]]
            assert row["digest"] == row["onboard_digest"] == digest_of(message)
            assert row["planes"] == len(message.planes.support_px)
            assert row["armed"] is True
            assert row["publish_latency_ms"] == 31.5
            assert 30.0 < row["camera_latency_ms"] < 60.0
    planes = [row for row in rows(dataset, "planes") if row["flight"] == "20261101-100000"]
    assert len(planes) == sum(row["planes"] for row in frames) > 0


def test_events_name_blindness_and_reports(dataset: Path) -> None:
    events = [row for row in rows(dataset, "events") if row["flight"] == "20261102-110000"]
    (blind,) = [row for row in events if row["kind"] == "blind"]
    assert (blind["cause"], blind["frames"], blind["armed"]) == ("no_measurement", 3, True)
    assert [row["kind"] for row in events].count("recovered") == 1
    assert {row["distance_m"] for row in events if row["kind"] == "obstacle_report"} == {8.0}


@pytest.mark.parametrize("tracking", [False, True])
def test_only_kernels_that_a_flight_needs_are_compiled(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tracking: bool
) -> None:
    """Those of the tracking were compiled at the first run without tracking too."""
    compiled: list[str] = []
    monkeypatch.setattr(task, "ensure_compiled", lambda *groups: compiled.extend(groups))
    task._compile.cache_clear()
    config = Config(tracking=TrackingParams(enabled=True)) if tracking else None
    process_all(fleet / "alpha", tmp_path, BatchOptions(config=config))
    assert compiled == ["extractor", "tracking"][: 1 + tracking]


def test_replayed_logs_equal_those_of_companion_replay(fleet: Path, dataset: Path, tmp_path: Path) -> None:
    for number in (0, 1):
        source = fleet / "alpha" / f"20261101-100000.{number:03d}.mcap"
        alone = tmp_path / source.name
        assert main(["replay", str(source), "--check", "--no-depth", "-o", str(alone)]) == 0
        assert alone.read_bytes() == (dataset / "logs/vehicle=alpha/date=2026-11-01" / source.name).read_bytes()


def test_another_configuration_differs_from_the_results_on_board(fleet: Path, tmp_path: Path) -> None:
    config = Config(extractor=Params(min_support_px=60))
    process_all(fleet / "alpha", tmp_path, BatchOptions(config=config))
    (row,) = flight_rows(tmp_path).values()
    assert row["equals_onboard"] is False
    assert row["different"] > 0
    assert "frame" in row["first_difference"]
    assert row["config_hash"] != row["onboard_config_hash"]
    differing = [f for f in rows(tmp_path, "frames") if f["equals_onboard"] is False]
    assert len(differing) == row["different"]
    assert not (tmp_path / "planes").exists()


def test_the_same_flight_gives_the_same_files(fleet: Path, dataset: Path, tmp_path: Path) -> None:
    process_all(fleet, tmp_path, BatchOptions(planes=True, logs=True))
    files = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*.*") if p.is_file())
    assert len(files) == 3 * 4 + 4
    for file in files:
        assert (tmp_path / file).read_bytes() == (dataset / file).read_bytes()


# ---- broken logs --------------------------------------------------------------------------------------------------------


def test_broken_logs_are_part_of_the_result(tmp_path: Path) -> None:
    source = tmp_path / "in" / "v"
    first, _ = write_parts(source, "20261101-100000", flight_events(1, 0.6), parts=2)
    first.write_bytes(b"not a log")
    (source / "empty.mcap").touch()
    process_all(source, tmp_path / "out", BatchOptions())
    flights = flight_rows(tmp_path / "out")
    assert f"{first}: not an MCAP file" in flights["20261101-100000"]["damage"]
    assert flights["20261101-100000"]["frames"] > 0
    assert flights["empty"]["frames"] == 0
    assert "empty" in flights["empty"]["damage"]
    assert flights["empty"]["equals_onboard"] is None


@pytest.mark.usefixtures("in_process")
def test_logs_that_cannot_be_read_are_counted_at_the_end_and_give_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ended with 0, and nothing but a warning among others said that a log is missing from the tables. A second run, which
    leaves present flights out, says it again."""
    source, out = tmp_path / "v", tmp_path / "out"
    first, _ = write_parts(source, "20261101-100000", flight_events(1, 0.6), parts=2)
    first.write_bytes(b"not a log")
    (source / "empty.mcap").touch()
    (source / "cut.mcap").write_bytes((source / "20261101-100000.001.mcap").read_bytes()[:-3000])
    for processed, present in ((2, 0), (0, 2)):
        assert main(["batch", str(source), "-o", str(out), "--workers", "1"]) == 1
        printed = capsys.readouterr()
        assert f"3 flights: {processed} processed, {present} already present, 0 failed, 1 unreadable\n" in printed.out
        assert printed.err.splitlines()[-1] == (
            "companion: error: 2 log files were not processed: nothing of them can be read. Flights: v/20261101-100000, v/empty; "
            "the column `damage` of the table flights says why"
        )
    assert main(["batch", str(source), "-o", str(out), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["unread_files"] == {"v/20261101-100000": 1, "v/empty": 1}


def test_what_a_recovered_log_lacks_is_in_the_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The column was empty, although results after the gap can differ from those in flight."""
    monkeypatch.setattr("companion.log.log_writer.CHUNK_BYTES", 30_000)
    (log,) = write_parts(tmp_path / "other", "20261101-100000", flight_events(1, 1.0))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    (tmp_path / "v").mkdir()
    recover(with_damaged_chunk(cut, tmp_path / "v" / log.name, 0), cameras_from=log)
    process_all(tmp_path / "v", tmp_path / "out", BatchOptions())
    (row,) = flight_rows(tmp_path / "out").values()
    assert row["frames"] > 0
    assert "recovered from a damaged file; 1 place could not be read" in row["damage"]
    assert f"/run, /camera/front/info are from another log ({log})" in row["damage"]


@pytest.mark.parametrize(
    ("camera", "processor", "later_s", "difference"),
    [
        (SMALL, "pdp11", 100.0, "software or configuration"),
        (SMALL, None, 0.0, "times, which begin before the end of the file before it"),
        (replace(SMALL, mount=replace(SMALL.mount, yaw_rad=0.1)), None, 100.0, "description of camera front"),
        (SMALL, None, 100.0, None),
    ],
)
def test_files_of_two_vehicles_in_one_flight_are_named(
    tmp_path: Path, camera: CameraInfo, processor: str | None, later_s: float, difference: str | None
) -> None:
    """They were processed as one flight without a message."""
    v, name = tmp_path / "v", "20261101-100000"
    write_parts(v, name, flight_events(1, 3.0))
    with LogWriter(v / f"{name}.001.mcap") as log, McapRecording(v / f"{name}.000.mcap") as first:
        assert first.run is not None
        first.run.processor = processor or first.run.processor
        log.begin(first.run, (camera,))
        for event in flight_events(2, 0.3):
            log.event(later(event, later_s))
    process_all(v, tmp_path / "out", BatchOptions())
    (row,) = flight_rows(tmp_path / "out").values()
    if difference is None:
        assert row["damage"] is None
    else:
        assert f"{name}.001.mcap: of another run than the first file of the flight ({difference})" in row["damage"]


@pytest.mark.parametrize("boots", [("one", "one"), ("one", ""), ("one", "two")])
def test_files_of_two_computers_in_one_flight_are_named(tmp_path: Path, boots: tuple[str, str]) -> None:
    """Vehicles of one configuration whose times follow each other. Health reports state the boot of their computer."""
    v, name = tmp_path / "v", "20261101-100000"
    (first,) = write_parts(tmp_path / "other", name, flight_events(1, 0.3))
    v.mkdir()
    with McapRecording(first) as source:
        assert source.run is not None
        run = source.run
    for part, boot in enumerate(boots):
        with LogWriter(v / f"{name}.{part:03d}.mcap") as log:
            log.begin(run, (SMALL,))
            for event in flight_events(1 + part, 0.3):
                log.event(later(event, 100.0 * part))
            for report in range(2):
                t_ns = (1 + 100 * part + report) * NS
                log.write("health", pb.Health(schema_version=1, boot_id=boot, t_ns=t_ns), t_ns)
    process_all(v, tmp_path / "out", BatchOptions())
    (row,) = flight_rows(tmp_path / "out").values()
    if boots == ("one", "two"):
        difference = "boot of the computer"
        assert f"{name}.001.mcap: of another run than the first file of the flight ({difference})" in row["damage"]
    else:
        assert row["damage"] is None


def later(event: Event, seconds: float) -> Event:
    """The event at another time."""
    if isinstance(event, DepthFrame):
        return replace(
            event,
            t_exposure_ns=event.t_exposure_ns + round(seconds * NS),
            t_arrival_ns=event.t_arrival_ns + round(seconds * NS),
        )
    return replace(event, t_ns=event.t_ns + round(seconds * NS), t_arrival_ns=event.t_arrival_ns + round(seconds * NS))


@pytest.mark.usefixtures("in_process")
def test_a_truncated_log_is_no_failure(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its readable part is in the tables."""
    (cut,) = fleet.glob("beta/20261103*")
    assert main(["batch", str(cut), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "1 flight: 1 processed, 0 already present, 0 failed\n" in capsys.readouterr().out


def test_a_dataset_without_the_count_of_unread_files_continues(fleet: Path, dataset: Path, tmp_path: Path) -> None:
    """Datasets of 0.1.0 lack this column."""
    parquet = pytest.importorskip("pyarrow.parquet")
    copy = shutil.copytree(dataset, tmp_path / "copy")
    for file in (copy / "flights").rglob("*.parquet"):
        parquet.write_table(parquet.ParquetFile(file).read().drop_columns(["unread_files"]), file)
    flights = find_flights([str(fleet)])
    assert finished(str(copy), flights) == dict.fromkeys(flights, 0)


@pytest.mark.usefixtures("in_process")
def test_a_folder_that_cannot_be_read_gives_status_1(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scandir = os.scandir

    def scan(path: str) -> object:
        if str(path).endswith("beta"):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", scan)
    assert main(["batch", str(fleet), "-o", str(tmp_path / "out"), "--workers", "1"]) == 1
    assert "companion: error: 1 input was not processed: it cannot be read" in capsys.readouterr().err


def test_what_has_the_name_of_a_log_and_cannot_be_read_gives_status_1(
    fleet: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A link to a disk that is not mounted was left out without a word."""
    logs, out = shutil.copytree(fleet, tmp_path / "logs"), shutil.copytree(dataset, tmp_path / "out")
    (logs / "beta" / "20261104-120000.000.mcap").symlink_to(tmp_path / "disk" / "20261104-120000.000.mcap")
    os.mkfifo(logs / "beta" / "20261105-120000.000.mcap")
    assert main(["batch", str(logs), "-o", str(out), "--planes", "--logs", "--workers", "1", "--json"]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out)["unread_inputs"] == 2
    assert "20261104-120000.000.mcap: cannot be read (No such file or directory): it is left out" in printed.err
    assert "20261105-120000.000.mcap: cannot be read (a pipe, socket or device" in printed.err
    assert "companion: error: 2 inputs were not processed: they cannot be read (named above)" in printed.err


@pytest.mark.usefixtures("in_process")
def test_a_log_without_depth_images_is_named(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It gave an empty result that looked like one of a flight without frames."""
    source = next(fleet.rglob("*.mcap"))
    (logs := tmp_path / "logs").mkdir()
    main(["replay", str(source), "--no-depth", "-o", str(logs / "flight.mcap")])
    capsys.readouterr()
    assert main(["batch", str(logs), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "logs without depth images, so that nothing was computed: logs/flight" in capsys.readouterr().err


def test_a_log_of_a_newer_version_is_processed_with_a_configuration_of_this_one(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "v").mkdir()
    newer = log_of_a_newer_version(min(fleet.glob("alpha/*.mcap")), tmp_path / "v" / "20261101-100000.000.mcap")
    options = BatchOptions(config=Config())
    (flight,) = find_flights([str(newer)])
    done = run_task(FlightTask(flight, str(tmp_path / "out"), options, software()))
    assert isinstance(done, Outcome)
    assert done.frames > 0
    assert flight_rows(tmp_path / "out")["20261101-100000"]["onboard_software"] == "osape-companion 99.0"


def test_a_log_that_disappears_is_no_result(tmp_path: Path) -> None:
    write_parts(tmp_path / "v", "20261101-100000", flight_events(1, 0.3))
    (flight,) = find_flights([str(tmp_path)])
    shutil.rmtree(tmp_path / "v")
    failure = run_task(FlightTask(flight, str(tmp_path / "out"), BatchOptions(), software()))
    assert "the file does not exist" in getattr(failure, "text", "")
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_tables_that_the_disk_does_not_take_are_no_result(fleet: Path, tmp_path: Path) -> None:
    """A limit of the file size acts as a full disk. The failure was `[Errno 27] ...` without a remedy."""
    (flight,) = (f for f in find_flights([str(fleet)]) if f.name == "20261102-110000")
    task = FlightTask(flight, str(tmp_path / "output"), BatchOptions(), software())
    run_task(replace(task, output=str(tmp_path / "other")))  # what it compiles is not limited
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, hard))
    try:
        failed = run_task(task)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert isinstance(failed, Failure)
    assert str(tmp_path / "output") in failed.text
    assert "allows no larger file" in failed.text
    assert [path for path in (tmp_path / "output").rglob("*") if path.is_file()] == []


def test_a_worker_of_another_version_is_refused(fleet: Path, tmp_path: Path) -> None:
    flight = find_flights([str(fleet)])[0]
    failure = run_task(FlightTask(flight, str(tmp_path), BatchOptions(), "osape-companion 0.0.9"))
    assert "install the same version on all workers" in getattr(failure, "text", "")


def test_addresses_give_the_same_files(fleet: Path, dataset: Path) -> None:
    fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed")
    memory = fsspec.filesystem("memory")
    memory.put(f"{fleet}/", "/bucket/logs/", recursive=True)
    try:
        flights = find_flights(["memory://bucket/logs"])
        assert [str(f) for f in flights] == [str(f) for f in find_flights([str(fleet)])]
        assert len(find_flights(["memory://bucket/logs/beta/*.mcap"])) == 2
        for flight in flights:
            done = run_task(FlightTask(flight, "memory://bucket/out", BatchOptions(planes=True), software()))
            assert isinstance(done, Outcome), done
        assert finished("memory://bucket/out", flights).keys() == set(flights)
        for table in ("frames", "events", "planes"):
            names = sorted(memory.find(f"/bucket/out/{table}"))
            assert len(names) == 3
            for name in names:
                assert memory.cat_file(name) == (dataset / name.removeprefix("/bucket/out/")).read_bytes()
        with pytest.raises(DeviceNotFound, match="no log"):
            find_flights(["memory://bucket/absent"])
    finally:
        memory.rm("/bucket", recursive=True)


def test_frames_that_the_live_run_skipped_are_left_out(tmp_path: Path) -> None:
    events = flight_events(1, 0.6)
    write_parts(tmp_path / "v", "20261101-100000", events, busy=3)
    process_all(tmp_path / "v", tmp_path / "out", BatchOptions())
    (row,) = flight_rows(tmp_path / "out").values()
    assert (row["skipped_live"], row["frames"], row["equals_onboard"]) == (1, 6, True)
    assert 3 not in [frame["sequence"] for frame in rows(tmp_path / "out", "frames")]


# ---- restart ------------------------------------------------------------------------------------------------------------


def test_present_results_are_not_computed_again(fleet: Path, dataset: Path) -> None:
    flights = find_flights([str(fleet)])
    assert finished(str(dataset), flights) == dict.fromkeys(flights, 0)


def test_a_flight_with_a_new_file_is_processed_again(tmp_path: Path) -> None:
    events = flight_events(1, 0.6)
    _, second = write_parts(tmp_path / "v", "20261101-100000", events, parts=2)
    kept = second.rename(tmp_path / "later")
    process_all(tmp_path / "v", tmp_path / "out", BatchOptions())
    kept.rename(second)
    (flight,) = find_flights([str(tmp_path / "v")])
    assert finished(str(tmp_path / "out"), [flight]) == {}
    process_all(tmp_path / "v", tmp_path / "out", BatchOptions())
    assert finished(str(tmp_path / "out"), [flight]) == {flight: 0}
    assert len(rows(tmp_path / "out", "flights")) == 1


def test_a_flight_is_complete_with_its_last_file_only(fleet: Path, dataset: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(dataset, tmp_path / "copy")
    shutil.rmtree(copy / "flights" / "vehicle=alpha")
    assert {f.vehicle for f in finished(str(copy), find_flights([str(fleet)]))} == {"beta"}


@pytest.mark.parametrize("left", [0, 100, -1])
def test_a_flight_with_a_damaged_row_is_processed_again(left: int, fleet: Path, dataset: Path, tmp_path: Path) -> None:
    """The whole dataset could not be used any more."""
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    flights = find_flights([str(fleet)])
    row = copy / "flights" / flights[1].partition / f"{flights[1].name}.parquet"
    row.write_bytes(row.read_bytes()[:left])
    assert finished(str(copy), flights).keys() == {flights[0], *flights[2:]}
    with pytest.raises(BadData, match=r"copy/flights: a file of this table is damaged"):
        plan_clips(str(copy), find_hits(str(copy), "blind"), tmp_path, 0.0, 0.0)


def compare_all(a: Path, b: Path) -> None:
    one, other = Dataset(str(a)), Dataset(str(b))
    for name in sorted(one.names):
        compare_flight(one, other, name)


@pytest.mark.parametrize("table", ["frames", "events"])
@pytest.mark.parametrize("number", [0, -1])
def test_a_damaged_table_is_named_with_the_remedy(table: str, number: int, dataset: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    file = sorted((copy / table).rglob("*.parquet"))[number]
    file.write_bytes(file.read_bytes()[:-1])
    condition = "blind" if table == "events" else '[["planes", ">", 0]]'
    with pytest.raises(BadData, match=rf"copy/{table}: a file of this table is damaged .* run the same"):
        find_hits(str(copy), condition)
    if table == "frames":
        with pytest.raises(BadData, match="a file of this table is damaged"):
            compare_all(copy, dataset)


@pytest.mark.parametrize("text", ["{", "[]", "3", "\udcff"])
def test_a_damaged_note_of_the_run_is_named(text: str, tmp_path: Path) -> None:
    """It records how the results were made: without it they could be mixed with others."""
    (tmp_path / "batch.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(BadData, match=r"batch\.json: .*delete the folder, or give -o another one"):
        begin_run(str(tmp_path), {"near_m": 2.0})


@pytest.fixture
def no_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.batch.command.ensure_compiled", lambda *modes: None)
    monkeypatch.setattr("companion.batch.local_engine.LocalEngine.run", lambda self, tasks: iter(()))


@pytest.mark.usefixtures("no_engine")
def test_results_of_other_options_are_not_mixed(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["batch", str(fleet), "-o", str(tmp_path)]
    assert main(command) == 0
    assert main(command) == 0
    assert main([*command, "--near", "3"]) == 1
    assert "near_m: 2.0 before, 3.0 now" in capsys.readouterr().err


@pytest.mark.usefixtures("no_engine")
@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--engine", "dask"], "needs --address"),
        (["--engine", "ray", "--address", "auto", "--workers", "3"], "leave it out"),
        (["--address", "tcp://host:8786"], "the local engine has none"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], text: str
) -> None:
    assert main(["batch", str(fleet), "-o", str(tmp_path / "out"), *options]) == 2
    assert text in capsys.readouterr().err


@pytest.mark.usefixtures("no_engine")
def test_the_json_report_counts_flights(
    fleet: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(dataset, tmp_path / "copy")
    assert main(["batch", str(fleet), "-o", str(copy), "--planes", "--logs", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["flights"], report["already_present"], report["processed"]) == (3, 3, 0)
