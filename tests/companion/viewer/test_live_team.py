"""Obstacles of other vehicles for the page: what is drawn, and what is said of each vehicle."""

from __future__ import annotations

from companion.viewer.live_team import team_data
from osape_client.neighbours import NeighbourObstacles
from osape_client.proto import osape_v1_pb2 as pb


def message(planes: int = 2) -> pb.NeighbourObstacles:
    """Two vehicles: 7 with planes and a moving obstacle, 9 without a place."""
    m = pb.NeighbourObstacles(schema_version=1, t_ns=5, section=1, publication=pb.Publication(boot_id="boot"))
    m.sender = bytes([7] * planes)
    m.id.extend(range(planes))
    m.aligned = bytes(planes)
    for k in range(planes):
        m.corners_m.extend([10.0 + k, -2.0, 10.0 + k, 2.0, -6.0, 0.0])
        m.margin_m.append(0.1)
        m.age_s.append(12.0 - k)
        m.flags.append(0)
    mover = m.movers.add(
        sender=7, id=3, kind=pb.NeighbourMover.KIND_OBSTACLE, velocity_x_m_s=1.5, margin_m=0.5, age_s=0.2
    )
    mover.centre_m.CopyFrom(pb.Vector3(x=6.0, y=1.0, z=-1.0))
    mover.half_size_m.CopyFrom(pb.Vector3(x=0.3, y=0.3, z=0.9))
    m.neighbours.add(vehicle=7, silent_s=0.21, placement="aligned", sigma_m=0.1, planes=planes, movers=1, withheld=4)
    m.neighbours.add(vehicle=9, silent_s=8.0, placement="unknown", sigma_m=float("inf"))
    return m


def test_each_vehicle_is_listed_with_what_it_contributed_and_how_old_it_is() -> None:
    data = team_data(NeighbourObstacles(message()))
    assert data["members"] == [
        {
            "vehicle": 7,
            "silent_s": 0.2,
            "text": "2 planes, observed up to 12 s ago; 1 moving; aligned by common planes ± 0.2 m; 4 planes withheld",
        },
        {"vehicle": 9, "silent_s": 8.0, "text": "0 planes; 0 moving; place not known"},
    ]


def test_planes_and_moving_obstacles_are_in_whole_centimetres() -> None:
    data = team_data(NeighbourObstacles(message()))
    assert data["planes"] == [1100, -200, 1100, 200, -600, 0, 1000, -200, 1000, 200, -600, 0]  # the newest first
    assert data["sender"] == [7, 7]
    assert data["movers"] == [
        {"sender": 7, "name": "moving, by vehicle 7", "box": [600, 100, -100, 80, 80, 140], "to": [750, 100, -100]}
    ]


def test_of_many_planes_the_newest_are_drawn() -> None:
    data = team_data(NeighbourObstacles(message(planes=5)), most=2)
    assert [data["planes"][k] for k in (0, 6)] == [1400, 1300]
    assert "5 planes" in data["members"][0]["text"]
