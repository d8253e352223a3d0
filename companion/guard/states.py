"""States, inputs and outputs of the guard's state machine."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from drivers.mavlink.session_types import Vehicle

from .assessment import Verdict
from .modes import StopMethod


class GuardState(StrEnum):
    """inactive: no watched mode, not armed or not in the air. unavailable: a watched mode, but nothing is sent, see `cause`.
    watching: the path is free. limited: a lower speed was asked for. stopping: a stop was asked for and is not confirmed.
    holding: the vehicle stands in a mode that the guard has set."""

    INACTIVE = "inactive"
    UNAVAILABLE = "unavailable"
    WATCHING = "watching"
    LIMITED = "limited"
    STOPPING = "stopping"
    HOLDING = "holding"


INTERVENES = frozenset({GuardState.STOPPING, GuardState.HOLDING})


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardMemory:
    """All that outlives the process. t_ns: instant of the last change, monotonic.

    mode: custom_mode in which the state began. stop_modes: those that the guard has asked for. taken: one of them was seen in a
    heartbeat. attempts: to stop. limit_m_s: asked for, 0: none; fastest_m_s: speed just before the limit.
    seen: the path was seen since the vehicle is in the air. blind_stop: the vehicle was stopped because nothing was seen; it is
    not stopped for that again before something is seen."""

    state: GuardState = GuardState.INACTIVE
    kind: str = ""
    system_id: int = 0
    mode: int = 0
    t_ns: int = 0
    stop_modes: tuple[int, ...] = ()
    taken: bool = False
    attempts: int = 0
    limit_m_s: float = 0.0
    fastest_m_s: float = 0.0
    seen: bool = False
    blind_stop: bool = False
    cause: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardInput:
    """now_ns: monotonic. vehicle: None, none is received. doubt: why it is not sure that commands reach this vehicle, as text; empty:
    it is. in_air: it flies. near_ground: it takes off or lands. silent: it has acknowledged commands and does not any more. verdict: None, no speed or no sight of the path."""

    now_ns: int
    vehicle: Vehicle | None
    doubt: str
    in_air: bool
    verdict: Verdict | None
    near_ground: bool = False
    silent: bool = False


@dataclass(frozen=True, slots=True)
class StopCommand:
    """Stop this vehicle by this method."""

    system_id: int
    method: StopMethod


@dataclass(frozen=True, slots=True)
class SpeedCommand:
    """Fly no faster than this."""

    system_id: int
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Announcement:
    """Text for the ground station. critical: MAV_SEVERITY_CRITICAL, else a warning."""

    text: str
    critical: bool = False


Output = StopCommand | SpeedCommand | Announcement
