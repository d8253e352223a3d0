"""MAVLink telemetry logs (.tlog): 8 bytes of big-endian microseconds, then a raw MAVLink frame, repeated.

Such a file contains two clocks: the stamp of each record is the time when the recording host received the message
(unix time), and `time_boot_ms` in the message is the time when the autopilot measured. No message is recorded before
it was sent. The line under all points (time_boot, stamp), the lower envelope, is therefore the best estimate of one
clock on the other. `map_boot_clock` computes it for each boot of the autopilot."""

from __future__ import annotations

import re
import struct
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median_low
from typing import Any

from ..base import BadData, DeviceNotFound
from ..regular_file import regular
from .dialect import dialect
from .parser import MAVLINK1, MAVLINK2

_MARK = re.compile(b"[\xfd\xfe]")
MAX_DRIFT = 200e-6
"""Clocks differ by up to about 75 ppm: a greater fitted drift is noise, and the drift is then 0."""
DRIFT_SPAN_MS = 30_000
"""Over a shorter span a drift cannot be distinguished from the 1 ms resolution of time_boot_ms."""
TIMED = ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED")
_KEPT = ("HEARTBEAT", *TIMED)
"""Types of messages that are kept: a log of some hours has millions of others."""
STRANGE_US = 10_000_000
"""A record stamp that differs by more from the others of its boot is damaged; it has no checksum."""
BOOT_STEP_MS = 1_000
"""A decrease of time_boot by more is a reboot of the autopilot; a smaller one is a change of the order of messages."""


@dataclass(frozen=True, slots=True, eq=False)
class TlogRecord:
    """A valid message of pymavlink, its system id, and the time at which the recorder received it (unix microseconds)."""

    stamp_us: int
    system: int
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class Tlog:
    """A parsed log."""

    path: Path
    # the messages of autopilots (component 1) with a time, and their heartbeats, in file order
    records: list[TlogRecord]
    bad_frames: int  # number of frames with a wrong checksum
    skipped_bytes: int  # bytes of noise between frames
    truncated: bool  # the file ends within a record


@dataclass(frozen=True, slots=True)
class Timed:
    """Time of a measurement and of its recording, both unix microseconds on the recorder's clock."""

    t_us: float
    stamp_us: int


@dataclass(frozen=True, slots=True)
class TlogAttitude(Timed):
    """Attitude of the vehicle."""

    q_wxyz: tuple[float, float, float, float] | None  # q_ned_frd; None: the message contains euler_rad instead
    euler_rad: tuple[float, float, float] | None  # roll, pitch, yaw; None: the message contains q_wxyz instead
    rates_rad_s: tuple[float, float, float]  # body rates in frd


@dataclass(frozen=True, slots=True)
class TlogPose(Timed):
    """Position and velocity in ned, metres and m/s."""

    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    reset_counter: int = 0  # changes where the estimate jumps, if the log has it


@dataclass(frozen=True, slots=True, eq=False)
class VehicleLog:
    """Attitudes and poses of one vehicle's autopilot."""

    system: int  # system id
    kind: str  # name of the message of the attitudes
    attitudes: list[TlogAttitude]
    poses: list[TlogPose]
    boots: int  # number of starts of the autopilot
    drift: float  # greatest drift over all boots of its clock relative to the recorder's
    strange: int  # number of messages left out because their record stamp is damaged
    unix: bool = True  # stamps are unix time; otherwise they count from the autopilot's start
    damaged: bool = False  # a part of the file could not be read


def read_tlog(path: Path) -> Tlog:
    """Reads a log. Noise, wrong checksums and a truncated end are counted.

    Raises DeviceNotFound if there is no such file and BadData if it contains no MAVLink message."""
    try:
        data = regular(path).read_bytes()
    except OSError as error:
        raise DeviceNotFound(f"{path}: cannot be read ({error.strerror}); check the path") from error
    decoder = dialect.MAVLink(None)
    records: list[TlogRecord] = []
    messages = bad = skipped = at = 0
    truncated = False
    while at < len(data):
        end = _record_end(data, at)
        if end is not None and end <= len(data):
            message = _decode(decoder, data[at + 8 : end])
            is_known = message is not None and not message.get_type().startswith("UNKNOWN_")
            if is_known:
                messages += 1
                if message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1 and message.get_type() in _KEPT:
                    stamp = int(struct.unpack_from(">Q", data, at)[0])
                    records.append(TlogRecord(stamp, message.get_srcSystem(), message))
            # the checksum of an unknown message cannot be computed: what follows it shows that it is one
            if is_known or _starts_record(data, end):
                bad += message is None
                at = end
                continue
        truncated = len(data) - at < 11 if end is None else end > len(data) and not _more(data, at + 1)
        if truncated:
            break
        step = _next_start(data, at + 1)
        skipped += step - at
        at = step
    if not messages:
        raise BadData(
            f"{path}: no MAVLink message in it; expected a .tlog (8 bytes of time, a MAVLink frame, repeated)"
        )
    return Tlog(path, records, bad, skipped, truncated)


def _record_end(data: bytes, at: int) -> int | None:
    """Returns the end of a record that starts at `at`; None if no frame follows its stamp."""
    frame = at + 8
    if frame + 3 > len(data):
        return None
    if data[frame] == MAVLINK2:
        return frame + 12 + data[frame + 1] + (13 if data[frame + 2] & 1 else 0)
    if data[frame] == MAVLINK1:
        return frame + 8 + data[frame + 1]
    return None


def _starts_record(data: bytes, at: int) -> bool:
    return at == len(data) or (at + 8 < len(data) and data[at + 8] in (MAVLINK1, MAVLINK2))


def _next_start(data: bytes, at: int) -> int:
    """Returns the next position at which a record may start, or the end of the data."""
    mark = _MARK.search(data, at + 8)
    return mark.start() - 8 if mark is not None else len(data)


def _more(data: bytes, at: int) -> bool:
    """True if a whole record may still start at or after `at`. A damaged length byte must not end the reading."""
    while at < len(data):
        at = _next_start(data, at)
        end = _record_end(data, at)
        if end is not None and end <= len(data):
            return True
        at += 1
    return False


def _decode(decoder: Any, frame: bytes) -> Any:
    """Returns pymavlink's message; None if its checksum or length is wrong."""
    try:
        return decoder.decode(bytearray(frame))
    except (dialect.MAVError, struct.error):
        return None


def vehicle_log(log: Tlog, system: int | None = None) -> VehicleLog:
    """Returns attitudes and poses of the autopilot (component 1) of one vehicle, on the recorder's clock.

    ATTITUDE_QUATERNION is preferred if it comes at least half as often as ATTITUDE. Messages of other components
    (gimbals, cameras, ground stations) never count. Raises BadData if there is no attitude or if there are several
    vehicles."""
    system = _vehicle(log, system)
    timed = [r for r in log.records if r.system == system and r.message.get_type() in TIMED]
    counts = Counter(r.message.get_type() for r in timed)
    kind = "ATTITUDE_QUATERNION" if 2 * counts["ATTITUDE_QUATERNION"] > counts["ATTITUDE"] else "ATTITUDE"
    if not counts[kind]:
        raise BadData(f"{log.path}: system {system} sent no attitude; record ATTITUDE or ATTITUDE_QUATERNION")
    attitudes: list[TlogAttitude] = []
    poses: list[TlogPose] = []
    boots = _boots(timed)
    drift, strange = 0.0, 0
    for records in boots:
        clock = map_boot_clock([(int(r.message.time_boot_ms), r.stamp_us) for r in records])
        drift = max(drift, clock[0], key=abs)
        good = [r for r in records if abs(r.stamp_us - _boot_us(r, clock)) <= STRANGE_US]
        strange += len(records) - len(good)
        attitudes.extend(_attitude(r, clock) for r in good if r.message.get_type() == kind)
        poses.extend(_pose(r, clock) for r in good if r.message.get_type() == "LOCAL_POSITION_NED")
    return VehicleLog(system, kind, attitudes, poses, len(boots), drift, strange)


def _vehicle(log: Tlog, system: int | None) -> int:
    autopilots = {
        r.system
        for r in log.records
        if r.message.get_type() == "HEARTBEAT" and r.message.autopilot != dialect.MAV_AUTOPILOT_INVALID
    }
    # a log cut out of the middle may hold no heartbeat: a sender of attitudes with component 1 is an autopilot too
    found = autopilots or {r.system for r in log.records if r.message.get_type().startswith("ATTITUDE")}
    if system is not None and system in found:
        return system
    names = ", ".join(str(s) for s in sorted(found)) or "none"
    if system is not None:
        raise BadData(f"{log.path}: no autopilot with system id {system}; found: {names}")
    if len(found) != 1:
        raise BadData(f"{log.path}: expected one vehicle, found system ids: {names}; choose with --system-id")
    return found.pop()


def _boots(records: list[TlogRecord]) -> list[list[TlogRecord]]:
    """Returns the records of each boot of the autopilot, in order."""
    boots: list[list[TlogRecord]] = []
    for r in records:
        if not boots or r.message.time_boot_ms < boots[-1][-1].message.time_boot_ms - BOOT_STEP_MS:
            boots.append([])
        boots[-1].append(r)
    return boots


def map_boot_clock(points: list[tuple[int, int]]) -> tuple[float, float]:
    """Returns (drift, offset_us) with stamp_us = time_boot_ms * 1000 * (1 + drift) + offset_us.

    The line lies below all points and has the least sum of distances to them: it is an edge of their lower convex
    hull."""
    delays: dict[int, int] = {}
    usual = median_low(stamp - boot_ms * 1000 for boot_ms, stamp in points)
    for boot_ms, stamp in points:
        delay = stamp - boot_ms * 1000
        if abs(delay - usual) > STRANGE_US:
            continue
        delays[boot_ms] = min(delay, delays.get(boot_ms, delay))
    flat = 0.0, float(min(delays.values()))
    if max(delays) - min(delays) < DRIFT_SPAN_MS:
        return flat
    hull: list[tuple[int, int]] = []
    for point in sorted(delays.items()):
        while len(hull) >= 2 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    mean = sum(delays) / len(delays)
    for (x0, d0), (x1, d1) in pairwise(hull):
        if x0 <= mean <= x1:
            drift = (d1 - d0) / ((x1 - x0) * 1000.0)
            if abs(drift) <= MAX_DRIFT:
                return drift, d0 - drift * x0 * 1000.0
    return flat


def _turns_right(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    """True if b does not lie below the chord from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0


def _boot_us(r: TlogRecord, clock: tuple[float, float]) -> float:
    return int(r.message.time_boot_ms) * 1000.0 * (1.0 + clock[0]) + clock[1]


def _measured_us(r: TlogRecord, clock: tuple[float, float]) -> float:
    """Returns the time of measurement, at most that of recording: the line is a fit, and no message arrives before it
    is measured."""
    return min(_boot_us(r, clock), float(r.stamp_us))


def _attitude(r: TlogRecord, clock: tuple[float, float]) -> TlogAttitude:
    m = r.message
    t_us = _measured_us(r, clock)
    rates = (float(m.rollspeed), float(m.pitchspeed), float(m.yawspeed))
    if m.get_type() == "ATTITUDE":
        return TlogAttitude(t_us, r.stamp_us, None, (float(m.roll), float(m.pitch), float(m.yaw)), rates)
    return TlogAttitude(t_us, r.stamp_us, (float(m.q1), float(m.q2), float(m.q3), float(m.q4)), None, rates)


def _pose(r: TlogRecord, clock: tuple[float, float]) -> TlogPose:
    m = r.message
    position = (float(m.x), float(m.y), float(m.z))
    return TlogPose(_measured_us(r, clock), r.stamp_us, position, (float(m.vx), float(m.vy), float(m.vz)))
