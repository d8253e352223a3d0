"""Finds the offset between the clocks of the frames and of a flight log by roll and pitch, which both contain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import euler_from_rotation, rotation_from_quaternion
from drivers.mavlink.tlog import TlogAttitude, VehicleLog

GRID_US = 20_000
MATCH_RAD = math.radians(0.5)
"""Largest rms difference of roll and pitch between frames.csv and the log for matched clocks."""
UNIQUE_US = 150_000
"""Largest distance of other, nearly equal matches from the best one."""
MIN_ROWS = 10
LONGEST_US = 86_400_000_000
"""Samples this far from the middle of a log are not of the same flight: their time is damaged."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TiltRow:
    """Roll and pitch at a frame's t_ns."""

    t_ns: int
    roll_rad: float
    pitch_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class _Series:
    """Roll and pitch over time."""

    t_us: _Floats  # (N,) increasing
    tilt_rad: _Floats  # (N, 2) roll, pitch

    def rms_rad(self, other: _Series, offset_us: float) -> float:
        """Rms difference of `other` from this one, when this much is added to its times."""
        at = other.t_us + offset_us
        roll, pitch = (np.interp(at, self.t_us, self.tilt_rad[:, i]) - other.tilt_rad[:, i] for i in (0, 1))
        return float(np.sqrt(np.mean(roll**2 + pitch**2)))


def match_tilt(vehicle: VehicleLog, rows: Sequence[TiltRow]) -> tuple[int, float] | None:
    """(unix microseconds of t_ns 0, rms in rad) where roll and pitch of the rows agree with the log's; None when they
    agree nowhere or at several times. All rows must lie within the log."""
    if len(rows) < MIN_ROWS or not (known := _known_tilts(vehicle)):
        return None
    rows = rows[:: max(1, len(rows) // 200)]
    begin_us = known[0][0]
    log = _Series(np.array([k[0] for k in known]) - begin_us, np.array([k[1:] for k in known]))
    frames = _Series(np.array([r.t_ns for r in rows]) / 1000.0, np.array([(r.roll_rad, r.pitch_rad) for r in rows]))
    match = _only_match(log, frames)
    still = np.ptp(frames.tilt_rad, axis=0).max() < 4.0 * MATCH_RAD  # a camera at rest matches at any time
    return None if match is None or still else (round((begin_us + match[0]) / 1000.0) * 1000, match[1])


def _only_match(log: _Series, frames: _Series) -> tuple[float, float] | None:
    """(offset in microseconds, rms in rad) at which the frames agree with the log; None when they agree nowhere or at several
    offsets."""
    slack = GRID_US / 2  # the log may begin and end with exactly these frames
    offsets: _Floats = np.arange(-frames.t_us[0] - slack, log.t_us[-1] - frames.t_us[-1] + slack, GRID_US)
    if not len(offsets):
        return None
    errors = np.array([log.rms_rad(frames, offset) for offset in offsets])
    fine = offsets[int(np.argmin(errors))] + np.arange(-GRID_US, GRID_US + 1, 1000.0)
    fine_errors = np.array([log.rms_rad(frames, offset) for offset in fine])
    least, found = float(fine_errors.min()), float(fine[int(np.argmin(fine_errors))])
    alike = offsets[errors <= max(2.0 * least, least + 0.2 * MATCH_RAD)]
    if least > MATCH_RAD or (len(alike) and np.abs(alike - found).max() > UNIQUE_US):
        return None
    return found, least


def _known_tilts(vehicle: VehicleLog) -> list[tuple[float, float, float]]:
    """(microseconds, roll, pitch) of the log in order of time, of one flight."""
    samples = ((a.t_us, *_tilt(a)) for a in vehicle.attitudes)
    known = sorted(sample for sample in samples if all(map(math.isfinite, sample)))  # NaN would be the least error
    if not known:
        return []
    middle_us = known[len(known) // 2][0]
    # a damaged time may be in a far future
    return [sample for sample in known if abs(sample[0] - middle_us) <= LONGEST_US]


def _tilt(a: TlogAttitude) -> tuple[float, float]:
    if a.euler_rad is not None:
        return a.euler_rad[0], a.euler_rad[1]
    if a.q_wxyz is None or not any(a.q_wxyz):
        return math.nan, math.nan
    roll, pitch, _ = euler_from_rotation(rotation_from_quaternion(a.q_wxyz))
    return roll, pitch
