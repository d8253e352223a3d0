"""Attitude and position from the log of a flight (.tlog, PX4 .ulg, ArduPilot .bin) on the clock of the frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.frames import euler_from_rotation, quaternion_from_euler, rotation_from_quaternion
from core.types import MAX_RATE_RAD_S, MAX_SPEED_M_S, AttitudeSample, PoseSample
from drivers.base import BadData
from drivers.mavlink.dataflash import read_dataflash
from drivers.mavlink.motion import MAX_ANGLE_RAD, within
from drivers.mavlink.tlog import Tlog, TlogAttitude, TlogPose, VehicleLog, read_tlog, vehicle_log
from drivers.mavlink.ulog import read_ulog

from .report import ImportOptions, Report

FLIGHT_LOGS = (".tlog", ".ulg", ".bin")
"""Suffixes of logs without images: of MAVLink, PX4 and ArduPilot."""
AROUND_US = 1_000_000
"""Samples this long before the first and after the last frame are kept."""
MAX_DELAY_US = 60_000_000
"""An arrival farther than this from the time of the sample is damaged."""
GRID_US = 20_000
MATCH_RAD = math.radians(0.5)
"""Largest rms difference of roll and pitch between frames.csv and the log for matched clocks."""
UNIQUE_US = 150_000
"""Largest distance of other, nearly equal matches from the best one."""
MIN_ROWS = 10
LONGEST_US = 86_400_000_000
"""Samples this far from the middle of a log are not of the same flight: their time is damaged."""


@dataclass(frozen=True, slots=True)
class TiltRow:
    """Roll and pitch at a frame's t_ns."""

    t_ns: int
    roll_rad: float
    pitch_rad: float


def find_flight_log(folder: Path, options: ImportOptions) -> Path | None:
    """The log to take the attitude from: the given one, or the only one in the folder. Raises BadData for several."""
    if options.tlog is not None or not options.use_tlog:
        return options.tlog
    found = sorted(f for f in folder.iterdir() if f.suffix.lower() in FLIGHT_LOGS)
    if len(found) > 1:
        names = ", ".join(f.name for f in found)
        raise BadData(f"{folder}: several logs ({names}); choose one with --tlog FILE or use none with --no-tlog")
    return found[0] if found else None


def read_flight_log(path: Path, options: ImportOptions, report: Report) -> VehicleLog:
    """The log, by its extension. Raises DriverError."""
    if path.suffix.lower() in (".ulg", ".bin"):
        vehicle = read_ulog(path) if path.suffix.lower() == ".ulg" else read_dataflash(path)
        clock = "" if vehicle.unix else ", without GPS time"
        report.note(f"attitude from {path.name}: {vehicle.kind}{clock}")
        if vehicle.damaged:
            report.note(f"{path.name}: damaged; the rest was read")
        return vehicle
    log = read_tlog(path)
    vehicle = vehicle_log(log, options.system_id)
    _report_log(path, vehicle, log, report)
    return vehicle


def flight_log_samples(
    path: Path, frames_ns: tuple[int, int], rows: Sequence[TiltRow], options: ImportOptions, report: Report
) -> tuple[list[AttitudeSample], list[PoseSample]]:
    """Samples around the frames (first and last t_ns) on the frames' clock.

    Raises BadData when the log has none, or when the offset of its clock cannot be determined."""
    vehicle = read_flight_log(path, options, report)
    epoch_us = options.tlog_epoch_us
    if epoch_us is None:
        epoch_us = _derived_epoch(path, vehicle, frames_ns, rows, report)
    first, last = (epoch_us + t // 1000 for t in frames_ns)

    def is_near(sample: TlogAttitude | TlogPose) -> bool:
        return first - AROUND_US <= sample.t_us <= last + AROUND_US

    samples: list[TlogAttitude | TlogPose] = [*vehicle.attitudes, *vehicle.poses]
    samples = list(filter(is_near, samples))
    if damaged := sum(not _has_arrival(sample) for sample in samples):
        report.note(
            f"{path.name}: {damaged} samples whose arrival is far from their time were left out; the log is damaged"
        )
    near = [a for a in vehicle.attitudes if is_near(a) and _has_arrival(a)]
    if not near:
        own = vehicle.attitudes[0].stamp_us, vehicle.attitudes[-1].stamp_us
        raise BadData(
            f"{path}: no attitude at the time of the frames: with t_ns 0 at {_unix(vehicle)}{seconds(epoch_us)} s they span "
            f"{seconds(first)}..{seconds(last)}, the log {seconds(own[0])}..{seconds(own[1])}; check --tlog-epoch"
        )
    attitudes = [s for a in near if (s := _attitude(a, epoch_us)) is not None]
    if len(attitudes) < len(near):
        report.problem(
            "attitude",
            f"{path}: {len(near) - len(attitudes)} attitudes are no attitudes of a vehicle and were left out",
        )
    poses = []
    for p in vehicle.poses:
        position_m = within(p.position_m, math.inf)
        if is_near(p) and _has_arrival(p) and position_m is not None:
            velocity_m_s = within(p.velocity_m_s, MAX_SPEED_M_S)
            poses.append(PoseSample(*_stamps(p.t_us, p.stamp_us, epoch_us), position_m, velocity_m_s, p.reset_counter))
    if not poses:
        report.warning("position", f"{path}: no position at the time of the frames: results are not placed in ned")
    return attitudes, poses


def _has_arrival(sample: TlogAttitude | TlogPose) -> bool:
    """Whether the arrival of a sample is near its time."""
    return abs(sample.stamp_us - sample.t_us) <= MAX_DELAY_US


def _report_log(path: Path, vehicle: VehicleLog, log: Tlog, report: Report) -> None:
    report.note(
        f"attitude from {path.name}: {vehicle.kind} of system {vehicle.system}, component 1"
        + (f", clock drift {vehicle.drift * 1e6:.0f} ppm" if vehicle.drift else "")
        + (f", {vehicle.boots} boots of the autopilot" if vehicle.boots > 1 else "")
    )
    counts = {
        "messages with a wrong checksum": log.bad_frames,
        "bytes of noise": log.skipped_bytes,
        "messages with a damaged timestamp": vehicle.strange,
    }
    damage = [f"{number} {what}" for what, number in counts.items() if number] + ["incomplete"] * log.truncated
    if damage:
        report.note(f"{path.name}: {', '.join(damage)}; the rest was read")


def _stamps(t_us: float, stamp_us: int, epoch_us: int) -> tuple[int, int]:
    t_ns, arrival_ns = round((t_us - epoch_us) * 1000.0), (stamp_us - epoch_us) * 1000
    return t_ns, max(t_ns, arrival_ns)


def _attitude(a: TlogAttitude, epoch_us: int) -> AttitudeSample | None:
    """The sample; None for an attitude that is none. The limits are those in flight."""
    if a.euler_rad is not None:
        q = None if within(a.euler_rad, MAX_ANGLE_RAD) is None else quaternion_from_euler(*a.euler_rad)
    else:
        q = a.q_wxyz
    norm = 0.0 if q is None else math.hypot(*q)
    if q is None or not 0.9 < norm < 1.1:
        return None
    w, x, y, z = (c / norm for c in q)
    stamps = _stamps(a.t_us, a.stamp_us, epoch_us)
    return AttitudeSample(*stamps, (w, x, y, z), within(a.rates_rad_s, MAX_RATE_RAD_S))


def _derived_epoch(
    path: Path, vehicle: VehicleLog, frames_ns: tuple[int, int], rows: Sequence[TiltRow], report: Report
) -> int:
    """Unix microseconds of t_ns 0 if only one value is plausible. Raises BadData otherwise."""
    own = vehicle.attitudes[0].t_us, vehicle.attitudes[-1].t_us
    # small stamps of both clocks may coincide by accident; unix times do not
    if vehicle.unix and own[0] - AROUND_US <= frames_ns[0] / 1000 and frames_ns[1] / 1000 <= own[1] + AROUND_US:
        report.note(f"t_ns of frames.csv are unix times within {path.name} and used as such (--tlog-epoch 0)")
        return 0
    match = match_tilt(vehicle, rows)
    if match is None:
        raise BadData(
            f"{path}: the offset between its clock and t_ns of frames.csv is unknown, and roll and pitch match at "
            f"several times or nowhere; give the time of t_ns 0 ({'unix time' if vehicle.unix else 'since the start of the autopilot'}) with --tlog-epoch SECONDS, or leave the log out "
            "with --no-tlog"
        )
    epoch_us, rms_rad = match
    report.note(
        f"t_ns 0 is at {_unix(vehicle)}{seconds(epoch_us)} s: the only time at which roll and pitch of frames.csv agree with "
        f"{path.name} (rms {math.degrees(rms_rad):.2f} deg); set explicitly with --tlog-epoch {seconds(epoch_us)}"
    )
    return epoch_us


def _unix(vehicle: VehicleLog) -> str:
    return "unix " if vehicle.unix else "this log's "


def match_tilt(vehicle: VehicleLog, rows: Sequence[TiltRow]) -> tuple[int, float] | None:
    """(unix microseconds of t_ns 0, rms in rad) where roll and pitch of the rows agree with the log's; None when they
    agree nowhere or at several times. All rows must lie within the log."""
    if len(rows) < MIN_ROWS:
        return None
    rows = rows[:: max(1, len(rows) // 200)]
    samples = ((a.t_us, *_tilt(a)) for a in vehicle.attitudes)
    known = sorted(sample for sample in samples if all(map(math.isfinite, sample)))  # NaN would be the least error
    if not known:
        return None
    middle_us = known[len(known) // 2][0]
    known = [
        sample for sample in known if abs(sample[0] - middle_us) <= LONGEST_US
    ]  # a damaged time may be in a far future
    start = known[0][0]
    log_us, tilt = np.array([k[0] for k in known]) - start, np.array([k[1:] for k in known])
    row_us = np.array([r.t_ns for r in rows]) / 1000.0
    wanted = np.array([(r.roll_rad, r.pitch_rad) for r in rows])

    def rms(offset_us: float) -> float:
        at = row_us + offset_us
        roll, pitch = (np.interp(at, log_us, tilt[:, i]) - wanted[:, i] for i in (0, 1))
        return float(np.sqrt(np.mean(roll**2 + pitch**2)))

    slack = GRID_US / 2  # the log may begin and end with exactly these frames
    offsets: NDArray[np.float64] = np.arange(-row_us[0] - slack, log_us[-1] - row_us[-1] + slack, GRID_US)
    if not len(offsets):
        return None
    errors = np.array([rms(o) for o in offsets])
    best = offsets[int(np.argmin(errors))]
    fine = best + np.arange(-GRID_US, GRID_US + 1, 1000.0)
    fine_errors = np.array([rms(o) for o in fine])
    least = float(fine_errors.min())
    found = float(fine[int(np.argmin(fine_errors))])
    alike = offsets[errors <= max(2.0 * least, least + 0.2 * MATCH_RAD)]
    if least > MATCH_RAD or (len(alike) and np.abs(alike - found).max() > UNIQUE_US):
        return None
    still = np.ptp(wanted, axis=0).max() < 4.0 * MATCH_RAD  # a camera at rest matches at any time
    return None if still else (round((start + found) / 1000.0) * 1000, least)


def _tilt(a: TlogAttitude) -> tuple[float, float]:
    if a.euler_rad is not None:
        return a.euler_rad[0], a.euler_rad[1]
    if a.q_wxyz is None or not any(a.q_wxyz):
        return math.nan, math.nan
    roll, pitch, _ = euler_from_rotation(rotation_from_quaternion(a.q_wxyz))
    return roll, pitch


def seconds(t_us: float) -> str:
    """Microseconds as seconds with three decimals."""
    return f"{t_us / 1e6:.3f}"
