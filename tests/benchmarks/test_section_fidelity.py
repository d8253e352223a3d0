"""The page of the fidelity figures: its tables on rows made by hand, and the whole of it on a small matrix."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.fidelity import section as section_fidelity
from benchmarks.fidelity.goals import measure
from benchmarks.fidelity.matrix import PARTS, Part, Settings, cases
from benchmarks.fidelity.metrics import RANGE_BINS, Recall
from benchmarks.fidelity.openings import OpeningSize
from benchmarks.fidelity.result import Case, Row
from benchmarks.fidelity.tables import cell, number, openings_table, range_table, worst_table
from benchmarks.fidelity.thin import curve
from benchmarks.markdown import table
from benchmarks.scenes.catalogue import HELD_OUT_SEEDS, TUNING_SEEDS

from .hand_rows import made


def opening(width: float, height: float, kept: bool, angle_deg: float = 10.0) -> OpeningSize:
    return OpeningSize(
        true_width_m=2.9,
        true_height_m=2.1,
        width_m=width,
        height_m=height,
        free_share=0.9,
        passable=width >= 2.0,
        kept=kept,
        distance_m=6.0,
        angle_deg=angle_deg,
        px_m=0.01,
    )


def test_numbers_have_three_digits() -> None:
    texts = [number(v) for v in (0.0, 0.00012, 0.0123456, 1.23456, 123.4, math.nan, math.inf)]
    assert texts == ["0", "0.0001", "0.0123", "1.23", "123", "-", "inf"]
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n|---|---:|\n| 1 | 2 |"


def test_a_cell_is_bold_where_the_worst_misses_the_goal() -> None:
    rows = [made(0, missed=0.0002), made(1, missed=0.001), made(2)]
    assert cell(measure("missed"), rows, "thin") == "**0.1 (0.02)**"
    assert cell(measure("missed"), rows[:1], "thin") == "0.02 (0.02)"
    assert cell(measure("missed"), rows, "thin", "pooled") == "**0.1 (0.04)**"
    assert cell(measure("missed"), []) == "-"


def test_the_worst_case_is_named_with_its_rays_and_how_many_miss_the_goal() -> None:
    rows = [made(0, 4000, phantom=0.002), made(7, 800, phantom=0.02), made(8, 800, valid=False, phantom=1.0)]
    line = next(text for text in worst_table(rows).splitlines() if text.startswith("| phantom, % | structured"))
    assert line == "| phantom, % | structured | 0.005 | 2 | 0.5 | 1 of 2 | `wall +0/+0 h 2 ke 0.005 seed 7`, 800 rays |"


def test_openings_seen_from_aside_are_left_out() -> None:
    rows = [
        replace(made(0), openings=[opening(2.8, 2.05, True)]),
        replace(made(1), openings=[opening(2.6, 1.9, False), opening(0.4, 2.0, False, angle_deg=50.0)]),
        replace(made(2), openings=[opening(1.2, 2.1, False)]),
        replace(made(3, valid=False), openings=[opening(0.1, 0.1, False)]),
    ]
    first, _, whole, _ = openings_table(rows).splitlines()[2:]
    assert first == "| 2.9 x 2.1 m, ke 0.005 | 3 | 2.60 x 2.05 m | 1.20 m | 1.90 m | 1 | 2 | 0 |"
    assert whole == "| all of 2 x 1 m or more, ke 0.005 | 3 |  |  |  | 1 | 2 | 0 |"


def test_recall_over_range_in_steps_of_two_metres() -> None:
    def row(seed: int, *things: tuple[str, float, float]) -> Row:
        kept = [Recall(name, distance, 50, share, 3.0) for name, distance, share in things]
        return replace(made(seed), case=replace(made(seed).case, scene="poles"), recall=kept)

    rows = [
        row(0, ("pole at 4 m", 4.1, 1.0), ("pole at 9 m", 9.0, 0.4), ("lamp", 4.5, 0.0)),
        row(1, ("pole at 4 m", 5.9, 0.5)),
        replace(made(2), recall=[Recall("pole at 4 m", 4.0, 50, 0.0, 3.0)]),  # another scene
    ]
    near, far = curve(rows, ("poles",), "pole at")
    assert (near.from_m, near.things, near.kept, near.found) == (4.0, 2, 0.75, 2)
    assert (far.from_m, far.things, far.kept, far.found) == (8.0, 1, 0.4, 0)


def test_rays_up_to_a_range() -> None:
    def bins(**counts: int) -> list[int]:
        return [counts.get(f"m{i}", 0) for i in range(RANGE_BINS)]

    by_range = replace(made(0).by_range, obstacle=bins(m3=1000, m7=9000), missed=bins(m7=40), phantom=bins(m3=1))
    line = range_table([replace(made(0), by_range=by_range)]).splitlines()[2]
    assert "| structured | 0.005 | 0.000 / 0.10 | 0.000 / 0.10 | 0.400 / 0.01 |" in line
    assert line.endswith("| 4 m |")


def small(seeds: Sequence[int]) -> Iterator[Case]:
    return cases(("wall", "trees", "poles", "open"), seeds, ((0, 0), (0, -30)), width=64)


def parts() -> dict[str, Part]:
    def of(make: Callable[[Sequence[int]], Iterator[Case]]) -> Part:
        return Part("small", make)

    return {
        "base": Part("small", small, grids=True),
        "noise": of(lambda s: cases(("wall", "trees"), s, ((0, 0),), (0.01,), width=64)),
        "faults": of(lambda s: cases(("wall",), s, ((0, 0),), (0.005,), faults=("none", "all"), width=64)),
        "heights": of(lambda s: cases(("wall",), s, ((0, 0),), (0.005,), heights=(0.7, 4.0), width=64)),
        "configured": of(
            lambda s: cases(("wall",), s, ((0, 0),), (0.005,), configured=lambda ke: (ke, 3 * ke), width=64)
        ),
    }


@pytest.mark.slow
@pytest.mark.parametrize("quick_look", [True, False])
def test_the_page_its_pictures_and_its_figures(
    quick_look: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert set(parts()) == set(PARTS)
    seen: list[int] = []
    monkeypatch.setattr(section_fidelity, "PARTS", parts())
    monkeypatch.setattr(section_fidelity, "quick", small)
    monkeypatch.setattr(section_fidelity.os, "cpu_count", lambda: 1)
    run = section_fidelity.run

    def noted(todo: Sequence[Case], settings: Settings, label: str) -> list[Row]:
        seen.extend(case.seed for case in todo)
        return run(todo, settings, label)

    monkeypatch.setattr(section_fidelity, "run", noted)
    text = section_fidelity.section(tmp_path, quick_look)
    assert not re.findall(r"^# ", text, re.MULTILINE)
    assert {"The goals", "Openings", "Thin things over range"} <= set(re.findall(r"^## (.*)$", text, re.MULTILINE))
    assert ("## Height above ground" in text) == (not quick_look)
    pictures = set(re.findall(r"\]\((\w+\.png)\)", text))
    assert pictures == {path.name for path in tmp_path.glob("*.png")}
    assert len(pictures) == (3 if quick_look else 5)
    assert "nan" not in text
    figures = json.loads((tmp_path / "fidelity.json").read_text())
    assert (tmp_path / "fidelity.json").stat().st_size < 200_000
    worst = figures["base"]["structured"]["0.005"]["mean error"]
    assert worst["where"].startswith("wall")
    assert worst["worst"] >= worst["median"] >= 0.0
    if quick_look:
        assert set(seen) == {HELD_OUT_SEEDS[0]}
    else:
        assert set(seen) == {*HELD_OUT_SEEDS[:2], TUNING_SEEDS[0]}
        data = json.loads((tmp_path / "limits.json").read_text())
        assert {line["height_m"] for line in data["heights"]} == {0.7, 4.0}
        assert {line["ke"] for line in data["ranges"]} == {0.0015, 0.005, 0.01}
        assert data["measured"]["command"] == "python -m benchmarks --only fidelity"
