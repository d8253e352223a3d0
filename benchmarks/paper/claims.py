"""The paper's claims, one by one: what it says, what came out of ours and of its printed form, and whether that holds.

A verdict is computed from the rows of the experiments, never typed in. "yes": the claim holds in the median and in the
worst frame; "partly": in the median only, or in one of several points; "no": not even so."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from benchmarks.markdown import table
from benchmarks.paper import (
    interval as paper_interval,
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
from benchmarks.paper.cases import PRINTED, PRINTED_OPENINGS, Figures, grid_name, middle, number, percent, worst
from benchmarks.paper.interval import IntervalRow
from benchmarks.paper.openings import OpeningRow
from benchmarks.paper.shapes import ShapeRow
from benchmarks.paper.storage import COARSE, FINE
from benchmarks.paper.tilt import TiltRow
from benchmarks.paper.time import TimeRow
from benchmarks.peers.grid_prisms import CELLS_M

MUCH, SLIGHTLY, FAR_FEWER = 0.5, 1.25, 0.2
"""What we take the paper's words for: much lower, slightly larger (at most), far fewer."""
COLUMNS = (("safe", "exact"), ("safe", "camera"), ("paper", "exact"), ("paper", "camera"))
HEAD = ["claim", "ours, exact depth", "ours, camera", "printed form, exact depth", "printed form, camera"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """The rows of all experiments."""

    storage: list[Figures]
    tilt: list[TiltRow]
    interval: list[IntervalRow]
    times: list[TimeRow]
    shapes: list[ShapeRow]
    openings: list[OpeningRow]


@dataclass(frozen=True, slots=True)
class Claim:
    """says: the claim in our words, with the printed figures. cells: of COLUMNS, what was measured and the verdict."""

    says: str
    cells: tuple[str, ...]


def verdict(typical: bool, always: bool) -> str:
    """yes, partly or no."""
    return "**yes**" if typical and always else "**partly**" if typical or always else "**no**"


def below(values: list[float], limit: float, unit: str = "") -> str:
    """Median and worst of what must not exceed a limit, with the verdict."""
    if not [v for v in values if not math.isnan(v)]:
        return "-"
    typical, most = middle(values), worst(values)
    return f"{number(typical)}{unit} (worst {number(most)}{unit}): {verdict(typical <= limit, most <= limit)}"


def _each(cell: Callable[[str, str], str]) -> tuple[str, ...]:
    return tuple(cell(mode, condition) for mode, condition in COLUMNS)


def storage_claims(rows: list[Figures]) -> list[Claim]:
    """Figures 11, 12 and 14."""

    def ratio(kind: str, against: str, field: str) -> Callable[[str, str], list[float]]:
        return lambda mode, condition: paper_storage.ratios(rows, kind, condition, mode, against, field)

    planes, errors = ratio("structured", COARSE, "planes"), ratio("structured", FINE, "mean_m")
    rough_coarse, rough_fine = ratio("unstructured", COARSE, "planes"), ratio("unstructured", FINE, "planes")
    rough_errors = ratio("unstructured", FINE, "mean_m")

    def fewer(mode: str, condition: str) -> str:
        found = planes(mode, condition) + rough_coarse(mode, condition)
        if not found:
            return "-"
        typical, best = 1.0 - middle(found), 1.0 - min(found)
        said = PRINTED["fewer_planes_than_0.8"]
        return (
            f"{percent(typical, 0)} % in the median, up to {percent(best, 0)} %: {verdict(best >= said, best >= said)}"
        )

    return [
        Claim(
            "Fig. 11a: structured scenes take fewer planes than the grid of any cell (planes / 0.8 m grid)",
            _each(lambda m, c: below(planes(m, c), 1.0)),
        ),
        Claim(
            "Fig. 11b: unstructured scenes take slightly more planes than the 0.8 m grid (planes / 0.8 m grid)",
            _each(lambda m, c: below(rough_coarse(m, c), SLIGHTLY)),
        ),
        Claim(
            "Fig. 11b: and far fewer than the 0.1 m grid (planes / 0.1 m grid)",
            _each(lambda m, c: below(rough_fine(m, c), FAR_FEWER)),
        ),
        Claim(
            "Fig. 12a: the error of structured scenes is much lower than the 0.1 m grid's (error / 0.1 m grid)",
            _each(lambda m, c: below(errors(m, c), MUCH)),
        ),
        Claim(
            "Fig. 12b: the error of unstructured scenes is slightly larger than the 0.1 m grid's (error / 0.1 m grid)",
            _each(lambda m, c: below(rough_errors(m, c), SLIGHTLY)),
        ),
        Claim("Fig. 14: up to 40 % fewer planes of a frame than the 0.8 m grid (both kinds)", _each(fewer)),
        Claim("Fig. 11, 12: a coarser grid takes fewer planes and has a greater error", _grids(rows)),
    ]


def _grids(rows: list[Figures]) -> tuple[str, ...]:
    """The claim about the grid itself: once an exact, once a camera column."""
    cells = []
    for condition in ("exact", "camera"):
        good = []
        for kind in paper_storage.KINDS:
            found = [paper_storage.of(rows, kind, condition, grid_name(cell)) for cell in CELLS_M]
            planes = [middle([float(r.planes) for r in mine]) for mine in found]
            errors = [middle([r.mean_m for r in mine]) for mine in found]
            good.append(planes == sorted(planes, reverse=True) and errors == sorted(errors))
        cells.append(f"grid: {verdict(any(good), all(good))}")
    return (*cells, "", "")


def tilt_claims(rows: list[TiltRow]) -> list[Claim]:
    """Figure 10."""

    def cell(mode: str, condition: str) -> str:
        level = paper_tilt.of(rows, "roll", 0.0, mode, condition)
        if not level:
            return "-"
        flat, good, parts = middle([f.mean_m for f in level]), [], []
        missed_level = middle([f.missed for f in level])
        for axis, angle in paper_tilt.PAPERS_DEG.items():
            mine = paper_tilt.of(rows, axis, angle, mode, condition)
            error, missed = middle([f.mean_m for f in mine]), middle([f.missed for f in mine])
            good.append(error <= 1.5 * flat and missed <= missed_level + 0.01)
            parts.append(f"{number(error, 3)} m")
        return f"level {number(flat, 3)} m, rolled {parts[0]}, nose down {parts[1]}: {verdict(any(good), all(good))}"

    return [
        Claim(
            "Fig. 10: works at 30° of roll and of pitch (median error at most half as much again as level, at most 1 % "
            "more rays missed)",
            _each(cell),
        )
    ]


def time_claims(rows: list[TimeRow]) -> list[Claim]:
    """Figure 13 a, b and the processing times; all under a camera's noise."""

    def ms(kind: str, method: str, step: int = 1) -> float:
        row = paper_time.of(rows, kind, method, step)
        return math.nan if row is None else row.cpu_ms

    def both(limit: Callable[[str], float], good: Callable[[float, float], bool], mode: str) -> str:
        values = {kind: ms(kind, mode) for kind in paper_time.SCENES}
        fits = [good(value, limit(kind)) for kind, value in values.items()]
        words = ", ".join(f"{kind} {number(value, 1)} ms" for kind, value in values.items())
        return f"{words}: {verdict(any(fits), all(fits))}"

    def columns(cell: Callable[[str], str]) -> tuple[str, ...]:
        return ("", cell("safe"), "", cell("paper"))

    def falls(mode: str) -> str:
        fits, words = [], []
        for kind in paper_time.SCENES:
            curve = [ms(kind, mode, step) for step in sorted({r.step for r in rows})]
            fits.append(all(b <= 1.05 * a for a, b in pairwise(curve)) and curve[-1] < curve[0])
            words.append(f"{kind} {number(curve[0], 1)} to {number(curve[-1], 1)} ms")
        return f"{', '.join(words)}: {verdict(any(fits), all(fits))}"

    fine = {kind: ms(kind, FINE) for kind in paper_time.SCENES}
    coarse = {kind: ms(kind, COARSE) for kind in paper_time.SCENES}
    said = ", ".join(f"{kind} {number(fine[kind], 1)} and {number(coarse[kind], 1)} ms" for kind in fine)
    return [
        Claim(
            f"Processing time: {PRINTED['osape_ms']:g} ± {PRINTED['osape_sd_ms']:g} ms for 640x480 (its processor, not ours)",
            columns(lambda m: both(lambda _: PRINTED["osape_ms"], lambda t, limit: t <= limit, m)),
        ),
        Claim(
            f"Fig. 13a: about as fast as the 0.8 m grid ({PRINTED['osape_ms']:g} to {PRINTED['grid_0.8_ms']:g} ms); our "
            f"grids of 0.1 and 0.8 m take {said}",
            columns(lambda m: both(lambda kind: coarse[kind], lambda t, limit: t <= SLIGHTLY * limit, m)),
        ),
        Claim(
            f"Fig. 13a: far faster than the 0.1 m grid ({PRINTED['grid_0.1_ms']:g} ms)",
            columns(lambda m: both(lambda kind: fine[kind], lambda t, limit: t <= MUCH * limit, m)),
        ),
        Claim("Fig. 13b: a greater sampling interval takes less time", columns(falls)),
    ]


def interval_claims(rows: list[IntervalRow]) -> list[Claim]:
    """Figure 13 c."""
    steps, noises = paper_interval.steps(rows), paper_interval.noises(rows)

    def over_steps(mode: str) -> str:
        fits, words = [], []
        for ke in noises:
            ends = [middle([f.mean_m for f in paper_interval.of(rows, mode, s, ke)]) for s in (steps[0], steps[-1])]
            fits.append(ends[1] > ends[0])
            words.append(f"ke {ke:g}: {number(ends[0], 3)} to {number(ends[1], 3)} m")
        return f"{'; '.join(words)}: {verdict(any(fits), all(fits))}"

    def over_noise(mode: str) -> str:
        fits = []
        for step in steps:
            ends = [
                middle([f.mean_m for f in paper_interval.of(rows, mode, step, ke)]) for ke in (noises[0], noises[-1])
            ]
            fits.append(ends[1] > ends[0])
        ends = [middle([f.mean_m for f in paper_interval.of(rows, mode, 1, ke)]) for ke in (noises[0], noises[-1])]
        words = f"{number(ends[0], 3)} to {number(ends[1], 3)} m from ke {noises[0]:g} to {noises[-1]:g}"
        return f"{words}: {verdict(any(fits), all(fits))}"

    return [
        Claim(
            f"Fig. 13c: a greater sampling interval costs accuracy (error, every {steps[0]}. to every {steps[-1]}. column)",
            ("", over_steps("safe"), "", over_steps("paper")),
        ),
        Claim("Fig. 13c: so does more noise (error, every column)", ("", over_noise("safe"), "", over_noise("paper"))),
    ]


def opening_claims(rows: list[OpeningRow]) -> list[Claim]:
    """Figure 8. The printed form is not judged: how reserved gaps split a wall is not printed, and ours does not do it."""

    def size(opening: str, condition: str) -> str:
        mine = paper_openings.of(rows, opening, condition, "safe")
        if not mine:
            return "-"
        (true_w, true_h), (printed_w, printed_h) = PRINTED_OPENINGS[opening]
        width, height = middle([r.width_m for r in mine]), middle([r.height_m for r in mine])
        least_w, least_h = min(r.width_m for r in mine), min(r.height_m for r in mine)
        largest = all(r.width_m <= true_w and r.height_m <= true_h for r in mine)
        typical = width >= printed_w and height >= printed_h and largest
        always = least_w >= printed_w and least_h >= printed_h and largest
        over = "" if largest else ", larger than it is in some"
        return f"{width:.2f} x {height:.2f} m (least {least_w:.2f}, {least_h:.2f}){over}: {verdict(typical, always)}"

    def slit(condition: str) -> str:
        mine = paper_openings.of(rows, "slit", condition, "safe")
        filled = [r.free_share < 0.02 for r in mine]
        return f"{sum(filled)} of {len(filled)}: {verdict(any(filled), all(filled))}" if mine else "-"

    out = []
    for opening, (true, printed) in PRINTED_OPENINGS.items():
        says = f"Fig. 8: the {opening} of {true[0]:g} x {true[1]:g} m comes out {printed[0]:g} x {printed[1]:g} m, never larger than it is"
        out.append(Claim(says, (size(opening, "exact"), size(opening, "ke 0.0015"), "not judged", "not judged")))
    says = "Gaps that the vehicle cannot pass are filled (a slit of 1.2 x 0.6 m)"
    return [*out, Claim(says, (slit("exact"), slit("ke 0.0015"), "not judged", "not judged"))]


def shape_claims(rows: list[ShapeRow]) -> list[Claim]:
    """Figure 15."""

    def cell(mode: str) -> str:
        fits, words = [], []
        for shape in paper_shapes.SHAPES:
            mine = paper_shapes.of(rows, shape, mode)
            error, grid = middle([r.mean_m for r in mine]), middle([r.grid_error_m for r in mine])
            few = middle([float(r.planes) for r in mine]) <= middle([float(r.grid_planes) for r in mine])
            fits.append(few and error <= grid)
            words.append(f"{shape} {number(error, 2)} m, {middle([float(r.planes) for r in mine]):.0f} planes")
        return f"{'; '.join(words)}: {verdict(any(fits), all(fits))}"

    says = "Fig. 15: cylinder, trapezoidal prism and sphere become prisms (error below the 0.1 m grid's, no more planes than the 0.8 m grid's)"
    return [Claim(says, ("", cell("safe"), "", cell("paper")))]


def claims(r: Results) -> list[Claim]:
    """All claims that can be judged here."""
    return [
        *opening_claims(r.openings),
        *tilt_claims(r.tilt),
        *storage_claims(r.storage),
        *time_claims(r.times),
        *interval_claims(r.interval),
        *shape_claims(r.shapes),
    ]


def claims_table(found: list[Claim]) -> str:
    """All of them as Markdown."""
    return table(HEAD, [[c.says, *c.cells] for c in found], words=5)


def counted(found: list[Claim], column: int) -> dict[str, int]:
    """How many cells of a column of COLUMNS say yes, partly and no."""
    cells = [c.cells[column] for c in found]
    return {word: sum(cell.endswith(f"**{word}**") for cell in cells) for word in ("yes", "partly", "no")}
