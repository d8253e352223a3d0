"""What moves leaves no planes behind in the merged world, and what is in view is never replaced by a plane elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.world.evidence import STEP, count_hit, erase_outside, has_evidence, merge_steps, plane_steps, steps_of
from core.world.free_grid import empty_free
from core.world.join_cost import END_A, END_B, Box, Joined, joined_cuts, stands_for, stays_open, widened
from core.world.params import WorldParams
from core.world.plane_index import Tables, empty_tables, new_slot
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

from .worlds import NS, seen, wall

STEP_NS = NS // 10
BACK = wall(15.0, -8.0, 15.0, 8.0)


def person(x: float, y: float) -> list[float]:
    """The front of a person of 0.5 m, seen from smaller x."""
    return wall(x, y - 0.25, x, y + 0.25)


# ---- moving objects ---------------------------------------------------------------------------------------------------


def test_two_persons_that_meet_leave_no_trail_and_are_there_in_every_frame() -> None:
    """Their trails are joined where they meet; 1.5 m behind each of them nothing is occupied a second later."""
    world = World()
    for k in range(50):
        y = -3.6 + 0.15 * k
        world.add(seen(np.array([BACK, person(8.0, y), person(8.2, -y)]), (0.0, 0.0), 0.0, k * STEP_NS))
        space = WorldSpace(world.picture(k * STEP_NS))
        assert space.points([[8.0, y, 0.0], [8.2, -y, 0.0]], 0.1).tolist() == [Occupancy.OCCUPIED] * 2
    behind = [[8.1, side * at, 0.0] for side in (-1, 1) for at in np.arange(0.0, y - 1.5, 0.1)]
    assert len(behind) > 20
    assert Occupancy.OCCUPIED not in space.points(behind, 0.1)


def test_a_person_who_stands_is_kept_beside_a_trail_that_goes() -> None:
    world = World()
    for k in range(60):
        y = min(-2.0 + 0.15 * k, 1.0)
        world.add(seen(np.array([BACK, person(8.0, y)]), (0.0, 0.0), 0.0, k * STEP_NS))
    space = WorldSpace(world.picture(60 * STEP_NS))
    assert space.points([[8.0, 1.0, 0.0]], 0.1).tolist() == [Occupancy.OCCUPIED]
    assert Occupancy.OCCUPIED not in space.points([[8.0, y, 0.0] for y in np.arange(-2.0, 0.3, 0.1)], 0.1)


def test_several_parts_of_a_plane_are_removed_in_one_frame() -> None:
    world, whole = World(), np.array([wall(8.0, -6.0, 8.0, 6.0)])
    ends = (-6.0, -4.0, -3.0, -0.5, 1.0, 3.0, 4.5, 6.0)
    open_ = np.array([wall(8.0, a, 8.0, b) for a, b in zip(ends[::2], ends[1::2], strict=True)])
    for k in range(20):
        world.add(seen(whole if k < 4 else open_, (0.0, 0.0), 0.0, k * STEP_NS))
    assert world.section is not None
    planes = world.picture(20 * STEP_NS).planes
    assert len(planes) == 4
    for part in open_:
        assert any(p[1] <= part[1] + 1e-3 and p[3] >= part[3] - 1e-3 for p in planes)
    table = world.section.used_slots
    table = table[table["hits"] > 0]
    assert table["cut"][np.argsort(table["ay_m"])].tolist() == [END_B, END_A | END_B, END_A | END_B, END_A]


def test_a_plane_with_more_steps_than_its_row_is_kept_whole() -> None:
    world, whole = World(WorldParams(longest_m=5.0)), np.array([wall(8.0, -6.0, 8.0, 6.0)])
    for k in range(40):
        world.add(seen(whole if k < 1 else np.zeros((0, 6)), (0.0, 0.0), 0.0, k * STEP_NS))
    assert len(world.picture(40 * STEP_NS).planes) == 1


# ---- what is in view --------------------------------------------------------------------------------------------------


def test_a_front_is_not_replaced_by_a_side_that_faces_away() -> None:
    """The side was observed from elsewhere; a camera before the front sees the side edge-on, from behind."""
    side, front = wall(6.0, 1.0, 10.0, 1.0), wall(10.2, 0.75, 10.3, 1.25)
    world = World(WorldParams(jump_m=100.0))
    for k in range(5):
        world.add(seen(np.array([side]), (8.0, 6.0), -math.pi / 2, k * STEP_NS))
    world.add(seen(np.array([front]), (0.0, 0.0), 0.0, 5 * STEP_NS))
    p = world.picture(5 * STEP_NS)
    assert len(p.planes) == 2
    fronts = p.planes[np.abs(p.planes[:, 2] - p.planes[:, 0]) < 0.2]
    assert len(fronts) == 1
    assert np.allclose(fronts[0, :4], front[:4], atol=0.05)


def box(ax: float, ay: float, bx: float, by: float) -> Box:
    return Box(ax, ay, bx, by, -1.0, 1.0)


def line(ax: float, ay: float, bx: float, by: float) -> Joined:
    return Joined(0.5, ax, ay, bx, by, 0.0)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (line(10.0, -2.0, 10.0, 2.0), True),
        (line(10.2, -2.0, 10.2, 2.0), True),
        (line(9.8, -2.0, 9.8, 2.0), True),
        (line(10.35, -2.0, 10.35, 2.0), False),  # behind what was observed
        (line(9.6, -2.0, 9.6, 2.0), False),  # too far in front of it
        (line(9.0, 0.3, 13.0, -0.3), False),  # edge-on, and seen from behind
        (line(8.0, -0.6, 11.0, 0.5), False),  # edge-on
        (line(10.0, 2.0, 10.0, -2.0), False),  # seen from behind
    ],
)
def test_which_planes_may_stand_for_an_observation(found: Joined, expected: bool) -> None:
    """The observation is 0.5 m wide at x = 10, the camera at the origin, the noise 0.02 m."""
    assert bool(stands_for(found, box(10.0, -0.25, 10.0, 0.25), 0.02, 0.0, 0.0)) == expected


@pytest.mark.nojit
@pytest.mark.parametrize("heading", [0.0, 0.4, -0.7])
def test_a_plane_behind_an_observation_hides_the_same_directions(heading: float) -> None:
    c, s = math.cos(heading), math.sin(heading)

    def turned(x: float, y: float) -> tuple[float, float]:
        return c * x - s * y, s * x + c * y

    seen_box = box(*turned(2.4, 1.0), *turned(2.4, 1.5))
    found = widened(line(*turned(2.6, 0.0), *turned(2.6, 1.5)), seen_box, 0.0, 0.0, 0.3)
    assert math.atan2(found.by, found.bx) >= math.atan2(seen_box.by, seen_box.bx) - 1e-9
    limited = widened(line(*turned(2.6, 0.0), *turned(2.6, 1.5)), seen_box, 0.0, 0.0, 0.05)
    assert math.dist((limited.ax, limited.ay), (limited.bx, limited.by)) == pytest.approx(1.55)


@pytest.mark.nojit
def test_a_gap_beside_a_removed_part_stays_open() -> None:
    free, a, b = empty_free(64), box(0.0, 0.0, 2.0, 0.0), box(2.3, 0.0, 4.0, 0.0)
    for cut_a, cut_b, expected in ((0, 0, False), (END_B, 0, True), (0, END_A, True), (END_A, END_B, False)):
        assert bool(stays_open(free, a, cut_a, b, cut_b, 0, 0.3)) == expected
        assert bool(stays_open(free, b, cut_b, a, cut_a, 0, 0.3)) == expected
    assert not stays_open(free, a, END_B, box(1.9, 0.0, 4.0, 0.0), 0, 0, 0.0)  # an observation reaches into it


@pytest.mark.nojit
def test_the_ends_of_a_joined_plane_are_those_of_its_parts() -> None:
    a, b, found = box(0.0, 0.0, 2.0, 0.0), box(1.0, 0.0, 4.0, 0.0), line(0.0, 0.0, 4.0, 0.0)
    assert joined_cuts(found, a, END_A | END_B, b, 0) == END_A
    assert joined_cuts(found, a, 0, b, END_A | END_B) == END_B
    assert joined_cuts(found, a, END_A, box(0.5, 0.0, 1.5, 0.0), END_A | END_B) == END_A


# ---- evidence of the steps --------------------------------------------------------------------------------------------


def table(*boxes: Box, longest_m: float = 10.0) -> Tables:
    """Planes with these boxes, their anchors in the middle; not in the index."""
    tables = empty_tables(64, longest_m)
    for b in boxes:
        p = tables.planes[new_slot(tables, 0)]
        p.ax_m, p.ay_m, p.bx_m, p.by_m, p.top_m, p.bottom_m = b
        p.anchor_x_m, p.anchor_y_m = 0.5 * (b.ax + b.bx), 0.5 * (b.ay + b.by)
    return tables


def column(tables: Tables, i: int, name: str) -> list[int]:
    steps = plane_steps(tables, i)
    return tables.steps[name][i][np.arange(steps.first, steps.end) % tables.steps.shape[1]].tolist()


def put(tables: Tables, i: int, name: str, value: int) -> None:
    steps = plane_steps(tables, i)
    tables.steps[name][i, np.arange(steps.first, steps.end) % tables.steps.shape[1]] = value


@pytest.mark.nojit
def test_an_observation_counts_for_the_steps_that_it_touches() -> None:
    tables = table(box(0.0, 0.0, 2.0, 0.0))
    put(tables, 0, "clears", 3)
    count_hit(tables, 0, box(0.6, 0.1, 1.1, 0.1))
    assert column(tables, 0, "hits") == [0, 0, 1, 1, 1, 0, 0, 0]
    assert column(tables, 0, "clears") == [3, 3, 1, 1, 1, 3, 3, 3]
    count_hit(tables, 0, box(0.6, 0.1, 1.1, 0.1))
    assert column(tables, 0, "clears") == [3, 3, 0, 0, 0, 3, 3, 3]
    count_hit(tables, 0, box(3.0, 0.1, 4.0, 0.1))
    assert column(tables, 0, "hits") == [0, 0, 2, 2, 2, 0, 0, 0]


@pytest.mark.nojit
def test_counts_end_at_their_greatest_value() -> None:
    tables = table(box(0.0, 0.0, 2.0, 0.0))
    put(tables, 0, "hits", np.iinfo(STEP["hits"]).max)
    count_hit(tables, 0, box(0.0, 0.0, 2.0, 0.0))
    assert column(tables, 0, "hits") == [65535] * 8


@pytest.mark.nojit
def test_steps_outside_of_a_plane_are_erased() -> None:
    tables = table(box(0.0, 0.0, 2.0, 0.0))
    put(tables, 0, "clears", 3)
    erase_outside(tables, 0, steps_of(box(0.5, 0.0, 1.25, 0.0), 1.0, 0.0))
    assert column(tables, 0, "clears") == [0, 0, 3, 3, 3, 0, 0, 0]
    assert tables.steps["clears"][0].sum() == 9


@pytest.mark.nojit
def test_joined_planes_keep_the_evidence_that_no_observation_cancels() -> None:
    tables = table(box(0.0, 0.0, 2.0, 0.0), box(1.0, 0.05, 3.0, 0.05))
    put(tables, 0, "clears", 7)
    put(tables, 0, "hits", 1)
    put(tables, 1, "clears", 1)
    put(tables, 1, "hits", 3)
    whole = box(0.0, 0.0, 3.0, 0.05)
    merge_steps(tables, 0, 1, whole)
    plane = tables.planes[0]
    plane.bx_m, plane.by_m = 3.0, 0.05
    assert column(tables, 0, "hits") == [1] * 4 + [3] * 8
    assert column(tables, 0, "clears") == [7] * 4 + [1] * 8
    put(tables, 0, "clears", 4)
    merge_steps(tables, 0, 1, whole)
    assert column(tables, 0, "clears") == [4] * 4 + [0] * 8


@pytest.mark.nojit
def test_a_row_is_used_as_a_ring_and_no_longer_plane_has_evidence() -> None:
    tables = table(box(-100.0, 0.0, -90.0, 0.0), box(0.0, 0.0, 12.0, 0.0))
    tables.planes[0].anchor_x_m = 0.0  # its steps are numbered from -400
    count_hit(tables, 0, box(-100.0, 0.0, -99.5, 0.0))
    assert column(tables, 0, "hits")[:4] == [1, 1, 1, 0]
    count_hit(tables, 1, box(0.0, 0.0, 12.0, 0.0))
    assert not has_evidence(tables, plane_steps(tables, 1))
    assert tables.steps["hits"][1].sum() == 0
