"""Alignment of two vehicles and the place of each published plane, by hand."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.sharing.pairs import ASTRAY_M, _ends, _rigid, astray

RNG = np.random.default_rng(5)
MIDDLE = RNG.uniform(-20.0, 20.0, (40, 2))
HALF = RNG.uniform(-2.0, 2.0, (40, 2))
OWN = np.column_stack([MIDDLE - HALF, MIDDLE + HALF, np.full(40, -3.0), np.zeros(40)])
MARGIN_M = np.full(40, 0.4)


def displaced(step: int, by_m: float) -> np.ndarray:
    planes = OWN.copy()
    planes[::step, [0, 2]] += by_m
    return planes


def test_single_planes_elsewhere_are_astray_and_do_not_change_the_alignment() -> None:
    """The fit leaves out what does not fit, so that place and margin of a pair say nothing of single planes."""
    wrong = displaced(10, 60.0)
    R, t = _rigid(_ends(OWN), _ends(wrong))
    np.testing.assert_allclose(R, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(t, 0.0, atol=1e-9)
    assert astray(OWN, MARGIN_M, OWN) == 0.0
    assert astray(wrong, MARGIN_M, OWN) == 0.1


def test_planes_within_their_margin_are_not_astray() -> None:
    alone = OWN[:1]
    across = np.array([-(alone[0, 3] - alone[0, 1]), alone[0, 2] - alone[0, 0]])
    across *= 1.0 / math.hypot(*across)
    for by_m, share in ((0.35 + ASTRAY_M, 0.0), (0.45 + ASTRAY_M, 1.0)):
        moved = alone.copy()
        moved[:, 0:2] += by_m * across
        moved[:, 2:4] += by_m * across
        assert astray(moved, MARGIN_M[:1], alone) == share
    assert astray(OWN[:0], MARGIN_M[:0], OWN) == 0.0
