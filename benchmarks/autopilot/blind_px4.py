"""How far PX4 flies on after the last exposure, and whether it then stands, by version, failsafe policy and stick.

    python -m benchmarks.autopilot.blind_px4

The camera covers 35 degrees on either side and has seen them clear. It then gives no more frames. Policies: `brake` and
`unknown` are the service's; `front` is a wall at CP_DIST + 5 cm in the camera's sectors alone, `near` one at 2.12 m, for
comparison.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from benchmarks.autopilot.px4_loop import NS, Px4Loop, Values, stick_at
from benchmarks.autopilot.px4_position_mode import position_mode
from companion.autopilot.failsafe import AutopilotNow, BlindPolicy, Policy, PolicyInput, policy_of
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm
from companion.autopilot.obstacle_memory import nothing_remembered
from companion.autopilot.polar_histogram import SECTORS, scan
from companion.config.avoidance import AvoidParams

AVOID = AvoidParams(max_distance_m=12.0)
CP_DIST_M = 3.0
VERSIONS = ((1, 15), (1, 16))
POLICIES = ("brake", "unknown", "front", "near")
NOTICED_S = 0.3
"""`[service] timeout_s`: after the last exposure the service sends the last observation for this time."""
SECTOR = np.arange(SECTORS)
COVERED = np.minimum(SECTOR, SECTORS - SECTOR) <= 7


@dataclass(frozen=True, slots=True)
class Stop:
    """distance_m: between the last exposure and 12 s later, in a straight line; end_m_s: speed then; greatest_m_s: speed
    at any time later than 4 s after the last exposure."""

    start_m_s: float
    distance_m: float
    end_m_s: float
    greatest_m_s: float


def clear() -> Values:
    """The camera's sectors clear, the others unknown."""
    return np.where(COVERED, clear_cm(AVOID), UNKNOWN).astype(np.uint16)


class Sender:
    """What is sent after the last exposure at seen_ns."""

    def __init__(self, name: str, seen_ns: int) -> None:
        self._name, self._seen_ns, self._policy = name, seen_ns, BlindPolicy(AVOID)
        nowhere = np.zeros(SECTORS, bool)
        self._sight = PolicyInput(scan([], AVOID), nothing_remembered(), COVERED, nowhere, nowhere, seen_ns)

    def __call__(self, now_ns: int) -> Values | None:
        if now_ns - self._seen_ns < NOTICED_S * NS:
            return clear()
        if self._name in ("front", "near"):
            return np.where(COVERED, 305 if self._name == "front" else 212, UNKNOWN).astype(np.uint16)
        known = policy_of(AVOID, AutopilotNow(kind="PX4", cp_dist_m=CP_DIST_M))
        return self._policy.values(self._sight, known if self._name == "brake" else Policy("unknown"), now_ns)


def stopped(version: tuple[int, int], policy: str, deflection: float, angle_deg: float) -> Stop:
    """One flight: 12 s with a clear view, then 12 s blind, with the stick held."""
    loop = Px4Loop(position_mode(version, CP_DIST_M), AVOID)
    stick = stick_at(deflection, angle_deg)
    loop.fly(12.0, stick, lambda now_ns: clear())
    begin_m, start_m_s = loop.vehicle.position_m.copy(), float(np.hypot(*loop.vehicle.velocity_m_s))
    send, speeds = Sender(policy, loop.now_ns), []
    for _ in range(12):
        loop.fly(1.0, stick, send)
        speeds.append(float(np.hypot(*loop.vehicle.velocity_m_s)))
    distance_m = float(np.hypot(*(loop.vehicle.position_m - begin_m)))
    return Stop(start_m_s, distance_m, speeds[-1], max(speeds[4:]))


def main() -> None:
    """Prints the matrix as a table."""
    print("| version | policy | stick | angle | speed m/s | distance m | greatest speed later m/s |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for version, policy, deflection in itertools.product(VERSIONS, POLICIES, (1.0, 0.4, 0.1)):
        for angle_deg in (0.0, 20.0, 30.0, -30.0):
            s = stopped(version, policy, deflection, angle_deg)
            print(
                f"| {version[0]}.{version[1]} | {policy} | {deflection:g} | {angle_deg:g} | {s.start_m_s:.2f} | "
                f"{s.distance_m:.2f} | {s.greatest_m_s:.2f} |"
            )


if __name__ == "__main__":
    main()
