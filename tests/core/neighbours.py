"""Packets of neighbours, and a map that has received some."""

from __future__ import annotations

import numpy as np

from core.sharing.neighbour import NS
from core.sharing.neighbour_map import NeighbourMap, OwnState
from core.sharing.packet_codec import planes_packet, state_packet
from core.sharing.records import Header, LocalFrame, SharedMover, SharedPlanes, VehicleState

FRAME = LocalFrame(
    latitude_deg=47.3977, longitude_deg=8.5456, altitude_m=488.0, sigma_m=0.2, sigma_z_m=0.2, sigma_yaw_rad=0.01
)
STREAM = 1_700_000_000
OWN = OwnState(
    state=VehicleState(frame=FRAME, position_m=(0.0, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4), section=1
)


def header(sent_ms: int, *, vehicle: int = 2, stream: int = STREAM, section: int = 0) -> Header:
    return Header(vehicle=vehicle, stream=stream, sent_ms=sent_ms, section=section)


def wall(number: int = 0, x_m: float = 10.0) -> SharedPlanes:
    return SharedPlanes(
        ids=np.array([number], np.uint16),
        box=np.array([[x_m, -4.0, x_m, 4.0, -6.0, 0.0]]),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([0.1]),
    )


def state(x_m: float = 30.0, frame: LocalFrame = FRAME) -> VehicleState:
    return VehicleState(frame=frame, position_m=(x_m, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4)


def wall_packet(sent_ms: int, number: int = 0, **of: int) -> bytes:
    return planes_packet(header(sent_ms, **of), wall(number), (0.0, 0.0, 0.0))


def state_at(sent_ms: int, **of: int) -> bytes:
    return state_packet(header(sent_ms, **of), state())


def mover(x_m: float, y_m: float = 0.0, speed_m_s: float = 1.0) -> SharedMover:
    return SharedMover(
        id=4,
        centre_m=(x_m, y_m, -3.0),
        half_size_m=(0.4, 0.4, 0.3),
        velocity_m_s=(speed_m_s, 0.0),
        sigma_m=0.1,
        sigma_m_s=0.1,
        age_s=0.0,
    )


def filled_map() -> NeighbourMap:
    """A map with one neighbour and its wall, received at 1 s."""
    found = NeighbourMap(1)
    assert found.receive(state_at(0), NS) == ""
    assert found.receive(wall_packet(1), NS + 1_000_000) == ""
    return found
