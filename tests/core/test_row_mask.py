"""Which rows of a column are open: measured, and neither ground nor below it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.stages import row_mask as px
from core.stages.density import Peaks
from core.stages.ground_fit import GroundPlane
from core.stages.ground_threshold import GroundThreshold

from . import naive

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
CODES = 400


def threshold_of(rng: np.random.Generator, cols: int) -> GroundThreshold:
    """A threshold whose tolerance is at each of its limits for a part of the codes."""
    height, least, cap = rng.uniform(0.001, 0.003), rng.uniform(1e-4, 3e-4), rng.uniform(3e-4, 1e-3)
    values = (height, least, cap, rng.uniform(0.0, 0.1), rng.uniform(-0.3, 0.1))
    shift = rng.uniform(-0.2, 0.2, cols).astype(np.float32)
    return GroundThreshold(*(np.float32(v) for v in values), shift=shift, plane=GroundPlane(2.0, 0.0, 0.0))


@given(SEED, st.sampled_from([8, 13, 50]))
def test_open_rows_against_their_definition(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    cols = 30
    ground = threshold_of(rng, cols)
    q = np.arange(65536, dtype=np.float32)
    gate = ground.height * q - np.minimum(np.maximum(ground.spread, ground.least * q), ground.cap * q) + ground.slope_x
    shift, tan_mid = ground.shift, np.linspace(-0.5, 0.5, rows).astype(np.float32)
    codes = rng.integers(0, CODES + 20, (cols, rows)).astype(np.uint16)
    codes[rng.random(codes.shape) < 0.3] = 0
    mask, table = np.zeros((rows + 7) // 8 * 8, np.uint8), np.zeros((2, rows + 8), np.int32)
    for u in range(cols):
        assert px.mask_open_rows(codes[u], ground, shift[u], tan_mid, mask) == (codes[u] > 1).sum()
        want = naive.mask_open_rows(codes[u], gate, shift[u], tan_mid)
        assert np.flatnonzero(mask).tolist() == want
        n = px.gather_rows(codes[u], mask, table)
        assert table[px.ROW, :n].tolist() == want
        assert table[px.CODE, :n].tolist() == codes[u][want].tolist()


@given(SEED, st.integers(0, 4))
def test_rows_are_marked_with_the_peak_that_holds_their_code(seed: int, peaks: int) -> None:
    rng = np.random.default_rng(seed)
    rows = 30
    bin_of_code = np.maximum(np.arange(65536) // 5, 1)
    first_code = np.searchsorted(bin_of_code, np.arange(60)).astype(np.int32)
    line = rng.integers(2, 200, rows).astype(np.uint16)
    mask = np.zeros(32, np.uint8)
    mask[:rows] = rng.random(rows) < 0.7
    edges = np.sort(rng.choice(40, 2 * peaks, replace=False))[::-1]
    high, low = edges[::2].astype(np.int32), edges[1::2].astype(np.int32)
    mark = np.full(32, px.CLOSED, np.uint8)
    px.label_rows(line, mask, Peaks(low, high, high), peaks, first_code, mark)
    for v in range(rows):
        held = [p for p in range(peaks) if low[p] <= bin_of_code[line[v]] <= high[p]]
        assert mark[v] == ((held[0] if held else px.NO_PEAK) if mask[v] else px.CLOSED)
    assert (mark[rows:] == px.CLOSED).all()
    mark[:rows:3] = px.TAKEN
    open_ = mask.copy()
    px.mask_remaining_rows(mark[:rows], open_)
    assert open_.tolist() == [int(m <= px.NO_PEAK) for m in mark]


def test_ends_of_a_mark() -> None:
    mark = np.array([9, 1, 1, 9, 1, 9, 2], np.uint8)
    assert px.ends_of(mark, 1, 0, 6) == (1, 4)
    assert px.ends_of(mark, 1, 2, 3) == (2, 2)
    assert px.ends_of(mark, 2, 0, 6) == (6, 6)
    first, last = px.ends_of(mark, 7, 0, 6)
    assert first > last
