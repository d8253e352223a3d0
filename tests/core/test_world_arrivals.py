"""An obstacle that comes into space that was seen free takes the free space behind it away: it may be inside of it."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from core.jit import kernel
from core.world.association import OBSERVATION
from core.world.free_grid import CELL_M, empty_free
from core.world.free_removal import arrived_in_free, clear_behind, remove_free
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

from ..nightly import examples
from .test_world_free import cells, look, observations_at, profile
from .worlds import NS, house, seen, wall

STEP = NS // 15
TRUCK = np.array(
    [wall(5, -1, 5, 1, -3, 3), wall(5, 1, 11, 1, -3, 3), wall(11, 1, 11, -1, -3, 3), wall(11, -1, 5, -1, -3, 3)]
)


def test_of_a_truck_that_stops_in_free_space_nothing_is_free_though_one_side_is_in_view() -> None:
    world, nothing = World(), np.zeros((0, 6))
    for k in range(5):
        world.add(seen(nothing, (0.0, 0.0), 0.0, k * STEP))
    inside = [[6.0, 0.0, 0.0], [8.0, 0.0, 0.0], [10.0, 0.5, 0.0]]
    assert (WorldSpace(world.picture(5 * STEP)).points(inside, 0.2) == Occupancy.FREE).all()
    for k in range(5, 8):
        world.add(seen(TRUCK, (0.0, 0.0), 0.0, k * STEP))
    space = WorldSpace(world.picture(8 * STEP))
    assert (space.points(inside) == Occupancy.UNKNOWN).all()
    assert space.segments([[8.0, 4.0, 0.0]], [[8.0, -4.0, 0.0]], 0.3).tolist() == [Occupancy.UNKNOWN]
    assert space.points([[8.0, 4.0, 0.0], [4.0, 0.0, 0.0]]).tolist() == [Occupancy.FREE] * 2  # beside and before it
    for k in range(8, 60):  # it is gone again
        world.add(seen(nothing, (0.0, 0.0), 0.0, k * STEP))
    assert (WorldSpace(world.picture(60 * STEP)).points(inside, 0.2) == Occupancy.FREE).all()


def test_a_frame_from_before_an_arrival_that_is_read_after_it_frees_nothing_inside_of_it() -> None:
    """Two cameras with different latencies: the second one's frame was exposed before the truck came."""
    world, nothing = World(), np.zeros((0, 6))
    for k in range(5):
        world.add(seen(nothing, (0.0, 0.0), 0.0, k * STEP))
    for k in range(5, 8):
        world.add(seen(TRUCK, (0.0, 0.0), 0.0, k * STEP))
    for k in range(1, 5):
        world.add(seen(nothing, (0.0, 0.5), 0.05, k * STEP + 1))
    space = WorldSpace(world.picture(8 * STEP))
    assert Occupancy.FREE not in space.points([[6.0, 0.0, 0.0], [8.0, 0.0, 0.0], [10.0, 0.5, 0.0]])
    assert space.points([[8.0, 4.0, 0.0]]).tolist() == [Occupancy.FREE]  # beside it


def test_frames_from_before_an_observation_are_no_proof_that_it_is_gone() -> None:
    world, nothing = World(), np.zeros((0, 6))
    world.add(seen(TRUCK, (0.0, 0.0), 0.0, 10 * STEP))
    for k in range(1, 10):
        world.add(seen(nothing, (0.0, 0.5), 0.05, k * STEP + 1))
    assert WorldSpace(world.picture(10 * STEP)).points([[5.0, 0.0, 0.0]]).tolist() == [Occupancy.OCCUPIED]


def test_a_camera_that_is_read_late_removes_what_is_gone_of_a_plane_that_another_one_observes() -> None:
    """The right part of a wall goes, and only the frames of the second camera show it. They are read 10 ms late."""
    world = World()
    for k in range(60):
        walls = np.array([wall(10.0, -8.0, 10.0, 8.0 if k < 10 else 1.0)])
        world.add(seen(walls, (0.0, 0.0), -0.25 * math.pi, k * STEP, view_deg=100.0))
        world.add(seen(walls, (0.0, 0.0), 0.25 * math.pi, k * STEP - NS // 100, view_deg=100.0))
    space = WorldSpace(world.picture(60 * STEP))
    assert (space.points([[10.0, 2.5, 0.0], [10.0, 5.0, 0.0]]) == Occupancy.FREE).all()
    assert (space.points([[10.0, 0.0, 0.0], [10.0, -5.0, 0.0]]) == Occupancy.OCCUPIED).all()


def test_a_late_frame_that_joins_two_planes_makes_none_of_them_older() -> None:
    world = World()
    world.add(seen(np.array([wall(10.0, -4.0, 10.0, -1.0)]), (0.0, 0.0), 0.0, 10 * STEP))
    world.add(seen(np.array([wall(10.0, 1.2, 10.0, 4.0)]), (0.0, 0.0), 0.0, 12 * STEP))
    assert len(world.picture(12 * STEP).planes) == 2
    world.add(seen(np.array([wall(10.0, -4.0, 10.0, 0.9)]), (0.0, 0.0), 0.0, 11 * STEP))
    assert world.picture(12 * STEP).seen_ns.tolist() == [12 * STEP]


def test_while_the_position_drifts_nothing_behind_a_wall_is_free() -> None:
    """By 0.1 m in each frame, as if the wall came nearer through what was free."""
    world, front = World(), np.array([wall(15.0, -12.0, 15.0, 12.0)])
    for k in range(60):
        world.add(seen(front - [0.1 * k, 0.0, 0.1 * k, 0.0, 0.0, 0.0], (0.0, 0.0), 0.0, k * STEP))
    behind = [[x, y, 0.0] for x in (9.7, 11.0, 13.0, 14.5) for y in (-4.0, 0.0, 4.0)]
    assert Occupancy.FREE not in WorldSpace(world.picture(60 * STEP)).points(behind)


def test_behind_a_house_that_always_stood_there_what_was_seen_free_stays_free() -> None:
    world = World()
    for k in range(240):
        a = math.tau * k / 120
        world.add(seen(house(0.0, 0.0), (10 * math.cos(a), 10 * math.sin(a)), a + math.pi, k * NS // 10))
    ring = [[6.5 * math.cos(a), 6.5 * math.sin(a), 0.0] for a in np.linspace(0.0, math.tau, 36)]
    assert (WorldSpace(world.picture(24 * NS)).points(ring) == Occupancy.FREE).all()


@kernel
def clear_one(free, x, y, observations):
    clear_behind(free, x, y, observations[0])


@kernel
def remove(free, observations, arrived):
    remove_free(free, observations, arrived, 0.0, 0.0)


def test_a_cell_in_which_an_obstacle_stands_is_not_free_whether_it_has_arrived_or_not() -> None:
    rng = np.random.default_rng(0)
    p = profile(rng)
    for arrived in (False, True):
        free = empty_free(256)
        look(free, p, 0.0, 0.0)
        before = cells(free)
        ix, iy, iz = max(before, key=lambda cell: cell[0])
        row = np.zeros(1, OBSERVATION)
        row["ax_m"] = row["bx_m"] = (ix + 0.9) * CELL_M  # behind the middle of the cell
        row["ay_m"], row["by_m"] = (iy + 0.1) * CELL_M, (iy + 0.9) * CELL_M
        row["top_m"], row["bottom_m"] = (iz + 0.1) * CELL_M, (iz + 0.9) * CELL_M
        assert arrived_in_free(free, np.repeat(row, 2)).tolist() == [True, True]
        assert cells(free) == before
        remove(free, row, np.array([arrived]))
        after = cells(free)
        assert (ix, iy, iz) not in after
        assert after < before


@examples(0.4)
@given(st.integers(0, 2**32 - 1))
def test_cells_behind_a_plane_by_a_ray_to_each(seed: int) -> None:
    rng, free = np.random.default_rng(seed), empty_free(256)
    p = profile(rng)
    look(free, p, 0.0, 0.0)
    free.state[0]["epoch"] += 1
    look(free, p, 0.0, 0.0)  # the cells are free in two epochs
    before = cells(free, 1)
    assume(before)
    z = float(p.layer_edges_m[0])
    row = np.concatenate([rng.uniform(-6, 6, 4), z + rng.uniform(0, 2, 1), z + rng.uniform(2, 4, 1)])
    x, y = rng.uniform(-1.0, 1.0, 2)
    clear_one(free, x, y, observations_at(row[None]))
    after = cells(free, 1)
    assert after <= before
    a, b, camera = row[0:2], row[2:4], np.array([x, y])

    def meeting(way: np.ndarray) -> tuple[float, float]:
        """Where a ray meets the line of the plane: share of the ray, place on the plane."""
        along = b - a
        turn = way[0] * along[1] - way[1] * along[0]
        share = ((a - camera)[0] * along[1] - (a - camera)[1] * along[0]) / turn
        return share, ((a - camera)[0] * way[1] - (a - camera)[1] * way[0]) / turn

    for ix, iy, iz in before:
        middle = (np.array([ix, iy]) + 0.5) * CELL_M
        share, place = meeting(middle - camera)
        hidden = 0.0 < share < 1.0 and 0.0 <= place <= 1.0
        if 0.0 < share < 1.0:  # a cell of which only a corner is hidden is not free either
            for corner in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)):
                of_ray, of_plane = meeting((np.array([ix, iy]) + corner) * CELL_M - camera)
                hidden = hidden or (0.0 < of_ray < 1.0 and 0.0 <= of_plane <= 1.0)
        level = (iz + 1) * CELL_M > row[4] and iz * CELL_M < row[5]
        if hidden and level:
            assert (ix, iy, iz) not in after
        out_of_level = iz * CELL_M > row[5] + 0.01 or (iz + 1) * CELL_M < row[4] - 0.01
        if out_of_level or share > 1.0 + 1e-6 or share < -1e-6:  # above, below, or not behind the plane
            assert (ix, iy, iz) in after
