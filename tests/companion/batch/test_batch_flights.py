"""The flights that `companion batch` finds in folders, patterns and addresses."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from companion.batch.flights import Flight, find_flights
from companion.batch.jobs import BatchOptions, Failure, FlightTask
from companion.batch.storage import StoredFile, find_logs
from companion.batch.task import run_task
from companion.cli import main
from companion.log.provenance import software
from companion.log.recover import default_output
from drivers.base import DeviceNotFound

pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")


def test_rotated_files_of_a_flight_stay_together(tmp_path: Path) -> None:
    touch(
        tmp_path, "a/20261101-100000.001.mcap", "a/20261101-100000.000.idle.mcap", "a/20261101-100000.010.mcap.active"
    )
    touch(tmp_path, "a/20261101-100000.001.mcap.active", "b/20261101-100000.000.mcap", "b/hover.mcap", "b/notes.txt")
    flights = {str(f): f for f in find_flights([str(tmp_path), str(tmp_path / "b" / "*.mcap")])}
    assert list(flights) == ["a/20261101-100000", "b/20261101-100000", "b/hover"]
    names = [file.name.removeprefix("20261101-100000.") for file in flights["a/20261101-100000"].files]
    assert names == ["000.idle.mcap", "001.mcap", "010.mcap.active"]
    assert [f.date for f in flights.values()] == ["2026-11-01", "2026-11-01", "unknown"]


def test_flights_that_would_be_mixed_are_refused(tmp_path: Path) -> None:
    touch(tmp_path, "x/v/one.mcap", "y/v/one.mcap")
    with pytest.raises(ValueError, match=r"flight one of the vehicle v is in .*x/v and in .*y/v"):
        find_flights([str(tmp_path)])


def test_a_pattern_takes_the_folders_that_it_matches(tmp_path: Path) -> None:
    """A shell replaces a pattern without quotes by these folders; in quotes it found the logs beside them only."""
    touch(tmp_path, "a/one.mcap", "b/c/two.mcap", "b/note.txt", "three.mcap")
    for pattern, expected in (("*", ["one", "three", "two"]), ("[b]", ["two"]), ("**", ["one", "three", "two"])):
        names = [f.name for f in find_logs(str(tmp_path / pattern), pytest.fail)]
        assert sorted(n.removesuffix(".mcap") for n in names if n != "note.txt") == expected
    assert [f.name for f in find_logs(str(tmp_path / "b*"), pytest.fail)] == ["two.mcap"]


def test_flights_with_names_of_other_alphabets_are_kept_apart(tmp_path: Path) -> None:
    touch(tmp_path, "v/\u98de\u884c.mcap", "v/\u6d4b\u8bd5.mcap", "v/\u00e4 1.mcap", "v/two\nlines.mcap")
    found = {str(flight) for flight in find_flights([str(tmp_path)])}
    assert found == {"v/\u98de\u884c", "v/\u6d4b\u8bd5", "v/\u00e4_1", "v/two_lines"}


def test_two_names_of_a_folder_that_become_one_are_named(tmp_path: Path) -> None:
    touch(tmp_path, "v/a b.mcap", "v/a_b.mcap")
    with pytest.raises(ValueError, match=r"Rename a_b.mcap or a b.mcap"):
        find_flights([str(tmp_path)])


@pytest.mark.parametrize("output", ["all/out", "all"])
def test_replayed_logs_of_the_output_are_no_flights(tmp_path: Path, output: str) -> None:
    """A second run with the same output would otherwise process what the first one has written."""
    touch(tmp_path, "all/alpha/one.mcap", "all/logs/two.mcap", f"{output}/logs/vehicle=alpha/date=unknown/one.mcap")
    touch(tmp_path, f"{output}/.unfinished/alpha-one-x/one.mcap")
    found = find_flights([str(tmp_path / "all")], output=str(tmp_path / output))
    assert [str(flight) for flight in found] == ["alpha/one", "logs/two"]


def test_a_name_that_no_table_can_hold_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`'utf-8' codec can't encode character '\\udce9'`."""
    errors: list[str] = []
    monkeypatch.setattr("companion.cli.fail", errors.append)
    name = os.fsdecode(b"caf\xe9")
    touch(tmp_path, f"{name}.mcap", "plain.mcap")
    for words in ([f"{name}.mcap", "-o", "out"], ["plain.mcap", "-o", name]):
        assert main(["batch", *(word if word == "-o" else str(tmp_path / word) for word in words)]) == 1
        assert errors.pop().endswith("this name is not UTF-8, which the tables need; rename the file or folder")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_cannot_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its flights were missing without a message."""
    touch(tmp_path, "alpha/one.mcap", "beta/two.mcap")
    scandir = os.scandir

    def scan(path: str) -> object:
        if Path(path).name == "beta":
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", scan)
    assert [str(flight) for flight in find_flights([str(tmp_path)])] == ["alpha/one"]
    assert (
        f"{tmp_path / 'beta'}: cannot be read (Permission denied): logs in it are left out" in capsys.readouterr().err
    )


def test_an_input_without_logs_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match=r"absent.*no log"):
        find_flights([str(tmp_path / "absent")])


@pytest.mark.parametrize(
    ("address", "package"),
    [("http://host/a.mcap", "fsspec[http]"), ("s3://bucket/a", "s3fs"), ("gs://bucket/a", "gcsfs")],
)
def test_the_library_of_an_address_is_named(address: str, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """For http:// the remedy was to install fsspec, which is installed, or s3fs."""
    fsspec = pytest.importorskip("fsspec")

    def missing(location: str) -> None:
        raise ImportError("a library is missing")

    monkeypatch.setattr(fsspec.core, "url_to_fs", missing)
    with pytest.raises(DeviceNotFound) as caught:
        find_flights([address])
    assert f"pip install '{package}" in str(caught.value)
    assert str(caught.value).count("pip install") == 1


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("closed.mcap", "cannot be reached (403 Forbidden); check the address"),
        ("page.mcap", "the size of this file is not known"),
        ("none.mcap", "no log (*.mcap) found"),
    ],
)
def test_an_address_that_cannot_be_read_is_named(name: str, text: str, tmp_path: Path) -> None:
    """The errors of the libraries of addresses ended the command with a traceback."""
    fsspec = pytest.importorskip("fsspec")

    class Site(fsspec.AbstractFileSystem):  # type: ignore[misc]
        protocol = "site"

        def info(self, path: str, **_: object) -> dict[str, object]:
            if "closed" in path:
                raise RuntimeError("403 Forbidden")  # no OSError, as those of aiohttp and botocore
            if "none" in path:
                raise FileNotFoundError(path)
            return {"name": path, "type": "file", "size": None}

    fsspec.register_implementation("site", Site, clobber=True)
    with pytest.raises(DeviceNotFound) as caught:
        find_flights([f"site://host/{name}"])
    assert f"site://host/{name}: " in str(caught.value)
    assert text in str(caught.value)
    if name == "closed.mcap":
        task = FlightTask(flight_at("site://host/closed.mcap"), str(tmp_path), BatchOptions(), software())
        failed = run_task(task)
        assert isinstance(failed, Failure)
        assert text in failed.text


def flight_at(location: str) -> Flight:
    return Flight("alpha", "unknown", "closed", (StoredFile(location, 1),))


def test_a_vehicle_s_name_is_safe_as_a_folder(tmp_path: Path) -> None:
    touch(tmp_path, "one.mcap")
    (flight,) = find_flights([str(tmp_path)], vehicle="../a b=c/d")
    assert flight.partition == "vehicle=_a_b_c_d/date=unknown"


def test_a_recovered_log_takes_the_place_of_its_damaged_original(tmp_path: Path) -> None:
    """`companion recover` writes it beside the original: each frame would be counted twice."""
    touch(tmp_path, "a/20261101-100000.000.idle.mcap", "a/20261101-100000.001.mcap", "a/hover.mcap")
    touch(tmp_path, "a/20261101-100000.000.idle.recovered.mcap", "a/hover.recovered.mcap")
    touch(tmp_path, "a/20261101-110000.000.recovered.mcap")
    found = {f.name: [file.name for file in f.files] for f in find_flights([str(tmp_path)])}
    assert found == {
        "20261101-100000": ["20261101-100000.000.idle.recovered.mcap", "20261101-100000.001.mcap"],
        "20261101-110000": ["20261101-110000.000.recovered.mcap"],
        "hover": ["hover.recovered.mcap"],
    }


def test_a_log_recovered_from_the_original_of_a_repair_takes_its_place(tmp_path: Path) -> None:
    """Each frame would be counted twice."""
    kept = tmp_path / "20261101-100000.000.mcap.damaged"
    touch(tmp_path, "20261101-100000.000.mcap", kept.name, default_output(kept).name)
    (flight,) = find_flights([str(tmp_path)])
    assert [file.name for file in flight.files] == ["20261101-100000.000.recovered.mcap"]


def test_missing_files_of_a_flight_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those before the first one may have been deleted for the budget."""
    touch(tmp_path, *(f"a/20261101-100000.{part:03d}.mcap" for part in (2, 3, 6, 8)))
    (flight,) = find_flights([str(tmp_path)])
    assert flight.missing_parts == (4, 5, 7)
    assert main(["batch", "-o", str(tmp_path / "out"), str(tmp_path / "a")]) == 1
    assert "warning: a/20261101-100000: part 4, 5, 7 is missing" in capsys.readouterr().err
