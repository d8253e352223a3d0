"""Coverage of the margins: by hand, and on a few scenes with white and with correlated noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.fidelity.case import FRAMES
from benchmarks.fidelity.coverage import BINS_M, Coverage, of_cases, within_margin
from benchmarks.fidelity.matrix import cases
from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState, FrameModel


def test_a_point_is_covered_within_the_margin_of_a_plane() -> None:
    plane = np.array([[5.0, -1.0, 5.0, 1.0, -2.0, 1.0]])
    points = np.array(
        [[4.9, 0.0, 0.0], [4.7, 0.0, 0.0], [5.0, 1.15, 0.0], [5.0, 1.3, 0.0], [5.0, 0.0, 1.15], [5.0, 0.0, -2.3]]
    )
    got = within_margin(points, plane, np.array([0.2]))
    assert got.tolist() == [True, False, True, False, True, False]


def test_shares_are_those_of_the_sum() -> None:
    both = Coverage(np.array([4, 0]), np.array([3, 0])) + Coverage(np.array([4, 0]), np.array([4, 0]))
    assert both.shares()[0] == 7 / 8
    assert np.isnan(both.shares()[1])


def test_frames_without_a_model_are_counted_and_not_left_out() -> None:
    class Half:
        """An extractor without a model of every second case."""

        params, calls = Params(), 0

        def extract(self, *args: Any, state: ExtractorState) -> tuple[FrameModel, ExtractorState]:
            self.calls += 1
            model, after = Extractor().extract(*args, state=state)
            return replace(model, valid=(self.calls - 1) // FRAMES % 2 == 0), after

    todo = list(cases(["wall"], [0, 1], [(0, 0)], kes=[0.0015], width=160))
    got = of_cases(todo, cast(Extractor, Half()))
    assert (got.frames, got.invalid) == (2, 1)
    assert got.points.sum() > 0


@pytest.mark.parametrize("faults", ["white", "all"])
@pytest.mark.parametrize("ke", [0.0015, 0.005])
def test_margins_cover_the_true_points(ke: float, faults: str) -> None:
    """At least 95 % in each bin of range in which there is enough to count."""
    todo = cases(["street", "mixture"], [0], [(0, 0)], kes=[ke], faults=[faults])
    got = of_cases(todo, Extractor(Params()))
    enough = got.points > 2000
    assert enough.sum() >= 3, dict(zip(BINS_M, got.points, strict=False))
    assert (got.shares()[enough] >= 0.95).all(), got.shares()
    assert (got.frames, got.invalid) == (2, 0)
