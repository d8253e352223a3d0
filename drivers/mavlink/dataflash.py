"""Attitude and position from an ArduPilot log (.bin), read by pymavlink's DFReader.

Stamps (`TimeUS`) count from the start of the autopilot; where the log has a GPS time they are mapped to unix time."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import replace
from pathlib import Path
from statistics import median_low
from typing import Any, Final

from pymavlink import DFReader

from ..base import BadData, DeviceNotFound
from ..library_output import collected_output
from ..regular_file import regular
from .tlog import TlogAttitude, TlogPose, VehicleLog
from .ulog import NO_RATES

MAGIC: Final = b"\xa3\x95"
ATTITUDE: Final = "ATT"
POSITIONS: Final = ("XKF1", "NKF1")
"""Estimates of position and velocity of EKF3 and EKF2, of each core."""
PRIMARY: Final = {"XKF4": "XKF1", "NKF4": "NKF1"}
"""Messages whose field PI is the index of the core that the autopilot uses -> the message of its position."""
GPS_EPOCH_UNIX_S: Final = 315_964_800
LEAP_S: Final = 18
"""Leap seconds between GPS time and UTC since 2017."""
_WEEK_S: Final = 7 * 86_400


def read_dataflash(path: Path) -> VehicleLog:
    """Reads an ArduPilot log. Raises DeviceNotFound (no file) and BadData (not an ArduPilot log, no attitude in it)."""
    try:
        with regular(path).open("rb") as stream:
            head = stream.read(len(MAGIC))
    except OSError as error:
        raise DeviceNotFound(f"{path}: cannot be read ({error.strerror}); check the path") from error
    if head != MAGIC:
        raise BadData(f"{path}: not an ArduPilot log (.bin begins with a3 95); copy it again from the autopilot")
    try:
        with collected_output() as printed:
            log = _vehicle_log(path)
    except Exception as error:  # of a damaged file the library raises this class itself
        raise BadData(f"{path}: damaged ({error}); copy it again from the autopilot") from error
    damaged = bool(printed.getvalue())
    if not log.attitudes:
        remedy = (
            "it is damaged: copy it again from the autopilot"
            if damaged
            else "set the attitude bits of the ArduPilot parameter LOG_BITMASK"
        )
        raise BadData(f"{path}: no {ATTITUDE} in it; {remedy}")
    return replace(log, damaged=damaged)


def _vehicle_log(path: Path) -> VehicleLog:
    attitudes: list[tuple[int, TlogAttitude]] = []
    poses: dict[str, list[tuple[int, int, TlogPose]]] = {kind: [] for kind in POSITIONS}
    primaries: dict[str, list[tuple[int, int]]] = {kind: [] for kind in POSITIONS}
    offsets_us: list[int] = []
    for message in _messages(path):
        kind, t_us = message.get_type(), int(message.TimeUS)
        if kind == ATTITUDE:
            euler = math.radians(message.Roll), math.radians(message.Pitch), math.radians(message.Yaw)
            attitudes.append((t_us, TlogAttitude(float(t_us), t_us, None, euler, NO_RATES)))
        elif kind in PRIMARY and int(getattr(message, "PI", -1)) >= 0:
            primaries[PRIMARY[kind]].append((t_us, int(message.PI)))
        elif kind in poses:
            position = float(message.PN), float(message.PE), float(message.PD)
            velocity = float(message.VN), float(message.VE), float(message.VD)
            core = int(getattr(message, "C", 0))
            poses[kind].append((t_us, core, TlogPose(float(t_us), t_us, position, velocity)))
        elif kind == "GPS" and getattr(message, "GWk", 0) > 0:
            offsets_us.append(_unix_us(message) - t_us)
    shift_us = median_low(offsets_us) if offsets_us else 0
    kind = next((k for k in POSITIONS if poses[k]), POSITIONS[0])
    return VehicleLog(
        system=1,
        kind=ATTITUDE,
        attitudes=[TlogAttitude(t + shift_us, t + shift_us, None, a.euler_rad, a.rates_rad_s) for t, a in attitudes],
        poses=[
            replace(p, t_us=p.t_us + shift_us, stamp_us=p.stamp_us + shift_us)
            for p in _of_primary(poses[kind], primaries[kind])
        ],
        boots=1,
        drift=0.0,
        strange=0,
        unix=bool(offsets_us),
    )


def _of_primary(rows: list[tuple[int, int, TlogPose]], primaries: list[tuple[int, int]]) -> list[TlogPose]:
    """The rows (time, core, pose) of the core that the autopilot uses at the time; the first one where the log does not
    contain that. The position may jump from one core to the next: the reset counter counts the changes."""
    times = [t_us for t_us, _ in primaries]
    found: list[TlogPose] = []
    before, changes = None, 0
    for t_us, core, pose in rows:
        wanted = primaries[max(0, bisect_right(times, t_us) - 1)][1] if primaries else 0
        if core != wanted:
            continue
        changes += before is not None and core != before
        before = core
        found.append(replace(pose, reset_counter=changes % 256))
    return found


def _messages(path: Path) -> list[Any]:
    """Returns all messages of the kinds that are used."""
    log = DFReader.DFReader_binary(str(path), zero_time_base=True)
    try:
        found = []
        while (message := log.recv_match(type=[ATTITUDE, "GPS", *POSITIONS, *PRIMARY])) is not None:
            if hasattr(message, "TimeUS"):
                found.append(message)
        return found
    finally:
        log.close()


def _unix_us(gps: Any) -> int:
    """Returns the unix time in microseconds of a GPS message, which has week and milliseconds of the week."""
    return (GPS_EPOCH_UNIX_S + int(gps.GWk) * _WEEK_S - LEAP_S) * 1_000_000 + int(gps.GMS) * 1000
