"""The memory of the merged world: tables take what is in use, and those of past sections are released."""

from __future__ import annotations

import os
import weakref
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from core.world.free_grid import empty_free
from core.world.plane_index import Tables, empty_tables
from core.world.world import World

from .worlds import NS, seen, wall


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_the_tables_of_a_past_section_are_released() -> None:
    """They have tens of megabytes, and only its planes are ever asked for."""
    world = World()
    world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, 0))
    assert world.section is not None
    tables = [weakref.ref(table) for table in (*world.section.tables, *world.section.free)]
    world.add(seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, NS // 10, reset_counter=1))
    assert [table() for table in tables if table() is not None] == []
    assert [len(s.box) for s in world.saved()] == [1, 0]


def test_the_tables_of_a_section_are_released_before_those_of_the_next_are_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both at once would take twice the memory."""
    world = World()
    world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, 0))
    assert world.section is not None
    kept = weakref.ref(world.section.tables.planes)

    def checked(*sizes: float) -> Tables:
        assert kept() is None
        return empty_tables(*sizes)

    monkeypatch.setattr("core.world.world.empty_tables", checked)
    world.add(seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, NS // 10, reset_counter=1))
    assert world.counts.sections == 2


def test_the_planes_of_a_past_section_keep_nothing_else_in_memory() -> None:
    """A view of one field of a table keeps all of its fields."""
    world = World()
    world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, 0))
    (section,) = world.saved()
    arrays = [getattr(section, f.name) for f in fields(section) if isinstance(getattr(section, f.name), np.ndarray)]
    assert len(arrays) == 6
    assert [a.dtype for a in arrays if a.base is not None and a.base.nbytes > a.nbytes] == []


def test_tables_that_were_never_written_take_no_memory() -> None:
    """Each jump of the position makes new ones."""

    before = resident_bytes()
    tables = [*empty_tables(262144), *empty_free(262144)]
    assert sum(table.nbytes for table in tables) > 2e9
    assert resident_bytes() - before < 50e6


def test_many_jumps_of_the_position_take_no_memory() -> None:
    """glibc takes a table from its heap, and clears all of it, once one of that size was freed."""
    world, others = World(), []
    world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, 0))
    before = resident_bytes()
    for k in range(1, 10):
        others.append(bytearray(100_000))  # above the tables, a heap does not shrink when they are released
        world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, k * NS // 10, reset_counter=k))
    assert resident_bytes() - before < 10e6
