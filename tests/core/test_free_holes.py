"""Holes of the levelled view: squares of unknown cells that may hide a thing, and the free ranges that they end."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.stages.free_cells import unknown_of_blocks
from core.stages.free_holes import add_sides, find_holes, holds_hole, join_holes, side_index
from core.types import FreeProfile

from . import naive_free
from .columns import F, code, view
from .test_free_space import THICK, profile

# Without the JIT holes and their sides are compared with naive_free, and one hole that ends a range and one that ends none.
SEED = st.integers(0, 2**32 - 1)
COLS, ROWS = 160, 160
WALL_M = 9.0
AROUND = 3
"""Layer of 2 m around the height of the camera. At 2 m it covers 50 rows on either side of the horizon."""


def random_holes(rng: np.random.Generator, cols: int, rows: int) -> np.ndarray:
    """Codes with rectangles and single cells that are unknown."""
    codes = np.ones((cols, rows), np.uint16)
    for _ in range(rng.integers(0, 6)):
        u, v = rng.integers(-8, cols), rng.integers(-8, rows)
        codes[max(u, 0) : u + rng.integers(1, 40), max(v, 0) : v + rng.integers(1, 40)] = 0
    codes[rng.random(codes.shape) < rng.choice([0.0, 0.1])] = 0
    codes[rng.random(codes.shape) < 0.01] = 1
    return codes


@pytest.mark.nojit
@given(SEED)
def test_holes_are_the_squares_of_unknown_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    codes = random_holes(rng, int(rng.integers(1, 50)), int(rng.integers(1, 50)))
    holes = find_holes(unknown_of_blocks(codes))
    for k in range(4):
        np.testing.assert_array_equal((holes >> k) & 1 != 0, naive_free.holes(codes == 0, 4 << k))


@pytest.mark.nojit
@given(SEED)
def test_holes_of_a_direction_and_those_beside_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = int(rng.choice([33, 34, 35, 36]))
    codes = random_holes(rng, 12, rows)
    found = rng.integers(0, 16, (12, 9)).astype(np.uint8) * (rng.random((12, 9)) < 0.1).astype(np.uint8)
    reached = [naive_free.rows_of_holes((found >> k) & 1 != 0, codes == 0) for k in range(4)]
    u0 = int(rng.integers(0, 11))
    u1 = int(rng.integers(u0 + 1, 13))
    own, beside = np.full(rows, 7, np.uint8), np.full(rows, 7, np.uint8)
    join_holes(codes, found, (u0, u1), np.empty(9, np.uint8), own, beside)
    v0, v1 = np.sort(rng.integers(-6, rows + 6, 2))
    for k in range(4):
        np.testing.assert_array_equal((own >> k) & 1 != 0, reached[k][u0:u1].any(axis=0))
        np.testing.assert_array_equal((beside >> k) & 1 != 0, reached[k][max(u0 - 1, 0) : u1 + 1].any(axis=0))
        assert holds_hole(own, v0, v1, k) == bool((own[max(v0, 0) : max(v1 + 1, 0)] >> k & 1).any())


@pytest.mark.nojit
def test_the_side_that_is_nearest_as_a_ratio() -> None:
    cells = [0.1, 4.0, 5.6, 5.7, 11.3, 11.4, 22.6, 22.7, 1000.0]
    assert [side_index(c) for c in cells] == [0, 0, 0, 1, 1, 2, 2, 3, 3]


def profile_with(*unknown: tuple[slice, slice], min_range_m: float = 0.3, **params: float) -> FreeProfile:
    """Free ranges before a wall, with these columns and rows unknown."""
    codes = np.full((COLS, ROWS), code(WALL_M)[0])
    for part in unknown:
        codes[part] = 0
    return profile(codes, view(rows=ROWS, cols=COLS), min_range_m=min_range_m, **params)


def first_columns(f: FreeProfile) -> np.ndarray:
    """First column of each direction, and the end of the last one."""
    t = np.tan(f.azimuth_edges_rad.astype(float))
    return np.ceil(np.round(t * F + 0.5 * (COLS - 1), 3)).astype(int)


def covers(f: FreeProfile, direction: int, range_m: float) -> bool:
    """Whether the layer around the camera is free at a range."""
    return bool(f.free_from_m[direction, AROUND] <= range_m <= f.free_to_m[direction, AROUND])


HIDDEN = {
    "sphere": (slice(-2, 12), slice(98, 112)),  # the last two columns of a direction and more, 14 of 100 rows
    "bar": (slice(-40, 40), slice(98, 106)),
    "pole": (slice(-2, 2), slice(80, 118)),  # it ends in the layer: less than half of each column is hidden
}
"""Columns from the end of a direction on, and rows, of things that hide less than a fifth of the layer at 2 m."""


@pytest.mark.parametrize("name", ["sphere", "bar", "pole"])
def test_a_thing_nearer_than_the_minimum_range_is_in_no_free_cell(name: str) -> None:
    """It may reach to 1.5 times that range: what is free begins behind that."""
    f = profile_with()
    direction, layer = len(f.azimuth_edges_rad) // 2, AROUND
    assert covers(f, direction, 2.1)
    end = first_columns(f)[direction + 1]
    columns, rows = HIDDEN[name]
    hidden = (slice(end + columns.start, end + columns.stop), rows)
    for min_range_m in (1.4, 2.0):
        g = profile_with(hidden, min_range_m=min_range_m, profile_blank_m=2.0)
        assert not covers(g, direction, 1.5 * min_range_m)
    # where the camera measures all of the ring, so small a thing without texture is not looked for
    g = profile_with(hidden, profile_blank_m=2.0)
    assert g.free_from_m[direction, layer] == f.free_from_m[direction, layer]


def test_the_corner_of_a_thing_without_texture_is_in_no_free_cell() -> None:
    """A blank thing of 1 x 1 m at 4 m: 25 cells, one column of which lies in the direction."""
    f = profile_with()
    direction = len(f.azimuth_edges_rad) // 2
    end = first_columns(f)[direction + 1]
    g = profile_with((slice(end - 1, end + 24), slice(90, 115)))
    assert covers(f, direction, 4.0)
    assert covers(f, direction + 1, 4.0)
    assert not covers(g, direction, 4.0)
    assert not covers(g, direction + 1, 4.0)
    assert covers(g, direction - 1, 4.0)


@pytest.mark.parametrize(("first", "end"), [(12, 54), (12, 55), (105, 148), (106, 148)])
def test_the_edge_of_a_hole_that_fills_a_block_in_part_is_in_no_free_cell(first: int, end: int) -> None:
    """The rings at 3.75 and 3.5 m see the layer in rows 53..106 and 51..108. The hole ends with the second or third of the four rows
    of the block in which the layer begins or ends, one or two rows within it."""
    f = profile_with()
    direction = len(f.azimuth_edges_rad) // 2
    assert covers(f, direction, 3.8)
    middle = int(first_columns(f)[direction])
    g = profile_with((slice(middle - 20, middle + 20), slice(first, end)))
    assert not covers(g, direction, 3.8)
    assert covers(g, direction, 5.0)


@pytest.mark.parametrize(("first", "end"), [(12, 53), (107, 148)])
def test_a_hole_whose_edge_does_not_reach_the_rows_of_a_ring_does_not_end_it(first: int, end: int) -> None:
    """The ring at 3.75 m sees the layer in rows 53..106, the one at 3.5 m in rows 51..108."""
    f = profile_with()
    direction = len(f.azimuth_edges_rad) // 2
    middle = int(first_columns(f)[direction])
    g = profile_with((slice(middle - 20, middle + 20), slice(first, end)))
    assert not covers(g, direction, 3.5)
    assert covers(g, direction, 3.8)


def test_the_upper_edge_of_a_wall_without_texture_is_in_no_free_cell_of_a_layer_below_the_camera() -> None:
    """The wall stands at 8.53 m and ends 1.11 m below the camera, in row 50 of rows 44..51 that the ring at 8.5 m sees. The ring at
    9.5 m sees the layer in rows 43..49, over the wall."""
    codes = np.full((COLS, ROWS), code(np.inf)[0])
    codes[:, 50:127] = 0
    g = view(rows=ROWS, cols=COLS, f=112.5)._replace(cv=34.5)
    f = profile(codes, g, profile_layer_m=0.5, profile_layers=9)
    direction, layer = len(f.azimuth_edges_rad) // 2, 6
    assert f.layer_edges_m[layer] == 0.75
    assert not f.free_from_m[direction, layer] <= 8.53 <= f.free_to_m[direction, layer]
    assert f.free_from_m[direction, layer] == pytest.approx(9.5, abs=0.05)
    assert f.free_to_m[direction, layer] > 18.0


@pytest.mark.parametrize("left", [True, False])
def test_the_side_of_a_round_hole_is_in_no_free_cell(left: bool) -> None:
    """A hole of 60 cells across, of which two columns lie in the direction: 15 and 21 rows, where 32 count. Squares of that side
    begin four columns within the hole."""
    f = profile_with(profile_blank_m=1.0)
    direction, radius = len(f.azimuth_edges_rad) // 2, 30
    assert covers(f, direction, 3.0)
    first, end = (int(u) for u in first_columns(f)[direction : direction + 2])
    middle = end - 2 + radius if left else first + 1 - radius
    u, v = np.mgrid[:COLS, :ROWS]
    codes = np.full((COLS, ROWS), code(WALL_M)[0])
    codes[(u - middle) ** 2 + (v - 0.5 * (ROWS - 1)) ** 2 <= radius * radius] = 0
    g = profile(codes, view(rows=ROWS, cols=COLS), profile_blank_m=1.0)
    assert not covers(g, direction, 3.0)
    assert covers(g, direction - 1 if left else direction + 1, 3.0)


@pytest.mark.nojit
@given(SEED)
def test_sides_of_holes_against_each_block(seed: int) -> None:
    rng = np.random.default_rng(seed)
    codes = random_holes(rng, int(rng.integers(1, 50)), int(rng.integers(1, 50)))
    unknown = unknown_of_blocks(codes)
    found = find_holes(unknown)
    add_sides(unknown, found)
    for k in range(4):
        wanted = naive_free.with_sides(naive_free.holes(codes == 0, 4 << k), codes == 0)
        np.testing.assert_array_equal((found >> k) & 1 != 0, wanted)


@given(SEED)
def test_dropped_pixels_and_lines_are_no_hole(seed: int) -> None:
    """Except in the outermost columns, beside which nothing is known."""
    rng = np.random.default_rng(seed)
    codes = np.full((COLS, ROWS), code(WALL_M)[0])
    codes[1:-1][rng.random((COLS - 2, ROWS)) < 0.08] = 0
    codes[1:-1, rng.choice(ROWS // 8, 6, replace=False) * 8] = 0
    codes[rng.choice(np.arange(8, COLS - 8, 8), 6, replace=False)] = 0
    assert not find_holes(unknown_of_blocks(codes)).any()


@given(SEED)
def test_holes_only_take_free_space_away(seed: int) -> None:
    """A range that begins behind a hole ends where it would without the rule."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(2.0, 12.0, (COLS // 8, ROWS // 8))
    codes = code(np.repeat(np.repeat(rows, 8, 0), 8, 1).ravel()).reshape(COLS, ROWS)
    codes[random_holes(rng, COLS, ROWS) == 0] = 0
    g, thin = view(rows=ROWS, cols=COLS), {"profile_layer_m": 1.0, "profile_layers": 9}
    with_rule = profile(codes, g, min_range_m=float(rng.uniform(0.1, 3.0)), **{**THICK, **thin})
    without = profile(codes, g, min_range_m=0.01, **{**THICK, **thin, "profile_blank_m": 2.0})
    free = with_rule.free_to_m > with_rule.free_from_m
    assert (with_rule.free_from_m >= without.free_from_m)[free].all()
    assert (with_rule.free_to_m <= without.free_to_m).all()
