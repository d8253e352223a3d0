"""A session and simulated autopilots without a line: instants are made up, bytes are real."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from core.types import AttitudeSample, PoseSample
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState

MS, NS = 1_000_000, 1_000_000_000


def turning(now_ns: int) -> VehicleState:
    """60 degrees a second to the right."""
    still = (0.0, 0.0, 0.0)
    yaw = math.remainder(math.radians(60.0) * now_ns / NS, 2.0 * math.pi)
    rates = (0.0, 0.0, math.radians(60.0))
    return VehicleState(position_ned_m=still, velocity_ned_m_s=still, euler_rad=(0, 0, yaw), rates_frd_rad_s=rates)


@dataclass
class Conversation:
    """Both ends in steps of a millisecond; a message is delay_ns on its way."""

    session: MavlinkSession
    autopilots: list[SimulatedAutopilot]
    delay_ns: int = 2 * MS
    now_ns: int = 100 * NS
    samples: list[AttitudeSample | PoseSample] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)
    noise: bytes = b""
    lost: frozenset[int] | None = frozenset()
    """Ids of messages that do not arrive here; None: none arrives."""

    def run(self, seconds: float) -> None:
        for _ in range(int(seconds * 1000)):
            self.now_ns += MS
            chunks = [
                (self.noise + d, self.now_ns + self.delay_ns)
                for a in self.autopilots
                for d in a.due(self.now_ns)
                if self.lost is not None and int.from_bytes(d[7:10], "little") not in self.lost
            ]
            self.samples += self.session.receive(chunks)
            for data in self.session.due(self.now_ns):
                self.sent.append(data)
                for a in self.autopilots:
                    a.receive(data, self.now_ns + self.delay_ns)

    def kinds(self) -> list[str]:
        parser = dialect.MAVLink(None)
        return [m.get_type() for d in self.sent for m in parser.parse_buffer(d)]


def talk(kind: str, params: MavlinkParams | None = None, **profile: Any) -> Conversation:
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, **profile))
    return Conversation(MavlinkSession(params), [autopilot])
