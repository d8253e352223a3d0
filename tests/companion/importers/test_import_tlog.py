"""A telemetry log beside the frames: matched in time by option or by common motion."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from companion.cli import main
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.mavlink.dialect import dialect

from ..recordings import EPOCH_US, events_of, row, tilt, write_folder, write_tlog

EPOCH = "1700000000"


def imported(folder: Path, *arguments: str) -> tuple[int, list[object]]:
    out = folder.parent / "out.mcap"
    out.unlink(missing_ok=True)
    status = main(["import", str(folder), "-o", str(out), *arguments])
    return status, list(events_of(out)) if out.exists() else []


def attitudes(events: list[object]) -> list[AttitudeSample]:
    return [e for e in events if isinstance(e, AttitudeSample)]


@pytest.mark.parametrize("rates", [(0.01, -0.02, 0.03), (0.0, 0.0, 0.0)])
def test_the_logs_attitude_is_used(
    rates: tuple[float, float, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rates of zero about all axes were not filled in, as in flight."""
    folder = write_folder(tmp_path / "rec", 40, [f"depth/{i:06d}.png,{i}00000000,9,9,9,1,2,3" for i in range(40)])
    write_tlog(folder / "a.tlog", 5.0, rates=rates)
    status, events = imported(folder, "--tlog-epoch", EPOCH)
    assert status == 0
    assert "attitude from a.tlog: ATTITUDE of system 1" in capsys.readouterr().out
    found = attitudes(events)
    at = next(a for a in found if abs(a.t_ns - 2_000_000_000) < 1_000_000)
    assert at.q_ned_frd_wxyz == pytest.approx(quaternion_from_euler(*tilt(2.0), 0.1), abs=1e-5)
    assert at.rates_frd_rad_s == (pytest.approx(rates) if any(rates) else None)
    # positions of frames.csv would be of another heading's ned
    assert not [e for e in events if isinstance(e, PoseSample)]
    assert len([e for e in events if isinstance(e, DepthFrame)]) == 40


def test_fractions_of_the_epoch_count_to_the_microsecond(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "rec", 40)
    write_tlog(folder / "a.tlog", 5.0, lag_us=0)
    _, events = imported(folder, "--tlog-epoch", "1700000000.123457")
    # samples before t_ns 0 are kept: a log cannot hold negative stamps, so everything moves by a whole second
    assert min(e.t_exposure_ns for e in events if isinstance(e, DepthFrame)) == 1_000_000_000
    stamps = [a.t_ns - 1_000_000_000 + 123_457_000 for a in attitudes(events)]
    assert stamps == [i * 20_000_000 for i in range(251)]


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 3e36, 7.0])
def test_values_that_no_vehicle_has_are_left_out(
    value: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in flight. An infinite angle ended the import with "math domain error"."""
    folder = write_folder(tmp_path / "rec", 30)
    log, sender = write_tlog(folder / "a.tlog", 3.0, lag_us=0), dialect.MAVLink(None, 1, 1)
    damaged = (
        dialect.MAVLink_attitude_message(10_020, value, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_attitude_message(10_040, 0.0, 0.0, 0.0, 0.0, 0.0, 100.0 * value),
        dialect.MAVLink_local_position_ned_message(10_060, 1.0, 2.0, 3.0, 100.0 * value, 0.0, 0.0),
    )
    with log.open("ab") as file:
        for k, message in enumerate(damaged, 1):
            file.write(struct.pack(">Q", EPOCH_US + 3_000_000 + 20_000 * k) + bytes(message.pack(sender)))
    status, events = imported(folder, "--tlog-epoch", EPOCH)
    assert status == 1
    assert "1 attitudes are no attitudes of a vehicle and were left out" in capsys.readouterr().err
    found = attitudes(events)
    assert len(found) == 151 + 1
    assert found[-1].rates_frd_rad_s is None
    assert [(e.position_ned_m, e.velocity_ned_m_s) for e in events if isinstance(e, PoseSample)] == [
        ((1.0, 2.0, 3.0), None)
    ]


def test_the_epoch_is_found_where_both_saw_the_same_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 60)
    write_tlog(folder / "a.tlog", 30.0, start_s=-10.0)
    status, events = imported(folder)
    output = capsys.readouterr().out
    assert status == 0
    assert "t_ns 0 is at unix 1700000000.000 s" in output or "t_ns 0 is at unix 1700000000.001 s" in output
    assert len(attitudes(events)) > 300


def test_unix_stamps_need_no_epoch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row(i).replace(f",{i}00000000,", f",{EPOCH_US * 1000 + i * 100_000_000},") for i in range(1, 20)]
    folder = write_folder(tmp_path / "rec", 20, rows)
    (folder / "depth" / "000000.png").unlink()
    write_tlog(folder / "a.tlog", 5.0)
    status, _ = imported(folder)
    assert status == 0
    assert "t_ns of frames.csv are unix times" in capsys.readouterr().out


def test_without_an_epoch_or_a_match_the_option_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    still = [f"depth/{i:06d}.png,{i}00000000,0.1,-0.2,0,,," for i in range(20)]
    folder = write_folder(tmp_path / "rec", 20, still)
    write_tlog(folder / "a.tlog", 30.0)
    status, events = imported(folder)
    output = capsys.readouterr().err
    assert status == 1
    assert "--tlog-epoch SECONDS" in output
    assert "--no-tlog" in output
    assert not events
    status, events = imported(folder, "--no-tlog")
    assert status == 0
    assert len(attitudes(events)) == 20


def test_a_motion_that_repeats_is_not_matched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same second of motion twice: two answers are none."""
    folder = write_folder(tmp_path / "rec", 12)
    once = write_tlog(tmp_path / "1", 3.0, boot_ms=1000).read_bytes()
    again = write_tlog(tmp_path / "2", 3.0, boot_ms=61_000, unix_us=EPOCH_US + 60_000_000).read_bytes()
    (folder / "a.tlog").write_bytes(once)
    assert imported(folder)[0] == 0
    (folder / "a.tlog").write_bytes(once + again)
    assert imported(folder)[0] == 1
    assert "match at several times or nowhere" in capsys.readouterr().err


def test_a_wrong_epoch_is_reported_with_both_spans(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 5)
    write_tlog(folder / "a.tlog", 5.0)
    assert imported(folder, "--tlog-epoch", "1600000000")[0] == 1
    output = capsys.readouterr().err
    assert "they span 1600000000.000..1600000000.400, the log 1700000000.000..1700000005.000" in output


def test_attitude_missing_for_part_of_the_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 40)
    write_tlog(folder / "a.tlog", 2.0)
    status, events = imported(folder, "--tlog-epoch", EPOCH)
    assert status == 1
    assert "no attitude near the frames of frames.csv line 23-41" in capsys.readouterr().err
    assert len([e for e in events if isinstance(e, DepthFrame)]) == 40


def test_several_logs_need_a_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 5)
    write_tlog(folder / "a.tlog", 2.0)
    write_tlog(folder / "b.tlog", 2.0)
    assert imported(folder, "--tlog-epoch", EPOCH)[0] == 1
    assert "a.tlog, b.tlog" in capsys.readouterr().err
    assert imported(folder, "--tlog-epoch", EPOCH, "--tlog", str(folder / "b.tlog"))[0] == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["--tlog-epoch", "noon"],
        ["--tlog-epoch", "1e400"],
        ["--tlog-epoch", "1e999999999"],
        ["--tlog", "x", "--no-tlog"],
        ["--mount", "1,2"],
    ],
)
def test_wrong_use(arguments: list[str], tmp_path: Path) -> None:
    assert main(["import", str(tmp_path), "-o", str(tmp_path / "o"), *arguments]) == 2


def test_a_real_log_beside_real_frames(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its attitude is that of frames.csv, interpolated: the two imports agree at every frame."""
    source = str(shared_data / "rs_d435_handheld")
    found = []
    for arguments in (["--no-tlog"], []):
        assert main(["import", source, "-o", str(tmp_path / "o.mcap"), "--replace", *arguments]) == 0
        found.append({a.t_ns: a.q_ned_frd_wxyz for a in attitudes(list(events_of(tmp_path / "o.mcap")))})
    rows, logged = found
    assert "t_ns 0 is at unix 1700000000.000 s" in capsys.readouterr().out
    shared = set(rows) & set(logged)
    assert len(shared) == 100
    for t in shared:
        assert rows[t] == pytest.approx(logged[t], abs=2e-6)
