"""Types of a MAVLink session: its parameters, the autopilot, and the status of the link."""

from __future__ import annotations

from dataclasses import dataclass, field

from core.param_field import check, number

from .clock_sync import ClockEstimate
from .rates import RateRequest

PX4, ARDUPILOT = "PX4", "ArduPilot"
"""Kinds of autopilots, see `Vehicle.autopilot`."""
ATTITUDE_ID, ATTITUDE_QUATERNION_ID, LOCAL_POSITION_NED_ID = 30, 31, 32


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkParams:
    """Ids of this service and requested messages. Raises ValueError naming the field, its value and its range."""

    system_id: int = number(0, 0, 255, "", "of the vehicle; 0: learned from its heartbeat")
    component_id: int = number(196, 2, 255, "", "ours; 196 is obstacle avoidance, 1 is the autopilot itself")
    attitude_hz: float = number(100.0, 5.0, 400.0, "Hz", "wanted rate of the attitude")
    position_hz: float = number(30.0, 1.0, 200.0, "Hz", "wanted rate of the position")
    obstacles_hz: float = number(0.0, 0.0, 20.0, "Hz", "rate at which obstacles will be posted; 0: never")
    obstacle_points: int = number(0, 0, 104, "", "as so many points (OBSTACLE_DISTANCE_3D); 0: as distances all around")
    distance_sensors: int = number(0, 0, 2, "", "and so many DISTANCE_SENSOR with them")
    tunnel_bytes_per_s: float = number(0.0, 0.0, 20_000.0, "B/s", "of TUNNEL messages to other vehicles, with headers")
    neighbours: int = number(0, 0, 254, "", "other vehicles whose TUNNEL messages arrive over this link")

    def __post_init__(self) -> None:
        check("mavlink", self)

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
    conflicts: dict[str, str] = field(default_factory=dict)
    """Topic -> what is wrong with others on the line, as text."""
