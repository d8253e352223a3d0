"""The table of two checkouts measured in turns."""

from __future__ import annotations

from benchmarks.speed.turns import Worker, compare


class Steady(Worker):
    """Takes the same time for each frame. results: what its frames are called."""

    def __init__(self, ns: int, results: str) -> None:
        self._ns, self._results = ns, results

    def extract(self, kind: str, frames: int) -> tuple[list[int], str]:
        return [self._ns] * frames, f"{self._results} of {kind}"


def test_ratios_are_those_of_this_checkout_over_the_other_one() -> None:
    row = compare(Steady(4_000_000, "models"), Steady(3_000_000, "models"), "street, level", 4, 3)
    assert row == "| street, level | 4.00 | 3.00 | 0.750 | 0.750 | 1.00 | 1.00 | yes |"


def test_other_results_are_stated() -> None:
    row = compare(Steady(1_000_000, "models"), Steady(1_000_000, "other models"), "trees, level", 2, 1)
    assert row.endswith("| no |")
