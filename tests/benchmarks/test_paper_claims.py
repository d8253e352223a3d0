"""Verdicts from rows made by hand: what holds, what holds in part, what does not."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from benchmarks.paper.cases import Figures, grid_name
from benchmarks.paper.claims import (
    COLUMNS,
    Claim,
    below,
    counted,
    interval_claims,
    opening_claims,
    shape_claims,
    storage_claims,
    tilt_claims,
    time_claims,
    verdict,
)
from benchmarks.paper.interval import IntervalRow
from benchmarks.paper.openings import OpeningRow
from benchmarks.paper.shapes import ShapeRow
from benchmarks.paper.storage import of, ratios
from benchmarks.paper.tilt import TiltRow
from benchmarks.paper.time import TimeRow
from benchmarks.peers.grid_prisms import CELLS_M

FRAME = Figures(
    scene="a",
    family="structured",
    condition="camera",
    seed=1,
    method="safe",
    planes=10,
    bytes=80,
    mean_m=0.1,
    missed=0.0,
    phantom=0.0,
    open_stopped=0.0,
)


def cell_of(claims: list[Claim], start: str, mode: str, condition: str) -> str:
    return next(c for c in claims if c.says.startswith(start)).cells[COLUMNS.index((mode, condition))]


def storage(planes: dict[str, int], errors: dict[str, float], family: str) -> list[Figures]:
    methods = ("safe", *(grid_name(cell) for cell in CELLS_M))
    return [replace(FRAME, family=family, method=m, planes=planes[m], mean_m=errors[m]) for m in methods]


def test_a_verdict_needs_the_worst_too() -> None:
    assert (verdict(True, True), verdict(True, False), verdict(False, False)) == ("**yes**", "**partly**", "**no**")
    assert below([0.5, 0.9, math.nan], 1.0) == "0.70 (worst 0.90): **yes**"
    assert below([0.5, 1.1, 0.7], 1.0).endswith("**partly**")
    assert below([1.2, 1.1], 1.0).endswith("**no**")
    assert below([math.nan], 1.0) == "-"


def test_ratios_are_taken_frame_by_frame() -> None:
    rows = [
        replace(FRAME, planes=5),
        replace(FRAME, method="grid 0.8 m", planes=10),
        replace(FRAME, scene="b", planes=6),
        replace(FRAME, scene="b", method="grid 0.8 m", planes=4),
        replace(FRAME, scene="c", planes=6),
        replace(FRAME, scene="c", method="grid 0.8 m", planes=0),
    ]
    assert ratios(rows, "structured", "camera", "safe", "grid 0.8 m", "planes") == [0.5, 1.5]
    assert len(of(rows, "structured", "camera", "safe")) == 3
    assert of(rows, "structured", "exact", "safe") == []


def test_the_claims_of_storage_and_precision() -> None:
    planes = {"safe": 5, "grid 0.1 m": 100, "grid 0.2 m": 50, "grid 0.4 m": 20, "grid 0.8 m": 10}
    errors = {"safe": 0.02, "grid 0.1 m": 0.1, "grid 0.2 m": 0.2, "grid 0.4 m": 0.3, "grid 0.8 m": 0.5}
    rows = storage(planes, errors, "structured") + storage({**planes, "safe": 30}, errors, "unstructured")
    found = storage_claims(rows)
    assert cell_of(found, "Fig. 11a", "safe", "camera") == "0.50 (worst 0.50): **yes**"
    assert cell_of(found, "Fig. 11b: unstructured", "safe", "camera") == "3.00 (worst 3.00): **no**"
    assert cell_of(found, "Fig. 11b: and far", "safe", "camera") == "0.30 (worst 0.30): **no**"
    assert cell_of(found, "Fig. 12a", "safe", "camera") == "0.20 (worst 0.20): **yes**"
    assert cell_of(found, "Fig. 12a", "safe", "exact") == "-"
    assert "up to 50 %" in cell_of(found, "Fig. 14", "safe", "camera")
    grids = next(c for c in found if c.says.startswith("Fig. 11, 12"))
    assert grids.cells[1].endswith("**yes**")
    assert (
        storage_claims(storage(planes, {**errors, "grid 0.8 m": 0.01}, "structured"))[-1]
        .cells[1]
        .endswith("**partly**")
    )


def test_the_claim_of_tilt_needs_error_and_missed_rays() -> None:
    def rows(rolled: float, missed: float) -> list[TiltRow]:
        return [
            TiltRow(axis="roll", angle_deg=0.0, figures=FRAME),
            TiltRow(axis="roll", angle_deg=30.0, figures=replace(FRAME, mean_m=rolled)),
            TiltRow(axis="pitch", angle_deg=-30.0, figures=replace(FRAME, missed=missed)),
        ]

    assert tilt_claims(rows(0.14, 0.005))[0].cells[1].endswith("**yes**")
    assert tilt_claims(rows(0.2, 0.005))[0].cells[1].endswith("**partly**")
    assert tilt_claims(rows(0.2, 0.05))[0].cells[1].endswith("**no**")
    assert tilt_claims(rows(0.14, 0.0))[0].cells[0] == "-"


def timed(method: str, ms: float, step: int = 1, kind: str = "structured") -> TimeRow:
    return TimeRow(
        kind=kind, method=method, step=step, size="640x480", cpu_ms=ms, cpu_sd_ms=0.0, cpu_p99_ms=ms, wall_ms=ms, runs=1
    )


def test_the_claims_of_time() -> None:
    rows = []
    for kind in ("structured", "foliage"):
        rows += [timed("safe", 9.0, kind=kind), timed("safe", 4.0, 4, kind), timed("paper", 30.0, kind=kind)]
        rows += [
            timed("paper", 40.0, 4, kind),
            timed("grid 0.1 m", 20.0, kind=kind),
            timed("grid 0.8 m", 5.0, kind=kind),
        ]
    found = time_claims(rows)
    assert cell_of(found, "Processing time", "safe", "camera").endswith("**yes**")
    assert cell_of(found, "Processing time", "paper", "camera").endswith("**no**")
    assert cell_of(found, "Fig. 13a: about", "safe", "camera").endswith("**no**")
    assert cell_of(found, "Fig. 13a: far", "safe", "camera").endswith("**yes**")
    assert cell_of(found, "Fig. 13b", "safe", "camera") == "structured 9.0 to 4.0 ms, foliage 9.0 to 4.0 ms: **yes**"
    assert cell_of(found, "Fig. 13b", "paper", "camera").endswith("**no**")


def test_the_claims_of_interval_and_noise() -> None:
    rows = [
        IntervalRow(step=s, ke_per_m=ke, columns="pooled", thin=math.nan, figures=replace(FRAME, method=m, mean_m=e))
        for m, s, ke, e in (
            ("safe", 1, 0.0, 0.1),
            ("safe", 8, 0.0, 0.2),
            ("safe", 1, 0.01, 0.3),
            ("safe", 8, 0.01, 0.4),
            ("paper", 1, 0.0, 0.5),
            ("paper", 8, 0.0, 0.2),
            ("paper", 1, 0.01, 0.1),
            ("paper", 8, 0.01, 0.3),
        )
    ]
    found = interval_claims(rows)
    assert (
        cell_of(found, "Fig. 13c: a greater", "safe", "camera")
        == "ke 0: 0.100 to 0.200 m; ke 0.01: 0.300 to 0.400 m: **yes**"
    )
    assert cell_of(found, "Fig. 13c: a greater", "paper", "camera").endswith("**partly**")
    assert cell_of(found, "Fig. 13c: so does", "safe", "camera").endswith("**yes**")
    assert cell_of(found, "Fig. 13c: so does", "paper", "camera").endswith("**partly**")


def test_an_opening_must_not_come_out_larger_than_it_is() -> None:
    def rows(width: float, height: float) -> list[OpeningRow]:
        return [
            OpeningRow(
                opening="window",
                condition="exact",
                method="safe",
                distance_m=6.0,
                seed=1,
                width_m=width,
                height_m=height,
                free_share=0.9,
            )
        ]

    assert cell_of(opening_claims(rows(2.75, 2.05)), "Fig. 8: the window", "safe", "exact").endswith("**yes**")
    assert cell_of(opening_claims(rows(2.75, 1.9)), "Fig. 8: the window", "safe", "exact").endswith("**no**")
    assert "larger" in cell_of(opening_claims(rows(2.95, 2.05)), "Fig. 8: the window", "safe", "exact")
    assert cell_of(opening_claims(rows(2.95, 2.05)), "Fig. 8: the window", "paper", "exact") == "not judged"


def test_a_shape_must_be_close_and_small() -> None:
    def row(shape: str, planes: int, error: float) -> ShapeRow:
        return ShapeRow(
            shape=shape, method="safe", seed=1, planes=planes, mean_m=error, p95_m=error, missed=0.0, open_stopped=0.0,
            grid_planes=10, grid_error_m=0.2, around_planes=0, around_error_m=math.nan,
        )  # fmt: skip

    good = [row("cylinder", 3, 0.1), row("trapezoidal prism", 4, 0.1), row("sphere", 2, 0.2)]
    assert shape_claims(good)[0].cells[1].endswith("**yes**")
    assert shape_claims([*good[:2], row("sphere", 11, 0.1)])[0].cells[1].endswith("**partly**")
    assert (
        shape_claims([row(s, 3, 0.3) for s in ("cylinder", "trapezoidal prism", "sphere")])[0]
        .cells[1]
        .endswith("**no**")
    )


@pytest.mark.parametrize("column", [0, 3])
def test_verdicts_are_counted_by_column(column: int) -> None:
    cells = ["-"] * 4
    cells[column] = "3 m: **no**"
    assert counted([Claim("a", tuple(cells)), Claim("b", ("-",) * 4)], column) == {"yes": 0, "partly": 0, "no": 1}
    assert counted([Claim("a", tuple(cells))], 1) == {"yes": 0, "partly": 0, "no": 0}
