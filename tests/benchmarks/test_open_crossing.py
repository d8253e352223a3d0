"""The closed loops over open ground: models without data stand, and the field is crossed by open space alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_air.crossing import FLIGHTS, row, scene_of
from benchmarks.open_air.crossing_loop import Course, CrossingLoop, Flown, body_rates_rad_s, ranges_m
from benchmarks.open_air.vehicles import AUTOPILOTS, vehicle_of
from companion.autopilot.obstacle_distance import obstacle_distance_message
from companion.config.avoidance import AvoidParams
from companion.pipeline.results import DropCause, PrismsResult
from companion.pipeline.transform import LevelTransform
from core.frames import R_CAMFRD_OPTICAL, quaternion_from_euler, rotation_from_quaternion
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.model import blind_model
from core.types import FreeEnd, FreeProfile, InvalidCause

NS = 1_000_000_000


AHEAD = np.array([4.0, 0.0])


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_vehicle_without_data_stands_and_one_with_clear_sectors_flies(autopilot: str) -> None:
    for values, flies in ((None, False), (np.full(72, 1001, np.uint16), True)):
        model, x_m = vehicle_of(autopilot), 0.0
        for step in range(100):
            now_ns = 10 * NS + step * NS // 50
            if values is not None and step % 3 == 0:
                model.read(obstacle_distance_message(values, 0, AvoidParams(max_distance_m=10.0)), now_ns)
            x_m = float(model.step(AHEAD, 0.0, 0.02, now_ns)[0][0])
        assert (x_m > 1.0) is flies
        assert flies or x_m < 0.01


def test_arducopter_flies_on_when_the_messages_stop() -> None:
    """Without a first message it does not arm."""
    model, x_m = vehicle_of("ArduPilot"), []
    near = np.full(72, 320, np.uint16)
    for step in range(150):
        now_ns = 10 * NS + step * NS // 50
        if step < 50 and step % 3 == 0:
            model.read(obstacle_distance_message(near, 0, AvoidParams(max_distance_m=10.0)), now_ns)
        x_m.append(float(model.step(AHEAD, 0.0, 0.02, now_ns)[0][0]))
    assert x_m[60] < 0.1
    assert x_m[-1] > 2.0


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_vehicle_that_turns_keeps_its_course_and_flies_on_to_where_it_faces(autopilot: str) -> None:
    """It turns by 90 degrees at once: its velocity in north and east stays, then follows the stick."""
    model, now_ns = vehicle_of(autopilot), 10 * NS
    clear = obstacle_distance_message(np.full(72, 1001, np.uint16), 0, AvoidParams(max_distance_m=10.0))
    for step in range(400):
        now_ns += NS // 50
        model.read(clear, now_ns)
        before = model.step(AHEAD, 0.0, 0.02, now_ns)
        if step == 150:
            assert before[1][0] > 1.0
            after = model.step(AHEAD, math.pi / 2.0, 0.02, now_ns)
            assert np.abs(after[1] - before[1]).max() < 0.15
            assert np.abs(after[0] - before[0]).max() < 0.15
    assert before[1][1] > 1.0
    assert abs(before[1][0]) < 0.5


def test_px4_is_guided_aside_and_the_loop_flies_it_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop took the way forward alone, and stood before what PX4 was guided past."""
    loop = CrossingLoop(scene_of("field"), "PX4")
    places: list[tuple[float, ...]] = []
    monkeypatch.setattr(CrossingLoop, "_expose", lambda self: places.append(tuple(self.place_ned_m)))
    values = np.full(72, 65535, np.uint16)
    values[3:6] = 1001  # clear from 15 to 25 degrees to the right
    for _ in range(150):
        loop.vehicle.read(obstacle_distance_message(values, 0, AvoidParams(max_distance_m=10.0)), loop.now_ns)
        loop._move()
        loop.now_ns += NS // 50
    loop._expose()
    north, east, _ = places[-1]
    assert north > 2.0
    assert math.degrees(math.atan2(east, north)) == pytest.approx(20.0, abs=1.0)
    assert loop.flown.east_m == east


def test_body_rates_turn_the_attitude() -> None:
    before, now, turn, dt = (0.1, -0.2), (0.1002, -0.2003), 0.0004, 0.02
    first = rotation_from_quaternion(quaternion_from_euler(*before, 0.3))
    second = rotation_from_quaternion(quaternion_from_euler(*now, 0.3 + turn))
    R = first.T @ second
    expected = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (2.0 * dt)
    assert np.array(body_rates_rad_s(before, now, turn, dt)) == pytest.approx(expected, abs=1e-4)


def test_distances_around_and_sectors_with_a_solid() -> None:
    scene = scene_of("pillar")
    place = np.array([10.0, 0.0, -2.0])
    found = ranges_m(scene, place, np.radians([0.0, 90.0]), np.zeros(1))
    assert found[0, 0] == pytest.approx(5.75, abs=0.1)
    assert math.isinf(found[0, 1])
    loop = CrossingLoop(scene, "PX4", Course())
    loop.place_ned_m = place
    values = np.full(72, 65535, np.uint16)
    values[18] = 1001
    loop._judge_sectors(values)
    assert loop.flown.wrong_clear == 0
    values[0] = 1001
    loop._judge_sectors(values)
    assert loop.flown.wrong_clear == 1


def test_free_cells_with_a_solid_are_counted_also_without_open_ones() -> None:
    """They were left out: those that were wrongly free hid those that were wrongly open in the same cells."""
    loop = CrossingLoop(scene_of("near_container"), "PX4", Course())
    shape = (12, 1)
    free = FreeProfile(
        azimuth_edges_rad=np.linspace(-0.3, 0.3, 13).astype(np.float32),
        layer_edges_m=np.array([-0.5, 0.5], np.float32),
        free_from_m=np.ones(shape, np.float32),
        free_to_m=np.full(shape, 8.0, np.float32),
        end=np.full(shape, int(FreeEnd.MAX_RANGE), np.uint8),
    )
    model = replace(blind_model(loop._info, InvalidCause.NONE, Params()), valid=True, free=free, ke_per_m=0.0015)
    result = PrismsResult(
        camera="front",
        sequence=0,
        t_exposure_ns=NS,
        t_arrival_ns=NS,
        frame="ned",
        drop=DropCause.NONE,
        model=model,
        transform=LevelTransform(0.0, (0.0, 0.0, 0.0)),
    )
    loop._count(result, R_CAMFRD_OPTICAL, np.array([0.0, 0.0, -2.0]))
    assert (loop.flown.frames, loop.flown.open_frames) == (1, 0)
    assert loop.flown.wrong_free == 12
    assert row("turn_container", "PX4", loop.flown).endswith("| 0 | 12 | 0 | 0 |")
    loop._count(replace(result, model=replace(model, valid=False)), R_CAMFRD_OPTICAL, np.array([0.0, 0.0, -2.0]))
    assert (loop.flown.frames, loop.flown.wrong_free) == (2, 12)


def test_the_scenes_have_what_they_are_named_after() -> None:
    for flight in FLIGHTS.values():
        scene = scene_of(flight.thing)
        assert (len(scene.scene.names) == 0) is (flight.thing == "field")
    with pytest.raises(ValueError, match="no thing"):
        scene_of("moon")
    with pytest.raises(ValueError, match="no autopilot"):
        vehicle_of("moon")


def test_a_row_leaves_out_what_did_not_happen() -> None:
    assert row("field", "PX4", Flown(distance_m=60.0)).endswith("| 0 |  | 0.0, 0.0, 0.0 |  | 0 | 0 | 0 | 0 |")
    assert "inf" not in row("field", "PX4", Flown())
    assert math.isnan(Flown().first_stop_m)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("autopilot", "mode", "moves"),
    [("PX4", "presume", True), ("PX4", "off", False), ("ArduPilot", "presume", True), ("ArduPilot", "off", False)],
)
def test_an_open_field_is_crossed_by_open_space_alone(autopilot: str, mode: str, moves: bool) -> None:
    """To ArduPilot each sector in view that is not clear is a wall, so that all of them must be."""
    loop = CrossingLoop(scene_of("field"), autopilot, open_sky=OpenSkyParams(mode=mode, mount_measured=True))
    flown = loop.run(2.5)
    assert (flown.distance_m > 2.0) is moves
    assert flown.stops == 0
    assert flown.wrong_free == 0
    assert flown.wrong_open == 0
    assert flown.wrong_clear == 0
    assert (flown.open_frames > 15) is moves


@pytest.mark.slow
def test_a_climb_through_the_range_of_the_ground_stops_nothing() -> None:
    """The last ground in range appears inclined by 13 to 18 degrees: frames were invalid from 5 m on, and the vehicle stopped."""
    course = Course(speed_m_s=2.0, height_m=2.0, height_to_m=6.5, climb_m_s=1.5, start_s=1.0)
    loop = CrossingLoop(scene_of("field"), "PX4", course)
    flown = loop.run(4.5)
    assert flown.height_m == pytest.approx(6.5)
    assert flown.stops == 0
    assert flown.wrong_free == 0
    assert flown.wrong_open == 0
    assert flown.open_frames > 0.8 * flown.frames
