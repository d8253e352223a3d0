"""Closed loops of rendered stereo, matching, pipeline, obstacle output and an autopilot model.

    python -m benchmarks.open_air.crossing
    python -m benchmarks.open_air.crossing --flights balloon,pillar --autopilots ArduPilot,PX4

`field` and `between_trees` cross 60 m of field, without trees and between trees; `climb` and `turn` climb from 1 to 10 m and turn by
45 degrees a second over it. `climb_bridge`, `turn_container` and `turn_pillar` do so beside a blank thing. All others fly towards a
blank thing. PX4 has CP_GO_NO_DATA = 0 and CP_GUIDE_ANG = 30 (--guide). The mount counts as measured ([open_sky] mount_measured)."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, field

import numpy as np

from benchmarks import markdown
from benchmarks.open_air.crossing_loop import Course, CrossingLoop, Flown
from benchmarks.open_air.vehicles import AUTOPILOTS
from benchmarks.open_air.view_options import words
from companion.argument_parser import ArgumentParser
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_scene import StereoScene, surfaces_of

AHEAD_M, HEIGHT_M, CROSSING_M, TOWARDS_M = 16.0, 2.0, 60.0, 24.0
TURN_RAD_S = math.radians(45.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """thing: of `scene_of`; seconds, until_m: longest time and way; still_s: standing for so long ends it."""

    thing: str
    course: Course = field(default_factory=Course)
    seconds: float = 40.0
    until_m: float = TOWARDS_M
    still_s: float = 1.0


def _towards(thing: str) -> Flight:
    return Flight(thing=thing, seconds=12.0)


CLIMB = Course(speed_m_s=2.0, height_m=1.0, height_to_m=10.0, climb_m_s=1.5, start_s=1.0)
TURN = Course(speed_m_s=2.0, turn_rad_s=TURN_RAD_S, start_s=2.0)
BESIDE = Course(speed_m_s=1.5, heading_rad=-0.75 * math.pi, turn_rad_s=TURN_RAD_S, start_s=0.6)
"""Faces away from a thing in the north, and turns to it."""
FLIGHTS = {
    "field": Flight(thing="field", until_m=CROSSING_M, still_s=math.inf),
    "between_trees": Flight(thing="between_trees", until_m=CROSSING_M, still_s=math.inf),
    "climb": Flight(thing="field", course=CLIMB, seconds=9.0, still_s=math.inf),
    "turn": Flight(thing="field", course=TURN, seconds=10.0, still_s=math.inf),
    "climb_bridge": Flight(thing="bridge_above", course=CLIMB, seconds=9.0, still_s=math.inf),
    "turn_container": Flight(thing="near_container", course=BESIDE, seconds=9.0, still_s=math.inf),
    "turn_pillar": Flight(thing="near_pillar", course=BESIDE, seconds=9.0, still_s=math.inf),
    **{
        thing: _towards(thing)
        for thing in ("container", "wall", "pillar", "thin_pillar", "balloon", "overhang", "bridge")
    },
}


def scene_of(thing: str, seed: int = 0, sky: str = "clear") -> StereoScene:
    """The field, with trees beside the way or without, or with a blank thing 16 m ahead in the north, `near_`: 6 m. Raises ValueError
    for a name that does not exist."""
    s = SceneBuilder(thing)
    s.ground()
    rng = np.random.Generator(np.random.PCG64([seed, 7]))
    if thing == "between_trees":
        for i in range(8):
            x, side = 4.0 + 8.0 * i, -1.0 if i % 2 else 1.0
            s.tree(f"tree {i}", x, side * (7.0 + rng.uniform(0.0, 2.0)), rng.uniform(6.0, 9.0), 1.8, 500, rng)
    elif thing == "field":
        pass
    elif thing == "container":
        s.box("container", AHEAD_M + 1.25, 0.0, 2.5, 6.0, 6.0, 0.1)
    elif thing == "near_container":
        s.box("container", 7.25, 0.0, 2.5, 6.0, 6.0, 0.1)
    elif thing == "wall":
        s.wall("blank wall", (AHEAD_M, -30.0), (AHEAD_M, 30.0), 8.0)
    elif thing == "pillar":
        s.pole("pillar", AHEAD_M, 0.1, 0.5, 10.0)
    elif thing == "thin_pillar":
        s.pole("pillar", AHEAD_M, 0.0, 0.12, 10.0)
    elif thing == "near_pillar":
        s.pole("pillar", 6.0, 0.1, 0.5, 10.0)
    elif thing == "balloon":
        s.sphere("balloon", AHEAD_M, 0.0, HEIGHT_M, 0.6)
    elif thing == "overhang":
        s.box("overhang", AHEAD_M, 0.0, 2.0, 5.0, 0.8, base=HEIGHT_M - 0.3)
    elif thing == "bridge":
        s.box("bridge", AHEAD_M, 0.0, 3.0, 60.0, 1.2, 0.1, base=HEIGHT_M - 0.4)
    elif thing == "bridge_above":
        s.box("bridge", AHEAD_M, 0.0, 3.0, 60.0, 1.2, 0.1, base=4.0)
    else:
        raise ValueError(f"no thing {thing!r}")
    return StereoScene(name=thing, surfaces=surfaces_of(s.build()), sky=SKIES[sky])


def fly(
    name: str,
    autopilot: str,
    *,
    seconds: float = math.inf,
    seed: int = 0,
    sky: str = "clear",
    guide_ang_deg: float = 30.0,
) -> Flown:
    """One flight of FLIGHTS, for at most so long."""
    flight = FLIGHTS[name]
    loop = CrossingLoop(
        scene_of(flight.thing, seed, sky), autopilot, flight.course, guide_ang_deg=guide_ang_deg, seed=seed
    )
    return loop.run(min(seconds, flight.seconds), flight.until_m, flight.still_s)


COLUMNS = (
    "flight",
    "autopilot",
    "flown m",
    "s",
    "fastest m/s",
    "stops",
    "first at m",
    "end north, east, up m",
    "least distance m",
    "frames with open %",
    "wrong free cells",
    "wrong open cells",
    "wrong clear sectors",
)


def row(name: str, autopilot: str, f: Flown) -> str:
    """A row of the table."""
    cells = (
        name,
        autopilot,
        f"{f.distance_m:.1f}",
        f"{f.seconds:.1f}",
        f"{f.fastest_m_s:.1f}",
        str(f.stops),
        "" if math.isnan(f.first_stop_m) else f"{f.first_stop_m:.1f}",
        f"{f.north_m:.1f}, {f.east_m:.1f}, {f.height_m:.1f}",
        f"{f.clearance_m:.2f}" if math.isfinite(f.clearance_m) else "",
        f"{100.0 * f.open_frames / max(1, f.frames):.0f}",
        str(f.wrong_free),
        str(f.wrong_open),
        str(f.wrong_clear),
    )
    return markdown.row(cells)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a vehicle flew into something."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--flights", type=words, default=list(FLIGHTS))
    p.add_argument("--autopilots", type=words, default=list(AUTOPILOTS))
    p.add_argument("--seeds", type=words, default=[0])
    p.add_argument("--sky", choices=list(SKIES), default="clear")
    p.add_argument("--seconds", type=float, default=math.inf)
    p.add_argument("--guide", type=float, default=30.0, help="CP_GUIDE_ANG of PX4, degrees")
    a = p.parse_args(arguments)
    print(markdown.head(COLUMNS, 2))
    hit = False
    for name in a.flights:
        for autopilot in a.autopilots:
            for seed in a.seeds:
                flown = fly(name, autopilot, seconds=a.seconds, seed=int(seed), sky=a.sky, guide_ang_deg=float(a.guide))
                hit |= flown.clearance_m <= 0.0
                print(row(name, autopilot, flown), flush=True)
    return int(hit)


if __name__ == "__main__":
    sys.exit(main())
