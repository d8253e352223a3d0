"""Which rows of a column are open: measured, and neither ground nor below it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.stages import row_mask as px

from . import naive

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
CODES = 400


def gate_of(rng: np.random.Generator, rising: bool) -> np.ndarray:
    """(65536,) float32: tangents below which a code is ground, those of the first codes at random, the others out of
    reach."""
    gate = np.full(65536, np.inf, np.float32)
    gate[:CODES] = rng.uniform(-0.3, 0.6, CODES)
    if rising:
        gate[:CODES] = np.sort(gate[:CODES])
        gate[:CODES] = np.repeat(gate[:CODES:4], 4)  # with equal neighbours
    return gate


@given(SEED, st.booleans(), st.sampled_from([0.0, 0.002, 0.4]), st.sampled_from([8, 13, 50]))
def test_open_rows_against_their_definition(seed: int, rising: bool, slope: float, rows: int) -> None:
    rng = np.random.default_rng(seed)
    cols = 30
    gate = gate_of(rng, rising)
    tan_mid = np.linspace(-0.5, 0.5, rows).astype(np.float32)
    shift = (slope * np.linspace(-0.5, 0.5, cols)).astype(np.float32)
    codes = rng.integers(0, CODES + 20, (cols, rows)).astype(np.uint16)
    codes[rng.random(codes.shape) < 0.3] = 0
    mask, table = np.zeros((rows + 7) // 8 * 8, np.uint8), np.zeros((2, rows + 8), np.int32)
    for u in range(cols):
        assert px.mask_open_rows(codes[u], gate, shift[u], tan_mid, mask) == (codes[u] > 1).sum()
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
    px.label_rows(line, mask, 0, rows - 1, peaks, low, high, first_code, mark)
    for v in range(rows):
        held = [p for p in range(peaks) if low[p] <= bin_of_code[line[v]] <= high[p]]
        assert mark[v] == ((held[0] if held else px.NO_PEAK) if mask[v] else px.CLOSED)
    assert (mark[rows:] == px.CLOSED).all()
    mark[:rows:3] = px.TAKEN
    open_ = mask.copy()
    px.mask_remaining_rows(mark, 0, rows - 1, open_)
    assert open_.tolist() == [int(m <= px.NO_PEAK) for m in mark]


def test_ends_of_a_mark() -> None:
    mark = np.array([9, 1, 1, 9, 1, 9, 2], np.uint8)
    assert px.ends_of(mark, 1, 0, 6) == (1, 4)
    assert px.ends_of(mark, 1, 2, 3) == (2, 2)
    assert px.ends_of(mark, 2, 0, 6) == (6, 6)
    first, last = px.ends_of(mark, 7, 0, 6)
    assert first > last
