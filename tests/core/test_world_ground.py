"""The ground in the merged world: solid where it was measured, and nothing at or below it stays free."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from companion.streams.world_messages import world_message
from core.transformed import turned
from core.types import Ground
from core.world.params import WorldParams
from core.world.world import Observation, World
from osape_client.query.space import Occupancy
from osape_client.world.decode import (
    blocks_from_message,
    ground_from_message,
    records_from_message,
    snapshot_from_parts,
)
from osape_client.world.space import WorldSpace
from tests.client.test_solid_ground import model_of, random_scene, roof, street

from ..nightly import examples
from .worlds import DIRECTIONS, NS, seen

Floats = NDArray[np.float64]
STEP = NS // 15


def flat(height_m: float, *, seen_to_m: float = 12.0, noise_per_m: float = 0.01, slope_x: float = 0.0) -> Ground:
    return Ground(
        seen=True,
        height_m=height_m,
        slope_x=slope_x,
        tolerance_m=0.25,
        noise_per_m=noise_per_m,
        seen_from_m=(1.0,) * DIRECTIONS,
        seen_to_m=(seen_to_m,) * DIRECTIONS,
    )


def look(
    t_ns: int, ground: Ground | None, at: tuple[float, float] = (0.0, 0.0), z: float = 0.0, heading: float = 0.0
) -> Observation:
    """A frame of an empty place whose layers, 3 m below the camera too, are free to 20 m."""
    observation = seen(np.zeros((0, 6)), at, heading, t_ns, z=z)
    return observation if ground is None else replace(observation, model=replace(observation.model, ground=ground))


def asked(world: World, points: object, radius_m: float = 0.0) -> list[Occupancy]:
    return [Occupancy(a) for a in WorldSpace(world.picture(_now(world))).points(points, radius_m)]


def _now(world: World) -> int:
    return 0 if world.section is None else world.section.newest_ns


def known_ground(world: World) -> NDArray[np.bool_]:
    ground = world.picture(_now(world)).ground
    assert ground is not None
    return np.isfinite(ground[..., 0])


def merged(*observations: Observation) -> World:
    world = World()
    for observation in observations:
        world.add(observation)
    return world


@pytest.mark.nojit
def test_below_the_ground_no_cell_is_free_and_what_touches_it_is_occupied() -> None:
    world = merged(look(0, flat(2.0)))
    assert asked(world, [[6.0, 0.0, z] for z in (0.0, 1.2)]) == [Occupancy.FREE] * 2
    assert asked(world, [[6.0, 0.0, z] for z in (2.1, 2.4, 2.9, 5.0)]) == [Occupancy.OCCUPIED] * 4
    assert asked(world, [[6.0, 0.0, 1.2]], 0.9) == [Occupancy.OCCUPIED]
    space = WorldSpace(world.picture(0))
    dive = space.segments([[5.0, 0.0, 0.5], [5.0, 0.0, 0.5]], [[7.0, 0.0, 2.5], [7.0, 0.0, 0.5]], 0.1)
    assert dive.tolist() == [Occupancy.OCCUPIED, Occupancy.FREE]
    distance_m, towards, plane = space.nearest([[6.0, 0.0, 0.0]])
    assert distance_m[0] == pytest.approx(1.9, abs=0.1)
    assert towards[0].tolist() == [0.0, 0.0, 1.0]
    assert plane[0] == -1


@pytest.mark.nojit
@pytest.mark.parametrize("late_m", [1.0, 2.5])
def test_a_frame_that_is_read_late_does_not_replace_newer_ground(late_m: float) -> None:
    """Two cameras with different latencies, while the estimated height of the vehicle changes."""
    newest = look(3 * STEP, flat(2.0))
    world = merged(look(2 * STEP, flat(1.5)), newest, look(STEP, flat(late_m)))
    known = world.picture(3 * STEP).ground
    np.testing.assert_array_equal(
        known[np.isfinite(known[..., 0])], merged(newest).picture(3 * STEP).ground[np.isfinite(known[..., 0])]
    )
    assert asked(world, [[6.0, 0.0, z] for z in (2.1, 2.4)]) == [Occupancy.OCCUPIED] * 2


def test_beyond_where_it_was_measured_it_is_unknown_and_never_free() -> None:
    world = merged(look(0, flat(2.0, seen_to_m=8.0)))
    assert asked(world, [[x, 0.0, 2.4] for x in (10.0, 15.0)]) == [Occupancy.UNKNOWN] * 2
    assert asked(world, [[15.0, 0.0, 1.2]]) == [Occupancy.FREE]


@pytest.mark.nojit
def test_ground_takes_back_what_was_free_below_it() -> None:
    world = merged(look(0, None))
    assert asked(world, [[6.0, 0.0, 2.4]]) == [Occupancy.FREE]
    world.add(look(STEP, flat(2.0)))
    assert asked(world, [[6.0, 0.0, 2.4], [6.0, 0.0, 1.2]]) == [Occupancy.OCCUPIED, Occupancy.FREE]


@pytest.mark.nojit
def test_a_frame_that_found_no_ground_frees_nothing_below_the_one_that_is_known() -> None:
    world = merged(look(0, flat(2.0)), look(STEP, None))
    assert asked(world, [[6.0, 0.0, z] for z in (1.2, 2.1, 2.6)]) == [
        Occupancy.FREE,
        Occupancy.OCCUPIED,
        Occupancy.OCCUPIED,
    ]


@pytest.mark.nojit
def test_lower_ground_replaces_what_was_taken_for_it() -> None:
    """Over the flat roof of a car that has gone."""
    world = merged(look(0, flat(1.0)), look(STEP, flat(2.6)))
    assert asked(world, [[6.0, 0.0, z] for z in (1.2, 2.2, 2.9)]) == [
        Occupancy.FREE,
        Occupancy.UNKNOWN,
        Occupancy.OCCUPIED,
    ]


def test_a_noisy_look_that_agrees_does_not_lift_the_ground() -> None:
    world = merged(look(0, flat(2.0)), look(STEP, flat(1.8, noise_per_m=0.05)))
    assert asked(world, [[6.0, 0.0, 1.55]], 0.1) != [Occupancy.OCCUPIED]
    assert asked(world, [[6.0, 0.0, 2.1]]) == [Occupancy.OCCUPIED]


@pytest.mark.nojit
def test_ground_at_the_border_of_two_blocks_is_one_surface() -> None:
    """z = 0 is a border: noise lifts the ground across it."""
    world = merged(look(0, flat(2.05, noise_per_m=0.03), z=-2.2), look(STEP, flat(2.25), z=-2.2))
    assert asked(world, [[6.0, 0.0, -0.12]]) != [Occupancy.OCCUPIED]
    assert asked(world, [[6.0, 0.0, 0.1]]) == [Occupancy.OCCUPIED]


def test_under_a_bridge_that_was_flown_over_free_space_may_be_seen_again() -> None:
    over = look(0, flat(2.0), z=-12.0)
    under = look(STEP, flat(2.5), z=-2.5)
    world = merged(over)
    assert asked(world, [[6.0, 0.0, -2.6]]) == [Occupancy.OCCUPIED]
    world.add(under)
    # a column of a block holds one ground, the newest: the deck is unknown then
    assert asked(world, [[6.0, 0.0, z] for z in (-2.6, -9.9, 0.1)]) == [
        Occupancy.FREE,
        Occupancy.UNKNOWN,
        Occupancy.OCCUPIED,
    ]
    world.add(replace(over, t_ns=2 * STEP))
    assert asked(world, [[6.0, 0.0, z] for z in (-2.6, -9.9, 0.1)]) == [Occupancy.OCCUPIED] * 3


def test_ground_does_not_age_and_free_space_does() -> None:
    world = merged(look(0, flat(2.0)))
    answers = WorldSpace(world.picture(200 * NS)).points([[6.0, 0.0, 1.2], [6.0, 0.0, 2.3]])
    assert answers.tolist() == [Occupancy.UNKNOWN, Occupancy.OCCUPIED]


def test_a_block_in_the_place_of_another_has_none_of_its_ground_and_free_cells() -> None:
    """64 blocks are less than three frames of this flight show. Ground was found in its first part only."""
    small, large = (World(WorldParams(most_free_blocks=n, jump_speed_m_s=500.0)) for n in (64, 4096))
    for k in range(16):
        frame = look(k * STEP, flat(2.0) if k < 8 else None, at=(13.3 * k, 0.0), heading=0.3 * k)
        for world in (small, large):
            world.add(frame)
        if k == 7:
            assert known_ground(small).any()
    assert small.free_blocks_dropped > 64
    assert not known_ground(small).any()
    p, everything = small.picture(_now(small)), large.picture(_now(large))
    free = dict(zip(map(tuple, everything.blocks.tolist()), everything.masks, strict=True))
    assert not any((mask & ~free[tuple(block)]).any() for block, mask in zip(p.blocks.tolist(), p.masks, strict=True))


def test_ground_of_numbers_that_are_none_frees_nothing() -> None:
    for bad in (replace(flat(2.0), height_m=math.nan), replace(flat(2.0), slope_x=math.nan)):
        assert Occupancy.FREE not in asked(merged(look(0, bad)), [[6.0, 0.0, z] for z in (0.0, 1.2, 2.4)])


@pytest.mark.parametrize("name", ["free_from_m", "free_to_m"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_ranges_that_are_no_numbers_free_nothing(name: str, bad: float) -> None:
    observation = look(0, flat(2.0))
    ranges = getattr(observation.model.free, name).copy()
    ranges[:] = bad
    free = replace(observation.model.free, **{name: ranges})
    world = merged(replace(observation, model=replace(observation.model, free=free)))
    assert Occupancy.FREE not in asked(world, [[6.0, 0.0, z] for z in (0.0, 1.2, 2.4)])


@pytest.mark.nojit
def test_sloped_ground_has_no_free_cell_below_it() -> None:
    slope = 0.25
    world = merged(look(0, flat(2.0, slope_x=-slope)))
    x = np.arange(2.0, 12.0, 0.2)
    p = np.concatenate([np.column_stack([x, 0 * x, 2.0 - slope * x + d]) for d in (0.05, 0.3, 0.6, 1.0)])
    answers = np.array(asked(world, p))
    assert (answers[(p[:, 0] > 2.5) & (p[:, 0] < 11.0)] == Occupancy.OCCUPIED).all()
    assert Occupancy.FREE not in answers


def test_through_a_message_no_ground_becomes_lower() -> None:
    world = merged(look(0, flat(1.994, slope_x=0.03), z=-2.0))
    before = world.picture(0)
    message = world_message(before, np.zeros(0, np.int32), 0)
    after = snapshot_from_parts(
        1, records_from_message(message), *blocks_from_message(message), ground_from_message(message), 0
    )
    assert before.ground is not None
    assert after.ground is not None
    known = ~np.isnan(before.ground[:, :, 0])
    assert known.sum() > 100
    assert np.array_equal(known, ~np.isnan(after.ground[:, :, 0]))
    lifted = (before.ground[:, :, 0] - after.ground[:, :, 0])[known]
    grown = (after.ground[:, :, 1] - before.ground[:, :, 1])[known]
    for change in (lifted, grown):
        assert change.min() > -1e-4
        assert change.max() < 0.0101


def test_a_message_without_ground_is_read_and_one_that_is_cut_refused() -> None:
    message = world_message(merged(look(0, flat(2.0))).picture(0), np.zeros(0, np.int32), 0)
    packed = message.ground
    message.ground = packed[: len(packed) // 2]
    with pytest.raises(ValueError, match="ground of"):
        ground_from_message(message)
    message.ground = b""
    assert np.isnan(ground_from_message(message)).all()


def test_balls_of_any_size_and_points_that_are_no_number() -> None:
    space = WorldSpace(merged(look(0, flat(2.0))).picture(0))
    for radius_m in (0.0, 1.9, 5.0, 1e6):
        answers = space.points([[6.0, 0.0, 1.0], [math.nan, 0.0, 0.0], [math.inf, 0.0, 0.0]], radius_m)
        assert (answers[1:] == Occupancy.OCCUPIED).all()
        assert (answers[0] == Occupancy.OCCUPIED) == (radius_m > 1.0)
        assert space.segments([[6.0, 0.0, 1.0]], [[6.5, 0.0, 1.0]], radius_m)[0] == answers[0]
    distance_m, _, _ = space.nearest([[math.nan, 0.0, 0.0], [6.0, 0.0, 1.0]])
    assert distance_m[0] == 0.0  # no clearance: the point is occupied


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("ground", "stays"),
    [
        (None, False),
        pytest.param(flat(2.8), False, marks=pytest.mark.compiled),
        (flat(1.5), True),
        pytest.param(flat(2.3, noise_per_m=0.15), True, marks=pytest.mark.compiled),
        pytest.param(flat(math.nan), True, marks=pytest.mark.compiled),
    ],
    ids=["no ground", "ground below it", "below the ground", "within the noise of the ground", "no number"],
)
def test_what_stands_below_the_ground_or_in_its_noise_is_not_seen_through(ground: Ground | None, stays: bool) -> None:
    """A layer that the ground cuts is free as a whole, and was judged above the ground only: a low thing that was seen from
    near, or from the street below a roof, is not gone."""
    low = np.array([[6.0, -1.0, 6.0, 1.0, 1.6, 2.2]])  # at 1.6 to 2.2 m below the cameras
    observations = [seen(low, (0.0, 0.0), 0.0, k * STEP) for k in range(3)]
    world = merged(*observations)
    assert len(world.picture(_now(world)).planes) == 1
    for k in range(10):
        world.add(look((3 + k) * STEP, ground))
    assert len(world.picture(_now(world)).planes) == int(stays)


def test_ways_beyond_all_measure_are_answered_and_not_free() -> None:
    """Their samples would take more memory than there is."""
    space = WorldSpace(merged(look(0, flat(2.0))).picture(0))
    ends = [[1e9, 1e9, -1.0], [6.0, 0.0, 9e8], [-8e8, 3.0, 1.0], [9e8, 0.0, 9e8]]
    answers = space.segments([[6.0, 0.0, 1.0]] * len(ends), ends, 0.1)
    assert Occupancy.FREE not in answers
    assert answers[1] == Occupancy.OCCUPIED  # straight down through the ground
    assert space.segments([[-1e9, 0.0, 2.2]], [[1e9, 0.0, 2.2]], 0.1).tolist() == [Occupancy.OCCUPIED]
    assert space.segments([[-1e9, 0.0, -40.0]], [[1e9, 0.0, -40.0]], 0.1).tolist() == [Occupancy.UNKNOWN]


@examples(0.4)
@given(st.integers(0, 2**32 - 1))
def test_a_way_is_occupied_where_a_ball_of_it_is(seed: int) -> None:
    """A way may pass the corner of a column between two samples of it."""
    rng = np.random.default_rng(seed)
    height = rng.uniform(0.5, 4.0, (1, 256))
    ground = np.stack([height, rng.uniform(0.0, 0.5, (1, 256))], axis=2).astype(np.float32)
    ground[rng.random((1, 256)) < 0.3] = np.nan
    free = np.full((1, 256), 0xFFFFFFFFFFFFFFFF, np.uint64)
    picture = replace(World().picture(0), blocks=np.zeros((1, 3), np.int32), masks=free, ground=ground)
    space = WorldSpace(picture)
    a = rng.uniform(0.0, 8.0, (200, 3)) * [1.0, 1.0, 0.5]
    b = a + rng.normal(size=(200, 3))
    along = a[:, None] + np.linspace(0.0, 1.0, 50)[None, :, None] * (b - a)[:, None]
    for radius_m in (0.0, 0.1, 0.5):
        answers = space.segments(a, b, radius_m)
        balls = space.points(along.reshape(-1, 3), radius_m).reshape(200, 50)
        assert (answers[(balls == Occupancy.OCCUPIED).any(axis=1)] == Occupancy.OCCUPIED).all()


# ---- rendered frames ------------------------------------------------------------------------------------------------


def in_ned(model, place: tuple[float, float, float], t_ns: int, yaw_rad: float = 0.0) -> Observation:
    return Observation(model=turned(model, yaw_rad, place), place_m=place, t_ns=t_ns)


@pytest.mark.parametrize("slope", [0.0, 0.04])
def test_rendered_street(slope: float) -> None:
    model = model_of(street(slope_x=slope))
    world = merged(in_ned(model, (0.0, 0.0, -2.0), 0))
    x, y = np.meshgrid(np.arange(3.0, 9.0, 0.23), np.arange(-1.0, 1.0, 0.21))
    for depth in (0.1, 0.4, 0.7, 0.95, 2.0):
        p = np.column_stack([x.ravel(), y.ravel(), slope * x.ravel() + depth])
        assert set(asked(world, p)) == {Occupancy.OCCUPIED}
    above = np.column_stack([x.ravel(), y.ravel(), slope * x.ravel() - 0.9])
    assert Occupancy.FREE in asked(world, above)


def test_rendered_roof_is_solid_and_the_street_beyond_is_not_freed() -> None:
    world = merged(in_ned(model_of(roof(), 14.0, math.radians(-30.0)), (0.0, 0.0, -14.0), 0))
    assert set(asked(world, [[4.0, 0.0, z] for z in (-11.9, -11.0, -5.0)])) == {Occupancy.OCCUPIED}
    assert set(asked(world, [[x, 0.0, z] for x in (7.5, 9.0, 12.0) for z in (-11.0, -9.0, 0.3)])) == {Occupancy.UNKNOWN}


@pytest.mark.parametrize("seed", range(6))
def test_of_flights_through_scenes_by_chance_no_solid_place_is_free(seed: int) -> None:
    rng = np.random.default_rng(500 + seed)
    builder, boxes = random_scene(rng)
    truth, world = builder.build().ground, World()
    for k in range(5):
        x, y, yaw = 0.6 * k, rng.uniform(-1.0, 1.0), rng.uniform(-0.3, 0.3)
        height_m = rng.uniform(1.5, 4.0)
        shift = (x, y, -height_m)
        model = model_of(builder, height_m, math.radians(rng.uniform(-20, 10)), yaw_rad=yaw, seed=k, place_m=(x, y))
        world.add(in_ned(model, shift, k * STEP, yaw))
    p = np.column_stack([rng.uniform(0, 20, 30_000), rng.uniform(-9, 9, 30_000), rng.uniform(-6, 3, 30_000)])
    solid = p[:, 2] > truth.slope_x * p[:, 0] + truth.slope_y * p[:, 1] + 0.1
    for low, high in boxes:
        solid |= ((p > low + 0.15) & (p < high - 0.15)).all(axis=1)
    answers = np.array(asked(world, p))
    assert not ((answers == Occupancy.FREE) & solid).any()
    assert (answers == Occupancy.FREE).sum() > 20
