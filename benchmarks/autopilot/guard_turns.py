"""The guard where the path bends to what was not seen: corners flown through, an obstacle behind the corner, other headings.

    python -m benchmarks.autopilot.guard_turns [flights] [--first N] [--width PX] [--yaw HEADING] [--speed-item] [--straight] [--clear]

Each flight has two legs with a turn of 40 to 120 degrees, flown through at the speed that the autopilot allows itself there, and a
wall, pole or tree on the second leg, 1.5 to 12 m behind the corner. Each number is flown with every heading of `Yaw`. With
--speed-item the mission sets 8 m/s at a random instant, also while the guard limits the speed. --straight: without the turn; --clear:
without the obstacle, to count needless stops; --no-guard: the autopilot alone.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.autopilot.auto_flight import Yaw
from benchmarks.autopilot.guard_loop import NS, GuardLoop
from benchmarks.autopilot.guard_missions import flight_of
from benchmarks.autopilot.guard_scenes import Mission, add_obstacle, clearance_m
from companion.config.guard import GuardParams
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info

LONGEST_S = 30.0
ACCEPTANCE_M = 2.0
"""NAV_ACC_RAD of a multicopter with PX4, WPNAV_RADIUS of ArduCopter."""
ITEM_M_S = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Result of one flight. behind_m: from the corner to the obstacle. clearance_m: least distance of the hull from a solid;
    hit_m_s: speed at a collision, 0: none; stood: the guard has stopped the vehicle."""

    number: int
    yaw: str
    autopilot: str
    speed_m_s: float
    turn_deg: float
    behind_m: float
    kind: str
    item_s: float | None
    clearance_m: float
    hit_m_s: float
    fastest_m_s: float
    stops: int
    stood: bool
    finished: bool
    texts: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Course:
    """What differs from the flights as described above."""

    item: bool = False
    straight: bool = False
    clear: bool = False


def turning_mission(number: int, course: Course) -> tuple[Mission, float, float]:
    """The mission of a number, always the same; the turn in degrees; from the corner to the obstacle, m."""
    rng = np.random.default_rng([27, number])
    turn = float(rng.choice([-1.0, 1.0]) * rng.uniform(math.radians(40.0), math.radians(120.0)))
    turn = 0.0 if course.straight else turn
    first = np.array([float(rng.uniform(10.0, 18.0)), 0.0])
    second = first + 18.0 * np.array([math.cos(turn), math.sin(turn)])
    height_m, behind_m = float(rng.uniform(1.8, 4.0)), float(rng.uniform(1.5, 12.0))
    b = SceneBuilder(f"turn {number}")
    b.ground()
    kind = str(rng.choice(["wall", "pole", "tree"]))
    if not course.clear:
        add_obstacle(b, kind, first, second, behind_m, float(rng.uniform(-0.3, 0.3)), height_m, rng)
    mission = Mission(
        number=number,
        scene=b.build(),
        waypoints_m=np.array([first, second]),
        height_m=height_m,
        speed_m_s=float(rng.uniform(1.0, 8.0)),
        autopilot=str(rng.choice(["PX4", "ArduPilot"])),
        guided=False,
        blocked=not course.clear,
        kinds=(kind,),
    )
    return mission, math.degrees(turn), behind_m


def fly_turn(number: int, yaw: Yaw, width: int, guard: GuardParams, course: Course) -> Turned:
    """One flight."""
    mission, turn_deg, behind_m = turning_mission(number, course)
    item_s = float(np.random.default_rng([28, number]).uniform(2.0, 12.0)) if course.item else None
    waits_s = item_s
    flight = flight_of(mission.autopilot, mission.waypoints_m, mission.height_m, mission.speed_m_s, guided=False)
    flight.yaw, flight.acceptance_m = yaw, ACCEPTANCE_M
    sensor = replace(TYPICAL.scaled_to(width), sky_is_far=True)
    loop = GuardLoop(
        mission.scene, camera_info(width, width * 3 // 4), sensor, flight, mission.autopilot, number, guard
    )
    loop.times_reactions = False
    least_m, hit_m_s, fastest_m_s, start_ns, stands_ns = math.inf, 0.0, 0.0, loop.now_ns, None
    while loop.now_ns - start_ns < LONGEST_S * NS and not flight.finished:
        loop.tick()
        if waits_s is not None and loop.now_ns - start_ns >= waits_s * NS:
            flight.mission_speed(ITEM_M_S)
            waits_s = None
        fastest_m_s = max(fastest_m_s, flight.speed_m_s)
        least_m = min(least_m, clearance_m(mission.scene, loop.place_m) - loop.avoid.radius_m)
        if least_m < 0.0:
            hit_m_s = flight.speed_m_s
            break
        stands = bool(loop.record.stops) and flight.speed_m_s < 0.05
        stands_ns = (stands_ns or loop.now_ns) if stands else None
        if stands_ns is not None and loop.now_ns - stands_ns > NS:
            break
    return Turned(
        number=number, yaw=str(yaw), autopilot=mission.autopilot, speed_m_s=mission.speed_m_s, turn_deg=turn_deg,
        behind_m=behind_m, kind=mission.kinds[0], item_s=item_s, clearance_m=least_m, hit_m_s=hit_m_s, fastest_m_s=fastest_m_s,
        stops=len(loop.record.stops), stood=stands_ns is not None, finished=flight.finished, texts=tuple(loop.record.texts),
        reasons=tuple(loop.record.reasons),
    )  # fmt: skip


def summary(flights: list[Turned]) -> str:
    """One line for each heading."""
    lines = []
    for yaw in Yaw:
        of = [f for f in flights if f.yaw == yaw]
        hits = [(f.number, round(f.hit_m_s, 1)) for f in of if f.clearance_m < 0.0]
        if of:
            lines.append(
                f"heading {yaw}: {len(of)} flights, {len(hits)} collisions {hits}, {sum(f.stood for f in of)} stopped"
            )
    return "\n".join(lines)


def main() -> None:
    """Flies, prints each flight as a line of JSON, then the summary."""
    parser = argparse.ArgumentParser()
    parser.add_argument("flights", type=int, nargs="?", default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--yaw", choices=list(Yaw), help="this heading alone")
    parser.add_argument("--speed-item", action="store_true")
    parser.add_argument("--straight", action="store_true")
    parser.add_argument("--clear", action="store_true")
    parser.add_argument("--no-guard", action="store_true", help="the autopilot alone, for comparison")
    args = parser.parse_args()
    off = {"mission": False, "guided": False, "return_home": False} if args.no_guard else {}
    guard = GuardParams(enabled=True, **off)
    course = Course(args.speed_item, args.straight, args.clear)
    flights = []
    for number in range(args.first, args.first + args.flights):
        for yaw in [Yaw(args.yaw)] if args.yaw else list(Yaw):
            flights.append(fly_turn(number, yaw, args.width, guard, course))
            print(json.dumps(asdict(flights[-1])))
            sys.stdout.flush()
    print(summary(flights))


if __name__ == "__main__":
    main()
