"""Reports of neighbours that must not hide other reports or count as fresh: uncertain vehicles, own surroundings, restarts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.sharing.neighbour import NS
from core.sharing.neighbour_map import NeighbourMap
from core.sharing.obstacles import MoverKind, PlacementState, SharedObstacles
from core.sharing.packet_codec import movers_packet, planes_packet, state_packet
from core.sharing.records import SharedPlanes

from .neighbours import FRAME, OWN, STREAM, filled_map, header, mover, state, state_at, wall_packet

ORIGIN = (0.0, 0.0, 0.0)


def bush(x_m: float) -> SharedPlanes:
    """A plane of the size of a vehicle."""
    return SharedPlanes(
        ids=np.array([5], np.uint16),
        box=np.array([[x_m, -0.3, x_m, 0.3, -3.3, -2.8]]),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([0.1]),
    )


def obstacle_senders(got: SharedObstacles) -> list[int]:
    """Senders of moving obstacles that are no vehicles."""
    return [m.sender for m in got.movers if m.kind is MoverKind.OBSTACLE]


def test_a_vehicle_whose_place_is_withheld_hides_no_report() -> None:
    """It is not published itself, so nothing would stand at its place."""
    found = filled_map()
    found.receive(planes_packet(header(9), bush(20.0), ORIGIN), 2 * NS)
    found.receive(movers_packet(header(10), (mover(20.0),), ORIGIN), 2 * NS)
    vague = replace(state(20.0), frame=replace(FRAME, sigma_m=600.0))
    found.receive(state_packet(header(10, vehicle=3), vague), 2 * NS)
    got = found.obstacles(OWN, 2 * NS)
    assert [n.placement for n in got.neighbours if n.vehicle == 3] == [PlacementState.WITHHELD]
    assert got.ids.tolist() == [0, 5]
    assert obstacle_senders(got) == [2]


def test_what_a_vehicle_reports_beside_itself_is_not_the_vehicle() -> None:
    """A vehicle at x = 30 m that reports a bush and a person 2 m ahead."""
    found = filled_map()
    found.receive(planes_packet(header(9), bush(32.0), ORIGIN), 2 * NS)
    found.receive(movers_packet(header(10), (mover(32.0),), ORIGIN), 2 * NS)
    got = found.obstacles(OWN, 2 * NS)
    assert got.ids.tolist() == [0, 5]
    assert obstacle_senders(got) == [2]


def test_ages_of_packets_that_arrive_after_the_instant_are_not_negative() -> None:
    """Packets are stamped in the threads of the links. Clients refuse a message with a negative age."""
    found = filled_map()
    found.receive(state_at(1000), 2 * NS)
    found.receive(movers_packet(header(1001), (mover(45.0),), ORIGIN), 2 * NS + 10**6)
    late = replace(bush(50.0), age_s=np.zeros(1))
    found.receive(planes_packet(header(1002), late, ORIGIN), 2 * NS + 2 * 10**6)
    got = found.obstacles(OWN, 2 * NS - 10**7)
    assert min(m.age_s for m in got.movers) >= 0.0
    assert got.age_s.min() >= 0.0
    assert min(n.silent_s for n in got.neighbours) >= 0.0


@pytest.mark.parametrize("silent_s", [20, 3000])
def test_a_restart_in_the_same_stream_is_known_by_its_time(silent_s: int) -> None:
    """A computer without a clock of its own, heard again when it has run for longer than it was heard before."""
    found = filled_map()
    found.receive(wall_packet(2000), 3 * NS)
    begin_s = 3 + silent_s
    assert found.receive(planes_packet(header(5000), bush(60.0), ORIGIN), begin_s * NS) == ""
    assert found.obstacles(OWN, begin_s * NS).ids.tolist() == ([0] if silent_s < 60 else [])  # no state of its frame
    assert found.receive(state_at(6000), (begin_s + 1) * NS) == ""
    got = found.obstacles(OWN, (begin_s + 1) * NS)
    assert dict(zip(got.ids.tolist(), got.age_s.tolist(), strict=True))[5] <= 1.3
    assert obstacle_senders(got) == []


def test_a_packet_with_a_wrong_stream_does_not_silence_its_sender() -> None:
    """All later packets were refused for ten seconds. A start is later than what was sent before it."""
    found = filled_map()
    assert found.receive(state_at(60_000), 61 * NS) == ""
    assert found.receive(state_at(60_100, stream=STREAM + (1 << 20)), 61 * NS + NS // 10) == "ahead"
    assert found.receive(state_at(60_200), 61 * NS + NS // 5) == ""
    assert found.receive(state_at(6000, stream=STREAM + 60), 65 * NS) == "ahead"
    assert found.receive(state_at(5000, stream=STREAM + 60), 65 * NS) == "", "the packet before may have been delayed"


def test_a_packet_that_is_late_after_a_silence_keeps_its_age() -> None:
    found = filled_map()
    assert found.receive(wall_packet(17_000, number=1), 21 * NS) == ""
    ages = dict(zip(*(column.tolist() for column in _ids_and_ages(found, 21 * NS)), strict=True))
    assert ages[1] == pytest.approx(3.2, abs=0.2)
    assert found.receive(wall_packet(21_000, number=2), 22 * NS) == ""


def _ids_and_ages(found: NeighbourMap, now_ns: int) -> tuple[np.ndarray, np.ndarray]:
    got = found.obstacles(OWN, now_ns)
    return got.ids, got.age_s
