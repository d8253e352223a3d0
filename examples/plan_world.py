"""A path through the merged world: of the flight in a log, of a simulated one, or of the live service.

Run: .venv/bin/python examples/plan_world.py --unknown allow --planner rrt --goal 4.5 10 -2 -o path.png
     .venv/bin/python examples/plan_world.py flight.mcap --goal 8 0 -2 -o path.png
     .venv/bin/python examples/plan_world.py --live --start 0 0 -2 --goal 8 0 -2 -o path.png
--live needs a service with [publish] world and world_requests. All in ned, metres: north, east, down of where the autopilot has its origin.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import cast

import numpy as np

from companion.config.loader import Config
from companion.live.world_thread import observation_of
from companion.pipeline.configured import make_pipeline
from companion.pipeline.results import PrismsResult
from companion.replay.replay import process
from companion.replay.summary import ReplayCounts
from companion.viewer.png import drawing_library, new_figure
from core.world.world import World
from drivers.base import DriverError
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client.world.mirror import WorldMirror
from osape_client.world.snapshot import WorldSnapshot
from osape_client.world.space import WorldSpace

try:
    from path_planner import NoPath, Room, Unknown, plan
    from plan_path import add_planner_options, line
except ImportError as error:
    sys.exit(str(error))

SLACK_M = 6.0
"""The path may leave the box around what is known, start and goal by so much."""


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("log", nargs="?", type=Path, help="a log with depth; without one a flight is simulated")
    parser.add_argument("--live", action="store_true", help="of the service on this machine")
    parser.add_argument("--start", type=float, nargs=3, help="north, east, down, m; default: where the flight ended")
    parser.add_argument("--goal", type=float, nargs=3, default=(4.5, 10.0, -2.0), help="north, east, down, m")
    add_planner_options(parser, radius_m=0.4, been_m=2.0, picture="world_path.png")
    args = parser.parse_args()
    if args.live and args.start is None:
        parser.error("--live: say where the vehicle is, with --start")
    if args.live and args.log is not None:
        parser.error("--live uses the world of the service: leave the log away")
    return args


def flown(log: Path | None) -> tuple[WorldSpace, np.ndarray]:
    """The world of a flight, and the places (N, 3) of its camera."""
    flight = SimulatedFlight("demo", width=320, height=240) if log is None else McapRecording(log)
    pipeline, world, places = make_pipeline(Config(), flight.cameras), World(), []
    newest_ns = 0
    for _, outputs in process(flight.events(), pipeline, ReplayCounts()):
        for observation in (observation_of(o) for o in outputs if isinstance(o, PrismsResult)):
            if observation is not None:
                world.add(observation)
                places.append(observation.place_m)
                newest_ns = observation.t_ns
    snapshot = cast(WorldSnapshot, world.picture(newest_ns))  # both classes have the same fields
    return WorldSpace(snapshot), np.array(places).reshape(-1, 3)


def draw(space: WorldSpace, places: np.ndarray, path: np.ndarray, radius_m: float, out: Path) -> None:
    """What is known from above and from the side, the way flown, and the path as wide as the vehicle."""
    figure = new_figure()
    top, side = figure.add_axes((0.05, 0.1, 0.44, 0.83)), figure.add_axes((0.55, 0.35, 0.43, 0.4))
    for prism in space.prisms:
        if prism.closed:
            top.fill(prism.vertices_m[:, 1], prism.vertices_m[:, 0], color="#ef9a9a", alpha=0.6)
    for ax, ay, bx, by, z0, z1 in space.snapshot.planes:
        top.plot([ay, by], [ax, bx], color="#c62828", linewidth=1.5)
        side.fill([ax, bx, bx, ax], [-z0, -z0, -z1, -z1], color="#c62828", alpha=0.15)
    top.plot([], [], color="#c62828", label="plane of the merged world")
    top.plot(places[:, 1], places[:, 0], color="#1565c0", linewidth=1.0, label="flown while observing")
    top.plot([], [], color="#8e24aa", label="planned path, as wide as the vehicle")
    side.plot(places[:, 0], -places[:, 2], color="#1565c0", linewidth=1.0)
    line(top, path[:, 1], path[:, 0], radius_m)
    line(side, path[:, 0], -path[:, 2], radius_m)
    top.set(aspect="equal", xlabel="east, m", ylabel="north, m")
    side.set(aspect="equal", xlabel="north, m", ylabel="up, m")
    figure.legend(loc="lower center", bbox_to_anchor=(0.765, 0.2))
    figure.savefig(out)


def main() -> int:
    args = arguments()
    try:
        drawing_library()
    except DriverError as error:
        print(error, file=sys.stderr)
        return 1
    if args.live:
        with WorldMirror() as mirror:
            if not mirror.update(5.0):
                print(
                    f"the world cannot be used: {mirror.cause}; the service needs [publish] world and world_requests",
                    file=sys.stderr,
                )
                return 1
            space, places = mirror.space, np.array([args.start])
    else:
        try:
            space, places = flown(args.log)
        except (DriverError, OSError, ValueError) as error:
            print(error, file=sys.stderr)
            return 1
        if not len(places):
            print("no frame of the flight has a position: there is no world", file=sys.stderr)
            return 1
    start = np.array(args.start) if args.start is not None else places[-1]
    corners = np.concatenate(
        [space.snapshot.planes[:, [0, 1, 4]], space.snapshot.planes[:, [2, 3, 5]], [start, args.goal]]
    )
    bounds = [corners.min(axis=0) - SLACK_M, np.minimum(corners.max(axis=0) + SLACK_M, [np.inf, np.inf, -0.5])]
    room = Room(space=space, radius_m=args.radius, start=start, been_m=args.been, unknown=Unknown(args.unknown))
    try:
        path = plan(room, args.goal, bounds, planner=args.planner, seed=args.seed)
    except NoPath as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{args.planner}: {len(path)} corners, {np.linalg.norm(np.diff(path, axis=0), axis=1).sum():.1f} m")
    draw(space, places, path, args.radius, args.o)
    print(args.o)
    return 0


if __name__ == "__main__":
    sys.exit(main())
