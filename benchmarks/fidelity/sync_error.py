"""Measures the error of the attitude at an exposure: `python -m benchmarks.fidelity.sync_error`.

A vehicle turns at 60 degrees per second. Its autopilot sends MAVLink over a link that delays every message by
least_delay_s plus up to jitter_s, in each direction, and its clock has a drift of drift_ppm. The companion's session,
clock filter and synchroniser give the attitude of each exposure when its frame arrives; the truth is known. Time is
simulated: an hour of flight takes a minute."""

from __future__ import annotations

import argparse
import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.markdown import table
from companion.config.sync import SyncParams
from companion.pipeline.sync import AttitudeAt, Synchroniser
from core.frames import rotation_from_quaternion
from core.types import AttitudeSample
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import ARDUPILOT, PX4
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState, body_rates

NS, MS = 1_000_000_000, 1_000_000
WARM_S = 2.0
"""After the first heartbeat; then the clock is to be known."""
COLUMNS = (
    "autopilot",
    "jitter ms",
    "drift ppm",
    "frame latency ms",
    "clock error ms, median / p99",
    "attitude error deg, median / p99",
    "dropped",
    "clock known after s",
    "bound ms",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One flight. frame_latency_s: from exposure to the frame's arrival; 0 means that every attitude is extrapolated."""

    kind: str = PX4
    turn_deg_s: float = 60.0
    jitter_s: float = 0.005
    least_delay_s: float = 0.001
    drift_ppm: float = 50.0
    frame_hz: float = 30.0
    frame_latency_s: float = 0.0
    seconds: float = 60.0
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of the frames after the warm-up. clock_s: signed, of the stamps of received attitudes; angle_deg: of the
    attitude at exposure; dropped: frames without an attitude; bound_s: the filter's own bound at the end."""

    clock_s: NDArray[np.float64]
    angle_deg: NDArray[np.float64]
    dropped: int
    known_after_s: float
    bound_s: float


class Line:
    """One direction of the link: bytes arrive in order, each with its own delay."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self._case, self._rng, self._last_ns, self._count = case, rng, 0, 0
        self._waiting: list[tuple[int, int, bytes]] = []

    def send(self, data: bytes, now_ns: int) -> None:
        """Takes bytes in."""
        delay_s = self._case.least_delay_s + self._rng.uniform(0.0, self._case.jitter_s)
        self._last_ns = max(self._last_ns + 1, now_ns + round(delay_s * NS))
        self._count += 1
        heapq.heappush(self._waiting, (self._last_ns, self._count, data))

    def arrived(self, now_ns: int) -> list[tuple[bytes, int]]:
        """What has arrived, with the instants."""
        found = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            at_ns, _, data = heapq.heappop(self._waiting)
            found.append((data, at_ns))
        return found


def turning(case: Case, t_ns: int) -> VehicleState:
    """A steady turn, banked and pitched."""
    rate = math.radians(case.turn_deg_s)
    euler = (0.15, -0.1, rate * t_ns / NS)
    still = (0.0, 0.0, 0.0)
    return VehicleState(
        position_ned_m=(0.0, 0.0, -2.0),
        velocity_ned_m_s=still,
        euler_rad=euler,
        rates_frd_rad_s=body_rates(euler, (0.0, 0.0, rate)),
    )


def fly(case: Case) -> Errors:
    """Runs a case in steps of a millisecond of simulated time."""
    rng = np.random.Generator(np.random.PCG64(case.seed))
    drift = case.drift_ppm * 1e-6
    autopilot = SimulatedAutopilot(
        FirmwareProfile(kind=case.kind, drift=drift, boot_at_ns=-1000 * NS, motion=lambda t_ns: turning(case, t_ns))
    )
    session, sync = MavlinkSession(), Synchroniser(SyncParams())
    down, up = Line(case, rng), Line(case, rng)
    clock_s: list[float] = []
    angles: list[float] = []
    dropped, known_after_s = 0, math.inf
    frames = 1
    for step in range(round(case.seconds * 1000)):
        now_ns = step * MS + int(rng.integers(0, MS))
        for data, at_ns in up.arrived(now_ns):
            autopilot.receive(data, at_ns)
        for data in autopilot.due(now_ns):
            down.send(data, now_ns)
        for chunk in down.arrived(now_ns):
            for sample in session.receive([chunk]):
                if isinstance(sample, AttitudeSample):
                    sync.attitudes.add(sample)
                    if now_ns > WARM_S * NS:
                        clock_s.append((sample.t_ns - _measured_ns(case, sample)) / NS)
        for data in session.due(now_ns):
            up.send(data, now_ns)
        if session.clock.estimate.source is ClockSource.TIMESYNC:
            known_after_s = min(known_after_s, now_ns / NS)
        exposure_ns = round(frames * NS / case.frame_hz)
        if now_ns >= exposure_ns + case.frame_latency_s * NS:
            frames += 1
            if exposure_ns > WARM_S * NS:
                found = sync.attitude_at(exposure_ns)
                if isinstance(found, AttitudeAt):
                    angles.append(_angle_deg(found, turning(case, exposure_ns)))
                else:
                    dropped += 1
    bound_ns = session.clock.estimate.bound_ns
    return Errors(
        clock_s=np.array(clock_s),
        angle_deg=np.array(angles),
        dropped=dropped,
        known_after_s=known_after_s,
        bound_s=math.inf if bound_ns is None else bound_ns / NS,
    )


def _measured_ns(case: Case, sample: AttitudeSample) -> float:
    """The time at which the vehicle had the heading of a sample: the turn gives the time, up to whole turns."""
    R = rotation_from_quaternion(sample.q_ned_frd_wxyz)
    rate = math.radians(case.turn_deg_s)
    heading = math.atan2(R[1, 0], R[0, 0])
    turns = round((rate * sample.t_ns / NS - heading) / (2.0 * math.pi))
    return (heading + 2.0 * math.pi * turns) / rate * NS


def _angle_deg(found: AttitudeAt, truth: VehicleState) -> float:
    turn = rotation_from_quaternion(found.q_ned_frd_wxyz).T @ truth.R_ned_frd
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return math.degrees(math.atan2(float(np.linalg.norm(axis)), float(np.trace(turn)) - 1.0))


def row(case: Case) -> list[str]:
    """Flies a case; returns its row of the table."""
    e = fly(case)
    clock_ms = np.abs(e.clock_s) * 1000.0
    return [
        case.kind,
        f"{case.jitter_s * 1000:g}",
        f"{case.drift_ppm:g}",
        f"{case.frame_latency_s * 1000:g}",
        f"{np.median(clock_ms):.2f} / {np.percentile(clock_ms, 99):.2f}",
        f"{np.median(e.angle_deg):.3f} / {np.percentile(e.angle_deg, 99):.3f}",
        str(e.dropped),
        f"{e.known_after_s:.2f}",
        f"{e.bound_s * 1000:.2f}",
    ]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=100)
    args = parser.parse_args()
    common = {"seconds": args.seconds, "seed": args.seed}
    cases = [
        Case(kind=kind, jitter_s=jitter_s, frame_latency_s=latency_s, drift_ppm=drift, **common)
        for kind in (PX4, ARDUPILOT)
        for jitter_s, drift in ((0.0, 0.0), (0.005, 50.0), (0.005, -50.0), (0.02, 100.0))
        for latency_s in (0.0, 0.04)
    ]
    print(table(COLUMNS, map(row, cases)))


if __name__ == "__main__":
    main()
