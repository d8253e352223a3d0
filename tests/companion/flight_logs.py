"""Logs of autopilots written by the tests: PX4's ULog and ArduPilot's DataFlash, with the motion of recordings.py."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

from core.frames import quaternion_from_euler

from .recordings import EPOCH_US, tilt

BOOT_US = 7_000_000
"""The autopilot's clock when t is 0."""
GPS_EPOCH_UNIX_US = 315_964_800_000_000
WEEK_MS = 7 * 86_400_000


def _stamps(seconds: float, hz: float, start_s: float) -> list[float]:
    return [start_s + i / hz for i in range(int(seconds * hz) + 1)]


def write_ulog(
    path: Path,
    seconds: float,
    hz: float = 50.0,
    start_s: float = 0.0,
    gps: bool = True,
    reset_s: float = math.inf,
    invalid_s: float = math.inf,
) -> Path:
    """vehicle_attitude and vehicle_local_position; with sensor_gps that gives the unix time. From reset_s on the height has
    been reset, from invalid_s on the velocity is not valid."""
    formats = {
        "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
        "vehicle_local_position": (
            "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float vx;float vy;float vz;"
            "bool xy_valid;bool z_valid;bool v_xy_valid;uint8_t xy_reset_counter;uint8_t z_reset_counter;"
        ),
        "sensor_gps": "uint64_t timestamp;uint64_t time_utc_usec;",
    }
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))

    def message(kind: bytes, body: bytes) -> None:
        out.extend(struct.pack("<H", len(body)) + kind + body)

    message(b"B", bytes(40))
    for name, fields in formats.items():
        message(b"F", f"{name}:{fields}".encode())
    for number, name in enumerate(formats):
        message(b"A", struct.pack("<BH", 0, number) + name.encode())
    for t_s in _stamps(seconds, hz, start_s):
        t_us = BOOT_US + round((t_s - start_s) * 1e6)
        q = quaternion_from_euler(*tilt(t_s), 0.1)
        message(b"D", struct.pack("<HQQ4f", 0, t_us + 2000, t_us, *q))
        flags = t_s > start_s, True, t_s < invalid_s
        counters = 4, 7 + (t_s >= reset_s)
        numbers = (1.0, 2.0, -3.0, 0.1, 0.2, 0.3)
        position = struct.pack("<HQQ6f3?2B", 1, t_us + 2000, t_us, *numbers, *flags, *counters)
        message(b"D", position)
        if gps:
            message(b"D", struct.pack("<HQQ", 2, t_us, EPOCH_US + round(t_s * 1e6)))
    path.write_bytes(bytes(out))
    return path


def write_dataflash(
    path: Path,
    seconds: float,
    hz: float = 50.0,
    start_s: float = 0.0,
    gps: bool = True,
    primary: Callable[[float], int] | None = None,
) -> Path:
    """ATT (degrees) and XKF1 of two estimators; with GPS that contains the week and its milliseconds. primary: the core in use at a
    time, logged in XKF4; None: no XKF4."""
    formats = {
        0x80: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89),
        1: ("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", 3 + 20),
        2: ("XKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD", 3 + 33),
        3: ("GPS", "QBIH", "TimeUS,Status,GMS,GWk", 3 + 15),
        4: ("XKF4", "QBb", "TimeUS,C,PI", 3 + 10),
    }
    out = bytearray()

    def message(kind: int, body: bytes) -> None:
        out.extend(b"\xa3\x95" + bytes([kind]) + body)

    for kind, (name, layout, columns, length) in formats.items():
        message(0x80, struct.pack("<BB4s16s64s", kind, length, name.encode(), layout.encode(), columns.encode()))
    for t_s in _stamps(seconds, hz, start_s):
        t_us = BOOT_US + round((t_s - start_s) * 1e6)
        roll, pitch = (math.degrees(a) for a in tilt(t_s))
        if gps:
            gps_ms = (EPOCH_US + round(t_s * 1e6) - GPS_EPOCH_UNIX_US) // 1000 + 18_000
            message(3, struct.pack("<QBIH", t_us, 3, gps_ms % WEEK_MS, gps_ms // WEEK_MS))
        message(1, struct.pack("<Qfff", t_us, roll, pitch, math.degrees(0.1)))
        for core in (0, 1):
            message(2, struct.pack("<QBffffff", t_us, core, 0.1, 0.2, 0.3, 1.0 + core, 2.0, -3.0))
            if primary is not None:
                message(4, struct.pack("<QBb", t_us, core, primary(t_s)))
    path.write_bytes(bytes(out))
    return path
