"""The autopilot's own log beside the frames: PX4 .ulg and ArduPilot .bin, read by pyulog and pymavlink."""

from __future__ import annotations

import contextlib
import json
import math
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.cli import main
from companion.importers.clock_match import TiltRow, match_tilt
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.base import DriverError, Event
from drivers.mavlink.dataflash import read_dataflash
from drivers.mavlink.ulog import read_ulog

from ..flight_logs import BOOT_US, write_dataflash, write_ulog
from ..recordings import EPOCH_US, events_of, tilt, write_folder, write_tlog
from ..ros2_recording import NS, START_NS, RosFlight

Write = Callable[..., Path]
KINDS = pytest.mark.parametrize(("write", "name"), [(write_ulog, "log.ulg"), (write_dataflash, "log.bin")])
NO_ANGLES = [f"depth/{i:06d}.png,{EPOCH_US * 1000 + i * 100_000_000}" for i in range(20)]


@pytest.fixture(autouse=True)
def _pyulog() -> None:
    pytest.importorskip("pyulog", reason="pyulog is not installed (extra recordings)")


def imported(source: Path, *arguments: str) -> tuple[int, list[Event]]:
    out = source.parent / "out.mcap"
    out.unlink(missing_ok=True)
    status = main(["import", str(source), "-o", str(out), *arguments])
    return status, list(events_of(out)) if out.exists() else []


@pytest.mark.parametrize("stamp", [0, 1 << 62])
def test_a_damaged_time_does_not_lengthen_the_search_for_the_clock(
    stamp: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The search went over the time up to the damaged one: a MemoryError."""
    folder = write_folder(tmp_path / "rec", 40)
    log = write_dataflash(folder / "log.bin", 12.0, start_s=-3.0, gps=False)
    status, expected = imported(folder)
    assert status == 0, capsys.readouterr().err
    begin = struct.pack("<BQ", 1, BOOT_US + 1_000_000)
    assert log.read_bytes().count(begin) == 1
    log.write_bytes(log.read_bytes().replace(begin, struct.pack("<BQ", 1, stamp)))
    status, events = imported(folder)
    assert status == 0, capsys.readouterr().err
    assert [e for e in events if isinstance(e, AttitudeSample)] == [
        e for e in expected if isinstance(e, AttitudeSample)
    ]  # the damaged one was long before the frames


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("stamp", [1 << 61, (1 << 63) - 1])
def test_a_damaged_arrival_costs_its_own_sample(
    number: int, stamp: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ended the import with `Value out of range`, or gave a log that no replay could read."""
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    log = write_ulog(folder / "log.ulg", 3.0)
    expected = [e for e in imported(folder)[1] if not isinstance(e, DepthFrame)]
    begin = struct.pack("<HQQ", number, BOOT_US + 1_000_000 + 2000, BOOT_US + 1_000_000)
    assert log.read_bytes().count(begin) == 1
    log.write_bytes(log.read_bytes().replace(begin, struct.pack("<HQQ", number, stamp, BOOT_US + 1_000_000)))
    status, events = imported(folder)
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "log.ulg: 1 samples whose arrival is far from their time were left out" in captured.out
    found = [e for e in events if not isinstance(e, DepthFrame)]
    assert len(found) == len(expected) - 1
    assert set(found) < set(expected)


@KINDS
def test_a_log_with_gps_time_needs_neither_angles_nor_an_epoch(
    write: Write, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    write(folder / name, 3.0)
    status, events = imported(folder)
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert f"attitude from {name}" in captured.out
    first_ns = min(e.t_exposure_ns for e in events if isinstance(e, DepthFrame))
    attitudes = {round((a.t_ns - first_ns) / 1e6): a for a in events if isinstance(a, AttitudeSample)}
    assert attitudes[1000].q_ned_frd_wxyz == pytest.approx(quaternion_from_euler(*tilt(1.0), 0.1), abs=1e-5)
    poses = [e for e in events if isinstance(e, PoseSample)]
    assert poses[1].position_ned_m == pytest.approx((1.0, 2.0, -3.0))
    assert poses[1].velocity_ned_m_s == pytest.approx((0.1, 0.2, 0.3))


def test_positions_of_px4_keep_their_validity_and_their_resets(tmp_path: Path) -> None:
    """EKF2 logs positions also while only the height is valid; its MAVLink stream leaves those out."""
    poses = read_ulog(write_ulog(tmp_path / "log.ulg", 3.0, reset_s=1.5, invalid_s=2.0)).poses
    assert len(poses) == 99  # from the second of 50 Hz to 2 s
    assert len({p.reset_counter for p in poses[:74]}) == len({p.reset_counter for p in poses[74:]}) == 1
    assert poses[73].reset_counter != poses[74].reset_counter
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    write_ulog(folder / "log.ulg", 3.0, reset_s=1.5)
    _, events = imported(folder)
    assert len({e.reset_counter for e in events if isinstance(e, PoseSample)}) == 2


@KINDS
def test_a_log_without_gps_time_is_matched_by_its_motion(
    write: Write, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 60)
    write(folder / name, 30.0, start_s=-10.0, gps=False)
    status, events = imported(folder)
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "t_ns 0 is at this log's 17.00" in captured.out
    assert len([e for e in events if isinstance(e, AttitudeSample)]) > 300


@pytest.mark.parametrize("q", [(math.nan,) * 4, (0.0,) * 4])
def test_an_attitude_without_a_value_does_not_decide_the_match(q: tuple[float, ...], tmp_path: Path) -> None:
    """One such attitude made the error of a wrong time NaN, which counted as the least."""
    vehicle = read_ulog(write_ulog(tmp_path / "log.ulg", 30.0, start_s=-10.0, gps=False))
    w, x, y, z = q
    attitudes = [replace(a, q_wxyz=(w, x, y, z)) if i == 5 else a for i, a in enumerate(vehicle.attitudes)]
    rows = [TiltRow(i * NS // 10, *tilt(i / 10)) for i in range(60)]
    found = match_tilt(replace(vehicle, attitudes=attitudes), rows)
    assert found is not None
    assert found[0] == 17_000_000
    assert found[1] < 1e-3
    assert match_tilt(replace(vehicle, attitudes=[replace(a, q_wxyz=(w, x, y, z)) for a in attitudes]), rows) is None


@KINDS
def test_small_stamps_of_both_clocks_are_not_taken_for_the_same_time(
    write: Write, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The autopilot's clock holds t_ns 8..10 s, but nothing says that it is the same clock."""
    rows = [f"depth/{i:06d}.png,{8 * NS + i * NS // 10}" for i in range(20)]
    folder = write_folder(tmp_path / "rec", 20, rows, heading="file,t_ns")
    write(folder / name, 15.0, gps=False)
    assert imported(folder)[0] == 1
    assert "give the time of t_ns 0 (since the start of the autopilot) with --tlog-epoch" in capsys.readouterr().err
    assert imported(folder, "--tlog-epoch", "0")[0] == 0


@KINDS
def test_a_file_that_is_none(write: Write, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 5)
    whole = write(folder / name, 1.0).read_bytes()
    (folder / name).write_bytes(b"hello" + whole)
    assert imported(folder)[0] == 1
    assert name in (output := capsys.readouterr().err)
    assert "copy it again" in output


DAMAGES = [
    (write_ulog, "log.ulg", b"vehicle_attitude:uint64_t timestamp;", b"vehicle_attitude:uint64_t timestamq;"),
    (write_ulog, "log.ulg", b"float[4] q;", b"float[4] r;"),
    (write_dataflash, "log.bin", b"QBffffff", b"QBffmfff"),
    (write_dataflash, "log.bin", b"TimeUS,Roll", b"TimeUS,Rool"),
]


@pytest.mark.parametrize(("write", "name", "before", "after"), DAMAGES)
def test_a_damaged_definition_is_an_error_with_a_remedy(
    write: Write, name: str, before: bytes, after: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 5)
    content = write(folder / name, 1.0).read_bytes()
    assert before in content
    (folder / name).write_bytes(content.replace(before, after))
    assert imported(folder, "--json")[0] == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert f"{name}: " in captured.err
    assert "copy it again from the autopilot" in captured.err


def test_messages_of_a_library_do_not_spoil_the_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    content = write_ulog(folder / "log.ulg", 3.0).read_bytes()
    (folder / "log.ulg").write_bytes(content + bytes(60))
    assert imported(folder, "--json")[0] == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert "log.ulg: damaged; the rest was read" in notes


def test_positions_are_those_of_the_core_that_the_autopilot_uses(tmp_path: Path) -> None:
    """XKF1 has a row for each core, XKF4 the index of the primary one. The position jumps where that changes."""
    path = write_dataflash(tmp_path / "log.bin", 2.0, hz=10.0, primary=lambda t_s: int(t_s >= 1.0))
    poses = read_dataflash(path).poses
    assert [(p.position_m[0], p.reset_counter) for p in poses] == [(1.0, 0)] * 10 + [(2.0, 1)] * 11


@pytest.mark.parametrize("primary", [None, lambda t_s: -1])
def test_without_the_index_of_the_core_the_first_one_is_taken(
    primary: Callable[[float], int] | None, tmp_path: Path
) -> None:
    poses = read_dataflash(write_dataflash(tmp_path / "log.bin", 1.0, hz=10.0, primary=primary)).poses
    assert [(p.position_m[0], p.reset_counter) for p in poses] == [(1.0, 0)] * 11


def test_a_log_without_positions_of_the_core_in_use_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    write_dataflash(folder / "log.bin", 3.0, primary=lambda t_s: 2)
    status, events = imported(folder)
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "no position at the time of the frames" in captured.out + captured.err
    assert not any(isinstance(e, PoseSample) for e in events)


@pytest.mark.parametrize(("write", "read"), [(write_ulog, read_ulog), (write_dataflash, read_dataflash)])
@given(data=st.data())
def test_a_log_with_any_damage_is_read_or_refused(
    write: Write, read: Callable[[Path], object], data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = write(tmp_path_factory.mktemp("logs") / "log", 0.2)
    content = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    length = data.draw(st.integers(0, 20))
    content[at : at + length] = data.draw(st.binary(max_size=20))
    path.write_bytes(content)
    with contextlib.suppress(DriverError):
        read(path)


def test_the_rate_of_a_telemetry_radio_is_named_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    write_ulog(folder / "log.ulg", 3.0, hz=2.0)
    assert imported(folder)[0] == 1
    output = capsys.readouterr().err
    assert "the attitude comes at 2.0 Hz: 4 of 20 frames can be used" in output
    assert ".bin" in output


def test_frames_without_angles_beside_a_tlog_are_right_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    write_tlog(folder / "a.tlog", 5.0)
    status, events = imported(folder)
    assert status == 0, capsys.readouterr().err
    assert len([e for e in events if isinstance(e, AttitudeSample)]) > 90


def test_without_angles_and_without_a_log_the_remedy_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 20, NO_ANGLES, heading="file,t_ns")
    assert imported(folder)[0] == 1
    assert ".tlog, .ulg, .bin" in capsys.readouterr().err


def test_a_ros_recording_without_attitude_takes_it_from_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shift_ns = EPOCH_US * 1000 - START_NS
    source = RosFlight(motion=(), stamp_offset_ns=shift_ns, log_offset_ns=shift_ns).write(tmp_path / "in.mcap")
    log = write_ulog(tmp_path / "log.ulg", 3.0)
    status, events = imported(source, "--attitude-log", str(log))
    assert status == 0, capsys.readouterr().err
    assert len([e for e in events if isinstance(e, DepthFrame)]) == 10
    assert len([e for e in events if isinstance(e, AttitudeSample)]) > 90
