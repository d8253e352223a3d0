"""What both autopilots do with the sectors that they receive."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.autopilot.failsafe import AutopilotNow, BlindPolicy, PolicyInput, policy_of
from companion.autopilot.obstacle_distance import (
    FACE,
    UNKNOWN,
    BrakingReach,
    clear_cm,
    encoded,
    for_coarse_bins,
    for_reader,
    near_cm,
    obstacle_distance_message,
    only_near,
)
from companion.autopilot.obstacle_distance_3d import level_points, obstacle_points_messages
from companion.autopilot.obstacle_memory import nothing_remembered
from companion.autopilot.polar_histogram import SECTORS, SectorScan, SectorState, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from core.types import Ground
from drivers.mavlink.ardupilot_faces import face_of
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.ardupilot_layers import ArduPilotLayers
from drivers.simulation.firmware_models.px4 import Px4Reader

from ..sector_models import AVOID, HERE, NS, model, wall_at

PX4_NOW = AutopilotNow(kind="PX4", cp_dist_m=3.0)


def message_of(found: SectorScan, avoid: AvoidParams = AVOID, autopilot: str = "") -> Any:
    return obstacle_distance_message(for_reader(encoded(found, avoid), avoid, autopilot), 0, avoid)


def message_seen_everywhere(found: SectorScan, autopilot: str) -> Any:
    """The message for an autopilot by its own policy, of cameras that look into a part of every sector."""
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    sight = PolicyInput(found, nothing_remembered(), nowhere, everywhere, nowhere, 0)
    values = BlindPolicy(AVOID).values(sight, policy_of(AVOID, AutopilotNow(kind=autopilot)), 0)
    assert values is not None
    return obstacle_distance_message(for_reader(values, AVOID, autopilot), 0, AVOID)


@given(
    st.floats(0.0, 360.0, exclude_max=True),
    st.floats(0.31, 12.2),
    st.sampled_from([0.02, 0.12, 2.0]),
    st.booleans(),
    st.booleans(),
)
def test_a_pole_is_lost_in_no_direction_and_at_no_distance(
    angle_deg: float, distance_m: float, width_m: float, clear: bool, known: bool
) -> None:
    """Where the way to it was not seen PX4 is sent unknown, which stops it, unless the pole is near;
    ArduPilot, to which that means clear, is sent the pole."""
    pole = wall_at(angle_deg, distance_m, width_m)
    around = scan([View(model(pole, free_to_m=13.0 if clear else 0.0), HERE)], AVOID)
    least = min(distance_m, math.hypot(*pole[:2]), math.hypot(*pole[2:4])) - 0.3
    for px4 in (Px4Reader(5), Px4Reader(10)):
        px4.read(message_seen_everywhere(around, "PX4" if known else ""), NS)
        bins = px4.bins_cm(NS)
        nearest = min(bins[int(angle_deg // px4.bin_deg)], bins[int(-(-angle_deg // px4.bin_deg)) % len(bins)])
        if known and not clear and least > AVOID.near_m - AVOID.radius_m - 0.01:
            assert nearest <= 100 * least + 1 or px4.room_m(angle_deg, NS) == 0.0
        else:
            assert 21 <= nearest <= max(22, 100 * least + 1)
    for one_pass, slides, filter_hz in product((False, True), (False, True), (0.0, 1.0)):
        ardupilot = ArduPilotReader(one_pass=one_pass, slides=slides, filter_hz=filter_hz)
        ardupilot.read(message_seen_everywhere(around, "ArduPilot" if known else ""), NS)
        assert ardupilot.faces_m(NS)[face_of(round(angle_deg / 5.0) * 5.0)] <= max(0.22, least + 0.01)
        # its fence has no corner nearer than 0.6 m
        assert ardupilot.room_m(angle_deg, NS) <= max(0.6, least + 0.02) - ardupilot.margin_m


def test_a_second_obstacle_in_the_front_face_does_not_hide_the_nearer_one() -> None:
    found = scan(
        [View(model(wall_at(10.0, 3.0), wall_at(90.0, 9.0), wall_at(350.0, 8.0), free_to_m=13.0), HERE)], AVOID
    )
    unadapted = ArduPilotReader()
    unadapted.read(obstacle_distance_message(encoded(found, AVOID), 0, AVOID), NS)
    assert unadapted.faces_m(NS)[0] > 7.0  # that is what has to be worked around
    reader = ArduPilotReader()
    reader.read(message_of(found), NS)
    assert reader.faces_m(NS)[0] < 3.0


@pytest.mark.parametrize("filter_hz", [0.0, 0.25, 2.0])
@pytest.mark.parametrize("aside_deg", [10.0, 20.0])
@pytest.mark.parametrize(("right_m", "left_m"), [(3.0, 8.0), (8.0, 3.0)])
def test_the_nearer_half_of_the_front_face_counts_whatever_the_low_pass(
    right_m: float, left_m: float, aside_deg: float, filter_hz: float
) -> None:
    planes = (wall_at(aside_deg, right_m), wall_at(90.0, 9.0), wall_at(360.0 - aside_deg, left_m))
    reader = ArduPilotReader(filter_hz=filter_hz)
    for tenth in range(10):
        reader.read(message_of(scan([View(model(*planes, free_to_m=13.0), HERE)], AVOID)), NS + tenth * NS // 10)
    assert reader.room_m(0.0, 2 * NS - NS // 10) < 3.0 - reader.margin_m


@given(
    st.dictionaries(st.integers(0, 71), st.integers(70, 1199), min_size=1, max_size=8),
    st.sampled_from(
        [(kind, cm) for kind in ("ArduPilot", "autopilot 8", "ArduPilot or PX4") for cm in (UNKNOWN, clear_cm(AVOID))]
    ),
    st.booleans(),
)
@example({6: 400, 66: 1000}, ("ArduPilot or PX4", UNKNOWN), False)
@example({2: 400, 54: 1000}, ("autopilot 8", UNKNOWN), False)
@example({6: 400, 66: 1000}, ("ArduPilot", 1201), False)
@example({2: 400, 54: 1000}, ("ArduPilot", 1201), False)
@example({2: 400, 54: 1000}, ("ArduPilot", UNKNOWN), True)
def test_the_fence_of_ardupilot_is_beyond_no_obstacle_whatever_is_beside_it(
    nearest_cm: dict[int, int], case: tuple[str, int], points: bool
) -> None:
    """The fence of a face is moved outwards by a face that is read later, where the one between them is empty: obstacles at 30
    degrees on the right, 4 m away, and on the left, 10 m away, made a fence that is 7.6 m away at 30 degrees."""
    autopilot, elsewhere = case
    values = np.full(SECTORS, elsewhere, np.uint16)
    values[list(nearest_cm)] = list(nearest_cm.values())
    sent = for_reader(values, AVOID, autopilot, wall_cm=302)
    reader = ArduPilotReader(backs_up=False)
    if points:
        layers = ArduPilotLayers(reader)
        for k in range(2):
            for message in obstacle_points_messages(level_points(sent, AVOID), 1000 + k, AVOID):
                layers.read(message, NS)
    else:
        reader.read(obstacle_distance_message(sent, 0, AVOID), NS)
    for sector, cm in nearest_cm.items():
        assert reader.room_m(5.0 * sector, NS) <= cm / 100.0 - reader.margin_m + 1e-6


@pytest.mark.parametrize("points", [False, True])
def test_both_corners_of_a_face_are_as_near_as_its_obstacle_whatever_is_in_the_others(points: bool) -> None:
    """Each face nothing, near or far, and the front face in its two halves."""
    parts = (0, 5, 14, 23, 32, 41, 50, 59, 68)  # an element of each
    for cm in list(product((1201, 200, 900), repeat=9))[:: 11 if points else 5]:
        values = np.full(SECTORS, clear_cm(AVOID), np.uint16)
        values[list(parts)] = cm
        reader = ArduPilotReader()
        sent = for_reader(values, AVOID, "ArduPilot")
        if points:
            nearest = [int(sent[face == FACE].min()) for face in range(8)]
            reader.take_faces([m / 100.0 if m < clear_cm(AVOID) else math.inf for m in nearest], NS)
        else:
            reader.read(obstacle_distance_message(sent, 0, AVOID), NS)
        nearest_cm = [min(cm[0], cm[8]), *cm[1:8]]
        for line in reader.fence(NS):
            face = face_of(math.degrees(math.atan2(*reversed(line[0]))) + 22.5)  # clockwise of its first corner
            corners_m = [math.hypot(*corner) for corner in line]
            assert nearest_cm[face] > 1200 or max(corners_m) <= nearest_cm[face] / 100.0 + 1e-6, (cm, face)


@pytest.mark.parametrize(
    ("autopilot", "wall_cm", "filled"),
    [
        ("ArduPilot", 302, 1199),
        ("autopilot 8", 302, 302),
        ("ArduPilot or PX4", 302, 302),
        ("ArduPilot or PX4", 0, UNKNOWN),
        ("ArduPilot or PX4", 2000, 1199),  # farther it would mean clear
        ("PX4", 302, UNKNOWN),
    ],
)
def test_an_unknown_sector_gets_no_value_by_which_px4_moves_into_it(autopilot: str, wall_cm: int, filled: int) -> None:
    """PX4 moves into a sector with a value that is farther than the artificial wall; what another kind does is not known."""
    values = np.full(SECTORS, UNKNOWN, np.uint16)
    values[[2, 54]] = 400, 1000
    sent = for_reader(values, AVOID, autopilot, wall_cm=wall_cm)[[face_of(5.0 * i) == 7 for i in range(SECTORS)]]
    assert sent.min() == filled
    assert (sent != UNKNOWN).sum() == (filled != UNKNOWN)


@given(st.lists(st.sampled_from([150, 777, 1199, 1201, UNKNOWN, UNKNOWN]), min_size=SECTORS, max_size=SECTORS))
@example([UNKNOWN] + 4 * [777] + 63 * [UNKNOWN] + 4 * [150])
def test_what_is_unknown_stays_unknown_to_an_autopilot_that_may_be_px4(cm: list[int]) -> None:
    """The nearest distance of the front face is put into its other part for ArduPilot."""
    values = np.array(cm, np.uint16)
    unknown = for_coarse_bins(values, clear_cm(AVOID), only_near(clear_cm(AVOID))) == UNKNOWN
    for autopilot in ("ArduPilot or PX4", "autopilot 8"):
        assert (for_reader(values, AVOID, autopilot)[unknown] == UNKNOWN).all()


def test_a_clear_field_stops_no_vehicle_and_an_unseen_one_stops_px4() -> None:
    for bin_deg in (5, 10):
        px4 = Px4Reader(bin_deg)
        px4.read(message_of(scan([View(model(free_to_m=13.0), HERE)], AVOID)), NS)
        assert all(px4.room_m(d, NS) == math.inf for d in range(360))
        px4 = Px4Reader(bin_deg)
        px4.read(message_of(scan([View(model(free_to_m=13.0, view_deg=80.0), HERE)], AVOID)), NS)
        assert px4.room_m(0.0, NS) == math.inf
        assert px4.room_m(180.0, NS) == 0.0
    for one_pass in (False, True):
        ardupilot = ArduPilotReader(one_pass=one_pass)
        ardupilot.read(message_of(scan([View(model(free_to_m=13.0), HERE)], AVOID)), NS)
        assert ardupilot.healthy(NS)
        assert all(ardupilot.room_m(d, NS) == math.inf for d in range(360))
        assert ardupilot.velocity_m_s((3.0, -2.0), NS) == (3.0, -2.0)


@pytest.mark.parametrize("bin_deg", [5, 10])
def test_no_direction_of_an_unseen_sector_has_a_bin_with_data(bin_deg: int) -> None:
    policy, nowhere, everywhere = policy_of(AVOID, PX4_NOW), np.zeros(SECTORS, bool), np.ones(SECTORS, bool)
    for unseen in range(SECTORS):
        found = scan([View(model(free_to_m=13.0), HERE)], AVOID)
        found.state[unseen] = SectorState.UNSEEN
        sight = PolicyInput(found, nothing_remembered(), nowhere, everywhere, everywhere, 0)
        values = BlindPolicy(AVOID).values(sight, policy, 0)
        assert values is not None
        px4 = Px4Reader(bin_deg)
        px4.read(obstacle_distance_message(for_reader(values, AVOID, "PX4"), 0, AVOID), NS)
        for direction_deg in 5.0 * unseen + np.linspace(-2.4, 2.4, 9):
            assert px4.room_m(float(direction_deg), NS) == 0.0, (unseen, direction_deg)
        assert px4.room_m(5.0 * unseen + 180.0, NS) == math.inf


def test_clear_beside_unknown_is_not_clear_in_the_coarse_bins() -> None:
    values = np.full(SECTORS, clear_cm(AVOID), np.uint16)
    values[11] = UNKNOWN
    out = for_coarse_bins(values, clear_cm(AVOID), only_near(600))
    assert out[10] == out[12] == UNKNOWN
    assert out[14] == clear_cm(AVOID)
    values[11], values[12] = 500, UNKNOWN
    out = for_coarse_bins(values, clear_cm(AVOID), only_near(600))
    assert (out[10], out[12]) == (500, 500)  # a near obstacle outranks what was not seen


def test_a_sector_is_free_as_far_as_most_of_its_rays() -> None:
    """The lowest of three layers is free for 4 m only."""
    whole = model(free_to_m=13.0)
    free_to_m = np.array(whole.free.free_to_m)
    free_to_m[:, 2] = 4.0
    edges = np.array([-3.0, -0.3, 0.3, 3.0], np.float32)
    found = replace(whole, free=replace(whole.free, free_to_m=free_to_m, layer_edges_m=edges))
    assert scan([View(found, HERE)], AVOID).free_m.max() < 4.5


@pytest.mark.parametrize(("height_m", "clear"), [(0.75, False), (1.5, True)])
def test_no_sector_is_clear_while_the_ground_below_is_in_the_band(height_m: float, clear: bool) -> None:
    """Most of the heights of the band are free."""
    found = replace(model(free_to_m=13.0), ground=Ground(seen=True, height_m=height_m))
    assert (scan([View(found, HERE)], AVOID).state == SectorState.CLEAR).all() == clear


def test_beside_unknown_an_obstacle_that_must_be_braked_for_is_sent_at_the_wall() -> None:
    """PX4 moves into a sector by a farther value."""
    values = np.full(SECTORS, clear_cm(AVOID), np.uint16)
    values[11], values[12] = 500, UNKNOWN
    reach = BrakingReach(np.full(SECTORS, 100.0), np.full(SECTORS, 600.0), wall_cm=302)
    assert for_coarse_bins(values, clear_cm(AVOID), reach)[12] == 302
    values[11] = 200
    assert for_coarse_bins(values, clear_cm(AVOID), reach)[12] == 200


def test_an_obstacle_is_sent_inside_of_the_range_that_both_autopilots_use() -> None:
    """Of other values ArduPilot uses none, and a value above the range means clear."""
    assert near_cm(np.array([0.0, 0.215, 11.999, 50.0]), AVOID).tolist() == [21, 21, 1199, 1199]


def test_golden_vectors() -> None:
    """Numbers written down once: what is on the wire must not drift with the code that makes it."""
    state = np.array([SectorState.UNSEEN] * SECTORS, np.uint8)
    state[0:4] = SectorState.CLEAR
    state[4:8] = SectorState.OBSTACLE
    distance = np.full(SECTORS, np.inf)
    distance[4:8] = (0.0, 5.239, 11.9999, 11.0)
    message = message_of(
        SectorScan(state, distance, np.zeros(SECTORS), np.zeros(SECTORS), np.zeros((SECTORS, 1, 1), np.bool_))
    )
    fields = message.to_dict()
    assert fields["distances"][:9] == [UNKNOWN, 1201, 1201, 1201, 21, 523, 523, 1100, 1100]
    assert set(fields["distances"][9:]) == {UNKNOWN}
    kept = ("sensor_type", "increment", "min_distance", "max_distance", "increment_f", "angle_offset", "frame")
    assert [fields[k] for k in kept] == [4, 5, 20, 1200, 5.0, 0.0, 12]
