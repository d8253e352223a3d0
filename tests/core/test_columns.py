"""All strips of a view at once: every open pixel is in one, room or no room."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core.params import Params
from core.stages import strips as s
from core.stages import support
from core.stages.columns import extract_strips
from core.stages.density import bin_table
from core.stages.settings import float_settings, int_settings

from .columns import QUANTUM, F, code, view

pytestmark = pytest.mark.nojit
COLS, ROWS = 12, 120


def search_of(
    codes: np.ndarray, p: Params, gate: np.ndarray | None = None
) -> tuple[tuple[Any, ...], np.ndarray, np.ndarray]:
    """What `extract_strips` takes of codes (cols, rows) in a level view; tables for the strips."""
    g = view(codes.shape[1], codes.shape[0])
    gate = np.full(65536, np.inf, np.float32) if gate is None else gate
    sigma = 0.0015 * F
    t = bin_table(F, QUANTUM, sigma, p)
    ints = np.full((len(codes) * p.max_column_strips, 9), -7, np.int32)
    floats = np.full((len(ints), 3), np.nan, np.float32)
    tan_mid = (0.5 * (g.tan_edge[1:] + g.tan_edge[:-1])).astype(np.float32)
    return (
        codes, gate, np.zeros(g.cols, np.float32), tan_mid, g.H, t.bin_of_code, t.disparity_px, t.width_px, t.threshold,
        t.weights, t.first_code, float_settings(g, 0.0015, sigma, p), int_settings(p),
    ), ints, floats  # fmt: skip


def strips_of(codes: np.ndarray, p: Params, gate: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, int, int]:
    """(ints, floats, ground pixels, merged strips) of codes (cols, rows) in a level view, by top row within a column."""
    search, ints, floats = search_of(codes, p, gate)
    n, ground, merged = extract_strips(*search, ints, floats)
    columns = np.zeros(len(codes) + 1, np.int32)
    support.index_columns(ints, n, len(codes), columns)
    support.sort_columns(ints, floats, len(codes), columns)
    return ints[:n], floats[:n], int(ground), int(merged)


def leaves(seed: int) -> np.ndarray:
    """Codes of a wall behind many single pixels, a tenth of them missing."""
    rng = np.random.default_rng(seed)
    x = np.full((COLS, ROWS), 9.0)
    near = rng.random(x.shape) < 0.4
    x[near] = rng.uniform(2.5, 8.0, int(near.sum()))
    codes = code(x.ravel()).reshape(x.shape)
    codes[rng.random(x.shape) < 0.1] = 0
    return codes


def test_all_that_is_measured_is_in_a_strip() -> None:
    codes = leaves(1)
    ints, floats, ground, merged = strips_of(codes, Params())
    assert (ground, merged) == (0, 0)
    for u in range(COLS):
        own = ints[ints[:, s.U] == u]
        assert own[:, s.SUPPORT].sum() >= 0.97 * s.PX * (codes[u] > 1).sum()
        for v in np.flatnonzero(codes[u] > 1):
            over = (own[:, s.TOP] <= v) & (own[:, s.BOTTOM] >= v)
            assert over.any()
    assert np.isfinite(floats).all()


def test_ground_is_taken_out_and_counted() -> None:
    codes = np.full((COLS, ROWS), code(9.0)[0], np.uint16)
    gate = np.full(65536, 0.3, np.float32)  # all that is seen more than 0.3 below the horizon
    ints, _, ground, _ = strips_of(codes, Params(), gate)
    below = int(np.sum((np.arange(ROWS) - 59.5) / F > 0.3))
    assert ground == COLS * below
    assert ints[:, s.BOTTOM].max() == ROWS - below - 1


def test_what_has_no_room_is_merged_at_the_nearest_distance_and_counted() -> None:
    codes = leaves(2)
    wide, wide_px, _, none = strips_of(codes, Params())
    narrow, narrow_px, _, merged = strips_of(codes, Params(max_column_strips=8))
    assert none == 0
    assert merged == len(wide) - len(narrow) > 100
    assert (narrow[:, s.KIND] == s.MERGED).sum() == COLS
    assert np.bincount(narrow[:, s.U]).max() == 8
    for row, (d, near, _) in zip(wide, wide_px, strict=True):
        over = (narrow[:, s.U] == row[s.U]) & (narrow[:, s.TOP] <= row[s.TOP]) & (narrow[:, s.BOTTOM] >= row[s.BOTTOM])
        assert (narrow_px[over, s.D] >= d).any()
        assert (narrow_px[over, s.NEAR] >= near).any()
    assert narrow[:, s.SUPPORT].sum() == wide[:, s.SUPPORT].sum()


def test_no_strip_loses_its_support_to_a_merged_one() -> None:
    codes = leaves(3)
    kept = {}
    for room in (128, 8):
        p = Params(max_column_strips=room)
        ints, floats, _, _ = strips_of(codes, p)
        n, columns = len(ints), np.zeros(COLS + 1, np.int32)
        support.index_columns(ints, n, COLS, columns)
        fs, si = float_settings(view(ROWS, COLS), 0.0015, 0.0015 * F, p), int_settings(p)
        n = support.drop_unsupported(
            ints, floats, n, COLS, fs, si, columns, np.zeros(n, np.int32), np.zeros(n, np.uint8)
        )
        kept[room] = ints[:n], floats[:n]
    (wide, wide_px), (narrow, narrow_px) = kept[128], kept[8]
    assert len(wide) > 100
    for row, px in zip(wide, wide_px, strict=True):
        over = (narrow[:, s.U] == row[s.U]) & (narrow[:, s.TOP] <= row[s.TOP]) & (narrow[:, s.BOTTOM] >= row[s.BOTTOM])
        assert (narrow_px[over, s.D] >= px[s.D]).any()
