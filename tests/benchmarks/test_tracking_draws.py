"""The figures of several draws of the noise: what tracks miss and invent beside the frame's own model."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from benchmarks.fidelity.matrix import cases
from benchmarks.tracking.draws import CaseDraws, Shares, draws_of, summary

CASE = next(cases(["wall"], (1,), ((0, 0),)))


def test_a_wall_is_tracked_without_a_miss() -> None:
    (found,) = draws_of([replace(CASE, width=160)], draws=3)
    assert len(found.frame) == len(found.tracks) == 3
    assert [s.missed for s in found.tracks] == [0.0, 0.0, 0.0]
    assert found.worse == 0


def test_the_summary_counts_cases_by_their_mean() -> None:
    bad = CaseDraws(
        CASE,
        (Shares(0.001, 0.0), Shares(0.0005, 0.0)),
        (Shares(0.002, 0.02), Shares(0.0, 0.0)),
    )
    good = CaseDraws(replace(CASE, scene="corner"), (Shares(0.0, 0.0),) * 2, (Shares(0.0, 0.0),) * 2)
    empty = CaseDraws(replace(CASE, scene="open"), (Shares(math.nan, math.nan),) * 2, (Shares(math.nan, math.nan),) * 2)
    tracks = summary([bad, good, empty], tracks=True)
    assert tracks.missed == pytest.approx(0.0005)
    assert tracks.worst_phantom == (pytest.approx(0.01), bad.case.name)
    assert (tracks.cases_missed, tracks.cases_phantom) == (1, 1)
    assert summary([bad, good, empty], tracks=False).cases_phantom == 0
    assert bad.worse == 1
