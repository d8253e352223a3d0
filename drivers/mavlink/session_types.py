"""Types of a MAVLink session: its parameters, the autopilot, and the status of the link."""

from __future__ import annotations

from dataclasses import dataclass, field

from .clock_sync import ClockEstimate
from .rates import RateRequest

PX4, ARDUPILOT = "PX4", "ArduPilot"
"""Kinds of autopilots, see `Vehicle.autopilot`."""
ATTITUDE_ID, ATTITUDE_QUATERNION_ID, LOCAL_POSITION_NED_ID = 30, 31, 32


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkParams:
    """Ids of this service and requested messages."""

    system_id: int = 0  # of the vehicle; 0: learned from its heartbeat
    component_id: int = 196  # ours; 196 is obstacle avoidance, 1 is the autopilot itself
    # requested rates
    attitude_hz: float = 100.0
    position_hz: float = 30.0
    obstacles_hz: float = 0.0  # rate at which obstacles will be posted; 0: never
    obstacle_points: int = 0  # as so many points (OBSTACLE_DISTANCE_3D); 0: as distances all around
    distance_sensors: int = 0  # and so many DISTANCE_SENSOR with them
    tunnel_bytes_per_s: float = 0.0  # of TUNNEL messages to other vehicles, with headers
    neighbours: int = 0  # other vehicles whose TUNNEL messages arrive over this link

    def rate_requests(self) -> tuple[RateRequest, ...]:
        """Returns the requested messages."""
        return (
            RateRequest(ATTITUDE_QUATERNION_ID, "ATTITUDE_QUATERNION", self.attitude_hz),
            RateRequest(ATTITUDE_ID, "ATTITUDE", self.attitude_hz, instead_of=ATTITUDE_QUATERNION_ID),
            RateRequest(LOCAL_POSITION_NED_ID, "LOCAL_POSITION_NED", self.position_hz),
        )


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The received autopilot, by its newest heartbeat."""

    system_id: int
    autopilot: str
    vehicle_type: int
    armed: bool
    custom_mode: int
    # earliest arrival of the newest heartbeat, see heartbeats.Arrivals; 0: none since the start
    heartbeat_ns: int
    mavlink_1: bool = False
    system_status: int = 0  # MAV_STATE; 0: not known

    def contradicts(self, earlier: Vehicle) -> bool:
        """Returns whether a command that was decided by an earlier heartbeat must not be sent any more: it is of another
        vehicle, in another mode, or armed or disarmed since."""
        return (self.system_id, self.autopilot, self.custom_mode, self.armed) != (
            earlier.system_id,
            earlier.autopilot,
            earlier.custom_mode,
            earlier.armed,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """Status of the link for the health report. Rates are in Hz over two seconds. An age is None if there was no such
    message."""

    vehicle: Vehicle | None
    clock: ClockEstimate
    clock_restarts: int
    attitude_hz: float
    position_hz: float
    received: int
    counts: dict[str, int]
    signed: bool = False
    """The autopilot's messages are signed with the configured key."""
    signing_fault: str = ""
    timesync_answered: bool = True
    """The autopilot's answers to TIMESYNC are used, or it is too early to tell."""
    attitude_repeated: bool = False
    """The autopilot's attitudes are refused, because they repeat an earlier one with new timestamps."""
    stamps_used: bool = True
    """The autopilot's clock is known: samples are made of its messages of motion."""
    vehicle_uncertain: bool = False
    """No motion is used, because it may be that of another vehicle; `conflicts` says why."""
    conflicts: dict[str, str] = field(default_factory=dict)
    """Topic -> what is wrong with others on the line, as text."""
