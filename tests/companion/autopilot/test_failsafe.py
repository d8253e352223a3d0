"""Obstacle output while cameras are blind, and the reaction of the autopilots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.failsafe import (
    AutopilotNow,
    BlindPolicy,
    Policy,
    PolicyInput,
    Recovery,
    braking_reach,
    policy_of,
)
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm, obstacle_distance_message
from companion.autopilot.obstacle_memory import Remembered, nothing_remembered
from companion.autopilot.polar_histogram import SECTORS, SectorScan, SectorState, scan
from companion.autopilot.view_free import View
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader

from ..failsafe_views import AVOID, NS, front_seen
from ..sector_models import HERE, model, wall_at

SECTOR = np.arange(SECTORS)
FRONT = np.minimum(SECTOR, SECTORS - SECTOR) <= 7
EDGES = np.minimum(SECTOR, SECTORS - SECTOR) == 7
"""Of which the camera in front sees a part."""
NOWHERE = np.zeros(SECTORS, bool)
NOTHING = np.full(SECTORS, np.inf)


def sight(
    found: SectorScan | None = None,
    blind: np.ndarray = NOWHERE,
    seeing: np.ndarray = NOWHERE,
    newest_ns: int | None = 0,
) -> PolicyInput:
    found = scan([], AVOID) if found is None else found
    return PolicyInput(found, nothing_remembered(), blind, seeing, seeing & ~EDGES, newest_ns)


def stop_at(margin_m: float) -> Policy:
    """The policy for an ArduPilot with this AVOID_MARGIN."""
    return policy_of(AVOID, AutopilotNow(kind="ArduPilot", margin_m=margin_m))


STOP, NOT_KNOWN = stop_at(2.0), Policy("unknown")


@pytest.mark.parametrize(
    ("autopilot", "name", "wall_m", "all_around"),
    [
        (AutopilotNow(kind="PX4"), "unknown", 0.0, False),
        (AutopilotNow(kind="PX4", cp_dist_m=3.0), "brake", 3.02, True),
        (AutopilotNow(kind="PX4", cp_dist_m=0.1), "brake", 0.22, True),  # PX4 keeps min_distance at least
        (AutopilotNow(kind="PX4", cp_dist_m=-1.0), "unknown", 0.0, False),  # collision prevention is off
        (AutopilotNow(kind="PX4", cp_dist_m=0.0), "unknown", 0.0, False),
        (AutopilotNow(kind="PX4", cp_dist_m=12.0), "unknown", 0.0, False),  # no room below max_distance_m
        (AutopilotNow(kind="ArduPilot", margin_m=2.0), "stop", 2.121, False),
        (AutopilotNow(kind="ArduPilot"), "stop", 2.121, False),
        (AutopilotNow(kind="autopilot 8"), "stop", 2.121, False),
        (AutopilotNow(), "stop", 2.121, False),
        # contradictory heartbeats: not nearer than CP_DIST, where PX4 v1.16 flies backwards, and not nearer than ArduPilot's
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, cp_dist_m=3.0), "stop", 3.02, True),
        (AutopilotNow(kind="ArduPilot or PX4"), "stop", 3.02, True),
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0), "stop", 2.121, True),  # it answered as ArduPilot
        # kept from the last start: it may have been another vehicle
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, margin_is_read=False), "stop", 3.02, True),
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=5.0, margin_is_read=False), "stop", 5.369, True),
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=5.0, cp_dist_m=3.0), "stop", 5.369, True),
        # several vehicles: what was read may be of another one, so that the wall is not nearer than for the usual values
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, is_uncertain=True), "stop", 3.02, True),
        (AutopilotNow(kind="ArduPilot or PX4", margin_m=5.0, is_uncertain=True), "stop", 5.369, True),
        (AutopilotNow(kind="ArduPilot or PX4", cp_dist_m=0.5, is_uncertain=True), "stop", 3.02, True),
        (AutopilotNow(kind="ArduPilot or PX4", cp_dist_m=4.0, is_uncertain=True), "stop", 4.02, True),
        (AutopilotNow(kind="PX4", cp_dist_m=0.5, is_uncertain=True), "brake", 3.02, True),
        (AutopilotNow(kind="PX4", cp_dist_m=-1.0, is_uncertain=True), "brake", 3.02, True),
        (AutopilotNow(kind="PX4", cp_dist_m=4.0, is_uncertain=True), "brake", 4.02, True),
        (AutopilotNow(kind="PX4", is_uncertain=True), "unknown", 0.0, False),
        (AutopilotNow(kind="ArduPilot", margin_m=0.5, is_uncertain=True), "stop", 2.121, False),
        (AutopilotNow(kind="ArduPilot", margin_m=5.0, is_uncertain=True), "stop", 5.369, False),
    ],
)
def test_policy_by_autopilot(autopilot: AutopilotNow, name: str, wall_m: float, all_around: bool) -> None:
    policy = policy_of(AVOID, autopilot)
    assert (policy.name, policy.all_around) == (name, all_around)
    assert policy.wall_m == pytest.approx(wall_m, abs=0.001)
    assert policy_of(replace(AVOID, blind="unknown"), autopilot) == Policy("unknown")
    configured = policy_of(replace(AVOID, blind="stop"), autopilot)
    assert configured.name == "stop"
    if autopilot.may_be_px4 and autopilot.cp_dist_m == 3.0:
        assert configured.wall_m >= 3.02


def test_px4_receives_unknown_and_then_nothing() -> None:
    policy, px4 = BlindPolicy(AVOID), Px4Reader()
    seen = policy.values(sight(front_seen(), seeing=FRONT), NOT_KNOWN, 0)
    assert seen is not None
    px4.read(obstacle_distance_message(seen, 0, AVOID), 0)
    assert px4.room_m(0.0, 0) == math.inf
    for t_ns in range(NS // 2, 2 * NS + 1, NS // 10):
        blind = policy.values(sight(blind=FRONT), NOT_KNOWN, t_ns)
        assert blind is not None
        assert (blind == UNKNOWN).all()
        px4.read(obstacle_distance_message(blind, 0, AVOID), t_ns)
    assert policy.values(sight(blind=FRONT), NOT_KNOWN, 2 * NS + 1) is None
    assert px4.room_m(0.0, NS) == 0.0  # it stands when its own bins are old, half a second after the last word
    assert px4.holds(8 * NS)


def test_blindness_counts_from_the_newest_exposure() -> None:
    policy = BlindPolicy(AVOID)
    late = sight(blind=FRONT, newest_ns=3 * NS)
    assert policy.values(late, NOT_KNOWN, 3 * NS + 400_000_000) is not None
    assert policy.values(late, NOT_KNOWN, 5 * NS + 1) is None
    again = policy.values(sight(front_seen(), seeing=FRONT, newest_ns=6 * NS), NOT_KNOWN, 6 * NS)
    assert again is not None
    assert again[0] == clear_cm(AVOID)


@pytest.mark.parametrize("margin_m", [1.0, 2.0, 3.0, 5.0, 10.0])
def test_ardupilot_is_shown_a_wall_where_it_holds_its_place_for_as_long_as_it_is_blind(margin_m: float) -> None:
    policy = BlindPolicy(AVOID)
    for t_ns in (NS, 60 * NS, 3600 * NS):
        values = policy.values(sight(blind=FRONT), stop_at(margin_m), t_ns)
        assert values is not None
        for old in (False, True):
            vehicle = ArduPilotReader(one_pass=old, margin_m=margin_m)
            vehicle.read(obstacle_distance_message(values, 0, AVOID), t_ns)
            assert -0.1 < vehicle.room_m(0.0, t_ns) < 0.0  # within the dead zone of backing up
            forward, right = vehicle.velocity_m_s((2.0, 0.0), t_ns)
            assert abs(forward) < 0.03
            assert abs(right) < 1e-6
            for aside_deg in (-40.0, -22.5, 22.5, 40.0):  # towards a corner of its fence it creeps
                wanted = (2.0 * math.cos(math.radians(aside_deg)), 2.0 * math.sin(math.radians(aside_deg)))
                assert math.hypot(*vehicle.velocity_m_s(wanted, t_ns)) < 0.03 + 0.085 * margin_m
            assert vehicle.room_m(180.0, t_ns) == math.inf  # no camera observes it in any case


def test_a_camera_that_never_saw_is_blind_from_the_start() -> None:
    policy = BlindPolicy(AVOID)
    values = policy.values(sight(blind=FRONT, newest_ns=None), STOP, NS)
    assert values is not None
    assert values[0] == 212


def test_what_is_remembered_nearer_than_the_wall_wins_and_what_is_farther_does_not() -> None:
    remembered = NOTHING.copy()
    remembered[0], remembered[2] = 1.1, 9.0
    blind = replace(sight(blind=FRONT), recalled=Remembered(remembered, remembered))
    stop = BlindPolicy(AVOID).values(blind, STOP, NS)
    assert stop is not None
    assert (stop[0], stop[2]) == (110, 212)
    unknown = BlindPolicy(AVOID).values(blind, NOT_KNOWN, NS)
    assert unknown is not None
    assert (unknown[0], unknown[2], unknown[4]) == (110, 900, UNKNOWN)


def obstacles(**distance_m: float) -> np.ndarray:
    """(72,) m; s3=1.5: an obstacle at 1.5 m in sector 3, none in the others."""
    out = NOTHING.copy()
    for sector, m in distance_m.items():
        out[int(sector[1:])] = m
    return out


def test_a_plane_behind_something_unmeasured_is_sent_to_ardupilot() -> None:
    """Unknown is clear for it. The wall is put before the plane; at the edge of the view, sector 7, there is no wall."""
    found = replace(scan([], AVOID), distance_m=obstacles(s2=5.0, s3=1.5, s7=5.0, s20=14.0))
    assert (found.state == SectorState.UNSEEN).all()
    values = BlindPolicy(AVOID).values(sight(found, seeing=FRONT), STOP, NS)
    assert values is not None
    assert values[[2, 3, 7]].tolist() == [212, 150, 500]
    without = BlindPolicy(replace(AVOID, unseen="unknown")).values(sight(found, seeing=FRONT), STOP, NS)
    assert without is not None
    assert np.flatnonzero(without != UNKNOWN).tolist() == [2, 3, 7]
    assert without[[2, 3, 7]].tolist() == [500, 150, 500]


def test_what_is_remembered_without_the_way_to_it_stops_ardupilot_and_leaves_px4_unknown() -> None:
    """Something nearer may be before it, and PX4 moves into a sector that has a value."""
    remembered = Remembered(obstacles(s3=0.4, s20=5.0), NOTHING)
    unseen = replace(sight(seeing=FRONT), recalled=remembered)
    values = BlindPolicy(AVOID).values(unseen, STOP, NS)
    assert values is not None
    assert values[[3, 20]].tolist() == [40, 500]
    values = BlindPolicy(AVOID).values(unseen, NOT_KNOWN, NS)
    assert values is not None
    assert values[[3, 20]].tolist() == [40, UNKNOWN]


def test_px4_brakes_for_the_nearer_of_a_measured_and_a_remembered_obstacle_in_an_unseen_sector() -> None:
    """A farther one is sent at the distance of the wall."""
    found = replace(scan([], AVOID), distance_m=obstacles(s1=6.0, s2=6.0, s3=2.4))
    unseen = replace(sight(found, seeing=FRONT), recalled=Remembered(obstacles(s2=2.5, s3=5.0, s4=5.0), NOTHING))
    values = BlindPolicy(AVOID).values(unseen, Policy("brake", 3.02, all_around=True), NS)
    assert values is not None
    assert values[:6].tolist() == [UNKNOWN, 302, 250, 240, 302, UNKNOWN]


def test_only_sectors_that_blind_cameras_alone_cover_are_filled() -> None:
    right = np.abs(SECTOR - 9) <= 7
    both = sight(front_seen(), blind=right, seeing=FRONT)
    stop = BlindPolicy(AVOID).values(both, STOP, NS)
    assert stop is not None
    assert stop[0] == clear_cm(AVOID)
    assert stop[7] == 212  # the other one sees a part of it only
    assert (stop[right & ~FRONT] == 212).all()
    assert (stop[~right & ~FRONT] == UNKNOWN).all()
    unknown = BlindPolicy(AVOID).values(both, NOT_KNOWN, 100 * NS)
    assert unknown is not None  # one sees: never silence
    assert (unknown[right & ~FRONT] == UNKNOWN).all()


def test_clear_is_never_sent_where_no_camera_looks() -> None:
    everywhere = scan([View(model(free_to_m=13.0), HERE)], AVOID)
    for policy in (STOP, NOT_KNOWN, Policy("brake", 3.02, True)):
        values = BlindPolicy(AVOID).values(sight(everywhere, seeing=FRONT), policy, NS)
        assert values is not None
        assert (values[~FRONT] == UNKNOWN).all()


def test_a_sector_in_view_that_was_not_seen_clear_stops_ardupilot_unless_configured_otherwise() -> None:
    """65535 would be clear to it. What was seen free before that is left to it."""
    found = scan([View(model(free_to_m=6.0, view_deg=72.0), HERE)], AVOID)
    assert found.state[0] == SectorState.UNSEEN
    values = BlindPolicy(AVOID).values(sight(found, seeing=FRONT), STOP, NS)
    assert values is not None
    assert 212 < values[0] <= 600
    nothing = scan([View(model(free_to_m=0.0, view_deg=72.0), HERE)], AVOID)
    values = BlindPolicy(AVOID).values(sight(nothing, seeing=FRONT), STOP, NS)
    assert values is not None
    assert values[0] == 212
    decided = BlindPolicy(replace(AVOID, unseen="unknown")).values(sight(nothing, seeing=FRONT), STOP, NS)
    assert decided is not None
    assert decided[0] == UNKNOWN


BRAKE = policy_of(AVOID, AutopilotNow(kind="PX4", cp_dist_m=3.0))


def test_px4_gets_a_wall_all_around_and_then_nothing() -> None:
    policy = BlindPolicy(AVOID)
    assert policy.values(sight(front_seen(), seeing=FRONT), BRAKE, 0) is not None
    for t_ns in (NS // 3, NS, 2 * NS):
        values = policy.values(sight(blind=FRONT), BRAKE, t_ns)
        assert values is not None
        assert (values == 302).all()
    assert policy.values(sight(blind=FRONT), BRAKE, 2 * NS + 1) is None


@pytest.mark.parametrize(("cp_dist_m", "wall_cm"), [(2.981, 301), (2.989, 301), (2.991, 302), (4.0, 402), (2.49, 251)])
def test_the_wall_for_px4_is_rounded_away_from_the_vehicle(cp_dist_m: float, wall_cm: int) -> None:
    """A wall nearer than CP_DIST makes v1.16 fly backwards. 100 times 2.49 + 0.02 is more than 251 by its last bits."""
    brake = policy_of(AVOID, AutopilotNow(kind="PX4", cp_dist_m=cp_dist_m))
    values = BlindPolicy(AVOID).values(sight(blind=FRONT), brake, NS)
    assert values is not None
    assert (values == wall_cm).all()


def test_one_of_two_blind_cameras_first_stops_px4_and_then_leaves_it_what_the_other_one_sees() -> None:
    right = np.abs(SECTOR - 9) <= 7
    policy = BlindPolicy(AVOID)
    both = sight(front_seen(), blind=right, seeing=FRONT, newest_ns=10 * NS)
    values = policy.values(both, BRAKE, 10 * NS)
    assert values is not None
    assert (values == 302).all()
    values = policy.values(both, BRAKE, 12 * NS + 1)
    assert values is not None
    assert (values[right & ~FRONT] == UNKNOWN).all()
    assert values[0] == clear_cm(AVOID)
    again = policy.values(sight(front_seen(), seeing=FRONT), BRAKE, 13 * NS)
    assert again is not None
    assert again[0] == clear_cm(AVOID)
    values = policy.values(both, BRAKE, 14 * NS)
    assert values is not None
    assert (values == 302).all()


def test_a_blind_camera_whose_sectors_another_one_sees_does_not_stop_px4() -> None:
    inside = np.minimum(SECTOR, SECTORS - SECTOR) <= 4
    values = BlindPolicy(AVOID).values(sight(front_seen(), blind=inside, seeing=FRONT), BRAKE, NS)
    assert values is not None
    assert values[0] == clear_cm(AVOID)


def test_a_blind_camera_whose_sectors_another_one_sees_in_part_stops_px4() -> None:
    values = BlindPolicy(AVOID).values(sight(front_seen(), blind=EDGES, seeing=FRONT), BRAKE, NS)
    assert values is not None
    assert (values == 302).all()


def test_without_a_velocity_all_obstacles_at_and_beside_the_edge_of_the_view_are_sent_to_px4() -> None:
    """A value stands for the sectors beside it, too."""
    clear = replace(scan([], AVOID), state=np.full(SECTORS, SectorState.CLEAR, np.uint8))
    edge = replace(sight(clear, seeing=FRONT), edge=SECTOR == 5)
    always_cm = braking_reach(edge, AVOID, BRAKE).always_cm
    assert (always_cm[4:7] == 100.0 * AVOID.max_distance_m).all()
    assert (np.delete(always_cm, (4, 5, 6)) < 400.0).all()


def test_without_a_wall_and_a_velocity_no_obstacle_at_the_edge_is_sent_at_the_distance_of_a_wall() -> None:
    """It would be at the distance 0."""
    found = front_seen(wall_at(20.0, 8.0))
    assert found.distance_m[4] < 8.0
    edge = replace(sight(found, seeing=FRONT), edge=(SECTOR >= 3) & (SECTOR <= 5))
    found.state[3:6] = SectorState.UNSEEN, SectorState.OBSTACLE, SectorState.UNSEEN
    assert (braking_reach(replace(edge, edge=NOWHERE), AVOID, NOT_KNOWN).approach_cm == 0.0).all()
    unseen = replace(edge, edge=SECTOR == 4)
    values = BlindPolicy(AVOID).values(unseen, NOT_KNOWN, NS)
    assert values is not None
    assert values[4] == UNKNOWN


def test_with_contradictory_heartbeats_the_wall_stands_all_around() -> None:
    """Before a wall in front alone PX4 v1.16 slides sideways."""
    both = policy_of(AVOID, AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, cp_dist_m=3.0))
    for t_ns in (NS, 3600 * NS):
        values = BlindPolicy(AVOID).values(sight(blind=FRONT), both, t_ns)
        assert values is not None
        assert (values >= 301).all()
        assert (values <= 302).all()


def test_with_contradictory_heartbeats_a_blind_camera_beside_the_edge_of_another_one_puts_the_wall_all_around() -> None:
    both = policy_of(AVOID, AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, cp_dist_m=3.0))
    values = BlindPolicy(AVOID).values(sight(front_seen(), blind=EDGES, seeing=FRONT), both, NS)
    assert values is not None
    assert values[0] == clear_cm(AVOID)
    assert (values[~FRONT] < 303).all()


def test_with_contradictory_heartbeats_no_sector_is_clear_into_which_the_hull_does_not_fit() -> None:
    both = policy_of(AVOID, AutopilotNow(kind="ArduPilot or PX4", margin_m=2.0, cp_dist_m=3.0))
    edge = replace(sight(front_seen(), seeing=FRONT), edge=SECTOR == 2)
    unseen = sight(front_seen(), seeing=FRONT)
    unseen.scan.state[3] = SectorState.UNSEEN  # PX4 moves into it by the value of the sector below it, too
    for view in (edge, unseen):
        for policy, value in ((both, UNKNOWN), (STOP, clear_cm(AVOID))):  # ArduPilot takes unknown for clear
            values = BlindPolicy(AVOID).values(view, policy, NS)
            assert values is not None
            assert values[2] == value
            assert values[0] == clear_cm(AVOID)


@pytest.mark.parametrize(
    ("distance_m", "velocity_m_s", "sent_cm"),
    [(8.0, (0.0, 0.0), UNKNOWN), (8.0, (4.0, 0.0), 769), (2.51, (0.0, 0.0), 221)],
)
def test_an_obstacle_at_the_edge_of_the_view_is_sent_to_px4_only_if_it_is_near_or_approached(
    distance_m: float, velocity_m_s: tuple[float, float], sent_cm: int
) -> None:
    """PX4 moves into a sector that has any value."""
    edge = replace(sight(front_seen(wall_at(20.0, distance_m)), seeing=FRONT), edge=SECTOR == 4)
    values = BlindPolicy(AVOID).values(replace(edge, velocity_m_s=velocity_m_s), BRAKE, 0)
    assert values is not None
    assert int(values[4]) == sent_cm


def test_px4_is_still_sent_an_obstacle_that_has_left_the_view() -> None:
    """The hull does not fit into any sector without a camera: such a sector is also at the edge."""
    distance_m = np.where(SECTOR == 20, 5.0, np.inf)
    left = replace(sight(front_seen(), seeing=FRONT), edge=~FRONT, recalled=Remembered(distance_m, distance_m))
    values = BlindPolicy(AVOID).values(replace(left, velocity_m_s=(0.0, 0.0)), BRAKE, 0)
    assert values is not None
    assert values[20] == 500


def test_a_blind_camera_is_used_again_after_good_frames_in_a_row() -> None:
    recovery = Recovery(("front", "right"), 3)
    recovered = []
    for valid in (True, True, False, True, True, True):
        recovery.frame("front", valid)
        recovered.append(recovery.recovered("front"))
    assert recovered == [False] * 5 + [True]
    recovery.blind({"front": "silent", "right": ""})
    assert not recovery.recovered("front")
    assert not recovery.recovered("right")


def test_a_clear_field_stops_ardupilot_in_no_face_that_the_camera_looks_into() -> None:
    """It sees a part of its outermost sectors only: a wall there would stand in the faces beside the nose for ever."""
    field = front_seen()
    assert field.state[7] == SectorState.UNSEEN
    values = BlindPolicy(AVOID).values(sight(field, seeing=FRONT), STOP, NS)
    assert values is not None
    vehicle = ArduPilotReader()
    vehicle.read(obstacle_distance_message(values, 0, AVOID), NS)
    assert all(vehicle.room_m(d, NS) == math.inf for d in range(360))


REAR = np.roll(FRONT, 36)
BRAKE = Policy("brake", 3.02, all_around=True)


def test_a_camera_that_fails_while_another_is_long_blind_brakes_px4() -> None:
    policy = BlindPolicy(AVOID)
    for t_ns in range(0, 60 * NS, NS // 2):
        front = policy.values(sight(front_seen(), blind=REAR, seeing=FRONT, newest_ns=t_ns), BRAKE, t_ns)
    assert front is not None
    assert front[0] == clear_cm(AVOID), "the time of the rear camera's wall is over"
    for t_ns in range(60 * NS, 62 * NS, NS // 10):
        walls = policy.values(sight(blind=FRONT | REAR, newest_ns=60 * NS), BRAKE, t_ns)
        assert walls is not None
        assert (walls == 302).all()
    assert policy.values(sight(blind=FRONT | REAR, newest_ns=60 * NS), BRAKE, 62 * NS + 1) is None


def test_the_last_of_two_cameras_on_the_same_sectors_brakes_px4() -> None:
    policy = BlindPolicy(AVOID)
    half = replace(sight(front_seen(), blind=FRONT, seeing=FRONT), whole=NOWHERE)
    policy.values(half, BRAKE, 0)
    seen = policy.values(replace(half, newest_ns=60 * NS), BRAKE, 60 * NS)
    assert seen is not None
    assert not (seen == 302).all()
    walls = policy.values(sight(blind=FRONT, newest_ns=60 * NS), BRAKE, 60 * NS + NS // 10)
    assert walls is not None
    assert (walls == 302).all()


def test_a_change_to_policy_brake_starts_the_time_of_the_wall() -> None:
    policy = BlindPolicy(AVOID)
    blind = sight(blind=FRONT, newest_ns=0)
    policy.values(blind, NOT_KNOWN, NS // 10)
    assert policy.values(blind, NOT_KNOWN, 30 * NS) is None
    for t_ns in (31 * NS, 33 * NS):
        walls = policy.values(blind, BRAKE, t_ns)
        assert walls is not None
        assert (walls == 302).all()
    assert policy.values(blind, BRAKE, 33 * NS + 1) is None


def test_px4_brakes_before_the_wall_even_where_another_camera_sees_something_nearer() -> None:
    """A value nearer than CP_DIST makes v1.16 fly backwards, possibly into the direction that is blind."""
    near = sight(front_seen(wall_at(0.0, 1.5)), blind=REAR, seeing=FRONT)
    policy = BlindPolicy(AVOID)
    walls = policy.values(near, BRAKE, NS)
    assert walls is not None
    assert (walls == 302).all()
    after = policy.values(near, BRAKE, 4 * NS)
    assert after is not None
    assert after[0] == 120


@pytest.mark.parametrize("blind", [FRONT, NOWHERE])
def test_on_the_ground_the_wall_for_a_wide_margin_is_not_clear(blind: np.ndarray) -> None:
    avoid = replace(AVOID, max_distance_m=5.0)
    wide = policy_of(avoid, AutopilotNow(kind="ArduPilot", margin_m=5.0))
    assert 100 * wide.wall_m > clear_cm(avoid)
    found = front_seen(wall_at(0.0, 0.6), wall_at(20.0, 1.21))
    near = replace(sight(found, seeing=FRONT, blind=blind), on_ground=True)
    values = BlindPolicy(avoid).values(near, wide, NS)
    assert values is not None
    assert values[0] == clear_cm(avoid) - 2
    assert values[4] == 90
