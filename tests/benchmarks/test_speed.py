"""The speed page: its tables contain the measured values, its goals use the slowest frames, and its frames match their
names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import benchmarks.speed.section as page
from benchmarks.speed.cases import (
    KINDS,
    Kind,
    block_noise,
    crowd,
    kind_sequence,
    noise,
    noise_in_a_tenth,
    noise_on_every_tenth,
    nothing,
)
from benchmarks.speed.reference import Reference
from benchmarks.speed.section import Effort, section
from benchmarks.speed.stages import main as stages_main
from benchmarks.speed.tables import GOALS, Timed, floor_words, goals_table, kinds_table, scenes_table, stage_table
from companion.bench.frames import Measured
from companion.bench.timing import Times

LEVEL = Kind(name="street, level", family="structured")
TILTED = Kind(name="street, rolled", family="structured", roll_deg=20.0)
TREES = Kind(name="trees", family="foliage")
BROKEN = Kind(name="noise", family="broken")
SLOW = Kind(name="blocks", family="broken")
TINY = Effort(runs=3, watched=1, images=1, budget_s=5.0, too_slow_ms=1e4, scenes=1, widths=(160,), crowds=(0, 2))


def measured(name: str, cpu_ms: list[float], wall_ms: list[float] | None = None, valid: bool = True) -> Measured:
    stages = {"merge": 1.0, "density, windows, strips, rest": 2.64}
    times = Times(np.array(wall_ms or cpu_ms), np.array(cpu_ms))
    return Measured(name=name, times=times, stages_ms=stages, valid=valid, planes=7, strips=90)


def timed(kind: Kind, cpu_ms: list[float], ke: float = 0.0015, valid: bool = True) -> Timed:
    return Timed(kind=kind, size=(640, 480), ke_per_m=ke, measured=measured(kind.name, cpu_ms, valid=valid))


def rows_of(markdown: str) -> dict[str, list[str]]:
    """First cell -> the others."""
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.strip().splitlines()]
    return {line[0]: line[1:] for line in lines}


def test_goals_are_compared_with_the_slowest_kind() -> None:
    rows = rows_of(
        goals_table(
            [timed(LEVEL, [0.7]), timed(TILTED, [3.0]), timed(TREES, [9.0, 9.0, 20.0]), timed(BROKEN, [9.5])],
            [LEVEL, TILTED, TREES, BROKEN, SLOW],
            1000.0,
        )
    )
    assert rows["structured, level"] == ["4", "1.2", "0.8", "0.70", "stretch"]
    assert rows["structured, tilted 20 degrees"] == ["4", "1.6", "1.2", "3.00", "must"]
    assert rows["foliage, level and tilted"] == ["8", "3", "", "9.00", "**missed**"]
    assert rows["p99 / median, worst kind with a model"][-2:] == ["2.22", "**missed**"]
    assert "p99 / median, worst kind that is blind" not in rows
    assert rows["noise: no slower than foliage"][-2:] == ["9.50", "**missed**"]
    assert rows["blocks: no slower than foliage"][-2:] == ["over 1000", "**missed**"]


@pytest.mark.parametrize(("ms", "reached"), [(0.8, "stretch"), (0.81, "aim"), (1.3, "must"), (4.1, "**missed**")])
def test_a_goal_shows_the_best_that_is_reached(ms: float, reached: str) -> None:
    assert GOALS[0].verdict(ms) == reached


def test_the_tail_of_blind_frames_is_distinguished() -> None:
    kinds = [
        timed(LEVEL, [1.0]),
        timed(TILTED, [1.0]),
        timed(TREES, [1.0]),
        timed(BROKEN, [0.1, 0.1, 0.4], valid=False),
    ]
    rows = rows_of(goals_table(kinds, [t.kind for t in kinds], 1000.0))
    assert rows["p99 / median, worst kind with a model"][-2:] == ["1.00", "must"]
    assert rows["p99 / median, worst kind that is blind"][-2:] == ["4.00", "**missed**"]


def test_every_kind_is_a_row_with_both_clocks_and_its_ratio() -> None:
    one = Timed(kind=LEVEL, size=(640, 480), ke_per_m=0.005, measured=measured("a", [2.0, 2.0, 3.0], [4.0, 4.0, 8.0]))
    text = kinds_table([one, timed(BROKEN, [1.0], valid=False)], reference_ms=0.5)
    assert rows_of(text)["street, level"] == ["0.005", "2.00", "3.00", "1.50", "4.00", "8.00", "4.0", "7", "3"]
    assert rows_of(text)["noise"][-2:] == ["blind", "1"]


def test_stages_and_what_lies_between_them_make_the_whole() -> None:
    rows = rows_of(stage_table([measured("street", [5.0])]))
    assert rows["merge"] == ["1.00"]
    assert rows["between the stages"] == ["1.36"]
    assert rows["**whole call, median**"] == ["**5.00**"]
    assert "street 2.64 ms, 10 times the floor" in floor_words([measured("street", [5.0])])


def test_of_a_family_the_median_and_the_slowest_scene_are_reported() -> None:
    scenes = [[measured("a", [1.0])], [measured("b", [3.0])], [measured("c", [2.0])]]
    assert rows_of(scenes_table({"thin": scenes}, ["level"]))["thin (3)"] == ["2.00, 3.00 (b)"]


def test_spoilt_images_are_what_they_are_called() -> None:
    rng, depth = np.random.Generator(np.random.PCG64(1)), np.full((60, 80), 5000, np.uint16)
    assert np.mean(noise(depth, rng) == 5000) < 0.01
    assert np.mean(noise_in_a_tenth(depth, rng) != 5000) == pytest.approx(0.1, abs=0.01)
    assert np.mean(noise_on_every_tenth(depth, rng) != 5000) == pytest.approx(0.1, abs=0.02)
    assert not nothing(depth, rng).any()
    blocks = block_noise(depth, rng, 3)
    assert blocks.shape == depth.shape
    assert blocks.dtype == np.uint16
    assert np.array_equal(blocks[0:3, 3:6], np.full((3, 3), blocks[0, 3]))
    assert len(np.unique(blocks)) > 400


def test_the_kinds_are_those_of_the_goals() -> None:
    for goal in GOALS:
        assert any(goal.holds_for(kind) for kind in KINDS)
    assert len({kind.name for kind in KINDS}) == len(KINDS)
    shot = kind_sequence(KINDS[-1], (160, 120), 0.0015, 2)
    assert shot.name == "nothing measured"
    assert not any(image.any() for image in shot.depth_mm)


def test_a_crowd_grows_with_its_number_and_is_the_same_each_time() -> None:
    assert len(crowd(0, False).label) < len(crowd(2, False).label) < len(crowd(8, False).label)
    assert len(crowd(2, True).label) > len(crowd(2, False).label)
    np.testing.assert_array_equal(crowd(8, True).rows, crowd(8, True).rows)


def test_the_reference_workload_is_timed_apart() -> None:
    reference = Reference()
    for _ in range(3):
        reference.run()
    assert len(reference.times()) == 3
    assert reference.times().cpu() > 0.0


@pytest.mark.slow
def test_the_section_makes_its_page_and_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole section on tiny images of a few kinds."""
    small, size = (96, 72), (160, 120)
    monkeypatch.setattr(page, "QUICK", TINY)
    monkeypatch.setattr(page, "KINDS", tuple(KINDS[i] for i in (0, 1, 4, -1)))
    monkeypatch.setattr(page, "SIZES", (small, size))
    monkeypatch.setattr(page, "SIZE", size)
    text = section(tmp_path, quick=True)
    for title in (
        "## Against the goals",
        "## All kinds, 96x72",
        "## All kinds, 160x120",
        "## Where the time goes",
        "## Every scene",
    ):
        assert title in text
    assert text.startswith("640x480 on one thread")
    assert "Not measured" not in text
    for name in ("speed_kinds.png", "speed_stages.png", "speed_curves.png"):
        assert (tmp_path / name).stat().st_size > 5000
        assert f"({name})" in text


def test_a_kind_that_is_too_slow_is_left_out_at_larger_sizes_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    class Fake(page.Lap):
        def time(self, what: str, make: object, runs: int, watched: int = 0) -> Measured:
            return measured(what, [1.0])

    monkeypatch.setattr(page, "KINDS", (LEVEL, BROKEN))
    small = [timed(LEVEL, [9000.0]), timed(BROKEN, [11000.0])]
    large = list(page.kinds_at(Fake(TINY), (640, 480), small))
    assert [t.kind for t in large] == [LEVEL, LEVEL]
    text = page.left_out({(320, 240): small, (640, 480): large}, 10_000.0)
    assert text == "Not measured, since a smaller image took more than 10 s already: 640x480: noise.\n"
    assert page.left_out({(320, 240): small}, 10_000.0) == ""


def test_stages_prints_its_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert stages_main(["--runs", "3", "--width", "160"]) == 0
    output = capsys.readouterr().out
    assert "160x120, ke 0.0015, one thread" in output
    assert "| merge |" in output
