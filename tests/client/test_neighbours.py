"""Obstacles of neighbours in a planner: they only add to the answers of the own model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from companion.share.messages import obstacles_message
from core.sharing.obstacles import MoverKind, SharedMovingObstacle, SharedObstacles
from osape_client.neighbours import NeighbourObstacles, no_obstacles
from osape_client.neighbours_subscriber import NeighboursSubscriber
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy
from osape_client.tracks_subscriber import TracksSubscriber

WALL = (5.0, -3.0, 5.0, 3.0, -4.0, 0.0)


def shared(*planes: tuple[float, ...], movers: tuple[SharedMovingObstacle, ...] = ()) -> NeighbourObstacles:
    n = len(planes)
    obstacles = SharedObstacles(
        now_ns=7,
        sender=np.full(n, 2, np.uint8),
        ids=np.arange(n, dtype=np.uint16),
        planes=np.array(planes, np.float32).reshape(n, 6),
        margin_m=np.full(n, 0.5, np.float32),
        age_s=np.full(n, 1.5, np.float32),
        flags=np.zeros(n, np.uint8),
        aligned=np.ones(n, np.uint8),
        movers=movers,
    )
    return NeighbourObstacles(pb.NeighbourObstacles.FromString(obstacles_message(obstacles, 3).SerializeToString()))


def test_a_way_through_a_reported_wall_is_occupied() -> None:
    found = shared(WALL)
    own = np.array([Occupancy.FREE, Occupancy.UNKNOWN, Occupancy.FREE], np.uint8)
    answers = found.added_to_segments(own, [[0, 0, -2]] * 3, [[10, 0, -2], [10, 0, -2], [3, 0, -2]], 0.5)
    assert answers.tolist() == [Occupancy.OCCUPIED, Occupancy.OCCUPIED, Occupancy.FREE]
    assert found.section == 3
    assert found.sender.tolist() == [2]


def test_a_reported_vehicle_is_occupied() -> None:
    mover = SharedMovingObstacle(
        sender=2,
        id=9,
        kind=MoverKind.VEHICLE,
        centre_m=(8.0, 0.0, -2.0),
        half_size_m=(0.4, 0.4, 0.4),
        velocity_m_s=(0.0, 0.0),
        margin_m=0.3,
        age_s=0.1,
    )
    found = shared(movers=(mover,))
    own = np.full(3, Occupancy.FREE, np.uint8)
    answers = found.added_to_points(own, [[8, 0.6, -2], [8.6, 0.6, -2], [8, 3, -2]])
    assert answers.tolist() == [Occupancy.OCCUPIED, Occupancy.OCCUPIED, Occupancy.FREE]
    assert found.movers[0].is_vehicle


def vehicle_at(x_m: float, speed_m_s: float, age_s: float = 0.1) -> SharedMovingObstacle:
    return SharedMovingObstacle(
        sender=2,
        id=9,
        kind=MoverKind.VEHICLE,
        centre_m=(x_m, 0.0, -2.0),
        half_size_m=(0.4, 0.4, 0.4),
        velocity_m_s=(speed_m_s, 0.0),
        margin_m=0.3,
        age_s=age_s,
    )


def test_a_vehicle_is_moved_to_the_present_and_its_margin_grows() -> None:
    """At 10 m/s it is 5 m further half a second after the message, with the uncertainty of its acceleration."""
    found = shared(WALL, movers=(vehicle_at(8.0, 10.0),))
    later = found.later(0.5)
    (moved,) = later.movers
    assert moved.centre_m == pytest.approx((13.0, 0.0, -2.0))
    assert moved.age_s == pytest.approx(0.6)
    assert moved.margin_m == pytest.approx(0.3 + 1.0 * 0.5 + 0.5 * 2.0 * (0.6**2 - 0.1**2))
    own = np.full(3, Occupancy.FREE, np.uint8)
    at = [[8, 0, -2], [13, 0, -2], [5, 0, -2]]  # the place of the message, the present one, the wall
    assert later.added_to_points(own, at).tolist() == [Occupancy.FREE, Occupancy.OCCUPIED, Occupancy.OCCUPIED]
    assert found.added_to_points(own, at).tolist() == [Occupancy.OCCUPIED, Occupancy.FREE, Occupancy.OCCUPIED]


def published(found: SharedObstacles, age_ms: int) -> bytes:
    message = obstacles_message(found, 3)
    message.publication.CopyFrom(pb.Publication(boot_id="b", number=1, age_ns=age_ms * 1_000_000))
    return message.SerializeToString()


def test_the_subscriber_returns_obstacles_of_the_present(tmp_path: Path) -> None:
    address, vehicle = (
        f"ipc://{tmp_path}/neighbours",
        replace(SharedObstacles.empty(7), movers=(vehicle_at(8.0, 10.0),)),
    )
    with zmq.Context() as context, context.socket(zmq.PUB) as socket, NeighboursSubscriber(address) as subscriber:
        socket.bind(address)
        found = no_obstacles()
        for _ in range(100):
            socket.send(published(vehicle, 500))
            found = subscriber.newest(section=3, wait_s=0.1)
            if found.movers:
                break
        assert found.movers[0].centre_m[0] >= 13.0
        for _ in range(100):  # older than a second at its publication
            socket.send(published(vehicle, 1500))
            found = subscriber.newest(section=3, wait_s=0.1)
            if not found.movers:
                break
        assert not found.movers


def test_tracks_without_their_end_are_not_used(tmp_path: Path) -> None:
    """Their age was taken for 0."""
    address = f"ipc://{tmp_path}/tracks"
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        socket.bind(address)
        with TracksSubscriber(address) as subscriber:
            while not subscriber.undecodable:
                socket.send(pb.Tracks(schema_version=1).SerializeToString())
                assert subscriber.wait(0.1) is None
            assert (
                subscriber.last_error == f"{address}: a message is cut short: the part that is written last is missing"
            )
            while subscriber.undecodable < 3:
                socket.send(pb.Tracks(schema_version=2).SerializeToString())
                assert subscriber.wait(0.1) is None
            assert "schema version 2" in subscriber.last_error


def test_a_message_without_its_end_does_not_replace_an_earlier_one(tmp_path: Path) -> None:
    """It may lack moving obstacles, and its age."""
    address = f"ipc://{tmp_path}/neighbours"
    vehicle = replace(SharedObstacles.empty(7), movers=(vehicle_at(8.0, 10.0),))
    cut = pb.NeighbourObstacles(schema_version=1, section=3).SerializeToString()
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        socket.bind(address)
        with NeighboursSubscriber(address, timeout_s=600.0) as subscriber:
            while not subscriber.newest(section=3, wait_s=0.1).movers:
                socket.send(published(vehicle, 500))
            while not subscriber.undecodable:
                socket.send(cut)
                assert subscriber.newest(section=3, wait_s=0.1).movers
            assert (
                subscriber.last_error == f"{address}: a message is cut short: the part that is written last is missing"
            )


number = st.floats(-50.0, 50.0)
place = st.tuples(number, number, number)


@given(st.lists(st.tuples(place, place, st.integers(0, 2)), min_size=1, max_size=20), st.floats(0.0, 3.0))
def test_nothing_becomes_free_and_nothing_occupied_is_cleared(
    asked: list[tuple[tuple[float, float, float], tuple[float, float, float], int]], radius_m: float
) -> None:
    own = np.array([answer for _, _, answer in asked], np.uint8)
    answers = shared(WALL).added_to_segments(own, [a for a, _, _ in asked], [b for _, b, _ in asked], radius_m)
    changed = answers != own
    assert (answers[changed] == Occupancy.OCCUPIED).all()
    assert (answers[own == Occupancy.OCCUPIED] == Occupancy.OCCUPIED).all()


def test_without_neighbours_nothing_changes() -> None:
    own = np.array([0, 1, 2], np.uint8)
    assert no_obstacles().added_to_points(own, np.zeros((3, 3))).tolist() == [0, 1, 2]


def test_a_damaged_message_is_refused() -> None:
    with pytest.raises(ValueError, match="rows"):
        NeighbourObstacles(pb.NeighbourObstacles(sender=b"\x01", corners_m=[0.0] * 6))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_an_obstacle_that_is_not_finite_is_refused(value: float) -> None:
    """It would touch nothing, nor would one whose other end is lost in rounding."""
    with pytest.raises(ValueError, match="finite"):
        shared((value, *WALL[1:]))
    mover = SharedMovingObstacle(
        sender=2,
        id=9,
        kind=MoverKind.VEHICLE,
        centre_m=(8.0, value, -2.0),
        half_size_m=(0.4, 0.4, 0.4),
        velocity_m_s=(0.0, 0.0),
        margin_m=0.3,
        age_s=0.1,
    )
    with pytest.raises(ValueError, match="finite"):
        shared(movers=(mover,))


@pytest.mark.parametrize(
    "changes",
    [
        {"half_size_m": (0.4, -3.0, 0.4)},
        {"margin_m": -9.0},
        {"age_s": -100.0},
        {"age_s": np.nan},
        {"velocity_m_s": (np.nan, 0.0)},
        {"velocity_m_s": (0.0, np.inf)},
        {"velocity_m_s": (1e300, 0.0)},
        {"margin_m": 1e300},
        {"age_s": 1e300},
    ],
)
def test_a_moving_obstacle_that_would_touch_nothing_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="moving obstacles of neighbours"):
        shared(movers=(replace(vehicle_at(8.0, 10.0), **changes),))


def test_a_wall_upside_down_or_with_a_negative_margin_is_refused() -> None:
    with pytest.raises(ValueError, match="a top below its bottom"):
        shared((*WALL[:4], WALL[5], WALL[4]))
    message = obstacles_message(SharedObstacles.empty(7), 3)
    message.MergeFrom(
        pb.NeighbourObstacles(sender=b"\x02", id=[1], corners_m=WALL, margin_m=[-5.0], age_s=[1.0], flags=[0])
    )
    message.aligned = b"\x01"
    with pytest.raises(ValueError, match="a negative margin"):
        NeighbourObstacles(message)
