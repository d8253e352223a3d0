"""Obstacles above the vehicle and the distance of the ground: sent where known, never as clear."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.distance_sensor import DOWNWARD, UPWARD, Overhead, distance_sensor_message, downward_m
from companion.autopilot.obstacle_memory import Here
from companion.autopilot.sender import messages_of
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform
from core.types import Ground
from drivers.mavlink.dialect import dialect
from drivers.simulation.firmware_models.ardupilot_layers import ArduPilotHeights
from tests.client.test_solid_ground import model_of, room

from ..report_chain import ARDUPILOT, AVOID, FAULTS, Chain, broken
from ..sector_models import model

NS = 1_000_000_000
UP = replace(AVOID, upward=True, remember_up_s=5.0)
BEAM = (6.0, -3.0, 6.0, 3.0, -4.0, -2.5)
"""6 m ahead, its underside 2.5 m above the vehicle's middle."""
AHEAD = LevelTransform(0.0, (0.0, 0.0, 0.0))


def test_a_beam_is_sent_while_the_vehicle_is_under_it_and_only_then() -> None:
    known = Overhead(UP)
    known.see(View(model(BEAM, margin=0.1), AHEAD), Here(0.0, (100.0, 50.0, -10.0), 1), NS)
    for north in np.arange(98.0, 110.0, 0.05):
        got_m = known.upward_m(Here(1.0, (float(north), 50.0, -10.0), 1), 2 * NS)
        assert (got_m is not None) == (abs(north - 106.0) <= UP.radius_m + 0.1 + 1e-6), north
        assert got_m is None or got_m == pytest.approx(2.4)
    assert known.upward_m(Here(0.0, (106.0, 53.5, -10.0), 1), 2 * NS) is None  # beside its end
    assert known.upward_m(Here(0.0, (106.0, 50.0, -11.5), 1), 2 * NS) == pytest.approx(0.9)  # has climbed
    assert known.upward_m(Here(0.0, (106.0, 50.0, -14.5), 1), 2 * NS) is None  # is above it
    assert known.upward_m(Here(0.0, (106.0, 50.0, -10.0), 1), 6 * NS + 1) is None  # long ago


def test_of_two_obstacles_above_the_lower_one_is_sent() -> None:
    known, here = Overhead(UP), Here(0.0, (0.0, 0.0, -10.0), 1)
    known.see(View(model((0.0, -3.0, 0.0, 3.0, -6.0, -5.0), (0.1, -3.0, 0.1, 3.0, -4.0, -2.5)), AHEAD), here, NS)
    assert known.upward_m(here, NS) == pytest.approx(2.5)


def test_many_undersides_ahead_do_not_displace_the_beam_above() -> None:
    """Below the roof of a hall each frame has a hundred of them, all of them farther ahead."""
    known, here = Overhead(UP), Here(0.0, (0.0, 0.0, -10.0), 1)
    known.see(View(model((2.0, -3.0, 2.0, 3.0, -4.0, -2.5)), AHEAD), here, NS)
    roof = model(*((8.0 + k / 50.0, -3.0, 8.0 + k / 50.0, 3.0, -9.0, -8.0) for k in range(200)))
    for frame in range(40):
        known.see(View(roof, AHEAD), here, NS + frame * NS // 15)
    assert known.upward_m(Here(0.0, (2.0, 0.0, -10.0), 1), 4 * NS) == pytest.approx(2.5)
    assert known.upward_m(Here(0.0, (9.0, 0.0, -10.0), 1), 4 * NS) == pytest.approx(8.0)


@pytest.mark.parametrize("pitch_deg", [0.0, 10.0, 20.0])
@pytest.mark.parametrize("ceiling_m", [0.7, 1.0, 2.0])
def test_under_a_ceiling_the_sent_distance_is_not_larger_than_the_true_one(ceiling_m: float, pitch_deg: float) -> None:
    """Of a rendered room, whether its ceiling was found or not: the distance sent upward is no farther than the ceiling."""
    seen = model_of(room(ceiling_m), height_m=1.5, pitch_rad=math.radians(pitch_deg))
    known = Overhead(UP)
    known.see(View(seen, AHEAD), Here(0.0, (0.0, 0.0, -1.5), 1), NS)
    for north in np.arange(0.0, 11.0, 0.25):
        got_m = known.upward_m(Here(0.0, (float(north), 0.0, -1.5), 1), NS)
        assert got_m is None or got_m <= ceiling_m + 0.05


@pytest.mark.parametrize("heading_deg", [0.0, 35.0, 90.0, 200.0, 341.0])
def test_its_position_does_not_depend_on_the_heading(heading_deg: float) -> None:
    known = Overhead(UP)
    heading = math.radians(heading_deg)
    known.see(View(model(BEAM), AHEAD), Here(heading, (10.0, -20.0, -5.0), 1), NS)
    under = (10.0 + 6.0 * math.cos(heading), -20.0 + 6.0 * math.sin(heading), -5.0)
    assert known.upward_m(Here(0.0, under, 1), NS) == pytest.approx(2.5)
    assert known.upward_m(Here(0.0, (10.0, -20.0, -5.0), 1), NS) is None


def test_a_position_jump_moves_the_beam_and_without_a_position_nothing_is_sent() -> None:
    known = Overhead(UP)
    known.see(View(model(BEAM), AHEAD), Here(0.0, (0.0, 0.0, -5.0), 1), NS)
    assert known.upward_m(Here(0.0, (6.0, 0.0, -5.0), 1), NS) is not None
    assert known.upward_m(Here(0.0, (506.0, 0.0, -25.0), 2), NS) == pytest.approx(2.5)
    assert known.upward_m(Here(0.0), NS) is None
    assert known.upward_m(Here(0.0, (506.0, 0.0, -25.0), 2), NS) is None


@pytest.mark.parametrize("velocity_m_s", [(2.0, 0.0, -3.0), None])
def test_what_was_flown_is_no_part_of_a_jump(velocity_m_s: tuple[float, float, float] | None) -> None:
    """While the vehicle climbed at 3 m/s, each jump put the beam 0.2 m higher than it was."""
    known, start = Overhead(UP), Here(0.0, (6.0, 0.0, -5.0), 1, velocity_ned_m_s=(2.0, 0.0, -3.0))
    under = (0.1, -3.0, 0.1, 3.0, -4.0, -2.5)
    known.see(View(model(under), AHEAD), start, NS)
    assert known.upward_m(start, NS) == pytest.approx(2.5)
    later_m = (6.0 + 0.1 * 2.0 + 40.0, 0.0, -5.0 - 0.1 * 3.0 - 20.0)
    jumped = Here(0.0, later_m, 2, velocity_ned_m_s=velocity_m_s)
    assert known.upward_m(jumped, NS + NS // 10) == pytest.approx(2.2)


def test_obstacles_ahead_below_and_invalid_models_are_nothing_overhead() -> None:
    known = Overhead(UP)
    for planes in ((0.0, -3.0, 0.0, 3.0, -1.0, 1.0), (0.0, -3.0, 0.0, 3.0, 1.0, 2.0)):
        known.see(View(model(planes), AHEAD), Here(0.0, (0.0, 0.0, -5.0), 1), NS)
    over = (0.0, -3.0, 0.0, 3.0, -4.0, -3.0)
    known.see(View(replace(model(over), valid=False), AHEAD), Here(0.0, (0.0, 0.0, -5.0), 1), NS)
    assert known.upward_m(Here(0.0, (0.0, 0.0, -5.0), 1), NS) is None


def up_of(chain: Chain, avoid: AvoidParams) -> list[float]:
    """The present distance of the upward DISTANCE_SENSOR."""
    messages = messages_of(chain.report(ARDUPILOT), "ArduPilot", avoid, chain.now_ns)
    return [
        m.current_distance / 100.0 for m in messages if m.get_type() == "DISTANCE_SENSOR" and m.orientation == UPWARD
    ]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_blind_service_sends_the_beam_for_a_while_and_then_nothing(fault: str) -> None:
    """It never sends clear; half a second after the last message ArduPilot climbs as without the companion."""
    over = (0.2, -3.0, 0.2, 3.0, -4.0, -2.5)
    chain = Chain(model(over, free_to_m=13.0, view_deg=72.0), UP)
    chain.position = (0.0, 0.0, -5.0)
    chain.fly(1.0)
    assert up_of(chain, UP) == [2.5]
    assert up_of(chain, replace(UP, upward=False)) == [2.5]  # sent although [avoid] upward is off
    broken(chain, fault, 0.4)
    assert up_of(chain, UP) in ([2.5], [])  # without an attitude the direction upward is unknown
    broken(chain, fault, 6.0)
    assert up_of(chain, UP) == []


def test_it_is_off_until_it_is_switched_on() -> None:
    over = (0.2, -3.0, 0.2, 3.0, -4.0, -2.5)
    chain = Chain(model(over, free_to_m=13.0, view_deg=72.0))
    chain.position = (0.0, 0.0, -5.0)
    chain.fly(1.0)
    assert [m.get_type() for m in messages_of(chain.report(ARDUPILOT), "ArduPilot", AVOID, 0)] == ["OBSTACLE_DISTANCE"]


def test_the_ground_under_the_vehicle_not_under_its_camera() -> None:
    ground = Ground(seen=True, height_m=3.0, slope_x=0.1, slope_y=-0.2)
    view = View(replace(model(), ground=ground), LevelTransform(0.0, (0.5, 0.25, -0.4)))
    assert downward_m([view]) == pytest.approx(-0.4 + 3.0 - 0.05 + 0.05)
    unseen = replace(view, model=replace(view.model, ground=Ground(seen=False)))
    blind = replace(view, model=replace(view.model, valid=False))
    assert downward_m([unseen]) is downward_m([blind]) is downward_m([]) is None
    nearer = replace(view, transform=LevelTransform(0.0, (0.0, 0.0, -1.0)))
    assert downward_m([view, nearer, unseen]) == pytest.approx(2.0)
    for height_m in (math.inf, math.nan, -1.0):
        wrong = replace(view, model=replace(view.model, ground=replace(ground, height_m=height_m)))
        assert downward_m([wrong]) is None
        assert downward_m([wrong, nearer]) == pytest.approx(2.0)


@pytest.mark.parametrize("fault", FAULTS)
def test_downward_ends_with_the_sight_of_the_ground(fault: str) -> None:
    down = replace(AVOID, downward=True)
    sees = replace(model(free_to_m=13.0, view_deg=72.0), ground=Ground(seen=True, height_m=2.0))
    chain = Chain(sees, down)
    chain.fly(1.0)
    assert chain.report(ARDUPILOT).down_m == pytest.approx(2.0)
    broken(chain, fault, 0.4)
    assert chain.report(ARDUPILOT).down_m is None


def test_ardupilot_removes_obstacles_that_are_not_sent_again() -> None:
    heights = ArduPilotHeights()
    heights.read(distance_sensor_message(2.5, UPWARD, 0, AVOID), NS)
    assert heights.up_m(NS + NS // 2) == 2.5
    assert heights.down_m(NS) is None
    assert heights.up_m(NS + NS // 2 + 1) is None


@pytest.mark.parametrize("distance_m", [0.0, 0.059, 0.1, 0.19, 0.2, 0.75])
def test_a_distance_below_the_least_one_is_not_sent_as_farther(distance_m: float) -> None:
    """A height that is too great would go into the autopilot's estimate; below min_distance both autopilots take it for out of
    range (RangeFinder_MAVLink, EKF2). ArduPilot uses each distance upward."""
    for orientation in (UPWARD, DOWNWARD):
        message = distance_sensor_message(distance_m, orientation, 0, replace(AVOID, min_distance_m=0.7))
        assert message.min_distance == 70
        assert distance_m - 0.01 < message.current_distance / 100.0 <= distance_m


def test_golden_bytes() -> None:
    packer = dialect.MAVLink(None, 1, 196)
    got_m = ((1.239, UPWARD), (99.0, DOWNWARD), (0.0, DOWNWARD))
    avoid = AvoidParams()
    assert [distance_sensor_message(m, way, 0x01020304, avoid).pack(packer).hex() for m, way in got_m] == [
        "fd0e00000001c4840000040302011400b0047b00040118ff2482",
        "fd0e00000001c4840000040302011400b004af04040119fff053",
        "fd0e00000001c4840000040302011400b0040000040119ff36bf",
    ]
