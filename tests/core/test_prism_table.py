"""Prisms in tables are the prisms that they were made of, and wrong tables are refused."""

import numpy as np
import pytest

from core.stages.prism_table import PrismTable, prism_table
from core.types import Prism


def prism(edges: int, closed: bool, seed: int) -> Prism:
    rng = np.random.default_rng(seed)
    return Prism(
        cluster=seed,
        top_m=-1.5 - seed,
        bottom_m=0.25,
        closed=closed,
        margin_m=0.5 * seed,
        vertices_m=rng.random((edges + (not closed), 2), np.float32),
        plane=rng.integers(0, 9, edges, np.int32),
    )


PRISMS = (prism(1, False, 0), prism(4, True, 1), prism(3, False, 2))


def same(a: Prism, b: Prism) -> bool:
    plain = all(getattr(a, name) == getattr(b, name) for name in ("cluster", "top_m", "bottom_m", "closed", "margin_m"))
    return plain and np.array_equal(a.vertices_m, b.vertices_m) and np.array_equal(a.plane, b.plane)


def test_each_prism_comes_back_as_it_was() -> None:
    table = prism_table(PRISMS)
    assert len(table) == 3
    assert all(same(a, b) for a, b in zip(table, PRISMS, strict=True))
    assert same(table[-1], PRISMS[2])
    assert [same(a, b) for a, b in zip(table[1:], PRISMS[1:], strict=True)] == [True, True]
    assert prism_table(table) is table
    assert not table[0].vertices_m.flags.writeable


def test_none_is_an_empty_sequence() -> None:
    assert len(prism_table(())) == 0
    assert tuple(prism_table(())) == ()


@pytest.mark.parametrize("key", [3, -4])
def test_a_prism_that_is_not_there(key: int) -> None:
    with pytest.raises(IndexError, match="of 3"):
        prism_table(PRISMS)[key]


def made(**changed: np.ndarray) -> PrismTable:
    table = prism_table(PRISMS)
    names = ("cluster", "heights_m", "closed", "margin_m", "vertex_begin", "edge_begin", "vertices_m", "plane")
    return PrismTable(**{name: changed.get(name, getattr(table, name)) for name in names})


def test_wrong_tables_are_refused() -> None:
    table = made()
    assert len(table) == 3
    with pytest.raises(ValueError, match="top must be less than bottom"):
        made(heights_m=table.heights_m[:, ::-1].copy())
    with pytest.raises(ValueError, match="vertices_m: shape"):
        made(vertices_m=table.vertices_m[:-1])
    with pytest.raises(ValueError, match="plane: dtype"):
        made(plane=table.plane.astype(np.int64))
