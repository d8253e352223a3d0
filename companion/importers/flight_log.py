"""Attitude and position from the log of a flight (.tlog, PX4 .ulg, ArduPilot .bin) on the clock of the frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from core.frames import quaternion_from_euler
from core.types import MAX_SPEED_M_S, AttitudeSample, PoseSample
from drivers.base import BadData
from drivers.mavlink.dataflash import read_dataflash
from drivers.mavlink.motion import MAX_ANGLE_RAD, measured_rates, within
from drivers.mavlink.tlog import Timed, Tlog, TlogAttitude, TlogPose, VehicleLog, read_tlog, vehicle_log
from drivers.mavlink.ulog import read_ulog

from .clock_match import TiltRow, match_tilt
from .report import ImportOptions, Report

FLIGHT_LOGS = (".tlog", ".ulg", ".bin")
"""Suffixes of logs without images: of MAVLink, PX4 and ArduPilot."""
AROUND_US = 1_000_000
"""Samples this long before the first and after the last frame are kept."""
MAX_DELAY_US = 60_000_000
"""An arrival farther than this from the time of the sample is damaged."""


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

    def is_near(sample: Timed) -> bool:
        return first - AROUND_US <= sample.t_us <= last + AROUND_US

    near, positions = list(filter(is_near, vehicle.attitudes)), list(filter(is_near, vehicle.poses))
    if damaged := sum(not _has_arrival(sample) for sample in (*near, *positions)):
        report.note(
            f"{path.name}: {damaged} samples whose arrival is far from their time were left out; the log is damaged"
        )
    near, positions = list(filter(_has_arrival, near)), list(filter(_has_arrival, positions))
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
    poses = [pose for p in positions if (pose := _pose(p, epoch_us)) is not None]
    if not poses:
        report.warning("position", f"{path}: no position at the time of the frames: results are not placed in ned")
    return attitudes, poses


def _has_arrival(sample: Timed) -> bool:
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
    return AttitudeSample(*stamps, (w, x, y, z), measured_rates(a.rates_rad_s))


def _pose(p: TlogPose, epoch_us: int) -> PoseSample | None:
    """The sample; None for a position that is none."""
    position_m = within(p.position_m, math.inf)
    if position_m is None:
        return None
    velocity_m_s = within(p.velocity_m_s, MAX_SPEED_M_S)
    return PoseSample(*_stamps(p.t_us, p.stamp_us, epoch_us), position_m, velocity_m_s, p.reset_counter)


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


def seconds(t_us: float) -> str:
    """Microseconds as seconds with three decimals."""
    return f"{t_us / 1e6:.3f}"
