"""Writes docs/research/sharing.md: `python -m benchmarks.sharing [--out FILE] [--quick]`."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.hardware_info import stamp
from benchmarks.sharing.measure import IN_TIME_S, WINDOW_S, Figures, run
from benchmarks.sharing.pairs import ASTRAY_M, LEAST_OVERLAP, Pair
from benchmarks.sharing.radio import Channel
from benchmarks.speed.tables import table

OUT = Path("docs/research/sharing.md")
BUDGETS = {"street": 300.0, "trees": 1000.0}


@dataclasses.dataclass(frozen=True, slots=True)
class Case:
    """One line of the table. processes: in real time, each vehicle and the radio a process."""

    scene: str
    vehicles: int
    seeds: tuple[int, ...]
    same_way: bool = False
    processes: bool = False


CASES = (
    Case("street", 2, (1, 2, 3)),
    Case("street", 2, (1, 2), same_way=True),
    Case("street", 5, (1, 2)),
    Case("trees", 2, (1, 2)),
    Case("trees", 2, (1,), same_way=True),
    Case("trees", 5, (1, 2)),
    Case("street", 2, (1, 2, 3), processes=True),
    Case("street", 5, (1, 2), processes=True),
    Case("trees", 2, (1, 2), processes=True),
    Case("trees", 5, (1, 2), processes=True),
)
CHANNEL = Channel()

HEAD = f"""# Sharing measurements

Simulated vehicles, each with its merged world and the sharing part of the service, over signed MAVLink TUNNEL messages on one simulated radio, in simulated time; lines with *processes* in real time, each vehicle and the radio a process of its own: {CHANNEL.loss:.0%} of the datagrams are lost for each receiver, {CHANNEL.bytes_per_s:.0f} B/s for all vehicles together, {1000 * CHANNEL.delay_s:.0f} ms of delay. Each vehicle flies 26 m of a street or of a row of trees at 2 m/s, every second one in the opposite direction (it then sees other sides of what stands across the street), or all *the same way*; neighbours have 18 m in common. Position and attitude have 5 cm and 0.3 degrees of noise. The local frames are tens of metres apart and turned by up to 2 degrees each, which the vehicles do not know; the stated origins of two vehicles are 3 m wrong against each other, those of five 1.5 m each.
"""
MEANING = f"""*Rate*: the vehicle that sent most, greatest over {WINDOW_S:g} s and mean over the flight, with the overhead and the signatures of MAVLink. *Delay*: from the third frame that observes a plane (`least_hits`) until another vehicle publishes planes that contain it within 0.5 m (the stream has 5 Hz, up to 10 Hz while packets arrive), all receivers, of the planes that it did not have yet, confirmed later than 5 s after the start; *with start*: p95 of all, with those that are in view at the start, all at once. *In time*: those that arrive within {IN_TIME_S:g} s, of all that are new in flight. *Never*: those that were not contained in the end. *Missed*: obstacle rays from places that no flight contains that pass more than max(0.5 m, 2 sigma) behind what is there, of what any vehicle has seen, by the first vehicle alone, by its own planes with those of its neighbours, and by one vehicle that flew all parts; *with margins*: that pass behind planes that are longer by their margins at both ends and nearer by them in front; a planner uses them in all directions. *Aligned*: pairs of receiver and sender whose frame is aligned by planes in the end, of those where the receiver has observed at least {LEAST_OVERLAP:.0%} of the obstacle points that the sender has observed, and of the others; error of the place at the middle of the common points, and of the yaw, median / worst; *place / stated*: worst error of the place over the 2 sigma that the margins contain; *plane / margin*: greatest distance by which the alignment displaces an end of a plane, over the margin of the plane; *astray*: planes of aligned senders that are published farther than their margin and {ASTRAY_M:g} m from all planes of the sender's own world, at their exact place.
"""


NOTES = "## What limits the figures"
"""The page is written by hand from this heading on; what is measured anew leaves it as it is."""


def main() -> int:
    """0: the page was written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sharing", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--quick", action="store_true", help="one run of two vehicles")
    args = parser.parse_args()
    begun = time.monotonic()
    found = []
    for case in CASES[:1] if args.quick else CASES:
        for seed in case.seeds[:1] if args.quick else case.seeds:
            figures = run(
                case.scene,
                case.vehicles,
                seed,
                BUDGETS[case.scene],
                CHANNEL,
                same_way=case.same_way,
                processes=case.processes,
            )
            print(figures, file=sys.stderr, flush=True)
            found.append(figures)
            write(args.out, found, begun, quick=args.quick)  # what is measured so far
    return 0


def write(out: Path, found: Sequence[Figures], begun: float, *, quick: bool) -> None:
    """Writes the page."""
    minutes = (time.monotonic() - begun) / 60.0
    made = stamp(["--quick"] if quick else [], minutes=minutes, quick=quick)
    made = dataclasses.replace(made, command=made.command.replace("benchmarks", "benchmarks.sharing", 1))
    out.parent.mkdir(parents=True, exist_ok=True)
    notes = _notes_of(out)
    out.write_text("\n".join([HEAD, made.markdown(), tables(found), notes]))


def _notes_of(page: Path) -> str:
    """The part of the page that is written by hand; empty: there is none."""
    _, heading, notes = (page.read_text() if page.exists() else "").partition(f"{NOTES}\n")
    return heading + notes


def tables(found: Sequence[Figures]) -> str:
    """The table with its goals."""
    rows = [_row(f) for f in found]
    head = [
        "scene", "vehicles", "rate, B/s", "mean", "delay p50, s", "p95, s", "max, s", "with start p95, s", "in time, %", "never, %", "rays",
        "missed alone, %", "joint, %", "one vehicle, %", "joint / one", "joint with margins, %", "one with margins, %", "aligned, views overlap", "others", "place, m", "yaw, deg", "place / stated", "plane / margin", "astray, %",
    ]  # fmt: skip
    goals = (
        "Goals: at most 300 B/s in a street and 1 kB/s past trees; 0.5 s until a neighbour has a new obstacle; joint / one at most "
        "1.1; alignment within 0.3 m and 1 degree where the views overlap.\n"
    )
    return "\n".join([table(head, rows), MEANING, goals])


def _row(f: Figures) -> list[str]:
    p50, p95, most = f.latency_s
    ratio = f"{f.joint.share / f.one.share:.2f}" if f.one.share else "" if f.joint.share else "1.00"
    return [
        f.scene, str(f.vehicles), f"{f.rate:.0f}", f"{f.mean_rate:.0f}", f"{p50:.2f}", f"{p95:.2f}", f"{most:.2f}",
        f"{f.start_s:.2f}", f"{100 * f.in_time:.1f}",
        f"{100 * f.never:.1f}", f"{f.joint.rays}", *(f"{100 * m.share:.2f}" for m in (f.alone, f.joint, f.one)), ratio,
        f"{100 * f.joint.with_margins:.2f}", f"{100 * f.one.with_margins:.2f}", *_alignment(f.pairs),
    ]  # fmt: skip


def _alignment(pairs: Sequence[Pair]) -> list[str]:
    """Cells of the pairs."""
    groups = [[p for p in pairs if (p.overlap >= LEAST_OVERLAP) == overlap] for overlap in (True, False)]
    counts = [f"{sum(p.aligned for p in group)} of {len(group)}" for group in groups]
    aligned = [p for p in pairs if p.aligned]
    if not aligned:
        return [*counts, "", "", "", "", ""]
    place, yaw = (sorted(getattr(p, name) for p in aligned) for name in ("place_m", "yaw_deg"))
    beyond = max(p.place_m / p.told_m for p in aligned)
    return [
        *counts,
        f"{median(place):.2f} / {place[-1]:.2f}",
        f"{median(yaw):.2f} / {yaw[-1]:.2f}",
        f"{beyond:.2f}",
        f"{max(p.of_margin for p in aligned):.2f}",
        f"{100 * max(p.astray for p in aligned):.1f}",
    ]


if __name__ == "__main__":
    sys.exit(main())
