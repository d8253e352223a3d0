"""The page of the fidelity figures: the whole matrix on the held-out seeds, and the tuning seeds for comparison."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.fidelity import limits, plots, tables
from benchmarks.fidelity.goals import MEASURES, Summary, summary
from benchmarks.fidelity.matrix import FEW_TILTS_DEG, PARTS, Settings, quick, run, spread
from benchmarks.fidelity.result import Case, Row
from benchmarks.hardware_info import stamp
from benchmarks.pages import INDEX, SECTIONS, index, page
from benchmarks.scenes.catalogue import FAMILIES, HELD_OUT_SEEDS, SCENES, TUNING_SEEDS

FULL, BRIEF = "python -m benchmarks --only fidelity", "python -m benchmarks.fidelity.section --brief"
BASE_SEEDS = 2
"""Of the base part, at each tilt; the others take one."""

INTRO = """The true depth of each ray is compared with the model. Scenes are ray-cast, so the truth is known; noise is that of stereo, sigma = ke Z², constant in disparity and correlated over about 9 px as that of a real D435 is. Images are 640x480 with a focal length of 450 px and a range of 20 m, and unless a table states otherwise have 5 % dropout, blob holes, 0.2 % of 2x2 mismatches and flying pixels at depth edges. One set of parameters, the shipped one. The last of four frames is scored, so that the noise level and the ground are measured, not given. The form of each scene and the place of the camera differ for each tilt and seed.

- *Obstacle rays*: the truth is more than 0.6 m above the ground, and at least 3 sigma short of the camera's range in disparity.
- *Error*: distance of each visible true obstacle point to the nearest plane; *grid 0.1 m*: the same of a grid of prisms made of the same noisy depth ([peers](peers.md)).
- *Missed*: of the obstacle rays, those that the model lets pass more than max(0.5 m, 2 sigma) beyond the true surface. *Margin subtracted*: as a consumer must, each plane's margin is taken off.
- *Phantom*: rays stopped more than max(1 m, 3 sigma) before the truth, farther than that from every visible true surface; the same *over ground and sky* alone.
- *Open rays stopped*: no obstacle behind, stopped all the same, near one or not; *early*: by more than max(0.5 m, 2 sigma).
- *Obstacle in space called free*: obstacle rays whose truth lies where the free-range profile is free, more than max(0.5 m, 2 sigma) before its end.
- Families: *structured* has planar faces, *unstructured* leaves, branches, stones, rubble and mixtures; *thin* is poles, wires, fences; *ground* is hardly anything but ground, or none. A frame without a model (`valid = false`) is counted, not scored.

Half of the seeds are for tuning; what stands here comes from the other half, but for the comparison of both."""


def section(out: Path, quick_look: bool) -> str:
    """Runs the matrix, draws the pictures into `out`, writes the figures to out/fidelity.json and returns the
    page."""
    jobs = os.cpu_count() or 1
    held, tuning = HELD_OUT_SEEDS[:BASE_SEEDS], TUNING_SEEDS[:BASE_SEEDS]
    if quick_look:
        base = _run("base", list(quick(held[:1])), Settings(jobs=jobs))
        _write(out, {"base": base})
        return "\n\n".join([_what("--quick --held-out"), *_goals(out, base), *_things(out, base)])
    base = _run("base", list(PARTS["base"].make(held)), _settings("base", jobs))
    tuned = _run("tuning", list(PARTS["base"].make(tuning[:1])), _settings("base", jobs))
    seeds = [
        "## Tuning and held-out seeds",
        f"The base part on {len({r.case.seed for r in tuned})} tuning seeds and {len({r.case.seed for r in base})} "
        "held-out ones. Were the parameters fitted to the scenes that they were chosen by, the right column would "
        "be worse throughout.",
        tables.seeds_table(tuned, base),
    ]
    return "\n\n".join(
        [_what("--part base --held-out --seeds 2"), *_all_of(out, base, held[:1], {"tuning": tuned}, FULL), *seeds]
    )


def brief(out: Path) -> str:
    """The page with one held-out seed and three tilts in its base part, an eighth of the work: all scenes all the same."""
    held = HELD_OUT_SEEDS[:1]
    base = _run("base", list(spread(SCENES, held, FEW_TILTS_DEG)), _settings("base", os.cpu_count() or 1))
    few = ",".join(f"{roll:g}:{pitch:g}" for roll, pitch in FEW_TILTS_DEG)
    configured = "Shortened: one held-out seed, level, rolled by 30 and pitched down by 30 degrees; no comparison with tuning seeds."
    return "\n\n".join(
        [configured, _what(f"--part base --held-out --tilts {few}"), *_all_of(out, base, held, {}, BRIEF)]
    )


def _all_of(
    out: Path, base: Sequence[Row], seeds: Sequence[int], more: dict[str, list[Row]], command: str
) -> list[str]:
    """The tables of the base part and of the parts that vary one property, for these seeds. Writes out/fidelity.json,
    and out/limits.json for the tables of docs/research/algorithm-measurements.md."""
    jobs = os.cpu_count() or 1
    parts = {
        name: _run(name, list(part.make(seeds)), _settings(name, jobs))
        for name, part in PARTS.items()
        if name != "base"
    }
    _write(out, {"base": list(base), **more, **parts})
    of_noise = [*_few_tilts(base), *parts["noise"]]
    measured = replace(stamp([], minutes=0.0, quick=False), command=command)
    made = limits.figures(of_noise, base, parts["heights"], measured)
    (out / limits.FIGURES.name).write_text(json.dumps(made, indent=1, allow_nan=False) + "\n")
    return [*_goals(out, base), *_things(out, base), *_noise(out, of_noise), *_varied(parts)]


def _few_tilts(rows: Sequence[Row]) -> list[Row]:
    return [r for r in rows if (r.case.roll_deg, r.case.pitch_deg) in FEW_TILTS_DEG]


def _run(name: str, todo: list[Case], settings: Settings) -> list[Row]:
    print(f"fidelity: {name}, {len(todo)} cases", file=sys.stderr)
    return run(todo, settings, name)


def _settings(name: str, jobs: int) -> Settings:
    return Settings(grids=PARTS[name].grids, jobs=jobs)


def _what(command: str) -> str:
    commands = ["    python -m benchmarks.fidelity.run " + command]
    commands += [
        f"    python -m benchmarks.fidelity.run --part {name} --held-out"
        for name in PARTS
        if "--part" in command and name != "base"
    ]
    again = (
        "Any case named below comes again, with a picture of what went wrong, by `python -m benchmarks.fidelity.draw_case`, for "
        "instance `--scenes trees --tilts 0:-30 --ke 0.005 --seed 103` for *trees +0/-30 ke 0.005 seed 103*."
    )
    return f"{INTRO}\n\nThe figures row by row:\n\n" + "\n".join(commands) + f"\n\n{again}"


def _goals(out: Path, base: Sequence[Row]) -> list[str]:
    plots.draw_goals(base, out / "fidelity_goals.png")
    plots.draw_heatmap(base, out / "fidelity_heatmap.png")
    said = ["## The goals", "![Worst and median case of each figure, as multiples of its goal](fidelity_goals.png)"]
    for ke in sorted({r.case.ke_per_m for r in base}):
        mine = [r for r in base if r.case.ke_per_m == ke]
        said += [f"### ke {ke:g}", "Bold: the worst case misses the goal.", tables.goals_table(mine)]
    said += [
        "### Where the worst cases are",
        "Figures with cases over the goal. The share over the rays of all cases together beside the worst case: a case with few "
        "rays has large shares.",
        tables.worst_table(base),
        "![Missed and phantom of each scene at each tilt](fidelity_heatmap.png)",
        "### Where no ground is found",
        "Worst case (all rays, or median): scenes without one, and frames that show too little of it.",
        tables.no_ground_table(base),
    ]
    return said


def _things(out: Path, base: Sequence[Row]) -> list[str]:
    plots.draw_thin(base, out / "fidelity_thin.png")
    return [
        "## Openings",
        "The largest free rectangle of each opening seen from less than 45 degrees aside. Kept: no smaller than it is "
        "by 0.2 m in width and 0.1 m in height, the paper's figure. Too large: by more than a pixel on each side. "
        "Openings narrower than 2 m or lower than 1 m are to be closed.",
        tables.openings_table(base),
        "## Thin things over range",
        "Kept: stopped within max(0.5 m, 2 sigma) of the truth, before or behind. Shares: "
        "[measured tables](../algorithm-measurements.md#thin-objects-width-range-noise).",
        "![Share of the rays of poles and wires that are kept, over range](fidelity_thin.png)",
    ]


def _noise(out: Path, rows: Sequence[Row]) -> list[str]:
    plots.draw_noise(rows, out / "fidelity_noise.png")
    plots.draw_ranges(rows, out / "fidelity_range.png")
    return [
        "## More noise, and the range to which it is safe",
        "ke 0.008 and 0.01 are a ZED at VGA or an OAK-D at 640x400; they are rows, not goals. Level, rolled and "
        "pitched by 30 degrees. Worst case (all rays, or median).",
        "![Error, missed and phantom over noise](fidelity_noise.png)",
        tables.varied(sorted(rows, key=lambda r: r.case.ke_per_m), lambda r: r.case.ke_per_m, "ke", "{:g}".format),
        "All obstacle rays up to a range together, and the range up to which both goals hold for them and for "
        "all nearer ones.",
        "![Missed and phantom rays over their true range](fidelity_range.png)",
        tables.range_table(rows),
    ]


def _varied(parts: dict[str, list[Row]]) -> list[str]:
    """The parts that vary one property."""

    def both(row: Row) -> tuple[float, float]:
        return row.case.ke_per_m, row.case.configured_ke_per_m

    few = "Twelve scenes that stand for the rest, level, rolled and pitched by 30 degrees. Worst case (all rays, or median)."
    configured = sorted(parts["configured"], key=both)
    estimated = max((r.ke_estimate_per_m / r.case.ke_per_m for r in configured if r.valid), default=math.nan)
    least = min((r.ke_estimate_per_m / r.case.ke_per_m for r in configured if r.valid), default=math.nan)
    return [
        "## Faults of the image, each alone",
        f"{few} Both noises.",
        tables.varied(parts["faults"], lambda r: r.case.faults, "faults"),
        "## Height above ground",
        "Scenes that show something from above too; level and pitched down by 10 and 30 degrees. Worst case (all rays, "
        "or median).",
        tables.varied(parts["heights"], lambda r: r.case.height_m, "height, m", "{:g}".format),
        "## Wrong configured noise",
        f"{few} The configured noise is a prior; the method measures {least:.2f} to {estimated:.2f} times the true one.",
        tables.varied(configured, both, "ke (configured)", lambda pair: f"{pair[0]:g} ({pair[1]:.2g})"),
    ]


def _write(out: Path, parts: dict[str, list[Row]]) -> None:
    """The figures of each part, family and noise as JSON: worst, median, all rays, and the worst case."""
    said: dict[str, Any] = {}
    for name, rows in parts.items():
        for family in FAMILIES:
            for ke in sorted({r.case.ke_per_m for r in rows}):
                mine = [r for r in rows if r.family == family and r.case.ke_per_m == ke]
                found = {m.name: summary(m, mine, m.goal(family)) for m in MEASURES}
                said.setdefault(name, {}).setdefault(family, {})[f"{ke:g}"] = {
                    key: {**_finite(s), "where": s.where.case.name} for key, s in found.items() if s is not None
                }
    (out / "fidelity.json").write_text(json.dumps(said, indent=1, allow_nan=False) + "\n")


def _finite(s: Summary) -> dict[str, float | int | None]:
    """The numbers of a summary to six digits; what JSON lacks becomes None."""
    shares = {"worst": s.worst, "median": s.median, "pooled": s.pooled}
    rounded = {key: float(f"{v:.6g}") if math.isfinite(v) else None for key, v in shares.items()}
    return {**rounded, "count": s.count, "over": s.over}


def main(arguments: list[str] | None = None) -> int:
    """`python -m benchmarks.fidelity.section --brief`: the shortened page in docs/research/benchmarks."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fidelity.section", description=main.__doc__)
    parser.add_argument("--brief", action="store_true", required=True, help="an eighth of the work; else: make bench")
    parser.add_argument(
        "--out", type=Path, default=Path("docs/research/benchmarks"), help="folder of the page and its pictures"
    )
    args = parser.parse_args(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    text = brief(args.out)
    minutes = (time.monotonic() - begun) / 60.0
    configured = replace(stamp([], minutes=minutes, quick=False), command=f"{parser.prog} --brief")
    section_of = next(s for s in SECTIONS if s.name == "fidelity")
    (args.out / "fidelity.md").write_text(page(section_of, text, configured))
    (args.out / INDEX).write_text(index(args.out))
    print(
        "docs/research/algorithm-measurements.md: run python -m benchmarks.fidelity.limits to update its tables",
        file=sys.stderr,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
