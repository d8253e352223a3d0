"""The closed loops over open ground: models without data stand, and the field is crossed by open space alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.open_air.crossing import FLIGHTS, CopterVehicle, CrossingLoop, Flown, Px4Vehicle, row, scene_of
from companion.autopilot.obstacle_distance import obstacle_distance_message
from companion.config.avoidance import AvoidParams
from core.open_sky_params import OpenSkyParams

NS = 1_000_000_000


@pytest.mark.parametrize("vehicle", [Px4Vehicle, CopterVehicle])
def test_a_vehicle_without_data_stands_and_one_with_clear_sectors_flies(vehicle: type) -> None:
    for values, flies in ((None, False), (np.full(72, 1001, np.uint16), True)):
        model, x_m = vehicle(), 0.0
        for step in range(100):
            now_ns = 10 * NS + step * NS // 50
            if values is not None and step % 3 == 0:
                model.read(obstacle_distance_message(values, 0, AvoidParams(max_distance_m=10.0)), now_ns)
            x_m, _ = model.step(0.02, now_ns)
        assert (x_m > 2.0) is flies
        assert flies or x_m < 0.01


def test_the_scenes_have_what_they_are_named_after() -> None:
    for name in FLIGHTS:
        scene = scene_of(name)
        assert (len(scene.scene.names) == 0) is (name == "field")
    with pytest.raises(ValueError, match="no flight"):
        scene_of("moon")


def test_a_row_leaves_out_what_did_not_happen() -> None:
    assert row("field", "PX4", Flown(distance_m=60.0)).endswith("| 0 |  |  | 0 |")
    assert "inf" not in row("field", "PX4", Flown())
    assert math.isnan(Flown().first_stop_m)


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "moves"), [("presume", True), ("off", False)])
def test_an_open_field_is_crossed_by_open_space_alone(mode: str, moves: bool) -> None:
    loop = CrossingLoop(scene_of("field"), "PX4", open_sky=OpenSkyParams(mode=mode, mount_measured=True))
    flown = loop.run(2.5)
    assert (flown.distance_m > 2.0) is moves
    assert flown.stops == 0
    assert (flown.open_frames > 15) is moves
