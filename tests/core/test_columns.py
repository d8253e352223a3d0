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
from core.stages.ground_fit import GroundPlane
from core.stages.ground_threshold import GroundThreshold
from core.stages.settings import view_settings

from .columns import QUANTUM, F, code, view

pytestmark = pytest.mark.nojit
COLS, ROWS = 12, 120
NOWHERE = GroundPlane(np.inf, 0.0, 0.0)


def search_of(codes: np.ndarray, p: Params, limit: float = np.inf) -> tuple[Any, ...]:
    """What `extract_strips` takes of codes (cols, rows) in a level view, with an empty table. limit: row tangent below which all
    is ground."""
    g = view(codes.shape[1], codes.shape[0])
    sigma = 0.0015 * F
    strips = np.zeros(len(codes) * p.max_column_strips, s.STRIP)
    strips["disparity_px"] = np.nan
    zero = np.float32(0.0)
    ground = GroundThreshold(zero, zero, zero, zero, np.float32(limit), np.zeros(g.cols, np.float32), NOWHERE)
    return codes, ground, g, bin_table(F, QUANTUM, sigma, p), view_settings(g, 0.0015, p), strips


def strips_of(codes: np.ndarray, p: Params, limit: float = np.inf) -> tuple[np.ndarray, int, int]:
    """(strips, ground pixels, merged strips) of codes (cols, rows) in a level view, by top row within a column."""
    search = search_of(codes, p, limit)
    strips = search[-1]
    n, ground, merged = extract_strips(*search)
    columns = np.zeros(len(codes) + 1, np.int32)
    support.index_columns(strips, n, len(codes), columns)
    support.sort_columns(strips, len(codes), columns)
    return strips[:n], int(ground), int(merged)


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
    strips, ground, merged = strips_of(codes, Params())
    assert (ground, merged) == (0, 0)
    for u in range(COLS):
        own = strips[strips["column"] == u]
        assert own["support"].sum() >= 0.97 * s.PX * (codes[u] > 1).sum()
        for v in np.flatnonzero(codes[u] > 1):
            assert ((own["top_row"] <= v) & (own["bottom_row"] >= v)).any()
    for name in ("disparity_px", "near_px", "sigma_px"):
        assert np.isfinite(strips[name]).all()


def test_ground_is_taken_out_and_counted() -> None:
    codes = np.full((COLS, ROWS), code(9.0)[0], np.uint16)
    strips, ground, _ = strips_of(codes, Params(), limit=0.3)
    below = int(np.sum((np.arange(ROWS) - 59.5) / F > 0.3))
    assert ground == COLS * below
    assert strips["bottom_row"].max() == ROWS - below - 1


def over(strips: np.ndarray, strip: np.ndarray) -> np.ndarray:
    """Which of the strips cover all rows of one."""
    spans = (strips["top_row"] <= strip.top_row) & (strips["bottom_row"] >= strip.bottom_row)
    return (strips["column"] == strip.column) & spans


def test_what_has_no_room_is_merged_at_the_nearest_distance_and_counted() -> None:
    codes = leaves(2)
    wide, _, none = strips_of(codes, Params())
    narrow, _, merged = strips_of(codes, Params(max_column_strips=8))
    assert none == 0
    assert merged == len(wide) - len(narrow) > 100
    assert (narrow["kind"] == s.MERGED).sum() == COLS
    assert np.bincount(narrow["column"]).max() == 8
    for strip in wide:
        covering = narrow[over(narrow, strip)]
        assert (covering["disparity_px"] >= strip.disparity_px).any()
        assert (covering["near_px"] >= strip.near_px).any()
    assert narrow["support"].sum() == wide["support"].sum()


def test_no_strip_loses_its_support_to_a_merged_one() -> None:
    codes = leaves(3)
    kept = {}
    for room in (128, 8):
        p = Params(max_column_strips=room)
        strips, _, _ = strips_of(codes, p)
        n, columns = len(strips), np.zeros(COLS + 1, np.int32)
        support.index_columns(strips, n, COLS, columns)
        settings = view_settings(view(ROWS, COLS), 0.0015, p)[0]
        n = support.drop_unsupported(strips, n, COLS, settings, columns, np.zeros(n, np.uint8))
        kept[room] = strips[:n]
    wide, narrow = kept[128], kept[8]
    assert len(wide) > 100
    for strip in wide:
        assert (narrow[over(narrow, strip)]["disparity_px"] >= strip.disparity_px).any()
