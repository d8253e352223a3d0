"""The map of neighbours: what counts, what is refused, and that it only adds."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.sharing.neighbour import MOST_MOVERS, NS
from core.sharing.neighbour_map import NeighbourMap, OwnState
from core.sharing.obstacles import MoverKind, PlacementState, SharedObstacles
from core.sharing.packet_codec import MOST_BYTES, OVERHEAD_BYTES, movers_packet, planes_packet, state_packet
from core.sharing.params import SharingParams
from core.sharing.plane_codec import LONG
from core.sharing.records import LocalFrame, SharedMover, SharedPlanes, VehicleState

from .neighbours import FRAME, OWN, STREAM, filled_map, header, mover, state, state_at, wall, wall_packet


def test_a_wall_of_a_neighbour_stands_in_the_own_frame_with_its_age() -> None:
    got = filled_map().obstacles(OWN, 3 * NS)
    assert got.planes[0, :4] == pytest.approx([10, -4, 10, 4], abs=0.05)
    assert got.sender.tolist() == [2]
    assert 2.0 <= got.age_s[0] <= 2.3
    # 2 sigma of both positions, and of the heading over the distance to the neighbour
    sigma_m = math.hypot(math.hypot(0.2, 0.2), 20.4 * math.hypot(0.01, 0.01))
    assert got.margin_m[0] == pytest.approx(0.15 + 2 * sigma_m, abs=0.02)
    assert got.neighbours[0].placement is PlacementState.BY_POSITION


def test_it_expires_unless_it_is_repeated() -> None:
    found = filled_map()
    assert len(found.obstacles(OWN, 60 * NS).sender) == 1
    found.receive(wall_packet(59_000), 60 * NS)
    assert len(found.obstacles(OWN, 100 * NS).sender) == 1
    assert len(found.obstacles(OWN, 121 * NS).sender) == 0
    assert found.obstacles(OWN, 121 * NS).movers == ()


def test_a_plane_without_a_known_place_is_not_published() -> None:
    found = NeighbourMap(1)
    found.receive(wall_packet(1), NS)
    got = found.obstacles(OWN, NS)
    assert len(got.sender) == 0
    assert got.neighbours[0].placement is PlacementState.UNKNOWN
    nowhere = OwnState(state=None, section=1)
    assert len(filled_map().obstacles(nowhere, 2 * NS).sender) == 0


def test_a_neighbour_that_has_not_reported_its_frame_is_not_aligned() -> None:
    found = NeighbourMap(1)
    found.receive(wall_packet(1), NS)
    found.align(wall().box, OWN, 2 * NS)
    assert found.obstacles(OWN, 2 * NS).neighbours[0].placement is PlacementState.UNKNOWN


def test_an_uncertain_place_is_withheld() -> None:
    vague = LocalFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_m=488.0, sigma_m=8.0)
    found = NeighbourMap(1)
    found.receive(state_packet(header(0), state(frame=vague)), NS)
    found.receive(wall_packet(1), NS)
    found.receive(movers_packet(header(2), (mover(45.0),), (0.0, 0.0, 0.0)), NS)
    got = found.obstacles(OWN, NS)
    assert (len(got.sender), got.movers) == (0, ())
    assert got.neighbours[0].placement is PlacementState.WITHHELD


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"", "bad_length"),
        (b"\x00" * 40, "other_version"),
        (wall_packet(1), "replayed"),
        (wall_packet(0), "replayed"),
        (wall_packet(5000, stream=STREAM - 1), "old_stream"),
        (wall_packet(5, vehicle=1), "same_number"),
        (wall_packet(5, vehicle=0), "bad_vehicle"),
        (wall_packet(5, vehicle=9), "sender_mismatch"),
        (wall_packet(20, number=7)[:-3], "bad_length"),
    ],
)
def test_a_packet_that_must_not_count_changes_nothing(data: bytes, code: str) -> None:
    found, untouched = filled_map(), filled_map()
    assert found.receive(data, 5 * NS, sender=2 if code != "same_number" else None) == code
    assert same(found.obstacles(OWN, 6 * NS), untouched.obstacles(OWN, 6 * NS))
    assert found.counts[code] == 1


def test_a_vehicle_with_the_own_number_is_refused_by_another_code_than_an_echo() -> None:
    """Also if it has started in the same second, and so has the same stream."""
    found, own = NeighbourMap(1), wall_packet(5, vehicle=1)
    found.note_sent([own])
    assert found.receive(own, NS) == "own_packet"
    assert found.same_number_ns is None
    assert found.receive(wall_packet(6, vehicle=1), 2 * NS) == "same_number"
    assert found.same_number_ns == 2 * NS
    assert len(found.obstacles(OWN, 2 * NS).sender) == 0


def test_a_packet_that_is_longer_than_any_link_sends_is_refused_undecoded() -> None:
    walls = SharedPlanes(
        ids=np.arange(300, dtype=np.uint16),
        box=np.tile(wall().box, (300, 1)),
        margin_m=np.full(300, 0.1),
        flags=np.zeros(300, np.uint8),
        age_s=np.full(300, 0.1),
    )
    data = planes_packet(header(5), walls, (0.0, 0.0, 0.0))
    assert len(data) > MOST_BYTES
    assert NeighbourMap(1).receive(data, NS) == "bad_length"
    most = (MOST_BYTES - OVERHEAD_BYTES) // LONG.bytes
    assert NeighbourMap(1).receive(data[: OVERHEAD_BYTES + most * LONG.bytes], NS) == ""


def test_other_vehicles_and_too_many_vehicles_are_refused() -> None:
    found = NeighbourMap(1, members=frozenset({2, 3}))
    assert found.receive(wall_packet(1, vehicle=4), NS) == "unknown_sender"
    small = NeighbourMap(1, SharingParams(most_neighbours=2))
    codes = [small.receive(wall_packet(1, vehicle=v), NS) for v in (2, 3, 4)]
    assert codes == ["", "", "too_many_neighbours"]
    assert small.receive(wall_packet(1, vehicle=4), 100 * NS) == ""


def test_a_delayed_packet_is_older_and_a_late_one_is_refused() -> None:
    found = filled_map()
    found.receive(wall_packet(1000, number=1), NS + 1_000_000_000 + 1_500_000_000)
    got = found.obstacles(OWN, 4 * NS)
    age_s = dict(zip(got.ids.tolist(), got.age_s.tolist(), strict=True))
    assert age_s[1] == pytest.approx(0.1 + 0.5 + 1.5, abs=0.1)
    assert found.receive(wall_packet(2000, number=2), 9 * NS) == "delayed"


def test_planes_of_a_frame_that_was_left_stay_at_their_place_until_they_expire() -> None:
    found = filled_map()
    found.receive(planes_packet(header(50, section=1), wall(3), (0.0, 0.0, 0.0)), 2 * NS)
    assert found.obstacles(OWN, 2 * NS).ids.tolist() == [0]  # the place of the new frame is not known before its state
    found.receive(state_packet(header(60, section=1), state()), 2 * NS)
    assert sorted(found.obstacles(OWN, 2 * NS).ids.tolist()) == [0, 3]
    assert found.obstacles(OWN, 61 * NS + NS // 2).ids.tolist() == [3]


def test_without_an_own_position_nothing_of_any_frame_is_published() -> None:
    found = filled_map()
    found.receive(state_packet(header(50, section=1), state()), 2 * NS)
    found.receive(planes_packet(header(51, section=1), wall(3), (0.0, 0.0, 0.0)), 2 * NS)
    got = found.obstacles(replace(OWN, state=None), 2 * NS)
    assert (len(got.sender), got.movers, got.neighbours[0].withheld) == (0, (), 2)
    assert len(found.obstacles(OWN, 2 * NS).sender) == 2


def test_of_too_many_planes_those_that_were_repeated_are_kept() -> None:
    found = NeighbourMap(1, SharingParams(most_planes=64))
    found.receive(state_at(0), NS)
    for k, number in enumerate((*range(64), 0, 64)):
        assert found.receive(wall_packet(1 + k, number=number), NS + k) == ""
    assert sorted(found.obstacles(OWN, NS + 100).ids.tolist()) == [0, *range(2, 65)]


def test_changes_of_frames_clear_nothing() -> None:
    found = filled_map()
    for k in range(40):
        found.receive(planes_packet(header(50 + 2 * k, section=k + 1), wall(9), (0.0, 0.0, 0.0)), 2 * NS)
        found.receive(state_packet(header(51 + 2 * k, section=k + 1), state()), 2 * NS)
    assert 0 in found.obstacles(OWN, 2 * NS).ids.tolist()
    assert found.counts["too_many_frames"] > 0


def test_a_time_far_ahead_is_refused_and_does_not_block() -> None:
    found = filled_map()
    assert found.receive(wall_packet(1_000_000_000, number=5), 2 * NS) == "ahead"
    assert found.receive(wall_packet(1000, number=6), 2 * NS) == ""
    found.receive(wall_packet(5, number=7, stream=0xFFFFFFFF), 3 * NS)
    assert found.receive(wall_packet(2000, number=8), 4 * NS) == "old_stream"
    assert found.receive(wall_packet(20_000, number=8), 20 * NS) == ""


def test_a_claimed_radius_hides_no_other_obstacle() -> None:
    found = filled_map()
    huge = VehicleState(frame=FRAME, position_m=(12.0, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=25.5)
    found.receive(state_packet(header(10, vehicle=3), huge), 2 * NS)
    assert 0 in found.obstacles(OWN, 2 * NS).ids.tolist()


@pytest.mark.parametrize(("length_m", "height_m"), [(4.5, 1.0), (1.0, 4.5)])
def test_a_claimed_radius_hides_nothing_larger_than_a_vehicle(length_m: float, height_m: float) -> None:
    found = filled_map()
    y, z = 0.5 * length_m, 0.5 * height_m
    row = SharedPlanes(
        ids=np.array([7], np.uint16),
        box=np.array([[12.0, -y, 12.0, y, -3.0 - z, -3.0 + z]]),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([0.1]),
    )
    moving = replace(mover(12.0), half_size_m=(0.2, y, z))
    found.receive(planes_packet(header(3), row, (0.0, 0.0, 0.0)), 2 * NS)
    found.receive(movers_packet(header(2000), (moving,), (0.0, 0.0, 0.0)), 2 * NS)
    huge = VehicleState(frame=FRAME, position_m=(12.0, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=25.5)
    found.receive(state_packet(header(10, vehicle=3), huge), 2 * NS)
    got = found.obstacles(OWN, 2 * NS)
    assert 7 in got.ids.tolist()
    assert MoverKind.OBSTACLE in [m.kind for m in got.movers]


def test_the_bodies_of_the_team_are_one_obstacle_each() -> None:
    found = filled_map()  # vehicle 2 is at x = 30
    found.receive(state_packet(header(10, vehicle=3), state(60.0)), 2 * NS)
    reports = (
        mover(30.5, speed_m_s=0.0),
        mover(0.3, speed_m_s=0.0),
    )  # vehicle 3 observes vehicle 2 and the own vehicle
    for k, one in enumerate(reports):
        found.receive(movers_packet(header(20 + k, vehicle=3), (one,), (0.0, 0.0, 0.0)), 2 * NS)
        got = found.obstacles(OWN, 2 * NS).movers
        assert sorted((m.sender, m.kind) for m in got) == [(2, MoverKind.VEHICLE), (3, MoverKind.VEHICLE)]
    found.receive(movers_packet(header(30, vehicle=3), (mover(45.0),), (0.0, 0.0, 0.0)), 2 * NS)
    assert [m.kind for m in found.obstacles(OWN, 2 * NS).movers].count(MoverKind.OBSTACLE) == 1


def test_the_own_body_is_recognised_with_the_default_errors_of_the_positions() -> None:
    vague = replace(FRAME, sigma_m=1.5, sigma_z_m=2.0, sigma_yaw_rad=0.035)
    assert OWN.state is not None
    own = replace(OWN, state=replace(OWN.state, frame=vague))
    found = NeighbourMap(1)
    found.receive(state_packet(header(1), state(frame=vague)), NS)
    found.receive(movers_packet(header(2), (mover(1.5, speed_m_s=0.0),), (0.0, 0.0, 0.0)), NS)
    assert [m.kind for m in found.obstacles(own, NS).movers] == [MoverKind.VEHICLE]


def test_a_plane_at_the_own_body_is_hidden_while_it_is_there() -> None:
    small = SharedPlanes(
        ids=np.array([5], np.uint16),
        box=np.array([[0.3, -0.3, 0.3, 0.3, -3.3, -2.8]]),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([0.1]),
    )
    found = filled_map()
    found.receive(planes_packet(header(9), small, (0.0, 0.0, 0.0)), 2 * NS)
    assert found.obstacles(OWN, 2 * NS).ids.tolist() == [0]
    assert OWN.state is not None
    away = OwnState(
        state=VehicleState(frame=FRAME, position_m=(-50.0, 0, -3), velocity_m_s=(0, 0, 0), radius_m=0.4), section=1
    )
    assert found.obstacles(away, 3 * NS).ids.tolist() == [0, 5]


def test_a_mover_is_carried_on_and_grows() -> None:
    found = filled_map()
    found.receive(movers_packet(header(20), (mover(45.0),), (0.0, 0.0, 0.0)), 2 * NS)
    early, late = (
        next(m for m in found.obstacles(OWN, t).movers if m.kind is MoverKind.OBSTACLE) for t in (2 * NS, 3 * NS)
    )
    assert late.centre_m[0] - early.centre_m[0] == pytest.approx(1.0, abs=0.02)
    assert late.margin_m > early.margin_m + 0.5
    assert all(m.kind is not MoverKind.OBSTACLE for m in found.obstacles(OWN, 5 * NS).movers)


def test_a_mover_reported_before_a_jump_stays_at_its_place_until_it_expires() -> None:
    """The neighbour's local frame moves 50 m north: its next positions are 50 m less."""
    found = filled_map()
    found.receive(movers_packet(header(1000), (mover(45.0),), (0.0, 0.0, 0.0)), 2 * NS)
    moved = replace(FRAME, latitude_deg=FRAME.latitude_deg + 50.0 / 111_180.0)
    found.receive(state_packet(header(1001, section=1), state(-20.0, moved)), 2 * NS)
    places = [m.centre_m[0] for m in found.obstacles(OWN, 2 * NS).movers if m.kind is MoverKind.OBSTACLE]
    assert places == [pytest.approx(45.0, abs=0.1)]
    found.receive(movers_packet(header(1002, section=1), (mover(-5.0),), (0.0, 0.0, 0.0)), 2 * NS)
    places = [m.centre_m[0] for m in found.obstacles(OWN, 2 * NS).movers if m.kind is MoverKind.OBSTACLE]
    assert places == [pytest.approx(45.0, abs=0.2)] * 2
    assert found.obstacles(OWN, 5 * NS).movers == ()


def test_changes_of_the_origin_within_a_section_are_bounded_and_clear_nothing() -> None:
    found = filled_map()
    for k in range(40):
        moved = replace(FRAME, altitude_m=400.0 + k)
        found.receive(state_packet(header(50 + 2 * k), state(frame=moved)), 2 * NS)
        found.receive(planes_packet(header(51 + 2 * k), wall(9), (0.0, 0.0, 0.0)), 2 * NS)
    got = found.obstacles(OWN, 2 * NS)
    assert 0 in got.ids.tolist()
    assert found.counts["too_many_frames"] > 0
    assert len(got.sender) <= 10


def test_planes_of_all_frames_of_a_neighbour_are_bounded_together() -> None:
    """Those of the oldest frame are dropped first."""
    found = NeighbourMap(1, SharingParams(most_planes=64))
    for section in range(6):
        begin_ms = 1000 * (section + 1)
        assert found.receive(state_packet(header(begin_ms, section=section), state()), 2 * NS) == ""
        for k in range(40):
            packet = wall_packet(begin_ms + 1 + k, number=100 * section + k, section=section)
            assert found.receive(packet, 2 * NS) == ""
    got = sorted(found.obstacles(OWN, 2 * NS).ids.tolist())
    assert got == [*range(416, 440), *range(500, 540)]


def test_planes_and_movers_of_one_neighbour_are_bounded() -> None:
    found = NeighbourMap(1, SharingParams(most_planes=64))
    found.receive(state_at(0), NS)
    for k in range(300):
        at_ns = NS + 1000 * (k + 1)
        some = tuple(replace(mover(100.0 + k), id=7 * k + n) for n in range(7))
        assert found.receive(movers_packet(header(1 + 2 * k), some, (128.0, 0.0, 0.0)), at_ns) == ""
        assert found.receive(wall_packet(2 + 2 * k, number=k), at_ns) == ""
    got = found.obstacles(OWN, NS + 10**6)
    assert sorted(got.ids.tolist()) == list(range(300 - 64, 300))
    movers = {m.id for m in got.movers if m.kind is MoverKind.OBSTACLE}
    assert len(movers) == MOST_MOVERS
    assert movers >= set(range(7 * 299, 7 * 300))  # the newest


# ---- the rule of safety ----------------------------------------------------------------------------------------------------


def test_messages_of_neighbours_contain_no_free_space() -> None:
    names = {f.name for kind in (SharedObstacles, SharedPlanes, SharedMover, VehicleState) for f in fields(kind)}
    assert not any("free" in name or "open" in name or "clear" in name for name in names)


packets = st.one_of(
    st.binary(max_size=140),
    st.builds(
        wall_packet, st.integers(0, 60_000), st.integers(0, 65_535), vehicle=st.integers(1, 5), stream=st.integers(0, 9)
    ),
    st.builds(
        state_at, st.integers(0, 60_000), vehicle=st.integers(1, 5), stream=st.integers(0, 9), section=st.integers(0, 3)
    ),
)


@given(st.lists(st.tuples(packets, st.integers(0, 70 * NS)), max_size=30))
def test_no_sequence_of_packets_breaks_the_map(sequence: list[tuple[bytes, int]]) -> None:
    found = NeighbourMap(1)
    for data, at_ns in sorted(sequence, key=lambda item: item[1]):
        found.receive(data, at_ns)
    got = found.obstacles(OWN, 70 * NS)
    assert np.isfinite(got.planes).all()
    assert (got.margin_m >= 0.0).all()
    assert (got.age_s >= 0.0).all()
    assert sum(found.counts.values()) == len(sequence)


def same(a: SharedObstacles, b: SharedObstacles) -> bool:
    """Whether two snapshots hold the same obstacles; counters aside."""
    return a.movers == b.movers and all(
        _equal(getattr(a, n), getattr(b, n)) for n in ("sender", "ids", "planes", "age_s")
    )


def _equal(a: NDArray[np.float32], b: NDArray[np.float32]) -> bool:
    return a.shape == b.shape and bool((a == b).all())
