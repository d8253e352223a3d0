"""States, inputs and outputs of the guard's state machine."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from drivers.mavlink.session_types import Vehicle

from .assessment import Verdict
from .modes import StopMethod


class GuardState(StrEnum):
    """State of the guard."""

    INACTIVE = "inactive"
    """No watched mode, not armed, or on the ground."""
    UNAVAILABLE = "unavailable"
    """A watched mode, but no command is sent; see `GuardMemory.cause`."""
    WATCHING = "watching"
    """The path is free."""
    LIMITED = "limited"
    """A lower speed was commanded."""
    STOPPING = "stopping"
    """A stop was commanded and is not confirmed."""
    HOLDING = "holding"
    """The vehicle rests in a mode that the guard has set."""


INTERVENES = frozenset({GuardState.STOPPING, GuardState.HOLDING})


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardMemory:
    """The part of the guard's state that outlives the process."""

    state: GuardState = GuardState.INACTIVE  # state of the guard
    kind: str = ""  # kind of the autopilot
    system_id: int = 0  # MAVLink system of the vehicle
    mode: int = 0  # custom_mode in which the state began
    t_ns: int = 0  # instant of the last change, monotonic
    stop_modes: tuple[int, ...] = ()  # custom_modes of the stop commands that were sent
    taken: bool = False  # a heartbeat has shown one of them
    attempts: int = 0  # number of stop commands
    limit_m_s: float = 0.0  # commanded speed limit; 0: none
    fastest_m_s: float = 0.0  # speed just before the limit
    seen: bool = False  # the path was seen since take-off
    # the vehicle was stopped because the path was not seen. It is not stopped for that again before the path is seen.
    blind_stop: bool = False
    cause: str = ""  # reason of the state, as text


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardInput:
    """Input of a step."""

    now_ns: int  # monotonic
    vehicle: Vehicle | None  # the autopilot that is received; None: none
    doubt: str  # why it is not certain that commands reach this vehicle alone, as text; empty: it is certain
    in_air: bool  # the vehicle flies
    verdict: Verdict | None  # the verdict on the path; None: the speed or the path is not known
    near_ground: bool = False  # the vehicle takes off or lands
    silent: bool = False  # the vehicle acknowledged commands before and does not any more


@dataclass(frozen=True, slots=True)
class StopCommand:
    """Stop the vehicle by this method."""

    system_id: int
    method: StopMethod


@dataclass(frozen=True, slots=True)
class SpeedCommand:
    """Limit the speed of the vehicle."""

    system_id: int
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Announcement:
    """Text for the ground station, of severity CRITICAL if `critical`, else WARNING."""

    text: str
    critical: bool = False


Output = StopCommand | SpeedCommand | Announcement
