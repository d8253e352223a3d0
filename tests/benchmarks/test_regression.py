"""A few frames are modelled no worse than before; and what the comparison holds against a change."""

from __future__ import annotations

import copy
import sys

import pytest

from .regression import CASES, FIGURES, GOLDEN, RAYS, changes, dumps, load, measured, worse


def test_no_frame_is_modelled_worse(update_golden: bool, capsys: pytest.CaptureFixture[str]) -> None:
    now = measured()
    if update_golden:
        changed = changes(load() if GOLDEN.exists() else {}, now)
        GOLDEN.write_text(dumps(now))
        with capsys.disabled():
            sys.stdout.write(f"\nfigures of {GOLDEN.name}:\n{changed}\n")
        return
    found = list(worse(load(), now))
    if found:
        listed = "\n".join(found)
        pytest.fail(
            f"the model became blinder or louder:\n{listed}\nA picture of each: python -m benchmarks.fidelity.draw_case. "
            "If this is meant, for what it gains: pytest --update-golden tests/benchmarks/test_regression.py, and say "
            "in the commit what became worse and why.",
            pytrace=False,
        )


def test_the_golden_figures_are_of_models_that_see() -> None:
    golden = load()
    assert list(golden) == [case.name for case in CASES]
    assert dumps(golden) == GOLDEN.read_text()
    for case, figures in golden.items():
        assert figures["invalid"] == 0.0, case
        assert (figures["planes"] == 0.0) == case.startswith("open")
        assert (figures["missed"] or 0.0) < 0.1, case
        assert (figures["false_free"] or 0.0) < 0.001, case
    for name in FIGURES:
        assert any(figures[name] is not None for figures in golden.values()), name


@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_is_held_against_a_change_beyond_its_margin_only(name: str) -> None:
    golden = load()
    case, figures = next((c, f) for c, f in golden.items() if f[name] is not None)
    old = figures[name] or 0.0
    limit = FIGURES[name].limit(old)
    for value, held in ((limit + 1e-4 + 0.001 * limit, True), (limit - 1e-6, False), (0.0, False)):
        now = copy.deepcopy(golden)
        now[case][name] = value
        changed = [text for text in worse(golden, now) if text.startswith(case)]
        assert bool(changed) == (held and value > limit), (name, value)


def test_what_moves_all_frames_a_little_is_held_against_their_mean() -> None:
    golden = load()
    for part, held in ((0.25, False), (0.5, True)):
        now = copy.deepcopy(golden)
        for figures in now.values():
            if figures["planes"] is not None:
                figures["planes"] += part * (FIGURES["planes"].limit(figures["planes"]) - figures["planes"])
        assert [text.partition(":")[0] for text in worse(golden, now)] == ["mean planes"] * held


def test_a_figure_or_a_case_that_went_away_and_an_easier_scene_are_seen() -> None:
    golden = load()
    first = next(iter(golden))
    for change in (
        lambda now: now[first].update(missed=None),
        lambda now: now.pop(first),
        lambda now: now[first].update({RAYS: 0.9 * golden[first][RAYS]}),
    ):
        now = copy.deepcopy(golden)
        change(now)
        assert list(worse(golden, now))
    assert not list(worse(golden, golden))


def test_an_update_reports_what_became_better_and_worse() -> None:
    golden = load()
    assert changes(golden, golden) == "as before"
    now = copy.deepcopy(golden)
    first = next(iter(now))
    now[first]["planes"] = 500.0
    now[first]["mean_m"] = 0.0
    changed = changes(golden, now)
    assert f"{first}: mean_m {golden[first]['mean_m']} -> 0.0, planes {golden[first]['planes']} -> 500.0" in changed
    assert "mean planes: " in changed
    assert changed.count("(worse)") == changed.count("(better)") == 1
    assert changes({}, {first: now[first]}) == f"{first}: new"
