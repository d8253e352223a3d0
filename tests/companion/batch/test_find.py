"""`companion find`: clips that replay with the same results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from companion.batch.clip import Span, cut, merged
from companion.batch.conditions import NAMED, find_hits
from companion.batch.dataset import open_table
from companion.batch.find import NO_MESSAGE, Clip, Found, cut_clips
from companion.batch.flights import find_flights
from companion.batch.jobs import BatchOptions, FlightTask, Outcome
from companion.batch.schema import TABLES
from companion.batch.task import run_task
from companion.cli import main
from companion.config.loader import Config, ConfigError
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info, software
from companion.replay.replay import Options, replay
from drivers.base import DeviceNotFound, Event
from drivers.logs.reader import McapRecording
from drivers.logs.record_scanner import MAGIC

from ..fleet import NS, flight_events, write_fleet, write_parts

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `batch` is not installed")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    fleet = write_fleet(tmp_path_factory.mktemp("fleet"))
    output = tmp_path_factory.mktemp("dataset")
    for flight in find_flights([str(fleet)]):
        assert isinstance(run_task(FlightTask(flight, str(output), BatchOptions(), software())), Outcome)
    return output


def frames_of(path: Path) -> list[int]:
    with McapRecording(path) as source:
        return [item.sequence for item in source.messages("depth")]


def cut_all(log: Path, spans: list[Span]) -> list[Path]:
    """The clips of an undamaged log."""
    written: list[Path] = []
    assert cut(log, spans, written.append) is None
    return written


def assert_replays_equally(path: Path) -> int:
    """The number of compared frames of a clip."""
    result = replay(path, Options(check=True))
    assert result.damage is None
    assert result.comparison is not None
    assert result.comparison.passed, result.comparison.first
    assert not result.comparison.only_computed
    assert not result.comparison.only_logged
    return result.comparison.compared


def test_overlapping_spans_are_joined() -> None:
    assert merged([(5, 9), (0, 3), (3, 4), (6, 7)]) == [(0, 4), (5, 9)]


def test_a_clip_continues_with_the_state_of_the_flight(tmp_path: Path) -> None:
    (log,) = write_parts(tmp_path, "long", flight_events(4, 2.0))
    spans = [Span(round(b * NS), round((b + 0.4) * NS), tmp_path / f"clip{b}.mcap") for b in (11.2, 10.5)]
    cut_all(log, spans)
    for span, first in zip(spans, (12, 5), strict=True):
        assert assert_replays_equally(span.output) == len(frames_of(span.output)) >= 3
        assert abs(frames_of(span.output)[0] - first) <= 1
        with McapRecording(span.output) as clip, McapRecording(log) as source:
            assert clip.cameras == source.cameras
            assert clip.run == source.run
            assert clip.snapshot is not None
            assert clip.snapshot.cameras[0].HasField("last_t_exposure_ns")
            keys = {item.key for item in clip.messages()}
        assert keys == {
            "run",
            "camera_info",
            "calibration",
            "state",
            "health",
            "depth",
            "attitude",
            "pose",
            "decision",
            "prisms",
        }


def test_a_span_without_messages_gives_no_file(tmp_path: Path) -> None:
    (log,) = write_parts(tmp_path, "short", flight_events(4, 0.3))
    assert cut_all(log, [Span(0, 1, tmp_path / "none.mcap")]) == []
    assert not (tmp_path / "none.mcap").exists()


def test_a_log_whose_configuration_cannot_be_used_is_refused_with_a_remedy_of_this_command(tmp_path: Path) -> None:
    """It named `-c FILE`, which `companion find` does not have."""
    (log,) = write_parts(tmp_path, "odd", flight_events(4, 0.5))
    odd = tmp_path / "retired.mcap"
    with McapRecording(log) as source, LogWriter(odd) as writer:
        run = run_info("live", Config())
        run.config_json = run.config_json.replace('"expert": {', '"expert": {"noise_grid": 0.1,')
        writer.begin(run, source.cameras)
    with pytest.raises(ConfigError, match="use that version") as caught:
        cut_all(odd, [Span(0, 1, tmp_path / "none.mcap")])
    assert "-c FILE" not in str(caught.value)


def test_blindness_of_an_armed_vehicle_is_cut_out(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(
            [
                "find",
                str(dataset),
                "blind_while_armed",
                "-o",
                str(tmp_path),
                "--before",
                "0.2",
                "--after",
                "0.1",
                "--json",
            ]
        )
        == 0
    )
    report = json.loads(capsys.readouterr().out)
    (clip,) = report["clips"]
    assert (clip["vehicle"], clip["flight"]) == ("beta", "20261102-110000")
    path = Path(clip["clip"])
    assert set(range(4, 7)) <= set(frames_of(path))
    assert len(frames_of(path)) < 8
    assert assert_replays_equally(path) == len(frames_of(path))


def test_a_filter_finds_frames_of_the_right_file(dataset: Path, tmp_path: Path) -> None:
    wanted = '[["flight", "=", "20261101-100000"], ["sequence", "in", [2, 8]]]'
    assert main(["find", str(dataset), wanted, "-o", str(tmp_path), "--before", "0", "--after", "0.06"]) == 0
    clips = sorted(tmp_path.glob("*.mcap"))
    assert [frames_of(clip) for clip in clips] == [[2], [8]]
    assert [assert_replays_equally(clip) for clip in clips] == [1, 1]


def test_two_clips_that_begin_with_the_flight_are_both_kept(dataset: Path, tmp_path: Path) -> None:
    """The time before a hit reached back to the begin of the flight from its second file too: the second clip replaced the
    first."""
    wanted = '[["flight", "=", "20261101-100000"], ["sequence", "in", [2, 8]]]'
    assert main(["find", str(dataset), wanted, "-o", str(tmp_path), "--before", "2", "--after", "0.06"]) == 0
    first, second = sorted(tmp_path.glob("*.mcap"), key=lambda clip: frames_of(clip)[0])
    assert 2 in frames_of(first)
    assert 8 in frames_of(second)
    assert [path.name for path in (first, second)] == [
        "alpha_20261101-100000_00000.000s.mcap",
        "alpha_20261101-100000_00000.000s-2.mcap",
    ]


def test_a_clip_begins_with_the_flight(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two seconds before the first frame were printed as a part of the clip that begins at -2.0 s."""
    wanted = '[["flight", "=", "20261101-100000"], ["sequence", "in", [0]]]'
    assert main(["find", str(dataset), wanted, "--list", "--before", "2", "--after", "0.1"]) == 0
    assert capsys.readouterr().out.splitlines()[1].endswith("00000.000s.mcap  0.1 s of alpha/20261101-100000 at 0.0 s")


def test_the_named_conditions_are_filters_of_existing_columns(dataset: Path) -> None:
    for name, condition in NAMED.items():
        assert {column for column, _, _ in condition.filters} <= {c.name for c in TABLES[condition.table]}
        assert isinstance(find_hits(str(dataset), name), list)
    assert len(find_hits(str(dataset), "blind")) == 1
    assert not find_hits(str(dataset), "differs_from_onboard")


def test_rows_may_come_from_a_query(dataset: Path, tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    rows = tmp_path / "rows.parquet"
    frames = f"read_parquet('{dataset}/frames/**/*.parquet', hive_partitioning = true)"
    duckdb.sql(
        f"COPY (SELECT vehicle, flight, file, t_exposure_ns FROM {frames} ORDER BY nearest_m LIMIT 2) TO '{rows}'"
    )
    hits = find_hits(str(dataset), str(rows))
    distances = sorted(r["nearest_m"] for r in open_table(str(dataset), "frames").to_table().to_pylist() if r["planes"])
    table = open_table(str(dataset), "frames").to_table().to_pylist()
    found = [r["nearest_m"] for h in hits for r in table if (r["flight"], r["t_exposure_ns"]) == (h.flight, h.begin_ns)]
    assert sorted(found) == distances[:2]


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("vehicle", None),
        ("flight", 5),
        ("file", "0"),
        ("t_ns", None),
        ("t_ns", "x"),
        ("end_ns", "x"),
        ("duration_s", "x"),
    ],
)
def test_rows_without_usable_values_are_refused(column: str, value: object, tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    path = tmp_path / "rows.parquet"
    row = {"vehicle": "alpha", "flight": "f", "file": 0, "t_ns": 5, column: value}
    parquet.write_table(arrow.Table.from_pylist([row]), path)
    with pytest.raises(ValueError, match=rf"rows.parquet: row 1: .*{column}"):
        find_hits("dataset", str(path))


def test_a_file_of_rows_that_does_not_exist_is_named() -> None:
    pytest.importorskip("pyarrow")
    with pytest.raises(DeviceNotFound, match=r"nowhere.parquet: cannot be read .*check the path"):
        find_hits("dataset", "nowhere.parquet")


def test_rows_of_another_dataset_are_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arrow = pytest.importorskip("pyarrow")
    row = {"vehicle": "alpha", "flight": "20260101-000000", "file": 0, "t_ns": 5}
    parquet.write_table(arrow.Table.from_pylist([row]), tmp_path / "rows.parquet")
    assert main(["find", str(dataset), str(tmp_path / "rows.parquet"), "-o", str(tmp_path)]) == 1
    assert "alpha/20260101-000000, file 0" in capsys.readouterr().err
    parquet.write_table(arrow.Table.from_pylist([{"vehicle": "alpha", "file": 0}]), tmp_path / "rows.parquet")
    assert main(["find", str(dataset), str(tmp_path / "rows.parquet"), "-o", str(tmp_path)]) == 1
    assert "lacks the columns flight, t_ns (or t_exposure_ns)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("condition", "status", "text"),
    [
        ("asleep", 2, "not a condition. Give one of blind, blind_while_armed"),
        ('[["height_m", "<", 3]]', 1, "the table frames has no such column; it has flight, file"),
        ('[["nearest_m", "near", 3]]', 1, "not a filter of the table frames"),
        ('[["nearest_m", "<", "far"]]', 1, "not a filter of the table frames"),
    ],
)
def test_a_wrong_condition_is_explained(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], condition: str, status: int, text: str
) -> None:
    assert main(["find", str(dataset), condition, "-o", str(tmp_path)]) == status
    assert text in capsys.readouterr().err


def test_without_hits_nothing_is_compiled_or_written(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []
    monkeypatch.setattr("companion.batch.find.ensure_compiled", lambda *modes: compiled.extend(modes))
    assert main(["find", str(dataset), '[["sequence", "=", 123456]]', "-o", str(tmp_path / "clips")]) == 0
    assert capsys.readouterr().out.strip() == "0 rows, 0 clips"
    assert compiled == []
    assert not (tmp_path / "clips").exists()


def test_a_missing_log_stops_no_other_clip(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flights = open_table(str(dataset), "flights").to_table().to_pylist()
    gone = Path(next(row for row in flights if row["flight"] == "20261102-110000")["files"][0])
    kept = gone.rename(tmp_path / "kept")
    try:
        wanted = '[["sequence", "=", 5], ["vehicle", "=", "beta"]]'
        assert main(["find", str(dataset), wanted, "-o", str(tmp_path), "--before", "0", "--after", "0.06"]) == 1
    finally:
        kept.rename(gone)
    assert f"{gone}: no clip" in capsys.readouterr().err
    assert len(list(tmp_path.glob("*.mcap"))) == 1


def test_an_output_that_cannot_be_written_stops_no_other_clip(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log itself is at the place of its clip."""
    wanted = '[["sequence", "=", 5], ["vehicle", "=", "beta"]]'
    arguments = ["find", str(dataset), wanted, "-o", str(tmp_path), "--before", "0", "--after", "0.06"]
    assert main(arguments) == 0
    first, *others = sorted(tmp_path.glob("*.mcap"))
    assert others
    before = [clip.read_bytes() for clip in others]
    flights = open_table(str(dataset), "flights").to_table().to_pylist()
    log = next(Path(row["files"][0]) for row in flights if f"_{row['flight']}_" in first.name)
    first.unlink()
    first.symlink_to(log)
    for clip in others:
        clip.unlink()
    assert main([*arguments, "--replace"]) == 1
    assert f"{log}: no clip" in capsys.readouterr().err
    assert [clip.read_bytes() for clip in others] == before


def test_a_clip_of_an_earlier_search_is_replaced_on_request_only(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A search with a shorter `--after` shortened it."""
    wanted = ["find", str(dataset), '[["sequence", "=", 5], ["flight", "=", "20261102-110000"]]', "-o", str(tmp_path)]
    assert main(wanted) == 0
    (clip,) = tmp_path.glob("*.mcap")
    before = clip.read_bytes()
    shorter = [*wanted, "--after", "0.1"]
    assert main(shorter) == 1
    assert f"{clip} exists; give -o another name, or --replace" in capsys.readouterr().err
    assert clip.read_bytes() == before
    assert main([*shorter, "--replace"]) == 0
    assert len(clip.read_bytes()) < len(before)


def test_a_clip_of_an_earlier_search_stays_and_does_not_count(dataset: Path, tmp_path: Path) -> None:
    """It was deleted, and may have been the last copy of these seconds."""
    row = open_table(str(dataset), "flights").to_table().to_pylist()[0]
    clip = Clip(row["vehicle"], row["flight"], row["files"][0], 0, 1, 0.0, tmp_path / "clip.mcap")
    clip.output.write_bytes(Path(clip.location).read_bytes())  # of an earlier search
    found = Found()
    cut_clips([clip], found)
    assert found.clips == []
    assert found.failed == {row["files"][0]: f"no clip: {NO_MESSAGE}"}
    assert clip.output.read_bytes() == Path(clip.location).read_bytes()


def test_a_table_or_file_of_rows_that_cannot_be_read_is_named(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`companion batch --compare` ended with a traceback, and `find` reported a full disk."""
    closed, output = str(tmp_path / ("x" * 300)), str(tmp_path / "output")  # too long for a name; as without permission
    for words in (["batch", "--compare", closed, closed], ["find", closed, "blind_while_armed"]):
        assert main([*words, "-o", output]) == 1
        assert "this table cannot be read" in capsys.readouterr().err
    assert main(["find", str(dataset), "missing.parquet", "-o", output]) == 1
    assert "missing.parquet: cannot be read (no such file)" in capsys.readouterr().err


@pytest.mark.parametrize(
    "lost", [ConnectionResetError("connection lost"), RuntimeError("connection lost")], ids=["OSError", "other"]
)
@pytest.mark.parametrize("first_lost", range(4))
def test_a_dataset_whose_connection_is_lost_is_not_called_damaged(
    lost: Exception, first_lost: int, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The remedy was to delete a file of it; errors that are no OSError, as those of aiohttp and botocore, ended with a
    traceback."""
    fsspec = pytest.importorskip("fsspec")
    local = pytest.importorskip("fsspec.implementations.local")
    opened: list[str] = []

    class Site(local.LocalFileSystem):  # type: ignore[misc]
        protocol = "site"
        cachable = False

        @classmethod
        def _strip_protocol(cls, path: str) -> str:
            return str(path).removeprefix("site://")

        def open(self, path: str, mode: str = "rb", **options: object) -> object:
            opened.append(path)
            if len(opened) > first_lost:
                raise lost
            return super().open(path, mode, **options)

    fsspec.register_implementation("site", Site, clobber=True)
    assert main(["find", f"site://{dataset}", '[["sequence", "=", 5]]', "--list"]) == 1
    err = capsys.readouterr().err
    assert "cannot be reached (connection lost); check the address, the access to it, and the network" in err
    assert "delete" not in err


def test_a_dataset_at_a_web_address_is_refused_with_the_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    """Where the server could not be reached: "there is no such table"; otherwise "a file of this table is damaged"."""
    for words in (
        ["find", "http://127.0.0.1:9/ds", "blind", "--list"],
        ["batch", "--compare", "https://h/a", "b", "-o", "r"],
    ):
        assert main(words) == 1
        assert "a dataset cannot be read from a web server, which lists no folders; copy it" in capsys.readouterr().err


def one_clip(dataset: Path, output: Path) -> Clip:
    """The first second of a log of the dataset."""
    row = open_table(str(dataset), "flights").to_table().to_pylist()[0]
    begin_ns = row["begin_ns"]
    return Clip(row["vehicle"], row["flight"], row["files"][0], begin_ns, begin_ns + NS, 0.0, output)


def test_an_earlier_clip_stays_where_its_log_is_gone(dataset: Path, tmp_path: Path) -> None:
    """It was deleted before the log was opened, and may have been the last copy of these seconds."""
    clip = replace(one_clip(dataset, tmp_path / "clip.mcap"), location=str(tmp_path / "deleted.mcap"))
    clip.output.write_bytes(MAGIC + b"the last copy")
    found = Found()
    cut_clips([clip], found)
    assert clip.output.read_bytes() == MAGIC + b"the last copy"
    assert found.clips == []
    assert "does not exist" in found.failed[clip.location]


def test_an_interrupted_search_leaves_no_part_of_a_clip(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C completed the clip, which then looked like a short one; an earlier clip was deleted."""
    clip = one_clip(dataset, tmp_path / "clip.mcap")
    cut_clips([clip], Found())
    whole = clip.output.read_bytes()
    event, events = LogWriter.event, []

    def interrupted(log: LogWriter, item: Event) -> None:
        events.append(item)
        if len(events) == 30:
            raise KeyboardInterrupt
        event(log, item)

    monkeypatch.setattr(LogWriter, "event", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cut_clips([clip], Found())
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mcap"]
    assert clip.output.read_bytes() == whole


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk without space")
def test_a_full_disk_is_named_with_the_place_and_the_remedy(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message was `[Errno 28] No space left on device`."""
    wanted = ["find", str(dataset), '[["sequence", "=", 5], ["flight", "=", "20261102-110000"]]']
    clips = tmp_path / "clips"
    assert main([*wanted, "-o", str(clips), "--list"]) == 0
    name = Path(capsys.readouterr().out.splitlines()[1].split("  ")[0]).name
    clips.mkdir()
    (clips / f"{name}.active").symlink_to("/dev/full")
    assert main([*wanted, "-o", str(clips)]) == 1
    ended = capsys.readouterr()
    assert "1 row, 0 clips" in ended.out
    assert f"20261102-110000.000.mcap: no clip: {clips}: No space left on device" in ended.err
    assert "check the free space" in ended.err
    assert list(clips.iterdir()) == []


def test_a_list_needs_no_output(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It writes nothing."""
    wanted = ["find", str(dataset), '[["sequence", "=", 5], ["flight", "=", "20261102-110000"]]']
    assert main([*wanted, "--list"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == "1 row, 1 clip"
    assert second.startswith("beta_20261102-110000_")
    assert main(wanted) == 2
    assert "-o DIR" in capsys.readouterr().err
