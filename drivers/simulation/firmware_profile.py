"""How a simulated autopilot behaves: its firmware, what it sends and answers, and how the vehicle moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..mavlink.session_types import PX4
from .firmware_models.timed_flight import CommandedFlight
from .flight_path import VehicleState


def hovering(_: int) -> VehicleState:
    """Level, two metres up, still."""
    still = (0.0, 0.0, 0.0)
    return VehicleState(position_ned_m=(0.0, 0.0, -2.0), velocity_ned_m_s=still, euler_rad=still, rates_frd_rad_s=still)


def never(_: int) -> bool:
    """Returns False at each instant."""
    return False


@dataclass(kw_only=True)
class FirmwareProfile:
    """Behaviour of a simulated autopilot."""

    kind: str = PX4
    system_id: int = 1
    component_id: int = 1
    drift: float = 0.0
    boot_at_ns: int = 0
    streams: dict[int, float] | None = None  # message id -> Hz sent without a request (None: as the firmware does)
    knows_intervals: bool = True  # SET_MESSAGE_INTERVAL is supported
    answers_timesync: bool = True
    timesync_asks_hz: float = 10.0
    armed: bool = False
    custom_mode: int = 0
    motion: Callable[[int], VehicleState] = field(default=hovering)  # the vehicle at a local instant, ns
    hides_attitude: Callable[[int], bool] = field(default=never)  # whether the attitude is not sent at an instant, ns
    # whether it sends its newest attitude again, with a new timestamp, at an instant, ns: its estimator does not run
    repeats_attitude: Callable[[int], bool] = field(default=never)
    # it signs, and accepts only messages that are signed with it; a key of zeros: it signs and accepts everything, as
    # PX4 1.17 without a key
    key: bytes | None = None
    signing_ticks: int = 0  # its time at boot in units of signatures (10 us); 0: it has no clock
    mavlink_1: bool = False  # it uses MAVLink 1
    version: tuple[int, int, int] | None = None  # of its firmware; None: a usual one
    hides_version: bool = False  # it does not answer AUTOPILOT_VERSION
    landed_state: int = 0  # MAV_LANDED_STATE; 0: unknown
    proximity_started: bool = True  # PRX1_TYPE was set when it started
    # it flies by itself, by its mode and by commands; mode and motion are then those of the flight
    flight: CommandedFlight | None = None
