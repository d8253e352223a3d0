"""The guard in the closed loop: random missions past walls, poles, trees and wires, and flights with nothing in the way.

    python -m benchmarks.autopilot.guard_missions [missions] [--first N] [--blocked] [--guided] [--width PX] [--minutes M] [--no-guard]
        [--gust M_S] [--velocity-noise M_S]

Each mission is flown by a model of PX4 or ArduPilot at 1 to 8 m/s with rendered depth. It ends when the vehicle stands for one
second after a stop, at its last waypoint, at a collision, or after 60 s. Then open and street scenes are flown for M minutes each.
With --gust the missions are flown in a steady wind of half that speed and in gusts up to it, from random directions; with
--velocity-noise the autopilot reports its velocity with that standard deviation.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.autopilot.auto_flight import (
    COPTER_AUTO,
    COPTER_GUIDED,
    PX4_MISSION,
    PX4_OFFBOARD,
    AutoFlight,
    CopterAutoFlight,
    Px4AutoFlight,
)
from benchmarks.autopilot.guard_loop import NS, GuardLoop
from benchmarks.autopilot.guard_scenes import Mission, clearance_m, random_mission, way_to_obstacle_m
from benchmarks.autopilot.wind import Wind
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.states import GuardState
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info

LONGEST_S = 60.0
SIDE_SPARE_M = 0.25
"""A stop counts as justified by a solid that is so much outside of the corridor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """Result of one flight. clearance_m: least distance of the hull from a solid. stops; false_stops: without a solid in the path
    within the braking distance. reaction_s: of the first stop before an obstacle, see `LoopRecord`; None: no such stop, or the path was
    not seen far enough."""

    number: int
    autopilot: str
    guided: bool
    speed_m_s: float
    kinds: tuple[str, ...]
    blocked: bool
    seconds: float
    fastest_m_s: float
    clearance_m: float
    stops: int
    false_stops: int
    limits: int
    reaction_s: float | None
    finished: bool
    texts: tuple[str, ...]
    reasons: tuple[str, ...] = ()


def flight_of(autopilot: str, waypoints: np.ndarray, height_m: float, speed_m_s: float, guided: bool) -> AutoFlight:
    """The model of an autopilot at the beginning of its flight."""
    if autopilot == "PX4":
        flight: AutoFlight = Px4AutoFlight(waypoints, height_m, speed_m_s, PX4_OFFBOARD if guided else PX4_MISSION)
    else:
        flight = CopterAutoFlight(waypoints, height_m, speed_m_s, COPTER_GUIDED if guided else COPTER_AUTO)
    return flight


def gusts(number: int, gust_m_s: float) -> Wind | None:
    """The wind of a mission, always the same: half of gust_m_s, and gusts of 2 to 6 s up to it from another direction."""
    if gust_m_s <= 0.0:
        return None
    rng = np.random.default_rng([29, number])
    steady, gust = (np.array([math.cos(a), math.sin(a)]) for a in rng.uniform(-math.pi, math.pi, 2))
    return Wind(0.5 * gust_m_s * steady, gust_m_s * gust, float(rng.uniform(2.0, 6.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """What makes a flight less than ideal, m/s. velocity_noise_m_s: see GuardLoop."""

    gust_m_s: float = 0.0
    velocity_noise_m_s: float = 0.0


CALM = Disturbance()


def fly(
    mission: Mission,
    width: int,
    guard: GuardParams,
    disturbance: Disturbance = CALM,
    times_reactions: bool = True,
    avoid: AvoidParams | None = None,
) -> Flown:
    """One mission. times_reactions, avoid: see GuardLoop."""
    flight = flight_of(mission.autopilot, mission.waypoints_m, mission.height_m, mission.speed_m_s, mission.guided)
    flight.wind = gusts(mission.number, disturbance.gust_m_s)
    loop = _loop(mission.scene, flight, mission.autopilot, width, mission.number, guard, avoid)
    loop.velocity_noise_m_s, loop.times_reactions = disturbance.velocity_noise_m_s, times_reactions
    loop.run(0.0)
    start = _hover(loop)
    if mission.guided:
        flight.velocity_target_m_s = np.array([mission.speed_m_s, 0.0])
    return _flown(loop, mission, start)


def _loop(
    scene: Scene,
    flight: AutoFlight,
    kind: str,
    width: int,
    seed: int,
    guard: GuardParams,
    avoid: AvoidParams | None = None,
) -> GuardLoop:
    camera = camera_info(width, width * 3 // 4)
    sensor = replace(TYPICAL.scaled_to(width), sky_is_far=True)
    return GuardLoop(scene, camera, sensor, flight, kind, seed, guard, avoid)


def _hover(loop: GuardLoop) -> int:
    """One second before the mission begins: the camera is in use when it does. Returns the instant of the beginning."""
    cruise, waypoints = loop.flight.mode, loop.flight.waypoints_m
    loop.flight.waypoints_m = np.zeros((0, 2))
    loop.run(1.0)
    loop.flight.waypoints_m, loop.flight.mode = waypoints, cruise
    return loop.now_ns


def _flown(loop: GuardLoop, mission: Mission, start_ns: int) -> Flown:
    flight, scene, hull_m = loop.flight, loop.scene, loop.avoid.radius_m
    least_m, fastest_m_s, false_stops, stands_ns, judged = math.inf, 0.0, 0, None, 0
    while loop.now_ns - start_ns < LONGEST_S * NS:
        loop.tick()
        fastest_m_s = max(fastest_m_s, flight.speed_m_s)
        least_m = min(least_m, clearance_m(scene, loop.place_m) - hull_m)
        while judged < len(loop.record.stops):
            false_stops += _judge(loop)
            judged += 1
        still = flight.speed_m_s < 0.05 or (flight.wind is not None and loop.guard.memory.state is GuardState.HOLDING)
        stands = bool(loop.record.stops) and still
        stands_ns = (stands_ns or loop.now_ns) if stands else None
        passed = mission.guided and flight.position_m[0] > mission.waypoints_m[0, 0]
        if least_m < 0.0 or flight.finished or passed or (stands_ns is not None and loop.now_ns - stands_ns > NS):
            break
    record = loop.record
    return Flown(
        number=mission.number, autopilot=mission.autopilot, guided=mission.guided, speed_m_s=mission.speed_m_s,
        kinds=mission.kinds, blocked=mission.blocked, seconds=(loop.now_ns - start_ns) / NS, fastest_m_s=fastest_m_s,
        clearance_m=least_m, stops=len(record.stops), false_stops=false_stops, limits=record.limits, reaction_s=next(iter(record.reactions_s), None),
        finished=flight.finished, texts=tuple(record.texts), reasons=tuple(record.reasons),
    )  # fmt: skip


def _judge(loop: GuardLoop) -> bool:
    """Whether the newest stop is a false one; it is marked so in its reason."""
    false = not _justified(loop)
    if false:
        loop.record.reasons[-1] = f"FALSE {loop.record.reasons[-1]}"
    return false


def braking_distance_m(speed_m_s: float, guard: GuardParams, avoid: AvoidParams) -> float:
    """From the vehicle's middle, as docs/explanation/guard.md states it; not that of the guard, which would excuse its own stops."""
    way_m = speed_m_s * guard.reaction_s + speed_m_s**2 / (2.0 * guard.deceleration_m_s2)
    return way_m + guard.margin_m + avoid.radius_m


def _justified(loop: GuardLoop) -> bool:
    """Whether a solid stands in the path within the braking distance of the speed that is to come, and 10 % more for what the camera measures too near."""
    verdict = loop.guard.verdict
    speed_m_s = max(loop.flight.speed_m_s, verdict.predicted_m_s if verdict is not None else 0.0)
    needed_m = 1.1 * braking_distance_m(speed_m_s, loop.params, loop.avoid) + 0.5
    half_m = loop.avoid.radius_m + loop.params.side_m + SIDE_SPARE_M
    return way_to_obstacle_m(loop.scene, loop.place_m, loop.direction, half_m, needed_m) <= needed_m


def free_flight(name: str, minutes: float, speed_m_s: float, width: int, guard: GuardParams, seed: int = 1) -> Flown:
    """To and fro along the middle of a scene with nothing in the way, for so long; after a stop the mission is resumed."""
    scene = make_scene(name, seed)
    ways = np.array([[18.0, 0.0], [0.0, 0.0]] * round(minutes * 60.0))
    autopilot = "PX4" if seed % 2 else "ArduPilot"
    flight = flight_of(autopilot, ways, 3.0, speed_m_s, guided=False)
    mode = flight.mode
    loop = _loop(scene, flight, autopilot, width, seed, guard)
    loop.times_reactions = False
    start_ns = _hover(loop)
    least_m, fastest_m_s, false_stops, judged = math.inf, 0.0, 0, 0
    while loop.now_ns - start_ns < minutes * 60.0 * NS:
        loop.tick()
        fastest_m_s = max(fastest_m_s, flight.speed_m_s)
        while judged < len(loop.record.stops):
            false_stops += _judge(loop)
            judged += 1
        if flight.mode != mode and flight.speed_m_s < 0.05 and loop.guard.memory.state == "holding":
            flight.enter(mode)
    return Flown(
        number=seed, autopilot=autopilot, guided=False, speed_m_s=speed_m_s, kinds=(name,), blocked=False, seconds=minutes * 60.0,
        fastest_m_s=fastest_m_s, clearance_m=least_m, stops=len(loop.record.stops), false_stops=false_stops,
        limits=loop.record.limits, reaction_s=None, finished=False, texts=tuple(loop.record.texts), reasons=tuple(loop.record.reasons),
    )  # fmt: skip


def summary(flights: list[Flown]) -> str:
    """The figures of the goals, in one line each."""
    hits = [f.number for f in flights if f.clearance_m < 0.0]
    late = sorted(f.reaction_s for f in flights if f.reaction_s is not None)
    minutes = sum(f.seconds for f in flights) / 60.0
    lines = [
        f"{len(flights)} missions, {sum(f.blocked for f in flights)} with an obstacle in the way: {len(hits)} collisions {hits}",
        f"{sum(f.stops > 0 for f in flights)} stopped, {sum(f.limits > 0 for f in flights)} limited, "
        f"{sum(f.finished for f in flights)} finished, {sum(f.false_stops for f in flights)} false stops in {minutes:.1f} min, "
        f"{sum(f.false_stops for f in flights if f.guided)} of them with velocity setpoints, which no limit slows down",
    ]
    if late:
        inside = 100.0 * sum(s <= 0.3 for s in late) / len(late)
        lines.append(
            f"exposure to stop command: median {late[len(late) // 2]:.2f} s, longest {late[-1]:.2f} s, {inside:.0f} % within 0.3 s"
        )
    return "\n".join(lines)


def main() -> None:
    """Flies, prints each flight as a line of JSON, then the summary."""
    parser = argparse.ArgumentParser()
    parser.add_argument("missions", type=int, nargs="?", default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--gust", type=float, default=0.0, help="m/s")
    parser.add_argument("--velocity-noise", type=float, default=0.0, help="m/s")
    parser.add_argument(
        "--blocked", action="store_true", help="only those with an obstacle in the way, of so many numbers"
    )
    parser.add_argument("--guided", action="store_true", help="only those with velocity setpoints, of so many numbers")
    parser.add_argument("--no-guard", action="store_true", help="the autopilot alone, for comparison")
    args = parser.parse_args()
    off = {"mission": False, "guided": False, "return_home": False} if args.no_guard else {}
    guard = GuardParams(enabled=True, **off)
    flights = []
    for number in range(args.first, args.first + args.missions):
        mission = random_mission(number)
        if (args.blocked and not mission.blocked) or (args.guided and not mission.guided):
            continue
        disturbance = Disturbance(gust_m_s=args.gust, velocity_noise_m_s=args.velocity_noise)
        flights.append(fly(mission, args.width, guard, disturbance))
        print(json.dumps(asdict(flights[-1])))
        sys.stdout.flush()
    if flights:
        print(summary(flights))
    if args.minutes > 0.0:
        for seed, (name, speed) in enumerate((("open", 3.0), ("open", 6.0), ("street", 3.0), ("street", 6.0))):
            f = free_flight(name, args.minutes / 2.0, speed, args.width, guard, seed + 1)
            print(
                f"{name} at {speed:g} m/s: {f.false_stops} false stops of {f.stops} in {f.seconds / 60.0:.1f} min, {f.texts}"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
