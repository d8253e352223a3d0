"""How well a wrong mount is found, and whether a right one is left alone: `python -m benchmarks.self_check.mount_check`.

Parts: `wrong` (each scene, one pose, errors of 5 degrees and more: after ten frames no frame may call free what is not), `right`
(each scene with the right mount, hovering and turning: no frame may become invalid, no error be reported), `slope` (true slopes
to 10 degrees, turning) and `small` (errors of 1 to 3 degrees, turning: named within 10 s)."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from benchmarks.scenes.catalogue import SCENES, camera_pose, make_scene
from benchmarks.self_check.mount_flights import Errors, Frame, MountFlight, hover, turning
from core.self_check.mount_check import MountVerdict
from core.self_check.mount_params import MountCheckParams
from drivers.simulation.scenes import Scene, SceneBuilder

SETTLED = 10
"""Frames after which nothing may be called free that is not."""
FRAMES = 15
WRONG = (
    Errors(pitch_deg=-5.0),
    Errors(pitch_deg=5.0),
    Errors(pitch_deg=-10.0),
    Errors(roll_deg=10.0),
    Errors(roll_deg=-5.0),
    Errors(roll_deg=5.0, pitch_deg=-5.0),
    Errors(pitch_deg=-20.0),
)
SMALL = (
    Errors(pitch_deg=1.0),
    Errors(pitch_deg=-1.0),
    Errors(roll_deg=1.0),
    Errors(pitch_deg=-2.0),
    Errors(roll_deg=-2.0),
    Errors(pitch_deg=3.0),
    Errors(roll_deg=2.0, pitch_deg=-2.0),
)
SMALL_SCENES = ("street", "trees", "open", "alley", "stones", "forest")
SLOPES_DEG = (-10.0, -7.0, -5.0, -3.0, 3.0, 5.0, 7.0, 10.0)
HEIGHT_M = 2.0
Row = dict[str, object]


def slope_scene(along_deg: float, across_deg: float, houses: bool) -> Scene:
    """A field of constant slope, with or without houses, whose walls are vertical."""
    s = SceneBuilder(f"slope {along_deg:g} {across_deg:g}")
    s.ground(math.tan(math.radians(along_deg)), math.tan(math.radians(across_deg)))
    if houses:
        s.box("house", 12.0, -3.0, 5.0, 5.0, 8.0, 0.3, base=-2.5)
        s.box("barn", 9.0, 6.0, 4.0, 6.0, 7.0, -0.2, base=-2.5)
    return s.build()


def wrong(scenes: tuple[str, ...], seed: int, ke_per_m: float, check: MountCheckParams | None = None) -> Iterator[Row]:
    """Large errors at one pose."""
    for name in scenes:
        position, yaw = camera_pose(name, seed, HEIGHT_M)
        for errors in WRONG:
            flight = MountFlight(make_scene(name, seed), errors, seed=seed, ke_per_m=ke_per_m, check=check)
            late = flight.fly(hover(position, yaw, FRAMES))[SETTLED:]
            yield {
                "part": "wrong",
                "scene": name,
                "errors": str(errors),
                "valid": sum(f.valid for f in late),
                "false_free": max(f.false_free for f in late),
                "verdict": late[-1].verdict.name,
                "error_deg": late[-1].error_deg,
            }


def right(scenes: tuple[str, ...], seed: int, ke_per_m: float) -> Iterator[Row]:
    """The right mount, standing and turning."""
    for name in scenes:
        position, yaw = camera_pose(name, seed, HEIGHT_M)
        for kind, poses in (("hover", hover(position, yaw, FRAMES)), ("turning", turning(position, yaw, hz=5.0))):
            flight = MountFlight(make_scene(name, seed), Errors(), seed=seed, ke_per_m=ke_per_m, frame_hz=5.0)
            yield {"part": "right", "scene": name, "kind": kind, **alarms(flight.fly(poses, judge=False))}


def _plane(rise: tuple[float, float], x: float, y: float) -> float:
    """Returns the height of a slope at a place."""
    return rise[0] * x + rise[1] * y


def slope(seed: int, ke_per_m: float) -> Iterator[Row]:
    """True slopes. Without houses a slope cannot be distinguished from a wrong mount until the vehicle has turned."""
    for houses in (True, False):
        for along in SLOPES_DEG:
            for across in (0.0, 0.5 * along):
                if math.hypot(along, across) > 10.1:
                    continue
                rise = math.tan(math.radians(along)), math.tan(math.radians(across))
                poses = turning((0.0, 0.0, -HEIGHT_M), 0.0, ground=partial(_plane, rise))
                flight = MountFlight(slope_scene(along, across, houses), Errors(), seed=seed, ke_per_m=ke_per_m)
                frames = flight.fly(poses, judge=False)
                withheld = [f.t_s for f in frames if f.verdict is MountVerdict.UNVERIFIED_SLOPE]
                yield {
                    "part": "slope",
                    "along_deg": along,
                    "across_deg": across,
                    "houses": houses,
                    **alarms(frames),
                    "withheld_to_s": max(withheld, default=0.0),
                }


def small(seed: int, ke_per_m: float) -> Iterator[Row]:
    """Errors of 1 to 3 degrees in turning flight."""
    for name in SMALL_SCENES:
        position, yaw = camera_pose(name, seed, HEIGHT_M)
        for errors in SMALL:
            flight = MountFlight(make_scene(name, seed), errors, seed=seed, ke_per_m=ke_per_m)
            frames = flight.fly(turning(position, yaw), judge=False)
            named = next((f for f in frames if f.verdict in (MountVerdict.DEGRADED, MountVerdict.ERROR)), None)
            yield {
                "part": "small",
                "scene": name,
                "errors": str(errors),
                "named_s": named.t_s if named else None,
                "verdict": frames[-1].verdict.name,
                "error_deg": frames[-1].error_deg,
            }


def alarms(frames: list[Frame]) -> Row:
    """How often a verdict stood that reports an error, or made frames invalid, and the largest error estimated."""
    return {
        "errors_reported": sum(f.verdict in (MountVerdict.DEGRADED, MountVerdict.ERROR) for f in frames),
        "withheld": sum(f.verdict is MountVerdict.UNVERIFIED_SLOPE for f in frames),
        "frames": len(frames),
        "verdict": frames[-1].verdict.name,
        "error_deg": frames[-1].error_deg,
    }


def bad(row: Row) -> bool:
    """Whether a row misses its goal."""
    if row["part"] == "wrong":
        return bool(row["false_free"])
    if row["part"] == "small":
        return row["named_s"] is None
    if row["part"] == "slope":
        return bool(row["errors_reported"])
    return bool(row["errors_reported"] or row["withheld"])


def main() -> None:
    """Runs the parts and prints the rows that miss their goal, then the totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="+", default=["wrong", "right", "slope", "small"])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--ke", type=float, default=0.0015)
    parser.add_argument("--rows", type=Path, help="write all rows as JSON lines")
    parser.add_argument("--off", action="store_true", help="part wrong without the check, to see what it prevents")
    args = parser.parse_args()
    scenes = tuple(args.scenes)
    rows: list[Row] = []
    for part in args.parts:
        made = {
            "wrong": lambda: wrong(scenes, args.seed, args.ke, MountCheckParams(enabled=not args.off)),
            "right": lambda: right(scenes, args.seed, args.ke),
            "slope": lambda: slope(args.seed, args.ke),
            "small": lambda: small(args.seed, args.ke),
        }[part]()
        count = missed = 0
        for row in made:
            rows.append(row)
            count, missed = count + 1, missed + bad(row)
            if bad(row):
                print(json.dumps(row), flush=True)
        print(f"{part}: {count} cases, {missed} miss their goal", flush=True)
    if args.rows:
        args.rows.write_text("".join(json.dumps(row) + "\n" for row in rows))


if __name__ == "__main__":
    main()
