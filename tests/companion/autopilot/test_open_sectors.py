"""Open space and the autopilot: sectors count it where the configuration says so; the memory of obstacles never does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.free_space_memory import FreeMemory
from companion.autopilot.obstacle_memory import Here, ObstacleMemory, nothing_remembered
from companion.autopilot.polar_histogram import SectorState, scan
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View, points_free
from companion.config.guard import GuardParams
from companion.guard.path_sight import path_sight
from core.types import FrameModel

from ..sector_models import AVOID, HERE, NS, model, wall_at


def open_ahead(*planes: tuple[float, ...], free_to_m: float = 4.0, open_to_m: float = 13.0) -> FrameModel:
    """Measured free to one range and presumed free to another, in all layers of a view of 72 degrees."""
    found = model(*planes, free_to_m=free_to_m, view_deg=72.0)
    f = found.free
    return replace(
        found,
        free=replace(
            f,
            open_from_dm=np.full(f.end.shape, 15, np.uint8),
            open_to_dm=np.full(f.end.shape, round(10 * open_to_m), np.uint8),
        ),
    )


@pytest.mark.parametrize(("counts", "state"), [(False, SectorState.UNSEEN), (True, SectorState.CLEAR)])
def test_a_band_that_is_open_to_the_maximum_is_clear_where_that_is_configured(counts: bool, state: SectorState) -> None:
    found = scan([View(open_ahead(), HERE, open_counts=counts)], AVOID)
    assert found.state[0] == state
    assert found.state[20] == SectorState.UNSEEN


def test_open_space_that_ends_before_the_maximum_is_not_clear() -> None:
    found = scan([View(open_ahead(open_to_m=10.0), HERE, open_counts=True)], AVOID)
    assert found.state[0] == SectorState.UNSEEN


def test_a_band_with_one_layer_that_is_not_open_is_not_clear() -> None:
    found = open_ahead(free_to_m=0.0)
    to_dm, from_dm = found.free.open_to_dm.copy(), found.free.open_from_dm.copy()
    to_dm[:, 1] = from_dm[:, 1] = 0
    found = replace(found, free=replace(found.free, open_from_dm=from_dm, open_to_dm=to_dm))
    assert scan([View(found, HERE, open_counts=True)], AVOID).state[0] == SectorState.UNSEEN


def test_a_plane_in_open_space_is_an_obstacle() -> None:
    found = scan([View(open_ahead(wall_at(0.0, 6.0)), HERE, open_counts=True)], AVOID)
    assert found.state[0] == SectorState.OBSTACLE
    assert found.distance_m[0] == pytest.approx(6.0 - AVOID.radius_m, abs=0.05)


def test_points_that_are_open_are_not_free_by_measurement() -> None:
    view = View(open_ahead(), HERE, open_counts=True)
    x, y, z = np.array([3.0, 8.0]), np.zeros(2), np.zeros(1)
    assert points_free(view, x, y, z)[0].tolist() == [True, True]
    assert points_free(view, x, y, z, measured=True)[0].tolist() == [True, False]


def test_open_space_does_not_remove_a_remembered_obstacle() -> None:
    memory, here = ObstacleMemory(AVOID), Here(0.0, (0.0, 0.0, 0.0), 0)
    near = AVOID.remember_m - 0.5
    with_wall = View(open_ahead(wall_at(0.0, near), free_to_m=near - 0.2, open_to_m=near - 0.2), HERE, open_counts=True)
    memory.recall(scan([with_wall], AVOID), [with_wall], here, 0)
    for t_ns in (NS // 10, 2 * NS // 10, 3 * NS // 10):
        opened = View(open_ahead(free_to_m=0.0), HERE, open_counts=True, t_ns=t_ns)
        kept = memory.recall(scan([opened], AVOID), [opened], here, t_ns)
        assert np.isfinite(kept.distance_m[0])
    for t_ns in (4 * NS // 10, 5 * NS // 10):
        free = View(open_ahead(free_to_m=13.0), HERE, open_counts=True, t_ns=t_ns)
        gone = memory.recall(scan([free], AVOID), [free], here, t_ns)
    assert not np.isfinite(gone.distance_m[0])


def test_the_guard_counts_measured_free_space_alone() -> None:
    view = View(open_ahead(free_to_m=4.0, open_to_m=13.0), HERE, open_counts=True)
    here = Here(0.0, (0.0, 0.0, -3.0), 1)
    memory = FreeMemory(AVOID)
    memory.see("front", NS, view, here)
    s = Surroundings(
        t_ns=NS,
        views=(view,),
        weak_px=(0.0,),
        exposed_ns=NS,
        recall=lambda x, y, z: memory.free((), here, NS, x, y, z),
        recalled=nothing_remembered(),
        blind={},
        here=here,
        velocity_ned_m_s=(5.0, 0.0, 0.0),
    )
    sight = path_sight(s, AVOID, GuardParams(enabled=True, horizon_m=20.0))
    assert 3.0 < sight.free_m <= 4.0


def test_open_space_that_was_withdrawn_is_not_remembered_as_free() -> None:
    """Open, then withdrawn, then out of the view."""
    memory, here = FreeMemory(AVOID), Here(0.0, (0.0, 0.0, -3.0), 1)
    memory.see("front", NS, View(open_ahead(free_to_m=4.0), HERE, open_counts=True), here)
    memory.see("front", 2 * NS, View(model(free_to_m=4.0, view_deg=72.0), HERE, open_counts=True), here)
    x, y, z = np.array([3.0, 8.0]), np.zeros(2), np.zeros(2)
    assert memory.free((), here, 2 * NS, x, y, z).tolist() == [True, False]
