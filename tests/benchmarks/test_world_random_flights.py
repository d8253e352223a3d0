"""Random flights with faults judge the merged world, and find what is planted in it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from benchmarks.world.random_judge import Judge, judged, main
from core.world import world as core_world
from core.world.world import World


def kinds(judge: Judge) -> dict[str, int]:
    """Number of wrong cells, places and sections, by their kind."""
    return dict(Counter(kind for _, kind, _ in judge.wrong))


@pytest.mark.parametrize("seed", [105, pytest.param(115, marks=pytest.mark.slow)])
def test_nothing_solid_is_free_and_no_obstacle_is_lost(seed: int) -> None:
    judge = judged(seed)
    assert judge.cells > 500
    assert judge.judged_places > 500
    assert judge.wrong == []


@pytest.mark.slow
def test_nothing_is_wrong_in_many_flights() -> None:
    assert {seed: found for seed in range(60) if (found := kinds(judged(seed)))} == {}


@pytest.mark.parametrize(("name", "seed", "kind"), [("_jump", 126, "unseen"), ("arrived_in_free", 127, "solid")])
def test_a_world_without_a_rule_is_found(monkeypatch: pytest.MonkeyPatch, name: str, seed: int, kind: str) -> None:
    """A world that begins no sections; one in which nothing arrives."""
    if name == "_jump":
        monkeypatch.setattr(World, name, lambda *_: "")
    else:
        monkeypatch.setattr(core_world, name, lambda _, observations: np.zeros(len(observations), np.bool_))
    assert kind in kinds(judged(seed))


def test_the_command_fails_where_something_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["--seeds", "105:106", "--duration", "3"]
    assert main(asked) == 0
    monkeypatch.setattr(Judge, "check", lambda judge, *_: judge.wrong.append((0, "solid", "planted")))
    assert main(asked) == 1


def test_a_world_that_forgets_newer_frames_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(3, 10.0, 7, among_vehicles=True).wrong == []
    monkeypatch.setattr(World, "_see_later_again", lambda *_: None)
    assert "solid" in kinds(judged(3, 10.0, 7, among_vehicles=True))
