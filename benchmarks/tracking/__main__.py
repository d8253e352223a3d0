"""Measures the tracker and writes a page of tables. Those of docs/research/tracking.md are copied from it by hand, beside notes.

python -m benchmarks.tracking [--out FILE] [--quick] [--only SECTION] [--tilts level|few|all]
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benchmarks.fidelity.matrix import FEW_TILTS_DEG, QUICK_SCENES, TILTS_DEG, Tilts, spread
from benchmarks.hardware_info import stamp
from benchmarks.scenes.catalogue import SCENES as ALL_SCENES
from benchmarks.speed.tables import table
from companion.bench.timing import one_core
from drivers.simulation.scene_library import make_scene

from . import draws, margins, movers, stability, timing, wires
from .sequences import HZ, Pose, along, drifting, exposures, hovering, swinging, true_pose, vibrating

OUT = Path("bench-out/tracking.md")
SCENES = ("street", "trees", "alley")
KES = (0.0015, 0.005)
WARM = 10
PICTURE = "tracking_margins.png"
SECTIONS = ("still", "draws", "flight", "moving", "false", "vanish", "wires", "margins", "cost")
TILTS: dict[str, Tilts] = {"level": ((0, 0),), "few": FEW_TILTS_DEG, "all": TILTS_DEG}
TILT_TEXTS = {
    "level": "level",
    "few": "level, rolled by 30 and pitched by -30 degrees, each with other shapes",
    "all": "level, rolled and pitched by 10 and 30 degrees to either side, each with other shapes",
}
FALSE_SCENES = ("poles", "mixture", "trees", "demo")
FALSE_S = 15.0


def main() -> int:
    """0: the page was written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tracking", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--quick", action="store_true", help="fewer frames and scenes")
    parser.add_argument(
        "--tilts", choices=TILTS, default="level", help="of the section draws: roll and pitch of the camera"
    )
    parser.add_argument("--only", action="append", choices=SECTIONS, help="this section; may be given several times")
    args = parser.parse_args()
    frames, scenes = (22, SCENES[:1]) if args.quick else (40, SCENES)
    begun = time.monotonic()
    makers: dict[str, Callable[[], str]] = {
        "still": lambda: still(scenes, frames),
        "draws": lambda: noise_draws(QUICK_SCENES if args.quick else ALL_SCENES, args.tilts),
        "flight": lambda: flight(scenes, frames if args.quick else 48),
        "moving": lambda: moving(movers.CASES[:2] if args.quick else movers.CASES),
        "false": lambda: false(FALSE_SCENES[:1] if args.quick else FALSE_SCENES, 3.0 if args.quick else FALSE_S),
        "vanish": vanish,
        "wires": thin,
        "margins": lambda: coverage(scenes, frames, args.out.parent / "benchmarks" / PICTURE),
        "cost": cost,
    }
    with one_core():
        parts = [HEAD, *(makers[name]() for name in args.only or SECTIONS)]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    minutes = (time.monotonic() - begun) / 60.0
    given = (
        ["--quick"] * args.quick
        + ["--tilts", args.tilts] * (args.tilts != "level")
        + [word for name in args.only or [] for word in ("--only", name)]
    )
    made = stamp(given, minutes=minutes, quick=args.quick)
    made = dataclasses.replace(made, command=made.command.replace("benchmarks", "benchmarks.tracking", 1))
    args.out.write_text("\n".join([parts[0], made.markdown(), *parts[1:]]))
    return 0


HEAD = """# Tracking measurements

Simulated frames of 640 x 480 at 12 Hz with all image faults (correlated noise, dropout, holes, mismatches, flying pixels), modelled with the default parameters and tracked with the default parameters of `[tracking]`. *Frame* is the model of each frame alone.
"""


def _mean(values: list[float]) -> str:
    good = [v for v in values if math.isfinite(v)]
    return f"{100 * np.mean(good):.2f}" if good else "-"


def _rows(name: str, ke: float, found: dict[str, stability.Figures]) -> list[list[str]]:
    return [
        [name, f"{ke:g}", way, f"{np.mean(f.planes):.0f}", _mean(f.again), _mean(f.same_id), _mean(f.same_steady_id), _mean(f.missed), _mean(f.phantom), _mean(f.open_stopped), str(f.movers)]
        for way, f in found.items()
    ]  # fmt: skip


COLUMNS = [
    "scene",
    "ke, 1/m",
    "model",
    "planes",
    "found again, %",
    "same id, %",
    "same id, steady, %",
    "missed, %",
    "phantom, %",
    "open rays stopped, %",
    "movers",
]
MEANING = f"""*Found again*: share of the area of a frame's planes that has a plane within {stability.REACH_M:g} m in the next frame. *Same id*: share of the area of the tracks whose place has a track of the same id within {stability.SAME_M:g} m in the next frame; *steady*: of the tracks observed in at least {stability.STEADY_HITS} frames. *Missed*, *phantom*, *open rays stopped*: as in [fidelity](benchmarks/fidelity.md), every {stability.SCORED_EVERY}th frame (for open rays: phantoms of open rays). *Movers*: moving obstacles, summed over all frames; nothing moves.
"""


def still(scenes: tuple[str, ...], frames: int) -> str:
    """A still camera before a still scene."""
    rows = []
    for name in scenes:
        for ke in KES:
            _say(f"still {name} {ke:g}")
            poses: dict[str, Pose | None] = {"tracks": true_pose, "tracks, attitude only": None}
            rows += _rows(name, ke, stability.run(hovering(make_scene(name, 1)), frames, ke, poses, WARM))
    return f"## Still camera, still scene\n\n{frames} frames, the first {WARM} not counted. {MEANING}\n{table(COLUMNS, rows)}"


def noise_draws(scenes: Iterable[str], tilts: str) -> str:
    """Several draws of the noise of each scene. tilts: a name of TILTS."""
    found = []
    for one in draws.draws_of(spread(scenes, (1,), TILTS[tilts], kes=KES)):
        _say(f"draws {one.case.name}")
        found.append(one)
    rows = []
    for way, tracks in (("frame", False), ("tracks", True)):
        s = draws.summary(found, tracks)
        rows.append(
            [
                way,
                f"{100 * s.missed:.3f}",
                f"{100 * s.worst_missed[0]:.2f} ({s.worst_missed[1]})",
                str(s.cases_missed),
                f"{100 * s.phantom:.3f}",
                f"{100 * s.worst_phantom[0]:.2f} ({s.worst_phantom[1]})",
                str(s.cases_phantom),
            ]
        )
    head = [
        "model",
        "missed, %",
        "most",
        f"cases above {100 * draws.MISSED_LIMIT:g} %",
        "phantom, %",
        "most",
        f"cases above {100 * draws.PHANTOM_LIMIT:g} %",
    ]
    worse = sum(one.worse for one in found)
    return f"## Draws of the noise\n\n{draws.DRAWS} frames of a still camera before each scene of the fidelity run, {TILT_TEXTS[tilts]}, both noises, {len(found)} cases: the mean over all frames, the first included. In {worse} of {draws.DRAWS * len(found)} frames the tracks miss more than the frame's own model.\n\n{table(head, rows)}"


def flight(scenes: tuple[str, ...], frames: int) -> str:
    """A flight at 1.5 m/s with several errors of the pose."""
    rows = []
    for name in scenes:
        for ke in KES:
            _say(f"flight {name} {ke:g}")
            poses: dict[str, Pose | None] = {"tracks": true_pose, "tracks, attitude only": None}
            if ke == KES[0]:
                poses |= {
                    "drift 1 %": drifting(0.01),
                    "yaw swings by 1 deg": swinging(1.0),
                    "vibration 0.03 m": vibrating(0.03),
                }
            plan = along(make_scene(name, 1), 1.5, frames / HZ)
            rows += _rows(name, ke, stability.run(plan, frames, ke, poses, WARM))
    return f"## Flight at 1.5 m/s\n\n{frames} frames ({frames / HZ:.0f} s) northwards with a swaying attitude; planes of a wrong pose are judged where the camera sees them.\n\n{table(COLUMNS, rows)}"


def moving(cases: tuple[movers.Case, ...]) -> str:
    """Movers under true pose."""
    rows = []
    for case in cases:
        for ke in KES:
            _say(f"mover {case.name} {ke:g}")
            f = movers.run(case, ke)
            rows.append(
                [
                    case.name,
                    f"{ke:g}",
                    f"{f.declared_s:.2f}",
                    f"{f.velocity_m_s[0]:.2f} ({f.velocity_m_s[1]:.2f})",
                    f"{f.place_m[0]:.2f} ({f.place_m[1]:.2f})",
                    f"{100 * f.share:.0f} of {f.frames}",
                    str(f.others),
                ]
            )
    head = [
        "mover",
        "ke, 1/m",
        "declared after, s",
        "velocity error, m/s: mean (max)",
        "place error, m: mean (max)",
        "frames with it, %",
        "false movers",
    ]
    return f"## Moving obstacles\n\nA person walks at 1.5 m/s, a car drives at 8 m/s; true pose. Times count from the first frame that shows the whole mover; errors from {movers.AFTER_S:g} s after it until it leaves the image. The true place is the middle of the box of the visible surface.\n\n{table(head, rows)}"


def false(scenes: tuple[str, ...], seconds: float) -> str:
    """False movers."""
    rows = []
    for name in scenes:
        for ke in KES:
            _say(f"false movers {name} {ke:g}")
            found = movers.false_movers(make_scene(name, 2), ke, seconds)
            rows.append([name, f"{ke:g}", *(str(found[pose]) for pose in movers.FALSE_POSES)])
    minutes = len(rows) * seconds / 60.0
    return f"## False movers\n\nMoving obstacles declared in flights of {seconds:g} s at 1 m/s through static scenes, {minutes:.1f} min in all.\n\n{table(['scene', 'ke, 1/m', *(f'{pose} pose' if pose == 'true' else pose for pose in movers.FALSE_POSES)], rows)}"


def vanish() -> str:
    """Removed and hidden obstacles."""
    rows = []
    for ke in KES:
        _say(f"vanishing {ke:g}")
        gone, kept = timing.vanishing(ke, False), timing.vanishing(ke, True)
        rows.append([f"{ke:g}", f"{gone:.2f}", "kept" if math.isinf(kept) else f"removed after {kept:.2f} s"])
    return f"## Vanishing\n\nA box at 6 m before a wall at 14 m is removed, or hidden by a screen, after 1.5 s.\n\n{table(['ke, 1/m', 'removed box is gone after, s', 'hidden box, 3 s later'], rows)}"


def thin() -> str:
    """Wires of 2 cm."""
    rows = []
    for ke in KES:
        for x_m in wires.RANGES_M:
            _say(f"wire {x_m:g} m {ke:g}")
            for r in wires.run(x_m, ke):
                rows.append(
                    [
                        f"{x_m:g}",
                        f"{ke:g}",
                        str(r.frames),
                        f"{100 * r.frame_kept:.1f}",
                        str(r.frame_planes),
                        f"{100 * r.tracks_kept:.1f}",
                        str(r.tracks_planes),
                    ]
                )
    head = ["range, m", "ke, 1/m", "frames", "frame: rays, %", "planes", "tracks: rays, %", "planes"]
    return f"## Wires\n\nA wire of 2 cm across the view of a still camera, a wall behind it. *Rays*: share of its rays that are stopped within max(0.5 m, 2 sigma) of it; *planes*: those that stop any of them there.\n\n{table(head, rows)}"


BINS_M = ((0.0, 4.0), (4.0, 8.0), (8.0, 12.0), (12.0, 20.0))


def coverage(scenes: tuple[str, ...], frames: int, picture: Path) -> str:
    """Coverage of the margins by range, as a table and a picture."""
    found: dict[tuple[str, float], dict[str, margins.Counts]] = {}
    for noise in margins.NOISES:
        for ke in KES:
            total = {name: margins.empty() for name in margins.MODELS}
            for name in scenes:
                _say(f"margins {name} {noise} {ke:g}")
                plan = along(make_scene(name, 1), 1.5, frames / HZ)
                for model, c in margins.run(plan, frames, ke, noise, WARM).items():
                    total[model] += c
            found[noise, ke] = total
    picture.parent.mkdir(parents=True, exist_ok=True)
    margins.draw(found, picture)
    rows = []
    for (noise, ke), models in found.items():
        for model, c in models.items():
            for first, last in BINS_M:
                m = c.merged(first, last)
                shares = [f"{100 * float(v[0] / m.points[0]):.2f}" for v in m.covered]
                means = [f"{float(v[0] / m.met[0]):.2f}" for v in (m.margin_m, m.short_m)]
                rows.append([noise, f"{ke:g}", model, f"{first:g}-{last:g}", *shares, *means])
    head = ["noise", "ke, 1/m", "model", "range, m", *(f"covered with {s:g} of the margin, %" for s in margins.SHARES)]
    head += ["margin, m", "clearance lost, m"]
    return f"""## Margins

Flights as above with a true pose, every {margins.SCORED_EVERY}th frame from frame {WARM} on, {len(scenes)} scenes. *Covered*: true obstacle points whose ray meets a plane before them, or that lie within the margin of a plane (as in `benchmarks.fidelity.coverage`); goal {100 * margins.GOAL:.0f} %. *White*: noise independent between pixels; *blobs*: correlated over 10 px. *Margin*: mean over the points whose ray meets a plane within 2 m of them. *Clearance lost*: by how much the planes less their margins lie in front of these points.

![Coverage over range](benchmarks/{PICTURE})

{table(head, rows)}"""


def cost() -> str:
    """Processor time."""
    _say("cost")
    model = next(iter(exposures(hovering(make_scene("street", 1)), 1, KES[0]))).model
    rows = []
    for planes in (50, 100, 500):
        for positioned in (True, False):
            median, p99, tracks = timing.cost_ms(planes, positioned, model)
            rows.append([str(planes), "yes" if positioned else "no", f"{tracks:.0f}", f"{median:.2f}", f"{p99:.2f}"])
    return f"## Cost\n\nProcessor time of one frame, one thread: planes at random, a tenth of them absent in each frame.\n\n{table(['planes', 'position', 'tracks', 'median, ms', 'p99, ms'], rows)}"


def _say(text: str) -> None:
    print(f"tracking: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
