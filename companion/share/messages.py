"""Obstacles of neighbours as messages (osape.v1)."""

from __future__ import annotations

from collections.abc import Iterable

from core.sharing.obstacles import NeighbourStatus, SharedMovingObstacle, SharedObstacles
from osape_client.proto import osape_v1_pb2 as pb

SCHEMA_VERSION = 1


def obstacles_message(obstacles: SharedObstacles, section: int) -> pb.NeighbourObstacles:
    """The message; the caller sets the publication."""
    return pb.NeighbourObstacles(
        schema_version=SCHEMA_VERSION,
        t_ns=obstacles.now_ns,
        section=section,
        sender=obstacles.sender.tobytes(),
        id=obstacles.ids.tolist(),
        corners_m=obstacles.planes.ravel().tolist(),
        margin_m=obstacles.margin_m.tolist(),
        age_s=obstacles.age_s.tolist(),
        flags=obstacles.flags.tolist(),
        aligned=obstacles.aligned.tobytes(),
        movers=[_mover(m) for m in obstacles.movers],
        neighbours=neighbour_messages(obstacles.neighbours),
    )


def neighbour_messages(statuses: Iterable[NeighbourStatus]) -> list[pb.NeighbourHealth]:
    """The states of the neighbours."""
    return [_neighbour(status) for status in statuses]


def _mover(m: SharedMovingObstacle) -> pb.NeighbourMover:
    (x, y, z), (hx, hy, hz) = m.centre_m, m.half_size_m
    return pb.NeighbourMover(
        sender=m.sender,
        id=m.id,
        kind=pb.NeighbourMover.Kind.Name(int(m.kind)),
        centre_m=pb.Vector3(x=x, y=y, z=z),
        half_size_m=pb.Vector3(x=hx, y=hy, z=hz),
        velocity_x_m_s=m.velocity_m_s[0],
        velocity_y_m_s=m.velocity_m_s[1],
        margin_m=m.margin_m,
        age_s=m.age_s,
    )


def _neighbour(s: NeighbourStatus) -> pb.NeighbourHealth:
    message = pb.NeighbourHealth(
        vehicle=s.vehicle,
        silent_s=s.silent_s,
        placement=s.placement.value,
        fit=s.fit,
        sigma_m=s.sigma_m,
        planes=s.planes,
        movers=s.movers,
        withheld=s.withheld,
        packets=s.packets,
        refused=s.refused,
    )
    if s.vehicle_m is not None:
        x, y, z = s.vehicle_m
        message.position_m.CopyFrom(pb.Vector3(x=x, y=y, z=z))
    return message
