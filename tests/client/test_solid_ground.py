"""The ground is solid to a planner: nothing below it is free, what touches it where it was measured is occupied."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.extractor import Extractor
from core.params import Params
from core.stages.free_geometry import lowest_clear, walk_settings
from core.stages.view_geometry import source_of, view_geometry
from core.transformed import turned
from core.types import FrameModel
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import TYPICAL, SensorModel
from osape_client.query.solid_ground import solid_ground
from osape_client.query.space import Occupancy, PlacedModel, Space
from tests.core.views import CLEAN, VIEW, level, seen
from tests.nightly import first, nightly

HERE = (0.0, 0.0, 0.0)
PITCH_20 = math.radians(-20.0)
Floats = NDArray[np.float64]


def street(*, slope_x: float = 0.0, slope_y: float = 0.0) -> SceneBuilder:
    """Flat or inclined ground between two walls."""
    builder = SceneBuilder("street")
    builder.ground(slope_x, slope_y)
    builder.wall("left", (0.0, -8.0), (40.0, -8.0), 6.0, base=-3.0)
    builder.wall("right", (40.0, 8.0), (0.0, 8.0), 6.0, base=-3.0)
    return builder


def model_of(
    scene: Scene | SceneBuilder,
    height_m: float = 2.0,
    pitch_rad: float = PITCH_20,
    sensor: SensorModel = CLEAN,
    yaw_rad: float = 0.0,
    seed: int = 0,
    place_m: tuple[float, float] = (0.0, 0.0),
) -> FrameModel:
    """The model of a frame from above a place."""
    at = (*place_m, -height_m)
    shot = seen(scene, position_ned_m=at, pitch_rad=pitch_rad, yaw_rad=yaw_rad, sensor=sensor, seed=seed)
    model, _ = Extractor().extract(shot.depth_mm, shot.info, shot.R_level_optical)
    assert model.valid
    return model


def space_of(model: FrameModel) -> Space:
    return Space([PlacedModel(model, HERE)])


def ahead(z_m: float, reach_m: float = 20.0, step_m: float = 0.25) -> Floats:
    """(M, 3) points of a horizontal fan in front of the camera."""
    x, y = np.meshgrid(np.arange(0.5, reach_m, step_m), np.arange(-6.0, 6.1, step_m))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z_m)])


# ---- one frame --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("z_m", [2.1, 2.4, 2.7, 2.95])
def test_below_the_street_nothing_is_free(z_m: float) -> None:
    model = model_of(street())
    assert model.ground.seen
    assert model.ground.height_m == pytest.approx(2.0, abs=0.05)
    space, p = space_of(model), ahead(z_m)
    answers = space.points(p)
    assert Occupancy.FREE not in answers
    where = (np.hypot(p[:, 0], p[:, 1]) < 8.0) & (p[:, 0] > 3.0) & (np.abs(p[:, 1]) < 0.5 * p[:, 0])
    assert (answers[where] == Occupancy.OCCUPIED).all()


def test_queries_cut_a_layer_where_the_profile_stops_judging_it() -> None:
    model, params = model_of(street(slope_x=0.03)), Params()
    view = view_geometry(VIEW, level(PITCH_20), params)
    source = source_of(VIEW, level(PITCH_20), VIEW.max_range_m)[0]
    w = walk_settings(view, source, model.ground, model.ke_per_m, params)[0]
    ground = solid_ground(model.ground, model.free, HERE)
    for x in (2.0, 8.0, 15.0, 60.0):
        z = lowest_clear(0.0, x, w)
        p = np.array([[x, 0.0, z - 1e-6], [x, 0.0, z + 1e-6]])
        assert ground.clear(p, 0.0).tolist() == [True, False]


def test_above_the_street_free_stays_free() -> None:
    space = space_of(model_of(street()))
    answers = space.points([[9.0, 0.0, 0.0], [5.0, 0.5, 1.2], [4.0, 0.0, 1.7]])
    assert (answers == Occupancy.FREE).all()


def test_a_ball_that_touches_the_ground_is_occupied() -> None:
    space = space_of(model_of(street()))
    p = np.array([[5.0, 0.0, 1.5]])
    assert space.points(p, 0.2).tolist() == [Occupancy.FREE]
    assert space.points(p, 0.45).tolist() == [
        Occupancy.UNKNOWN
    ]  # within the tolerance low things are part of the ground
    assert space.points(p, 0.55).tolist() == [Occupancy.OCCUPIED]


def test_a_way_that_dives_is_occupied() -> None:
    space = space_of(model_of(street()))
    ends = np.array([[6.0, 0.0, 2.4], [6.0, 0.0, 1.4], [12.0, 0.0, 1.3]])
    starts = np.array([[3.0, 0.0, 1.3], [3.0, 0.0, 1.3], [9.0, 0.0, 0.0]])
    assert space.segments(starts, ends, 0.2).tolist() == [Occupancy.OCCUPIED, Occupancy.FREE, Occupancy.FREE]
    # down through the ground and up again
    assert space.segments([[4.0, 0.0, 1.0]], [[8.0, 0.0, 3.0]]).tolist() == [Occupancy.OCCUPIED]


def test_ways_beyond_all_measure_meet_the_ground_where_they_cross_it() -> None:
    space = space_of(model_of(street()))
    far = [[-1e9, 0.0, 2.1], [5.0, 0.0, -9e8], [-1e9, 0.0, -8.0], [5.0, -1e9, 1e9]]
    to = [[1e9, 0.0, 2.1], [5.0, 0.0, 9e8], [1e9, 0.0, -8.0], [5.0, 1e9, -1e9]]
    # the last one passes at 45 degrees through the camera's height above the measured ground
    assert space.segments(far[:3], to[:3], 0.1).tolist() == [Occupancy.OCCUPIED, Occupancy.OCCUPIED, Occupancy.UNKNOWN]
    assert space.segments(far[3:], to[3:], 0.1).tolist() == [Occupancy.OCCUPIED]


def test_beyond_where_the_ground_was_measured_it_is_unknown() -> None:
    model = model_of(street())
    space, g = space_of(model), model.ground
    assert max(g.seen_to_m) > 10.0
    beyond = max(g.seen_to_m) + 0.5
    p = np.array([[x, 0.0, g.height_m + d] for x in (beyond, beyond + 5.0) for d in (0.0, 0.3, 0.95)])
    assert (space.points(p) == Occupancy.UNKNOWN).all()
    # beneath the camera, too, where it does not look
    assert space.points([[0.3, 0.0, 2.2]]).tolist() == [Occupancy.UNKNOWN]


def test_the_nearest_object_may_be_the_ground() -> None:
    space = space_of(model_of(street()))
    distance_m, towards, plane = space.nearest([[6.0, 0.0, 0.8], [6.0, 0.0, 2.5]])
    assert distance_m[0] == pytest.approx(1.2, abs=0.15)
    assert towards[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.05)
    assert plane.tolist() == [-1, -1]
    assert distance_m[1] == 0.0


def test_from_beside_the_measured_ground_the_nearest_of_it_counts() -> None:
    model = model_of(street())
    first = min(f for f, t in zip(model.ground.seen_from_m, model.ground.seen_to_m, strict=True) if t > f)
    distance_m, towards, _ = space_of(model).nearest([[0.0, 0.0, 0.0]])
    assert distance_m[0] == pytest.approx(math.hypot(first, 2.0), rel=0.1)
    assert towards[0][0] > 0.3


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.03, -0.03)])
def test_an_inclined_street_is_solid_along_its_slope(slope_x: float, slope_y: float) -> None:
    model = model_of(street(slope_x=slope_x, slope_y=slope_y))
    assert model.ground.seen
    p = np.concatenate([ahead(z) for z in np.arange(1.0, 4.0, 0.2)])
    truth = 2.0 + slope_x * p[:, 0] + slope_y * p[:, 1]
    answers = space_of(model).points(p)
    assert not ((answers == Occupancy.FREE) & (p[:, 2] > truth + 0.05)).any()
    assert ((answers == Occupancy.OCCUPIED) & (p[:, 2] > truth + 0.1)).any()


def test_the_ground_moves_with_its_model() -> None:
    model, yaw, shift = model_of(street(slope_x=0.04, slope_y=0.02)), 0.7, (3.0, -5.0, 11.0)
    moved = turned(model, yaw, shift)
    p = np.concatenate([ahead(z) for z in np.arange(-1.0, 3.5, 0.37)])
    c, s = math.cos(yaw), math.sin(yaw)
    q = np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]]) + shift
    before, after = space_of(model).points(p, 0.1), Space([PlacedModel(moved, shift)]).points(q, 0.1)
    assert (before == after).mean() > 0.999  # float32 edges
    assert {Occupancy.FREE, Occupancy.OCCUPIED, Occupancy.UNKNOWN} == set(before.tolist())


# ---- several cameras --------------------------------------------------------------------------------------------------


def test_what_one_camera_calls_free_below_the_ground_of_another_is_not() -> None:
    low = model_of(street())
    # a second camera that found no ground and claims its layers whole
    blank = SceneBuilder("nothing")
    blank.box("far", 40.0, 0.0, 1.0, 1.0, 1.0)
    high = model_of(blank, pitch_rad=0.0)
    assert not high.ground.seen
    p = np.array([[11.0, 0.0, 2.6]])
    assert space_of(high).points(p).tolist() == [Occupancy.FREE]
    assert Space([PlacedModel(high, HERE), PlacedModel(low, HERE)]).points(p).tolist() == [Occupancy.OCCUPIED]


# ---- roofs ------------------------------------------------------------------------------------------------------------


def roof() -> SceneBuilder:
    """A flat roof, 12 m above the street, whose edge is 6 m ahead."""
    builder = SceneBuilder("roof")
    builder.ground()
    builder.box("house", -4.0, 0.0, 20.0, 40.0, 12.0)
    return builder


def test_beyond_the_edge_of_a_roof_nothing_at_its_level_is_occupied_or_free_below() -> None:
    shot = seen(roof(), position_ned_m=(0.0, 0.0, -14.0), pitch_rad=math.radians(-30.0))
    model, _ = Extractor().extract(shot.depth_mm, shot.info, shot.R_level_optical)
    assert model.ground.seen
    assert model.ground.height_m == pytest.approx(2.0, abs=0.1)
    space = space_of(model)
    on_roof = np.array([[x, y, z] for x in (3.5, 4.0, 4.5) for y in (-1.0, 0.0, 1.0) for z in (2.1, 2.5, 3.5)])
    assert (space.points(on_roof) == Occupancy.OCCUPIED).all()
    beyond = np.array([[x, y, z] for x in (7.0, 9.0) for y in (-1.0, 0.0, 1.0) for z in (2.1, 3.0, 5.0)])
    assert (space.points(beyond) == Occupancy.UNKNOWN).all()
    street_below = np.array([[x, 0.0, z] for x in np.arange(6.5, 18.0, 0.5) for z in (14.2, 15.0, 16.0)])
    assert Occupancy.FREE not in space.points(street_below)


# ---- ceilings ---------------------------------------------------------------------------------------------------------


def room(ceiling_m: float) -> SceneBuilder:
    """A room 12 m long with a floor 1.5 m below the camera at z = -1.5 and a ceiling so far above the camera."""
    builder = SceneBuilder("room")
    builder.ground()
    builder.wall("left", (-2.0, -4.0), (12.0, -4.0), 6.0)
    builder.wall("right", (12.0, 4.0), (-2.0, 4.0), 6.0)
    builder.wall("end", (12.0, -4.0), (12.0, 4.0), 6.0)
    builder.box("ceiling", 5.0, 0.0, 14.0, 8.0, 0.3, base=1.5 + ceiling_m)
    return builder


@pytest.mark.parametrize("ceiling_m", [0.6, 0.75, 0.9, 1.5, 2.9, *nightly(0.65, 0.7, 0.8, 0.85, 1.0, 1.1, 2.7)])
@pytest.mark.parametrize("pitch_deg", [0.0, 20.0])
def test_above_a_ceiling_nothing_is_free(ceiling_m: float, pitch_deg: float) -> None:
    model = model_of(room(ceiling_m), height_m=1.5, pitch_rad=math.radians(pitch_deg))
    space = space_of(model)
    p = np.concatenate([ahead(-z, 11.0) for z in np.arange(ceiling_m + 0.1, ceiling_m + 2.5, 0.1)])
    assert Occupancy.FREE not in space.points(p[np.abs(p[:, 1]) < 3.9])


def test_below_a_ceiling_free_stays_free() -> None:
    space = space_of(model_of(room(2.7), height_m=1.5, pitch_rad=0.0))
    assert Occupancy.FREE in space.points(ahead(0.0, 11.0))


# ---- ground that was not found ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height_m", [1.0, 2.7, *nightly(1.3, 2.0, 2.9)])
@pytest.mark.parametrize("slope_deg", [8.0, 15.0])
@pytest.mark.parametrize("pitch_deg", [0.0, -20.0])
def test_a_ramp_too_steep_for_ground_is_no_free_space(height_m: float, slope_deg: float, pitch_deg: float) -> None:
    slope = math.tan(math.radians(slope_deg))
    model = model_of(street(slope_x=-slope), height_m, math.radians(pitch_deg))
    p = np.concatenate([ahead(z, 12.0) for z in np.arange(-2.0, height_m + 1.0, 0.1)])
    truth = height_m - slope * p[:, 0]
    answers = space_of(model).points(p)
    free = (answers == Occupancy.FREE) & (p[:, 2] > truth + 0.1)
    assert not free.any()


@pytest.mark.parametrize("height_m", [2.9, 3.05, 2.6])
def test_without_a_ground_what_lies_low_is_an_obstacle(height_m: float) -> None:
    """The ground is drawn as a slab too small for `find_ground` to find."""
    builder = SceneBuilder("slab")
    builder.box("slab", 9.0, 0.0, 3.0, 8.0, 0.5, base=-0.5)
    model = model_of(builder, height_m, 0.0)
    p = np.concatenate([ahead(z, 11.0) for z in np.arange(height_m + 0.1, height_m + 0.45, 0.1)])
    inside = (np.abs(p[:, 0] - 9.0) < 1.4) & (np.abs(p[:, 1]) < 3.9)
    assert Occupancy.FREE not in space_of(model).points(p[inside])


# ---- scenes by chance -------------------------------------------------------------------------------------------------


def random_scene(rng: np.random.Generator) -> tuple[SceneBuilder, list[tuple[Floats, Floats]]]:
    """Boxes on inclined ground; and the (low, high) corners of the boxes in ned."""
    builder, boxes = SceneBuilder("random"), []
    builder.ground(*rng.uniform(-0.05, 0.05, 2))
    for k in range(int(rng.integers(1, 6))):
        x, y, length, width = rng.uniform(5, 16), rng.uniform(-7, 7), *rng.uniform(1.0, 4.0, 2)
        tall = rng.uniform(1.0, 7.0)
        builder.box(f"box {k}", x, y, length, width, tall + 2.0, base=-2.0)
        boxes.append((np.array([x - length / 2, y - width / 2, -tall]), np.array([x + length / 2, y + width / 2, 2.0])))
    return builder, boxes


@pytest.mark.parametrize("seed", first(8, range(24)))
def test_in_scenes_by_chance_no_solid_place_is_free(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    builder, boxes = random_scene(rng)
    height_m, pitch = rng.uniform(1.0, 5.0), math.radians(rng.uniform(-25.0, 15.0))
    model = model_of(builder, height_m, pitch, TYPICAL if seed % 2 else CLEAN, seed=seed)
    p = np.column_stack(
        [rng.uniform(0.5, 20.0, 20_000), rng.uniform(-10, 10, 20_000), rng.uniform(-4.0, 4.0, 20_000) + height_m - 1.0]
    )
    ned, truth = p - np.array([0.0, 0.0, height_m]), builder.build().ground
    solid = ned[:, 2] > truth.slope_x * ned[:, 0] + truth.slope_y * ned[:, 1] + 0.1
    for low, high in boxes:
        solid |= ((ned > low + 0.15) & (ned < high - 0.15)).all(axis=1)
    answers = space_of(model).points(p)
    assert not ((answers == Occupancy.FREE) & solid).any()
    assert (answers == Occupancy.FREE).sum() > 20
