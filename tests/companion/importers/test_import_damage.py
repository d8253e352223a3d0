"""`companion import` of directories with damaged flight logs, or times in the wrong unit."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.cli import main

from ..flight_logs import write_dataflash, write_ulog
from ..recordings import write_folder


def imported(folder: Path) -> int:
    return main(["import", str(folder), "-o", str(folder.parent / "out.mcap")])


def test_a_damaged_log_of_ardupilot_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The compiled part of the library reports damage on stderr only."""
    folder = write_folder(tmp_path / "rec", 20)
    log = write_dataflash(folder / "log.bin", 4.0)
    data = bytearray(log.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 200] = bytes(200)
    log.write_bytes(data)
    assert imported(folder) == 0
    captured = capfd.readouterr()
    assert "log.bin: damaged; the rest was read" in captured.out
    assert "bad header" not in captured.err


def test_a_place_outside_of_a_log_of_px4_is_damage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """pyulog seeks back by the length of a message, also of a damaged one: to a negative place."""
    pyulog = pytest.importorskip("pyulog", reason="pyulog is not installed (extra recordings)")

    def seek(path: str, *_: object) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(pyulog, "ULog", seek)
    folder = write_folder(tmp_path / "rec", 20)
    log = write_ulog(folder / "log.ulg", 4.0)
    assert imported(folder) == 1
    assert f"{log}: not a readable PX4 log" in capsys.readouterr().err


@pytest.mark.parametrize(("write", "name"), [(write_dataflash, "log.bin"), (write_ulog, "log.ulg")])
def test_a_log_that_has_lost_its_definitions_is_to_be_copied_again(
    write: Callable[..., Path], name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The remedy was to log the attitude, which the autopilot had done."""
    folder = write_folder(tmp_path / "rec", 20)
    log = write(folder / name, 4.0)
    data = bytearray(log.read_bytes())
    data[100:110] = bytes(10)
    log.write_bytes(data)
    assert imported(folder) == 1
    error = capfd.readouterr().err
    assert f"{log}: no " in error
    assert "it is damaged: copy it again from the autopilot" in error
    assert "parameter" not in error


@pytest.mark.parametrize("divisor", [1_000, 1_000_000])
def test_times_in_another_unit_than_nanoseconds_are_a_problem(
    divisor: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 20)
    table = folder / "frames.csv"
    head, *rows = table.read_text().splitlines()
    place = head.split(",").index("t_ns")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[place] = str(int(row[place]) // divisor)
    table.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    assert imported(folder) == 1
    assert "their times are probably in another unit than nanoseconds" in capsys.readouterr().err
