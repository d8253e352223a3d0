"""The figures of both sources of depth: what a wrong model costs in them, and which views are taken."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fidelity.metrics import rays_of
from benchmarks.open_air import both_sources
from benchmarks.open_air.both_sources import NOISES_GREY, SEEDS, SKIES, combinations, missed_goals, modelled
from benchmarks.open_air.joint_figures import JointFigures, figures_of, outline_table
from benchmarks.open_air.views import Seen, View, profile_of
from core.extractor import Extractor
from core.params import Params
from core.types import TEXTURED_MM


@pytest.fixture(scope="module")
def container() -> Seen:
    """A blank container at 8 m, which the noise model measures."""
    return modelled(View(scene="container_8m"), profile_of("zed"), Extractor(Params()))


def with_planes(seen: Seen, planes: np.ndarray) -> Seen:
    """The view with other planes in its model."""
    n = len(planes)
    model = replace(
        seen.model,
        planes=planes.astype(np.float32).reshape(-1, 6),
        support_px=np.full(n, 100, np.int32),
        margin_m=np.zeros(n, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    return replace(seen, model=model)


def test_the_noise_model_measures_and_keeps_a_blank_thing(container: Seen) -> None:
    row = figures_of(container).row()
    assert row["unmeasured"] < 10.0
    assert row["missed"] == 0.0
    assert row["phantom"] == 0.0
    assert row["false_stops"] == 0.0
    assert 0.1 < row["mean_m"] < 0.5  # one sigma is 0.46 m at 8 m
    assert "| x | " in outline_table({"x": figures_of(container)})


def test_a_plane_that_is_not_there_is_a_phantom_and_stops_free_directions() -> None:
    field = modelled(View(scene="field"), profile_of("zed"), Extractor(Params()))
    wall = np.array([[4.0, -1.0, 4.0, 1.5, -1.0, 1.0]])
    before, after = figures_of(field), figures_of(with_planes(field, wall))
    assert before.false_stops == before.closed == before.open_phantom == 0 < before.directions
    assert 4 <= after.false_stops == after.closed < after.directions
    assert 10_000 < after.open_phantom <= after.open_early < after.open_rays
    assert after.wrong_free == 0


def test_without_planes_all_measured_obstacle_rays_are_missed(container: Seen) -> None:
    figures = figures_of(with_planes(container, np.zeros((0, 6))))
    row = figures.row()
    assert row["missed"] == row["missed_inside"] == 100.0
    assert row["false_stops"] == 0.0
    assert sum(o.kept for o in figures.outlines) == 0 < sum(o.pixels for o in figures.outlines)
    blind = figures_of(replace(container, model=replace(container.model, valid=False)))
    assert (blind.invalid, blind.judged, blind.false_stops) == (1, 0, 0)


def test_three_seeds_skies_and_noises_meet_pairwise_once() -> None:
    square = [(seed, sky, noise) for seed, sky, noises in combinations(False) for noise in noises]
    assert len(square) == 9
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert set(Counter((c[a], c[b]) for c in square).values()) == {1}
    every = [(seed, sky, noise) for seed, sky, noises in combinations(True) for noise in noises]
    assert len(set(every)) == len(SEEDS) * len(SKIES) * len(NOISES_GREY) == len(every)


def test_marks_are_no_measurements(container: Seen) -> None:
    """A pixel with a mark was counted as measured, so that each unmeasured blank surface was a missed one."""
    frame = container.frame
    depth = frame.depth_mm.copy()
    depth[100:200] = np.arange(1, TEXTURED_MM + 1, dtype=np.uint16).repeat(25)[:, None]
    info = replace(frame.info, marks_smooth=True)
    marked = rays_of(replace(frame, depth_mm=depth, info=info), 0.005).measured
    assert not marked[100:200].any()
    assert np.array_equal(marked[:100], rays_of(frame, 0.005).measured[:100])
    assert (
        rays_of(replace(frame, depth_mm=depth), 0.005).measured[100:200].all()
    )  # of other cameras they are raw depths


def test_a_goal_is_missed_by_more_than_one_percent_or_by_one_cell() -> None:
    def row(**values: int) -> JointFigures:
        return JointFigures(views=1, directions=1000, **values)

    assert missed_goals({"a": row(false_stops=10)}) == []
    assert missed_goals({"a": row(false_stops=11)}) == ["a: 1.10 % false stops, goal 1 %"]
    assert missed_goals({"a": row(wrong_free=1), "b": row(wrong_open=2)}) == [
        "a: 1 cells called free hold a solid",
        "b: 2 cells called open hold a solid",
    ]
    assert missed_goals({"a": row(invalid=1)}) == ["a: no view has a valid model, nothing was judged"]


def test_the_command_states_both_sources(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(both_sources, "SEEDS", (1,))
    monkeypatch.setattr(both_sources, "SKIES", ("clear",))
    out = tmp_path / "each.json"
    assert both_sources.main(["--profiles", "zed", "--scenes", "field", "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "| zed, noise model | 1 | 0 |" in printed
    assert "| zed, rendered pairs | 1 | 0 | 0.00 |" in printed
    assert "all goals are reached" in printed
    each = json.loads(out.read_text())
    assert [v["source"] for v in each] == ["noise model", "rendered pairs"]
    assert all(v["views"] == 1 and v["directions"] > 20 for v in each)
