"""Margins of planes in the measurements of sharing."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.sharing.measure import lengthened


def test_planes_are_longer_by_their_margins_at_both_ends() -> None:
    planes = np.array([[0.0, 0.0, 3.0, 4.0, -2.0, 0.0], [1.0, 1.0, 1.0, 1.0, -2.0, 0.0]])
    found = lengthened(planes, np.array([0.5, 0.5]))
    assert found[0] == pytest.approx([-0.3, -0.4, 3.3, 4.4, -2.0, 0.0])
    assert found[1] == pytest.approx(planes[1])
