"""Attitude and position from a PX4 log (.ulg), read by pyulog (extra `recordings`).

Stamps count from the start of the autopilot; where the log has a GPS time they are mapped to unix time."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..base import BadData, DeviceNotFound
from ..library_output import collected_output
from ..optional_library import optional_module
from ..regular_file import regular
from .tlog import TlogAttitude, TlogPose, VehicleLog

ATTITUDE: Final = "vehicle_attitude"
POSITION: Final = "vehicle_local_position"
GPS: Final = ("vehicle_gps_position", "sensor_gps")
NO_RATES: Final = (math.nan, math.nan, math.nan)
_PARSE_ERRORS: Final = (struct.error, ValueError, TypeError, LookupError, AttributeError, OverflowError, OSError)
"""The last two: a place outside of the file."""


def read_ulog(path: Path) -> VehicleLog:
    """Reads a PX4 log. Raises DeviceNotFound (no file, pyulog missing) and BadData (not a PX4 log, no attitude in
    it)."""
    need = f"{path}: PX4 logs need pyulog", "pyulog>=1.1"
    pyulog, core = optional_module("pyulog", *need), optional_module("pyulog.core", *need)
    try:
        regular(path).open("rb").close()
    except OSError as error:
        raise DeviceNotFound(f"{path}: cannot be read ({error.strerror}); check the path") from error
    try:
        with collected_output():
            log = pyulog.ULog(str(path), [ATTITUDE, POSITION, *GPS])
        return _vehicle_log(path, log)
    except (core.ULogException, *_PARSE_ERRORS) as error:
        raise BadData(f"{path}: not a readable PX4 log ({error}); copy it again from the autopilot") from error


def _vehicle_log(path: Path, log: Any) -> VehicleLog:
    attitude = _first(log, ATTITUDE)
    if attitude is None or not len(attitude["timestamp"]):
        remedy = (
            "it is damaged: copy it again from the autopilot"
            if log.file_corruption
            else "set the PX4 parameter SDLOG_PROFILE to its default"
        )
        raise BadData(f"{path}: no {ATTITUDE} in it; {remedy}")
    offset_us = _unix_offset_us(log)
    return VehicleLog(
        system=1,
        kind=ATTITUDE,
        attitudes=_attitudes(attitude, offset_us or 0),
        poses=_poses(_first(log, POSITION), offset_us or 0),
        boots=1,
        drift=0.0,
        strange=0,
        unix=offset_us is not None,
        damaged=bool(log.file_corruption),
    )


def _first(log: Any, name: str) -> dict[str, NDArray[Any]] | None:
    """Returns the columns of the first instance of a topic; None: not in the log."""
    found = sorted((d for d in log.data_list if d.name == name), key=lambda d: int(d.multi_id))
    return found[0].data if found else None


def _unix_offset_us(log: Any) -> int | None:
    """Returns the median over all GPS times of unix time minus the autopilot's time; None without a GPS time."""
    for name in GPS:
        data = _first(log, name)
        if data is not None and "time_utc_usec" in data:
            known = data["time_utc_usec"] > 0
            if known.any():
                delays = data["time_utc_usec"][known].astype(np.int64) - data["timestamp"][known].astype(np.int64)
                return int(np.median(delays))
    return None


def _measured_us(data: dict[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Returns the times of measurement; the times of publication if the log has no others."""
    sample = data.get("timestamp_sample")
    published = data["timestamp"].astype(np.int64)
    return published if sample is None else np.where(sample > 0, sample.astype(np.int64), published)


def _attitudes(data: dict[str, NDArray[Any]], offset_us: int) -> list[TlogAttitude]:
    q = np.stack([data[f"q[{i}]"] for i in range(4)], axis=1).astype(float)
    stamps, measured = data["timestamp"].astype(np.int64) + offset_us, _measured_us(data) + offset_us
    return [
        TlogAttitude(float(t), int(stamp), (w, x, y, z), None, NO_RATES)
        for t, stamp, (w, x, y, z) in zip(measured.tolist(), stamps.tolist(), q.tolist(), strict=True)
    ]


def _poses(data: dict[str, NDArray[Any]] | None, offset_us: int) -> list[TlogPose]:
    """Returns the positions that the estimator marked as valid, by the flags of PX4's MAVLink stream and of the height."""
    if data is None:
        return []
    values = np.stack([data[name] for name in ("x", "y", "z", "vx", "vy", "vz")], axis=1).astype(float)
    stamps, measured = data["timestamp"].astype(np.int64) + offset_us, _measured_us(data) + offset_us
    valid = np.ones(len(stamps), bool)
    for name in ("xy_valid", "z_valid", "v_xy_valid"):
        if name in data:
            valid &= data[name].astype(bool)
    counters = np.zeros(len(stamps), np.int64)
    for name in ("xy_reset_counter", "z_reset_counter"):
        if name in data:
            counters = counters << 8 | data[name].astype(np.int64)
    return [
        TlogPose(float(measured[i]), int(stamps[i]), (x, y, z), (vx, vy, vz), int(counters[i]))
        for i, (x, y, z, vx, vy, vz) in enumerate(values.tolist())
        if valid[i]
    ]
