"""A vehicle that flies by itself, by the instants of a link: it flies up to each instant, and answers commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from ...mavlink.dialect import dialect
from ..flight_path import VehicleState

NS = 1_000_000_000
STEP_NS = 20_000_000


class CommandedFlight(Protocol):
    """A vehicle that flies by itself, by its mode and by commands."""

    mode: int  # as in HEARTBEAT

    def step(self, dt_s: float) -> None:
        """Flies for a short time, 20 ms or less."""
        ...

    def command(self, message: Any) -> int | None:
        """MAV_RESULT of a COMMAND_LONG; None: no answer."""
        ...

    def state(self) -> VehicleState:
        """Position, velocity, attitude and body rates."""
        ...


@dataclass(slots=True)
class TimedFlight:
    """A flight that follows the clock."""

    flight: CommandedFlight | None  # as it is at the newest instant. None: there is none, and nothing is answered.
    _now_ns: int = field(default=0)

    def until(self, now_ns: int) -> None:
        """Flies until an instant, in steps of STEP_NS; the first call sets the beginning."""
        if self.flight is None:
            return
        self._now_ns = self._now_ns or now_ns
        while now_ns - self._now_ns >= STEP_NS:
            self.flight.step(STEP_NS / NS)
            self._now_ns += STEP_NS

    def answer(self, command: Any, own: tuple[int, int], now_ns: int) -> Any | None:
        """COMMAND_ACK to a COMMAND_LONG; None: it is for another vehicle, or nothing is answered. own: system and component id."""
        if self.flight is None or (command.target_system, command.target_component) != own:
            return None
        self.until(now_ns)
        result = self.flight.command(command)
        if result is None:
            return None
        sender = command.get_srcSystem(), command.get_srcComponent()
        return dialect.MAVLink_command_ack_message(command.command, result, 0, 0, *sender)
