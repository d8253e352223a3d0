"""The paper's experiments in one run: pictures and a page for docs/research/benchmarks, and the judged claims in docs/research/paper.md.

Run `python -m benchmarks.paper.section`, or with --quick, --only PART (the other parts are taken from the last run),
--out FOLDER, --doc FILE. `make bench` runs the same as one of its sections."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.hardware_info import CHECKOUT, stamp
from benchmarks.paper import (
    equations as paper_equations,
)
from benchmarks.paper import (
    geometry as paper_geometry,
)
from benchmarks.paper import (
    interval as paper_interval,
)
from benchmarks.paper import (
    modes as paper_modes,
)
from benchmarks.paper import (
    openings as paper_openings,
)
from benchmarks.paper import (
    shapes as paper_shapes,
)
from benchmarks.paper import (
    storage as paper_storage,
)
from benchmarks.paper import (
    tilt as paper_tilt,
)
from benchmarks.paper import (
    time as paper_time,
)
from benchmarks.paper.cases import Figures, held_out, progress
from benchmarks.paper.claims import HEAD, Results, claims, claims_table, counted
from benchmarks.paper.equations import Finding
from benchmarks.paper.interval import IntervalRow
from benchmarks.paper.openings import OpeningRow
from benchmarks.paper.shapes import ShapeRow
from benchmarks.paper.tilt import TiltRow
from benchmarks.paper.time import TimeRow

OUT = CHECKOUT / "docs" / "research" / "benchmarks"
DOC = CHECKOUT / "docs" / "research" / "paper.md"
ROWS = CHECKOUT / "bench-out"
"""Where the rows of the last run are kept, so that one part can be measured again; not in git."""
BEGIN, END = "<!-- measured: {name} -->", "<!-- end of {name} -->"

Json = dict[str, Any]
PARTS: dict[str, Callable[[bool], list[Any]]] = {
    "times": paper_time.run,
    "storage": paper_storage.run,
    "tilt": paper_tilt.run,
    "interval": paper_interval.run,
    "shapes": paper_shapes.run,
    "openings": paper_openings.run,
    "findings": lambda quick: [
        *paper_equations.findings(),
        *paper_geometry.findings(),
        *paper_modes.findings(quick),
    ],
}
"""What is measured, in the order in which it runs: times first, before the memory has filled."""


def section(out: Path, quick: bool) -> str:
    """Measures everything, draws the pictures into `out` and returns the page; a full run into the folder of the
    documentation also rewrites the claims in docs/research/paper.md."""
    out.mkdir(parents=True, exist_ok=True)
    data = measured(ROWS, quick, list(PARTS))
    if not quick and out.resolve() == OUT.resolve() and DOC.is_file():
        DOC.write_text(filled(DOC.read_text(), blocks(data)))
    return page(data, out)


def measured(folder: Path, quick: bool, parts: list[str]) -> Json:
    """The rows of all parts: those named are run, the others taken from the last run. What is there is kept after each
    part, so that a run that was cut short goes on with the parts that are missing. Raises FileNotFoundError where a part
    was never run."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = rows_file(folder, quick)
    data: Json = json.loads(kept.read_text()) if kept.is_file() and set(parts) != set(PARTS) else {}
    for name, run in PARTS.items():
        if name in parts:
            begun = time.monotonic()
            data[name] = [asdict(row) for row in run(quick)]
            progress(f"{name}: {len(data[name])} rows in {time.monotonic() - begun:.0f} s")
            print(file=sys.stderr)
            kept.write_text(json.dumps(data, indent=0))
    missing = [name for name in PARTS if name not in data]
    if missing:
        raise FileNotFoundError(f"{kept}: holds no {', '.join(missing)}; run those too (--only {missing[0]} ...)")
    return data


def rows_file(folder: Path, quick: bool) -> Path:
    """The rows of the last quick, or full, run."""
    return folder / ("paper-quick.json" if quick else "paper.json")


def results(data: Json) -> Results:
    """The rows as what they were."""
    return Results(
        storage=[Figures(**row) for row in data["storage"]],
        tilt=[TiltRow(**{**row, "figures": Figures(**row["figures"])}) for row in data["tilt"]],
        interval=[IntervalRow(**{**row, "figures": Figures(**row["figures"])}) for row in data["interval"]],
        times=[TimeRow(**row) for row in data["times"]],
        shapes=[ShapeRow(**row) for row in data["shapes"]],
        openings=[OpeningRow(**row) for row in data["openings"]],
    )


def summary(data: Json) -> str:
    """How many claims hold, by form and kind of depth."""
    found = claims(results(data))
    parts = []
    for column, words in enumerate(HEAD[1:]):
        n = counted(found, column)
        parts.append(f"{words}: {n['yes']} hold, {n['partly']} partly, {n['no']} do not")
    return f"{len(found)} claims of the paper, each judged where it can be. {'; '.join(parts)}."


def blocks(data: Json) -> dict[str, str]:
    """The measured pieces of docs/research/paper.md by name."""
    header = stamp([], minutes=0.0, quick=False)
    return {
        "stamp": f"Measured on {header.date} at commit {header.commit}, {header.host_info}, by `make bench ARGS='--only paper'`.",
        "summary": summary(data),
        "claims": claims_table(claims(results(data))),
    }


def filled(text: str, pieces: dict[str, str]) -> str:
    """A document with the pieces between their marks renewed; marks without a piece keep what they hold."""
    for name, piece in pieces.items():
        begin, end = BEGIN.format(name=name), END.format(name=name)
        if begin in text and end in text:
            head, rest = text.split(begin, 1)
            tail = rest.split(end, 1)[1]
            text = f"{head}{begin}\n{piece}\n{end}{tail}"
    return text


def page(data: Json, out: Path) -> str:
    """The page of docs/research/benchmarks, its pictures drawn into `out`."""
    r = results(data)
    paper_openings.draw(r.openings, out / "paper_openings.png")
    paper_tilt.draw(r.tilt, out / "paper_tilt.png")
    paper_storage.draw(r.storage, out / "paper_storage.png", "planes", "planes of a frame", log=True)
    paper_storage.draw(r.storage, out / "paper_precision.png", "mean_m", "mean error, m", log=True)
    paper_time.draw(r.times, out / "paper_time.png")
    paper_interval.draw(r.interval, out / "paper_interval.png")
    paper_shapes.draw(out / "paper_shapes.png", held_out(1)[0])
    equations = "\n\n".join(f"### {f['title']}\n\n{Finding(**f).markdown()}" for f in data["findings"])
    return PAGE.format(
        summary=summary(data),
        openings=paper_openings.tables(r.openings),
        tilt=paper_tilt.tables(r.tilt),
        storage=paper_storage.tables(r.storage),
        times=paper_time.tables(r.times),
        interval=paper_interval.tables(r.interval),
        shapes=paper_shapes.tables(r.shapes),
        equations=equations,
    )


PAGE = """{summary}

*Ours* is the extractor that flies, *as printed* is `benchmarks/paper/printed` with constants that the paper's text does not give chosen as in
ours. *Exact depth* is what a game engine gives, as the paper's simulator did; *camera* is noise of sigma = 0.0015 Z² with
5 % dropout, holes, mismatches and flying pixels. Scenes and seeds are held out from tuning. *Missed*: obstacle rays that
the model lets pass; *phantom*: rays stopped where nothing is; *open stopped*: rays without an obstacle behind that are
stopped all the same. Each claim with its judgement: [paper.md](../paper.md#the-claims). Again, a part at a time:
`python -m benchmarks.paper.section --only tilt`.

## Openings (Fig. 8)

{openings}

![Size of both openings in the model over the distance of the wall](paper_openings.png)

## Tilt (Fig. 10)

{tilt}

![Error, planes and missed rays over roll and pitch](paper_tilt.png)

## Storage and precision (Fig. 11, 12, 14)

{storage}

![Planes of a frame](paper_storage.png)
![Mean error](paper_precision.png)

## Processing time (Fig. 13 a, b)

{times}

![Time over grid cell and over sampling interval](paper_time.png)

## Sampling interval and noise (Fig. 13 c)

{interval}

![Error over sampling interval and noise, poles over the interval](paper_interval.png)

## Shapes (Fig. 15)

{shapes}

![The three shapes from above](paper_shapes.png)

## The equations

{equations}
"""


def main(arguments: list[str] | None = None) -> int:
    """Runs the parts, writes the pictures, the claims of the document and, with --page, the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.paper.section", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="few frames; figures are rough")
    parser.add_argument("--only", action="append", choices=[*PARTS, "none"], help="run this part; may be given again")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the pictures")
    parser.add_argument("--rows", type=Path, default=ROWS, help="folder of the rows of the last run")
    parser.add_argument("--doc", type=Path, default=DOC, help="document whose measured pieces are renewed")
    parser.add_argument("--page", type=Path, help="write the page there too")
    args = parser.parse_args(arguments)
    parts = list(PARTS) if not args.only else [p for p in args.only if p != "none"]
    try:
        data = measured(args.rows, args.quick, parts)
    except FileNotFoundError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    args.out.mkdir(parents=True, exist_ok=True)
    text = page(data, args.out)
    if args.page:
        args.page.write_text(text)
    if args.doc.is_file():
        args.doc.write_text(filled(args.doc.read_text(), blocks(data)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
