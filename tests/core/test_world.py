"""The merged world: one wall is one plane, doors stay open, what moved away goes, jumps are kept apart, unknown stays unknown."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.types import PlaneFlags
from core.world.evidence import CLEAR_LIMIT
from core.world.params import WorldParams
from core.world.snapshot import WorldSnapshot
from core.world.world import Observation, World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

from .worlds import NS, blind, house, seen, wall

STEP = NS // 10
FAR_STEPS = WorldParams(jump_m=100.0)
"""For cameras at several places at once."""


def fly(world: World, walls: np.ndarray, frames: int, *, begin: int = 0, speed: float = 2.0, **how: object) -> int:
    """Along x at y = 0, looking along x; returns the stamp after the last frame."""
    for k in range(begin, begin + frames):
        world.add(seen(walls, (speed * 0.1 * k, 0.0), 0.0, k * STEP, **how))
    return (begin + frames) * STEP


def around(world: World, walls: np.ndarray, *, radius: float = 10.0, frames: int = 120, seed: int = 1) -> int:
    rng = np.random.default_rng(seed)
    for k in range(frames):
        a = math.tau * k / frames
        at = (radius * math.cos(a), radius * math.sin(a))
        world.add(seen(walls, at, a + math.pi, k * STEP, noise=rng))
    return frames * STEP


def same(a: WorldSnapshot, b: WorldSnapshot) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("slots", "planes", "margin_m", "flags", "hits", "seen_ns", "blocks", "masks")
    )


def distance_to(planes: np.ndarray, wall_row: np.ndarray) -> float:
    """Greatest distance of an end of any plane from a wall's line."""
    e = wall_row[2:4] - wall_row[0:2]
    n = np.array([-e[1], e[0]]) / np.linalg.norm(e)
    return float(max(abs((planes[:, 0:2] - wall_row[:2]) @ n).max(), abs((planes[:, 2:4] - wall_row[:2]) @ n).max()))


# ---- merging ----------------------------------------------------------------------------------------------------------


def test_a_wall_seen_in_parts_from_many_places_is_one_plane() -> None:
    world, walls = World(), np.array([wall(0.0, -4.0, 30.0, -4.0)])
    rng = np.random.default_rng(4)
    for k in range(60):
        world.add(seen(walls, (0.4 * k, 0.0), -0.6, k * STEP, noise=rng))
    p = world.picture(60 * STEP)
    assert len(p.planes) == 1
    assert distance_to(p.planes, walls[0]) < 0.03  # a single look is 0.03 m off, 1 sigma
    assert p.planes[0, 2] - p.planes[0, 0] > 26.0  # free space stays on the right


def test_a_flight_around_a_house_closes_it() -> None:
    """Its walls run past their corners by what the noise makes of them: they stay as they were seen, the profile closes."""
    world, walls = World(), house(0.0, 0.0)
    now = around(world, walls)
    p = world.picture(now)
    assert len(p.planes) == 4
    (prism,) = WorldSpace(p).prisms
    assert prism.closed
    assert np.allclose(sorted(np.round(prism.vertices_m).tolist()), [(-3, -3), (-3, 3), (3, -3), (3, 3)])
    assert (np.hypot(*(p.planes[:, 2:4] - p.planes[:, 0:2]).T) >= 6.0).all()


def test_what_faces_away_stays_apart() -> None:
    """Both sides of a thin wall."""
    walls = np.array([wall(6.0, -3.0, 6.0, 3.0), wall(6.15, 3.0, 6.15, -3.0)])
    world = World(FAR_STEPS)
    for k in range(20):
        world.add(seen(walls, (0.0, 0.1 * k), 0.0, k * STEP))
        world.add(seen(walls, (12.0, 0.1 * k), math.pi, k * STEP + 1))
    p = world.picture(20 * STEP)
    assert sorted(np.sign(p.planes[:, 3] - p.planes[:, 1]).tolist()) == [-1.0, 1.0]


def test_parallel_walls_and_steps_of_height_stay_apart() -> None:
    world = World()
    low, high = wall(8.0, -3.0, 8.0, 0.0, -1.0, 4.0), wall(8.0, 0.0, 8.0, 3.0)
    now = fly(world, np.array([low, high, wall(9.0, 3.0, 9.0, 7.0)]), 20)
    p = world.picture(now)
    assert len(p.planes) == 3
    assert sorted(p.planes[:, 4].tolist()) == [-4.0, -4.0, -1.0]


def test_a_door_that_was_seen_through_stays_open_and_an_unseen_gap_is_closed_and_marked() -> None:
    both = np.array([wall(9.0, -6.0, 9.0, -0.9), wall(9.0, 0.9, 9.0, 6.0)])
    world = World()
    now = fly(world, both, 25)
    p = world.picture(now)
    assert len(p.planes) == 2
    assert WorldSpace(p).segments([[6, 0, 0]], [[12, 0, 0]], 0.1).tolist() == [Occupancy.FREE]
    # the same two halves, of which each frame shows but one; nothing of the gap between is ever in view
    world = World(FAR_STEPS)
    for k in range(10):
        world.add(seen(both, (0.0, -3.0), -0.2, 2 * k * STEP, view_deg=50))
        world.add(seen(both, (0.0, 3.0), 0.2, (2 * k + 1) * STEP, view_deg=50))
    p = world.picture(20 * STEP)
    assert len(p.planes) == 1
    assert p.flags[0] & PlaneFlags.INFERRED
    assert WorldSpace(p).segments([[6, 0, 0]], [[12, 0, 0]], 0.1).tolist() == [Occupancy.OCCUPIED]
    # until it is measured after all
    world.add(seen(np.array([wall(9.0, -6.0, 9.0, 6.0)]), (0.0, 0.0), 0.0, 21 * STEP))
    assert not world.picture(21 * STEP).flags[0] & PlaneFlags.INFERRED


def test_scattered_objects_are_not_joined_across_gaps() -> None:
    both = np.array([wall(9.0, -6.0, 9.0, -0.9), wall(9.0, 0.9, 9.0, 6.0)])
    world = World(FAR_STEPS)
    for k in range(10):
        for y in (-3.0, 3.0):
            world.add(seen(both, (0.0, y), 0.12 * y, k * STEP, view_deg=50, flags=int(PlaneFlags.IRREGULAR)))
    assert len(world.picture(10 * STEP).planes) == 2


def test_drift_is_followed_and_nothing_seen_stands_before_the_plane_and_its_margin() -> None:
    world = World()
    for k in range(200):
        at = wall(10.0 - 0.01 * k, -5.0, 10.0 - 0.01 * k, 5.0)  # 0.1 m/s: the estimate drifts
        world.add(seen(np.array([at]), (0.0, 0.0), 0.0, k * STEP))
        p = world.picture(k * STEP)
        assert p.planes[:, 0].min() - p.margin_m.max() <= at[0] + 1e-3
    assert len(p.planes) == 1
    assert p.planes[0, 0] == pytest.approx(8.0, abs=0.5)


@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize("y", [(-4.2, -3.9), (-3.9, -4.2)])
def test_no_part_of_joined_planes_stands_before_them_and_their_margin(y: tuple[float, float], saved: bool) -> None:
    """Two parts of a wall, one 0.3 m in front of the other, as observations and as planes of saved worlds."""
    walls = [wall(0.0, y[0], 5.0, y[0]), wall(4.0, y[1], 9.0, y[1])]
    worlds = [World(), World()]
    for k, part in enumerate(walls):
        model = seen(np.array([part]), (6.0, 8.0), -math.pi / 2, 0).model
        whole = replace(model, planes=np.array([part], np.float32))
        worlds[k * saved].add(Observation(model=whole, place_m=(6.0, 8.0, 0.0), t_ns=k * STEP))
    world = worlds[0]
    if saved:
        world = World()
        world.load((*worlds[0].saved(), *worlds[1].saved()))
    p = world.picture(STEP)
    assert len(p.planes) == 1
    a, b = p.planes[0, 0:2].astype(float), p.planes[0, 2:4].astype(float)
    free_side = np.array([a[1] - b[1], b[0] - a[0]]) / math.dist(a, b)
    ahead = max((np.array(part[k : k + 2]) - a) @ free_side for part in walls for k in (0, 2))
    assert 0.07 < ahead <= p.margin_m[0] + 0.001


# ---- what goes, what stays --------------------------------------------------------------------------------------------


def test_what_moved_away_is_gone_after_some_looks_and_then_free() -> None:
    back, car = wall(15.0, -8.0, 15.0, 8.0), wall(7.0, -1.0, 7.0, 1.0)
    world = World()
    now = fly(world, np.array([back, car]), 10, speed=0.0)
    assert WorldSpace(world.picture(now)).points([[7, 0, 0]], 0.3).tolist() == [Occupancy.OCCUPIED]
    for k in range(10, 20):
        world.add(seen(np.array([back]), (0.0, 0.0), 0.0, k * STEP))
        answer = WorldSpace(world.picture(k * STEP)).points([[7, 0, 0]], 0.3)[0]
        gone = k - 9 >= CLEAR_LIMIT + 10 // 4  # ten looks onto it before
        assert answer == (Occupancy.FREE if gone else Occupancy.OCCUPIED)
    assert len(world.picture(20 * STEP).planes) == 1
    assert world.numbers()["cleared"] == 1


def test_only_the_part_that_was_seen_through_goes() -> None:
    world, whole = World(), np.array([wall(8.0, -6.0, 8.0, 6.0)])
    open_ = np.array([wall(8.0, -6.0, 8.0, -1.5), wall(8.0, 2.0, 8.0, 6.0)])
    fly(world, whole, 10, speed=0.0)
    now = fly(world, open_, 15, begin=10, speed=0.0)
    p = world.picture(now)
    assert len(p.planes) == 2
    low, high = p.planes[np.argsort(p.planes[:, 1])]
    assert -2.0 < low[3] < -1.0
    assert 1.5 < high[1] < 2.5


def test_a_wall_that_noise_hides_now_and_then_stays() -> None:
    world, walls, nothing = World(), np.array([wall(8.0, -4.0, 8.0, 4.0)]), np.zeros((0, 6))
    rng = np.random.default_rng(6)
    hidden = rng.random(150) < 0.4
    fly(world, walls, 10, speed=0.0)
    for k, hide in enumerate(hidden, start=10):
        world.add(seen(nothing if hide else walls, (0.0, 0.0), 0.0, k * STEP))
        assert WorldSpace(world.picture(k * STEP)).points([[8, 0, 0]], 0.2).tolist() == [Occupancy.OCCUPIED]


def test_a_new_object_in_a_place_known_to_be_free_is_there_at_once() -> None:
    world = World()
    now = fly(world, np.zeros((0, 6)), 20, speed=0.0)
    place = [[7.0, 0.0, 0.0]]
    assert WorldSpace(world.picture(now)).points(place, 0.3).tolist() == [Occupancy.FREE]
    world.add(seen(np.array([wall(7.0, -1.0, 7.0, 1.0)]), (0.0, 0.0), 0.0, now))
    space = WorldSpace(world.picture(now))
    assert space.points(place, 0.3).tolist() == [Occupancy.OCCUPIED]
    assert space.segments([[4, 0, 0]], [[10, 0, 0]]).tolist() == [Occupancy.OCCUPIED]


# ---- unknown ----------------------------------------------------------------------------------------------------------


def test_behind_a_sheet_and_inside_of_a_house_nothing_is_free() -> None:
    world, walls = World(), house(0.0, 0.0)
    now = around(world, walls)
    grid = np.stack(np.meshgrid(np.arange(-2.9, 3, 0.1), np.arange(-2.9, 3, 0.1), [-0.5, 0.0, 0.5]), axis=-1)
    assert Occupancy.FREE not in WorldSpace(world.picture(now)).points(grid.reshape(-1, 3), 0.05)
    world = World()
    now = fly(world, np.array([wall(8.0, -4.0, 8.0, 4.0)]), 10, speed=0.0)
    behind = [[x, y, 0.0] for x in np.arange(8.5, 16, 0.25) for y in np.arange(-2.5, 2.5, 0.25)]
    assert set(WorldSpace(world.picture(now)).points(behind).tolist()) == {Occupancy.UNKNOWN}


def test_what_was_seen_long_ago_is_unknown_again() -> None:
    world = World(WorldParams(free_age_s=10.0))
    now = fly(world, np.zeros((0, 6)), 10, speed=0.0)
    place = [[7.0, 0.0, 0.0]]
    assert WorldSpace(world.picture(now)).points(place).tolist() == [Occupancy.FREE]
    assert WorldSpace(world.picture(now + 10 * NS)).points(place).tolist() == [Occupancy.UNKNOWN]
    # the camera looks elsewhere meanwhile
    for k in range(10, 130):
        world.add(seen(np.zeros((0, 6)), (0.0, 0.0), math.pi, k * STEP))
    answers = WorldSpace(world.picture(130 * STEP)).points([*place, [-7.0, 0.0, 0.0]])
    assert answers.tolist() == [Occupancy.UNKNOWN, Occupancy.FREE]


def test_blind_frames_change_nothing_and_an_empty_world_is_unknown() -> None:
    world = World()
    for k in range(5):
        world.add(blind(k))
    p = world.picture(0)
    assert len(p.planes) == 0
    assert WorldSpace(p).points([[3, 0, 0]]).tolist() == [Occupancy.UNKNOWN]
    assert world.numbers()["blind"] == 5
    now = fly(world, np.array([wall(8.0, -4.0, 8.0, 4.0)]), 10)
    before = world.picture(now)
    world.add(blind(now))
    assert same(before, world.picture(now))
    assert [world.numbers()[name] for name in ("frames", "blind")] == [16, 6]


# ---- jumps ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"reset_counter": 1}, "the estimate of the position was reset"),
        ({"estimate": (1, 7)}, "the estimate of position or heading jumped"),
        ({"place_m": (3.5, 0.0, 0.0)}, "the position stepped"),
        ({"t_ns": 20 * NS}, "there was no position for too long"),
    ],
)
def test_a_jump_begins_a_new_section_and_nothing_is_smeared(change: dict, why: str) -> None:
    walls = np.array([wall(8.0, -4.0, 8.0, 4.0)])
    world = World(WorldParams(jump_speed_m_s=5.0))
    now = fly(world, walls, 10, speed=0.0)
    assert WorldSpace(world.picture(now)).points([[4, 1, 0]]).tolist() == [Occupancy.FREE]
    observation = replace(seen(walls + np.array([0.2, 0, 0.2, 0, 0, 0]), (0.0, 0.0), 0.6, now), **change)
    world.add(observation)
    p = world.picture(observation.t_ns)
    assert p.section == 2
    assert p.planes[0, 0] == pytest.approx(8.2)  # not the mean of both
    assert world.counts.why == {"first": 1, why: 1}
    assert [len(s.box) for s in world.past] == [1]
    # what only the old section saw is not free any more
    assert WorldSpace(p).points([[4, -2, 0]]).tolist() == [Occupancy.UNKNOWN]


@pytest.mark.parametrize("change", [{"reset_counter": 1}, {"estimate": (2, 0)}])
def test_a_late_frame_from_before_a_jump_does_not_replace_the_section_after_it(change: dict) -> None:
    """Two cameras with different latencies: its coordinates are those of before the jump."""
    walls = np.array([wall(8.0, -4.0, 8.0, 4.0)])
    world = World()
    now = fly(world, walls, 10, speed=0.0)
    moved = walls - np.array([5.0, 0, 5.0, 0, 0, 0])
    world.add(replace(seen(moved, (-5.0, 0.0), 0.0, now + NS // 10), **change))
    before = world.picture(now + NS // 10)
    world.add(seen(walls, (0.0, 0.0), 0.0, now + NS // 20))
    assert same(before, world.picture(now + NS // 10))
    assert (world.counts.sections, world.counts.late) == (2, 1)


def test_frames_of_a_second_camera_that_are_read_later_begin_no_section() -> None:
    """At 10 m/s, 0.2 s apart: the next frame is compared with the place of the newest one, not of the last one read."""
    walls, world = np.array([wall(30.0, -4.0, 30.0, 4.0)]), World()
    for k in range(20):
        world.add(seen(walls, (k * STEP / NS * 10.0, 0.0), 0.0, k * STEP))
        if k >= 6:
            world.add(seen(walls, ((k - 6) * STEP / NS * 10.0, 0.0), 0.0, (k - 6) * STEP + 1))
    assert (world.counts.sections, world.counts.late) == (1, 0)


def test_a_frame_that_is_read_late_does_not_make_an_earlier_one_recent() -> None:
    walls, world = np.array([wall(30.0, -4.0, 30.0, 4.0)]), World()
    for back_s, late in ((0.0, 0), (0.8, 0), (1.5, 1)):
        world.add(seen(walls, (0.0, 0.0), 0.0, round((10.0 - back_s) * NS)))
        assert world.counts.late == late


@pytest.mark.parametrize("back_s", [[2.0], [9.0], [9.0, 8.5, 8.1]])
def test_frames_of_the_past_change_nothing(back_s: list[float]) -> None:
    """A second camera whose stamps are wrong, or whose frames are read late: its frames end no section and free nothing."""
    walls = np.array([wall(8.0, -4.0, 8.0, 4.0)])
    world = World()
    now = 20 * NS + fly(world, np.zeros((0, 6)), 1, speed=0.0)
    for k in range(10):
        world.add(seen(walls, (0.0, 0.0), 0.0, now + k * STEP))
    for k in range(10, 20):
        before = world.picture(now + k * STEP)
        for s in back_s:
            world.add(seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, now + k * STEP - round(s * NS)))
        assert same(before, world.picture(now + k * STEP))
        world.add(seen(walls, (0.0, 0.0), 0.0, now + k * STEP))
    assert world.counts.late == 10 * len(back_s)


def test_a_clock_that_went_back_begins_a_new_section_after_restart_s() -> None:
    walls = np.array([wall(8.0, -4.0, 8.0, 4.0)])
    world = World()
    now = 20 * NS + fly(world, walls, 10, speed=0.0)
    world.add(seen(walls, (0.0, 0.0), 0.0, now))
    sections = world.counts.sections
    for k in range(12):
        world.add(seen(walls, (0.0, 0.0), 0.0, now - 10 * NS + k * STEP))
        assert world.counts.sections - sections == (k >= 10), k
    assert world.counts.why["the clock went back"] == 1


def test_sections_are_bounded_and_counted() -> None:
    world = World(WorldParams(most_sections=2, most_planes=64))
    for k in range(6):
        world.add(seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, k * STEP, reset_counter=k))
    assert [s.number for s in world.past] == [4, 5]
    assert world.numbers()["sections_dropped"] == 3


@pytest.mark.parametrize("x", [math.nan, math.inf, -2e6, 1e30])
def test_a_place_that_cannot_be_one_is_refused(x: float) -> None:
    with pytest.raises(ValueError, match=r"the place of the camera at 5 ns is .*is the autopilot's position right"):
        Observation(model=blind(0).model, place_m=(x, 0.0, 0.0), t_ns=5)


def test_planes_that_are_no_numbers_are_counted_and_left_out() -> None:
    observation = seen(np.array([wall(8.0, -4.0, 8.0, 4.0)]), (0.0, 0.0), 0.0, 0)
    rows = np.repeat(observation.model.planes, 3, axis=0)
    rows[1, 0], rows[2, 2:4] = np.nan, rows[2, 0:2]
    model = replace(
        observation.model,
        planes=rows,
        support_px=np.ones(3, np.int32),
        margin_m=np.zeros(3, np.float32),
        flags=np.zeros(3, np.uint8),
        cluster=np.zeros(3, np.int32),
    )
    world = World()
    world.add(replace(observation, model=model))
    assert len(world.picture(0).planes) == 1
    assert world.numbers()["bad_planes"] == 2


# ---- the same again, and bounded -----------------------------------------------------------------------------------------


def test_the_same_frames_make_the_same_world() -> None:
    first, second = World(), World()
    now = around(first, house(0.0, 0.0), seed=8)
    around(second, house(0.0, 0.0), seed=8)
    assert same(first.picture(now), second.picture(now))
    assert not same(first.picture(now), World().picture(now))


def test_a_full_world_removes_what_was_not_observed_longest() -> None:
    world = World(WorldParams(most_planes=64, most_free_blocks=64, jump_speed_m_s=100.0))
    walls = np.array([wall(10.0 * k + 3, -3.0, 10.0 * k + 3, -1.0) for k in range(150)])
    for k in range(300):
        x = 5.0 * k
        near = walls[abs(walls[:, 0] - x) < 25]
        world.add(seen(near, (x, 0.0), 0.0, k * STEP, view_deg=120))
    p = world.picture(300 * STEP)
    assert len(p.planes) == 64
    assert world.numbers()["dropped"] > 50
    assert p.planes[:, 0].min() > 700.0
    assert world.numbers()["free_blocks"] == 64


def test_changes_put_together_are_the_world() -> None:
    """As a mirror does it: planes by slot, blocks by index."""
    world, planes, blocks, since = World(), {}, {}, 0
    walls = np.array([wall(15.0, -8.0, 15.0, 8.0), wall(7.0, -1.0, 7.0, 1.0)])
    for k in range(60):
        world.add(seen(walls if k < 20 else walls[:1], (0.05 * k, 0.0), 0.01 * k, k * STEP))
        if k % 3 == 2:
            changed, gone = world.changes(k * STEP, since)
            since = world.frame
            planes |= dict(zip(changed.slots.tolist(), changed.planes.tolist(), strict=True))
            for slot in gone.tolist():
                planes.pop(slot, None)
            blocks |= dict(zip(map(tuple, changed.blocks.tolist()), changed.masks, strict=True))
            p = world.picture(k * STEP)
            assert planes == dict(zip(p.slots.tolist(), p.planes.tolist(), strict=True))
            there = {block: m for block, m in blocks.items() if m.any()}
            assert there
            assert set(there) == set(map(tuple, p.blocks.tolist()))
            assert all(np.array_equal(there[tuple(b)], m) for b, m in zip(p.blocks.tolist(), p.masks, strict=True))
    assert world.numbers()["cleared"] == 1
