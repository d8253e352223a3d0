"""Which planes others contain that were sent, against plain samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.sharing.cover import COVER_HEIGHT_M, COVER_M, MOST_SAMPLES, SAMPLE_M, covered

pytestmark = pytest.mark.nojit

Floats = NDArray[np.float64]
step = st.integers(-3, 3).map(lambda k: 0.4 * k)
boxes = st.lists(
    st.tuples(step, step, step, step, st.sampled_from([-6.0, -5.7, -5.0]), st.sampled_from([0.0, -0.3, -1.0])),
    min_size=1,
    max_size=6,
).map(lambda rows: np.array(rows, np.float64))


def naive(box: Floats, others: Floats) -> bool:
    high = [o for o in others if o[4] <= box[4] + COVER_HEIGHT_M and o[5] >= box[5] - COVER_HEIGHT_M]
    count = min(MOST_SAMPLES, 2 + int(math.dist(box[:2], box[2:4]) / SAMPLE_M))
    return all(
        any(_apart_m(box[:2] + share * (box[2:4] - box[:2]), o) <= COVER_M + 1e-12 for o in high)
        for share in np.linspace(0.0, 1.0, count)
    )


def _apart_m(point: Floats, box: Floats) -> float:
    along = box[2:4] - box[:2]
    t = min(1.0, max(0.0, float((point - box[:2]) @ along) / max(float(along @ along), 1e-9)))
    return math.dist(point, box[:2] + t * along)


@given(boxes, st.integers(0, 63), st.integers(0, 63), st.integers(0, 63))
def test_planes_that_others_contain(box: Floats, sent_bits: int, row_bits: int, late_bits: int) -> None:
    """Along the axes no distance is COVER_M, which rounding could decide."""
    k = np.arange(len(box))
    sent, rows = (sent_bits >> k & 1).astype(bool), np.flatnonzero(row_bits >> k & 1)
    moved = box + np.array([0.07, 0.0, 0.07, 0.0, 0.0, 0.0])  # as they were sent
    sent_ns = late_bits >> k & 1
    found = covered(box, rows, moved, sent, sent_ns)
    for row in k.tolist():
        others = moved[sent & (sent_ns != sent_ns[row])]
        assert found[row] == (row in rows and naive(box[row], others))


def test_a_plane_does_not_contain_itself() -> None:
    box = np.array([(0.0, 0.0, 2.0, 0.0, -3.0, 0.0)])
    assert not covered(box, np.array([0]), box, np.ones(1, bool), np.zeros(1, np.int64)).any()
