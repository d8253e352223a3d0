"""MAVLink logs: framing under noise, whose attitude counts, and the mapping of the autopilot's clock."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import BadData, DeviceNotFound
from drivers.mavlink.dialect import dialect
from drivers.mavlink.tlog import map_boot_clock, read_tlog, vehicle_log

EPOCH_US = 1_700_000_000_000_000


def record(stamp_us: int, message: object, system: int = 1, component: int = 1) -> bytes:
    sender = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    return struct.pack(">Q", stamp_us) + bytes(message.pack(sender))


def heartbeat(autopilot: int = 12) -> object:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3)


def attitude(boot_ms: int, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> object:
    return dialect.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, 0.1, 0.2, 0.3)


def flight(count: int = 20, start_ms: int = 5000, step_ms: int = 20, lag_us: int = 700) -> list[bytes]:
    out = [record(EPOCH_US, heartbeat())]
    for i in range(count):
        boot = start_ms + step_ms * i
        out.append(record(EPOCH_US + boot * 1000 + lag_us + 37 * (i % 5), attitude(boot, pitch=0.01 * i)))
    return out


def written(path: Path, parts: list[bytes]) -> Path:
    path.write_bytes(b"".join(parts))
    return path


def test_reads_every_message(tmp_path: Path) -> None:
    log = read_tlog(written(tmp_path / "a.tlog", flight()))
    assert len(log.records) == 21
    assert (log.bad_frames, log.skipped_bytes, log.truncated) == (0, 0, False)
    vehicle = vehicle_log(log)
    assert vehicle.kind == "ATTITUDE"
    assert [round(a.euler_rad[1], 4) for a in vehicle.attitudes] == [round(0.01 * i, 4) for i in range(20)]
    assert vehicle.attitudes[0].rates_rad_s == pytest.approx((0.1, 0.2, 0.3))
    # measured on the recorder's clock: the least lag is taken for none
    assert vehicle.attitudes[1].t_us == EPOCH_US + 5020 * 1000 + 700
    assert vehicle.attitudes[1].stamp_us == EPOCH_US + 5020 * 1000 + 737


def test_messages_that_are_not_used_take_no_memory(tmp_path: Path) -> None:
    """A log of some hours has millions of them, of a kilobyte each."""
    other = record(EPOCH_US, dialect.MAVLink_statustext_message(6, b"EKF3 IMU0 is using GPS"))
    log = read_tlog(written(tmp_path / "a.tlog", [*flight(), *([other] * 50)]))
    assert len(log.records) == 21
    assert log.skipped_bytes == 0
    with pytest.raises(BadData, match="expected one vehicle, found system ids: none"):
        vehicle_log(read_tlog(written(tmp_path / "b.tlog", [other] * 50)))


@given(noise=st.binary(min_size=1, max_size=60), at=st.integers(0, 20))
def test_noise_between_records_costs_at_most_its_neighbour(
    noise: bytes, at: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    parts = flight()
    log = read_tlog(written(tmp_path_factory.mktemp("n") / "a.tlog", [*parts[:at], noise, *parts[at:]]))
    assert len(log.records) >= len(parts) - 1
    boots = [r.message.time_boot_ms for r in log.records if r.message.get_type() == "ATTITUDE"]
    assert boots == sorted(boots)


@given(cut=st.integers(30, 800))
def test_a_log_cut_anywhere_keeps_what_came_before(cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    parts = flight()
    whole = b"".join(parts)
    cut = min(cut, len(whole) - 1)
    ends = [sum(len(p) for p in parts[: i + 1]) for i in range(len(parts))]
    log = read_tlog(written(tmp_path_factory.mktemp("c") / "a.tlog", [whole[:cut]]))
    assert len(log.records) == sum(e <= cut for e in ends)
    assert log.truncated == (cut not in ends)


def test_wrong_checksum_is_counted_and_skipped(tmp_path: Path) -> None:
    parts = flight()
    broken = bytearray(parts[5])
    broken[8 + 10 + 6] ^= 0x55
    log = read_tlog(written(tmp_path / "a.tlog", [*parts[:5], bytes(broken), *parts[6:]]))
    assert log.bad_frames == 1
    assert len(log.records) == len(parts) - 1


def test_only_the_vehicles_own_autopilot_counts(tmp_path: Path) -> None:
    others = [
        record(EPOCH_US, heartbeat(autopilot=8), system=255, component=190),
        record(EPOCH_US + 1, attitude(5000, roll=1.0), component=154),
        record(EPOCH_US + 2, attitude(5000, roll=1.0), system=255, component=190),
    ]
    vehicle = vehicle_log(read_tlog(written(tmp_path / "a.tlog", [*others, *flight()])))
    assert vehicle.system == 1
    assert len(vehicle.attitudes) == 20
    assert all(a.euler_rad[0] == 0.0 for a in vehicle.attitudes)


def test_two_vehicles_need_a_choice(tmp_path: Path) -> None:
    second = [record(EPOCH_US, heartbeat(3), system=7), record(EPOCH_US + 9, attitude(1, roll=0.5), system=7)]
    log = read_tlog(written(tmp_path / "a.tlog", [*flight(), *second]))
    with pytest.raises(BadData, match="1, 7"):
        vehicle_log(log)
    assert len(vehicle_log(log, system=7).attitudes) == 1
    with pytest.raises(BadData, match="no autopilot with system id 9"):
        vehicle_log(log, system=9)


def test_quaternions_are_preferred(tmp_path: Path) -> None:
    parts = flight()
    for i in range(20):
        message = dialect.MAVLink_attitude_quaternion_message(5000 + 20 * i, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        parts.append(record(EPOCH_US + (5000 + 20 * i) * 1000 + 800, message))
    vehicle = vehicle_log(read_tlog(written(tmp_path / "a.tlog", parts)))
    assert vehicle.kind == "ATTITUDE_QUATERNION"
    assert vehicle.attitudes[0].q_wxyz == (1.0, 0.0, 0.0, 0.0)


def test_a_reboot_starts_the_mapping_over(tmp_path: Path) -> None:
    later = [record(EPOCH_US + 60_000_000 + b * 1000, attitude(b)) for b in range(100, 500, 20)]
    vehicle = vehicle_log(read_tlog(written(tmp_path / "a.tlog", [*flight(), *later])))
    assert vehicle.boots == 2
    assert vehicle.attitudes[-1].t_us == EPOCH_US + 60_480_000


@given(drift_ppm=st.integers(-80, 80), seed=st.integers(0, 5))
def test_the_lower_envelope_finds_offset_and_drift(drift_ppm: int, seed: int) -> None:
    points = []
    for i in range(3000):
        boot = 1_000_000 + 40 * i
        jitter = (i * 7919 + seed * 104729) % 5003  # up to 5 ms late, most of it by chance
        points.append((boot, round(boot * 1000 * (1 + drift_ppm * 1e-6)) + 123_456_789 + jitter))
    drift, offset = map_boot_clock(points)
    worst = max(
        abs(b * 1000 * (1 + drift) + offset - (b * 1000 * (1 + drift_ppm * 1e-6) + 123_456_789)) for b, _ in points
    )
    assert worst < 100  # microseconds


@pytest.mark.parametrize("stamp", [0, EPOCH_US - 3_600_000_000, EPOCH_US + 10**9, 2**64 - 1])
def test_a_damaged_record_stamp_moves_nothing(stamp: int, tmp_path: Path) -> None:
    parts = flight()
    whole = vehicle_log(read_tlog(written(tmp_path / "a.tlog", parts)))
    parts[7] = struct.pack(">Q", stamp) + parts[7][8:]
    vehicle = vehicle_log(read_tlog(written(tmp_path / "a.tlog", parts)))
    assert vehicle.strange == 1
    assert [a.t_us for a in vehicle.attitudes] == [a.t_us for i, a in enumerate(whole.attitudes) if i != 6]


def test_a_short_log_has_no_drift() -> None:
    assert map_boot_clock([(0, 1000), (20, 21_400), (40, 40_900)]) == (0.0, 900.0)


def test_no_mavlink_and_no_file_are_distinguished(tmp_path: Path) -> None:
    with pytest.raises(BadData, match="no MAVLink message"):
        read_tlog(written(tmp_path / "a.tlog", [b"\xfd" * 500]))
    with pytest.raises(DeviceNotFound, match="cannot be read"):
        read_tlog(tmp_path / "none.tlog")
    with pytest.raises(BadData, match="no attitude"):
        vehicle_log(read_tlog(written(tmp_path / "b.tlog", [record(EPOCH_US, heartbeat())])))


def test_recorded_logs(shared_data: Path) -> None:
    """Real and simulated autopilots: nothing lost, pitch and roll of a flight, the drift of a crystal."""
    counts = {}
    for name in ("arducopter462_sitl_50hz", "ardusub411_20hz_timesync", "sample_log_small_derived_100hz"):
        log = read_tlog(shared_data / "mavlink" / f"{name}.tlog")
        vehicle = vehicle_log(log)
        assert not log.truncated
        assert log.skipped_bytes == 0
        assert abs(vehicle.drift) < 1e-4
        assert all(a.stamp_us - a.t_us >= 0.0 for a in vehicle.attitudes)
        counts[name] = (len(vehicle.attitudes), vehicle.kind, log.bad_frames)
    assert counts["arducopter462_sitl_50hz"] == (8545, "ATTITUDE_QUATERNION", 0)
    assert counts["ardusub411_20hz_timesync"] == (5245, "ATTITUDE", 4)
    assert counts["sample_log_small_derived_100hz"] == (649, "ATTITUDE_QUATERNION", 0)


def test_quaternion_and_euler_of_one_flight_agree(shared_data: Path) -> None:
    log = read_tlog(shared_data / "mavlink" / "arducopter462_sitl_50hz.tlog")
    euler = {r.message.time_boot_ms: r.message for r in log.records if r.message.get_type() == "ATTITUDE"}
    worst = 0.0
    for r in log.records:
        if r.message.get_type() == "ATTITUDE_QUATERNION" and r.message.time_boot_ms in euler:
            m, e = r.message, euler[r.message.time_boot_ms]
            pitch = math.asin(2 * (m.q1 * m.q3 - m.q4 * m.q2))
            worst = max(worst, abs(pitch - e.pitch))
    assert worst < 1e-4
