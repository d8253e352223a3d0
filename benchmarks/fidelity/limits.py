"""The tables of docs/research/algorithm-measurements.md that are measured by the fidelity section.

`python -m benchmarks.fidelity.limits` writes them from docs/research/benchmarks/limits.json. The fidelity section writes
both."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from benchmarks.fidelity.goals import Summary, measure, summary
from benchmarks.fidelity.result import Row
from benchmarks.fidelity.tables import number
from benchmarks.fidelity.thin import STEP_M, THINGS, curve
from benchmarks.hardware_info import CHECKOUT, Stamp
from benchmarks.markdown import table

FIGURES: Final = CHECKOUT / "docs/research/benchmarks/limits.json"
PAGE: Final = CHECKOUT / "docs/research/algorithm-measurements.md"
FAMILIES: Final = {"structured": "structured (walls, houses)", "unstructured": "unstructured (trees, rubble)"}
TO_M: Final = (4, 8, 12, 16)

Figures = Mapping[str, Any]
"""Of `figures`, as JSON holds it."""


def figures(ranges: Sequence[Row], thin: Sequence[Row], heights: Sequence[Row], stamp: Stamp) -> dict[str, Any]:
    """The figures of the tables. ranges: rows at several noises; thin: rows with poles and wires; heights: rows at several
    heights above ground."""
    return {
        "measured": {"date": stamp.date, "commit": stamp.commit, "command": stamp.command},
        "thin": _thin(thin),
        "ranges": _ranges(ranges),
        "heights": _heights(heights),
    }


def _thin(rows: Sequence[Row]) -> list[dict[str, Any]]:
    return [
        {"object": title, "ke": ke, "from_m": point.from_m, "kept": round(point.kept, 4), "count": point.things}
        for title, scenes, prefix in THINGS
        for ke in sorted({r.case.ke_per_m for r in rows})
        for point in curve([r for r in rows if r.case.ke_per_m == ke], scenes, prefix)
    ]


def _ranges(rows: Sequence[Row]) -> list[dict[str, Any]]:
    found = []
    for family in FAMILIES:
        for ke in sorted({r.case.ke_per_m for r in rows}):
            some = [r for r in rows if r.family == family and r.case.ke_per_m == ke and r.valid]
            shares = [_up_to(some, limit_m) for limit_m in TO_M]
            if some:
                found.append({"family": family, "ke": ke, "missed_phantom": shares})
    return found


def _up_to(rows: Sequence[Row], limit_m: int) -> list[float] | None:
    """Shares of the obstacle rays up to a range that are (missed, phantom); None: no rays."""
    obstacle = sum(sum(r.by_range.obstacle[:limit_m]) for r in rows)
    if not obstacle:
        return None
    missed = sum(sum(r.by_range.missed[:limit_m]) for r in rows)
    phantom = sum(sum(r.by_range.phantom[:limit_m]) for r in rows)
    return [round(missed / obstacle, 7), round(phantom / obstacle, 6)]


def _heights(rows: Sequence[Row]) -> list[dict[str, Any]]:
    found = []
    for height_m in sorted({r.case.height_m for r in rows}):
        line: dict[str, Any] = {"height_m": height_m}
        for family in FAMILIES:
            some = [r for r in rows if r.family == family and r.case.height_m == height_m]
            for name in ("missed", "phantom"):
                line[f"{family} {name}"] = _worst(summary(measure(name), some))
        found.append(line)
    return found


def _worst(s: Summary | None) -> list[float] | None:
    """(worst frame, all rays), percent; None: no frame."""
    return None if s is None else [float(f"{s.worst:.6g}"), float(f"{s.pooled:.6g}")]


def thin_table(data: Figures) -> str:
    """Recall of thin objects over range."""
    steps = sorted({p["from_m"] for p in data["thin"]})
    lines = []
    for title, ke in dict.fromkeys((p["object"], p["ke"]) for p in data["thin"]):
        mine = {p["from_m"]: p["kept"] for p in data["thin"] if (p["object"], p["ke"]) == (title, ke)}
        lines.append([title, f"{ke:g}", *(f"{100 * mine[m]:.0f} %" if m in mine else "-" for m in steps)])
    return table(["object", "noise", *(f"{m:.0f}-{m + STEP_M:.0f} m" for m in steps)], lines)


def range_table(data: Figures) -> str:
    """Missed and phantom rays up to each range."""
    lines = [
        [FAMILIES[line["family"]], f"{line['ke']:g}", *(_pair(pair) for pair in line["missed_phantom"])]
        for line in data["ranges"]
    ]
    return table(["scenes", "noise", *(f"to {m} m" for m in TO_M)], lines)


def _pair(pair: Sequence[float] | None) -> str:
    return "-" if pair is None else f"{100 * pair[0]:.3f} / {100 * pair[1]:.2f}"


def height_table(data: Figures) -> str:
    """Missed and phantom rays over the height above ground."""
    columns = [f"{family} {name}" for family in FAMILIES for name in ("missed", "phantom")]
    lines = [
        [
            f"{line['height_m']:g} m",
            *("-" if line[c] is None else f"{number(line[c][0])} ({number(line[c][1])})" for c in columns),
        ]
        for line in data["heights"]
    ]
    return table(["height", *columns], lines)


def source(data: Figures) -> str:
    """Where the tables come from."""
    run = data["measured"]
    return f"Measured by `{run['command']}`, {run['date']}, commit {run['commit']}."


BLOCKS: Final[Mapping[str, Callable[[Figures], str]]] = {
    "thin": thin_table,
    "ranges": range_table,
    "heights": height_table,
    "source": source,
}


def fill(text: str, data: Figures) -> str:
    """The page with each block between `<!-- measured: NAME -->` and `<!-- end -->` replaced.

    Raises ValueError where the page does not contain a block."""
    for name, write in BLOCKS.items():
        pattern = rf"(?<=<!-- measured: {name} -->\n).*?(?=\n<!-- end -->)"
        text, count = re.subn(pattern, write(data).replace("\\", r"\\"), text, flags=re.DOTALL)
        if count == 0:
            raise ValueError(f"{PAGE.name}: no block '<!-- measured: {name} -->' ... '<!-- end -->': add it")
    return text


def main() -> int:
    """Writes docs/research/algorithm-measurements.md."""
    PAGE.write_text(fill(PAGE.read_text(), json.loads(FIGURES.read_text())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
