"""Where and how large reports of neighbours are in the own frame, how old they are, and when they expire."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.sharing.neighbour import NS, OLDEST_S
from core.sharing.neighbour_map import GROWTH_M_S2, NeighbourMap, OwnState, own_frame
from core.sharing.obstacles import MoverKind, PlacementState, SharedMovingObstacle
from core.sharing.packet_codec import movers_packet, planes_packet, state_packet
from core.sharing.params import SharingParams
from core.sharing.records import Header, SharedMover, SharedPlanes, VehicleState

from .neighbours import FRAME, OWN, STREAM, filled_map, header, mover, state, state_at, wall, wall_packet

ORIGIN = (0.0, 0.0, 0.0)


def plane(*box: float, number: int = 0, age_s: float = 0.1) -> SharedPlanes:
    return SharedPlanes(
        ids=np.array([number], np.uint16),
        box=np.array([box], np.float64),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([age_s]),
    )


def received(content: SharedPlanes | tuple[SharedMover, ...], frame_state: VehicleState | None = None) -> NeighbourMap:
    """A map with these reports of one neighbour, sent and received at 1 s."""
    found = NeighbourMap(1)
    assert found.receive(state_packet(header(999), frame_state or state()), NS) == ""
    head = header(1000)
    data = movers_packet(head, content, ORIGIN) if isinstance(content, tuple) else planes_packet(head, content, ORIGIN)
    assert found.receive(data, NS) == ""
    return found


def moving(found: NeighbourMap, now_ns: int, own: OwnState = OWN) -> list[SharedMovingObstacle]:
    return [m for m in found.obstacles(own, now_ns).movers if m.kind is MoverKind.OBSTACLE]


# ---- time ------------------------------------------------------------------------------------------------------------------


def test_a_sender_that_begins_again_in_the_same_stream_is_accepted_after_ten_seconds_of_silence() -> None:
    """A computer without a clock of its own may state the same time at two starts."""
    found = filled_map()
    found.receive(wall_packet(60_000), 61 * NS)
    assert found.receive(wall_packet(5, number=1), 70 * NS) == "replayed"
    assert found.receive(wall_packet(5, number=1), 72 * NS) == ""
    assert found.receive(state_at(6), 72 * NS + 10**6) == ""
    assert found.receive(wall_packet(1005, number=2), 73 * NS) == ""
    ages = dict(zip(*_ids_and_ages(found, 73 * NS), strict=True))
    assert ages[2] <= 0.3


@pytest.mark.parametrize("difference", [-9e-4, 1e-4, 9e-4])
def test_clocks_of_different_rates_delay_nothing(difference: float) -> None:
    """Time synchronisation changes the rate of each by up to 5e-4."""
    found = NeighbourMap(1)
    for k in range(6000):
        assert found.receive(state_at(5000 * k), round(5 * NS * k * (1.0 + difference))) == ""
    assert found.obstacles(OWN, round(5 * NS * 5999 * (1.0 + difference))).neighbours[0].silent_s == 0.0


def test_the_age_counts_from_the_fastest_packet_not_from_the_first() -> None:
    found = NeighbourMap(1)
    found.receive(state_at(0), NS + 3 * NS // 2)  # 1.5 s on its way
    found.receive(wall_packet(2000, number=1), 3 * NS)
    found.receive(wall_packet(4000, number=2), 5 * NS + 3 * NS // 2)
    ages = dict(zip(*_ids_and_ages(found, 5 * NS + 3 * NS // 2), strict=True))
    assert ages[2] == pytest.approx(1.6, abs=0.2)
    assert found.receive(wall_packet(5000, number=3), 8 * NS + NS // 10) == "delayed"


def _ids_and_ages(found: NeighbourMap, now_ns: int) -> tuple[list[int], list[float]]:
    got = found.obstacles(OWN, now_ns)
    return got.ids.tolist(), got.age_s.tolist()


def test_an_old_plane_that_is_repeated_does_not_expire() -> None:
    found = received(plane(10, -4, 10, 4, -6, 0, age_s=math.inf))
    got = found.obstacles(OWN, 30 * NS)
    assert got.age_s.tolist() == [pytest.approx(OLDEST_S + 29.0)]
    assert len(found.obstacles(OWN, 62 * NS).sender) == 0


def test_a_mover_expires_by_its_observation() -> None:
    found = received((replace(mover(45.0), age_s=1.5),))
    assert len(moving(found, NS + 4 * NS // 10)) == 1
    assert moving(found, NS + 6 * NS // 10) == []


# ---- place and size --------------------------------------------------------------------------------------------------------


def test_margin_and_height_of_a_plane_contain_the_errors_of_its_place() -> None:
    """The end that is farther from the neighbour counts: its heading is wrong by 0.01 rad."""
    found = received(plane(30.0, 0.0, 50.0, 0.0, -6.0, 0.0))
    got = found.obstacles(OWN, NS)
    z_m = 2.0 * math.hypot(0.2, 0.2)
    sigma_m = math.hypot(math.hypot(0.2, 0.2), 20.0 * math.hypot(0.01, 0.01))
    assert got.margin_m[0] == pytest.approx(0.15 + 2.0 * sigma_m, abs=0.01)
    assert got.planes[0, 4:].tolist() == pytest.approx([-6.0 - z_m, z_m], abs=0.01)


def test_a_plane_that_is_too_far_from_its_sender_is_withheld() -> None:
    vague = state(30.0, replace(FRAME, sigma_yaw_rad=0.05))
    near, far = plane(40, 0, 40, 5, -6, 0), plane(200, 0, 200, 5, -6, 0, number=1)
    found = received(near, vague)
    found.receive(planes_packet(header(1001), far, ORIGIN), NS)
    got = found.obstacles(OWN, NS)
    assert got.ids.tolist() == [0]
    assert (got.neighbours[0].planes, got.neighbours[0].withheld) == (1, 1)
    assert got.neighbours[0].placement is PlacementState.BY_POSITION


def test_a_mover_in_a_turned_frame() -> None:
    """The neighbour's x axis points east: its (x, y) is (-y, x) here."""
    turned = state(30.0, replace(FRAME, yaw_rad=math.pi / 2))
    one = replace(mover(40.0, 10.0), half_size_m=(2.0, 0.5, 0.3), velocity_m_s=(2.0, 0.0))
    (got,) = moving(received((one,), turned), NS + NS // 2)
    assert got.centre_m == pytest.approx((-10.0, 41.0, -3.0), abs=0.03)
    assert got.velocity_m_s == pytest.approx((0.0, 2.0), abs=0.01)
    assert got.half_size_m == pytest.approx((0.6, 2.1, 0.4 + 2.0 * math.hypot(0.2, 0.2)), abs=0.02)


def test_the_margin_of_a_mover_contains_its_errors_and_grows() -> None:
    found = received((mover(45.0),))
    sigma_m = math.hypot(0.1, math.hypot(math.hypot(0.2, 0.2), 15.0 * math.hypot(0.01, 0.01)))
    for age_s in (0.0, 1.0, 1.5):
        (got,) = moving(found, NS + round(age_s * NS))
        grown_m = 2.0 * 0.3 * age_s + 0.5 * GROWTH_M_S2 * age_s**2  # 0.1 m/s, and half a step of the velocity
        assert got.margin_m == pytest.approx(2.0 * sigma_m + grown_m, abs=0.03)


# ---- bodies ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x_m", "z_m", "hidden"), [(2.6, -3.0, True), (2.8, -3.0, False), (0.0, -5.9, True), (0.0, -6.1, False)]
)
def test_the_own_body_hides_what_is_near_it_only(x_m: float, z_m: float, hidden: bool) -> None:
    """With metres of uncertainty the distance to its end is limited to the radius and 3 m."""
    vague = replace(FRAME, sigma_m=2.5, sigma_z_m=4.0)
    assert OWN.state is not None
    own = replace(OWN, state=replace(OWN.state, frame=vague))
    found = received((replace(mover(x_m, speed_m_s=0.0), centre_m=(x_m, 0.0, z_m)),), state(30.0, vague))
    assert (moving(found, NS, own) == []) is hidden


@pytest.mark.parametrize(("off_z_m", "hidden"), [(0.5, True), (0.7, False), (-0.5, True), (-0.7, False)])
def test_the_own_body_hides_what_is_within_two_sigma_of_its_height(off_z_m: float, hidden: bool) -> None:
    """The report is 0.4 m high in each direction, as is the vehicle; the heights of both frames are certain to 0.2 m."""
    found = received((replace(mover(0.0, speed_m_s=0.0), centre_m=(0.0, 0.0, -3.0 + off_z_m)),))
    assert (moving(found, NS, OWN) == []) is hidden


def test_a_claimed_radius_hides_nothing_at_a_distance() -> None:
    found = received((mover(45.0, speed_m_s=0.0),))
    huge = VehicleState(frame=FRAME, position_m=(50.5, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=25.5)
    found.receive(state_packet(header(10, vehicle=3), huge), NS)
    assert len(moving(found, NS)) == 1


# ---- the table of neighbours -----------------------------------------------------------------------------------------------


def test_a_new_vehicle_takes_the_place_of_the_one_that_is_silent_longest() -> None:
    found = NeighbourMap(1, SharingParams(most_neighbours=2))
    for vehicle in (2, 3):
        found.receive(state_at(0, vehicle=vehicle), NS)
    found.receive(state_at(40_000, vehicle=2), 41 * NS)
    assert found.receive(state_at(0, vehicle=4), 60 * NS) == "too_many_neighbours"
    assert found.receive(state_at(0, vehicle=4), 62 * NS) == ""
    assert [n.vehicle for n in found.obstacles(OWN, 62 * NS).neighbours] == [2, 4]


def test_a_later_start_of_the_sender_keeps_what_it_reported_before() -> None:
    found = filled_map()
    later = Header(vehicle=2, stream=STREAM + 30, sent_ms=1, section=0)
    assert found.receive(state_packet(later, state()), 2 * NS) == ""
    assert found.receive(planes_packet(replace(later, sent_ms=2), wall(3), ORIGIN), 2 * NS) == ""
    assert sorted(found.obstacles(OWN, 2 * NS).ids.tolist()) == [0, 3]
    assert found.receive(wall_packet(5000, number=4), 3 * NS) == "old_stream"


def test_the_own_frame_has_the_configured_errors() -> None:
    """Margins of what neighbours report contain them."""
    errors = SharingParams(position_sigma_m=1.25, height_sigma_m=3.5, heading_sigma_deg=6.0)
    frame = own_frame(errors, 47.0, 8.0, 400.0)
    assert (frame.latitude_deg, frame.longitude_deg, frame.altitude_m, frame.yaw_rad) == (47.0, 8.0, 400.0, 0.0)
    assert (frame.sigma_m, frame.sigma_z_m, math.degrees(frame.sigma_yaw_rad)) == pytest.approx((1.25, 3.5, 6.0))


def test_a_vehicle_placed_by_positions_alone_is_not_aligned() -> None:
    """Obstacles at its place are sent all the same: they may be something else."""
    found = filled_map().bodies(OWN, NS)
    assert [(body.vehicle, body.is_own, body.is_aligned) for body in found] == [(1, True, False), (2, False, False)]
