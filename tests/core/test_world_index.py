"""The table of planes: found again by place like by looking at all of them, bounded, the one not seen longest goes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.jit import kernel
from core.world.params import WorldParams
from core.world.plane_index import empty_tables, gather, insert, new_slot, remove, set_links

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)


@kernel
def put(tables, row, t_ns):
    i = new_slot(tables, t_ns)
    plane = tables.planes[i]
    plane.ax_m, plane.ay_m, plane.bx_m, plane.by_m, plane.top_m, plane.bottom_m = (
        row[0],
        row[1],
        row[2],
        row[3],
        row[4],
        row[5],
    )
    insert(tables, i)
    return i


@kernel
def drop(tables, i):
    set_links(tables, i, False)
    remove(tables, i)


def planes(rng: np.random.Generator, n: int) -> np.ndarray:
    xy = rng.uniform(-40, 40, (n, 2))
    along = rng.normal(size=(n, 2)) * rng.choice([0.3, 5.0, 40.0], (n, 1))
    top = rng.uniform(-6, 4, n)
    return np.column_stack([xy, xy + along, top, top + rng.uniform(0.1, 5, n)]).astype(np.float32)


def boxes_touch(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """The definition, one plane at a time."""
    x, y = sorted((p[0], p[2])), sorted((p[1], p[3]))
    return bool(
        x[0] <= high[0] and x[1] >= low[0] and y[0] <= high[1] and y[1] >= low[1] and p[4] <= high[2] and p[5] >= low[2]
    )


def crosses(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether any of many points along a plane lies in the box seen from above, and its heights overlap."""
    s = np.linspace(0, 1, 400)[:, None]
    at = p[0:2] + s * (p[2:4] - p[0:2])
    return bool(((at >= low[:2]) & (at <= high[:2])).all(axis=1).any() and p[4] <= high[2] and p[5] >= low[2])


@given(SEED)
def test_found_by_place_as_by_looking_at_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tables, rows, slots = empty_tables(256), planes(rng, 120), []
    for k, row in enumerate(rows):
        slots.append(put(tables, row, k))
    alive = np.ones(len(rows), bool)
    for k in rng.choice(len(rows), 40, replace=False):
        drop(tables, slots[k])
        alive[k] = False
    assert tables.state[0].live == alive.sum()
    out = np.empty(256, np.int32)
    for _ in range(8):
        low = rng.uniform(-45, 40, 3)
        high = low + rng.uniform(0.1, 30, 3)
        n = gather(tables, low[0], low[1], high[0], high[1], low[2], high[2], out)
        found = out[:n].tolist()
        assert len(set(found)) == len(found)
        for k, row in enumerate(rows):
            if not alive[k]:
                assert slots[k] not in found
            elif crosses(row, low, high):
                assert slots[k] in found
            elif slots[k] in found:
                assert boxes_touch(row, low, high)


def test_the_one_not_seen_longest_goes_and_is_counted() -> None:
    tables, rng = empty_tables(64), np.random.default_rng(3)
    rows = planes(rng, 200)
    rows[:, 2:4] = rows[:, 0:2] + 0.5
    slots = [put(tables, row, k) for k, row in enumerate(rows)]
    assert tables.state[0].live == 64
    assert tables.state[0].dropped == 136
    alive = np.flatnonzero(tables.planes["hits"] > 0)
    assert sorted(tables.planes["seen_ns"][alive].tolist()) == list(range(136, 200))
    assert sorted(slots[136:]) == alive.tolist()


def test_long_planes_that_take_all_links_push_others_out_and_are_found() -> None:
    tables, rng = empty_tables(64), np.random.default_rng(3)
    for k in range(64):
        x, y = rng.uniform(-5, 5, 2)
        put(tables, np.array([x, y, x + 70, y + 70, 0, 1], np.float32), k)
    assert 0 < tables.state[0].live < 64
    out = np.empty(256, np.int32)
    assert gather(tables, 30.0, 20.0, 40.0, 50.0, 0.0, 1.0, out) == tables.state[0].live


def test_what_does_not_fit_is_counted() -> None:
    tables = empty_tables(64)
    for k in range(10):
        put(tables, np.array([k, 0, k + 1, 0, 0, 1], np.float32), k)
    assert gather(tables, -1.0, -1.0, 20.0, 1.0, 0.0, 1.0, np.empty(4, np.int32)) == 4
    assert tables.state[0].overflow == 6


def test_a_plane_takes_no_more_than_256_bytes_and_4_for_each_step_of_the_longest() -> None:
    for longest_m, most in ((100.0, 256 + 4 * (400 + 2)), (0.0, 256)):
        assert sum(t.nbytes for t in empty_tables(1 << 16, longest_m)) <= most * (1 << 16)


def test_parameters_are_checked() -> None:
    with pytest.raises(ValueError, match=r"free_age_s = 0\.5: expected 1\.0\.\.3600"):
        WorldParams(free_age_s=0.5)
    with pytest.raises(ValueError, match=r"most_planes = 1000\.5: expected a whole number"):
        WorldParams(most_planes=1000.5)
