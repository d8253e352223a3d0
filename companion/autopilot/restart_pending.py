"""Detects that ArduPilot must be restarted before it reads obstacles.

PRX1_TYPE takes effect at the next start. SYS_STATUS reports the proximity sensor as present only if it was set when
the autopilot started (AP_Proximity::sensor_present)."""

from __future__ import annotations

from typing import Any, Final

from drivers.mavlink.commands import request_message
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import ARDUPILOT

from .parameter_fault import AutopilotFacts

NS: Final = 1_000_000_000
ASK_AGAIN_NS, TRIES = NS, 4
TEXT: Final = "restart the autopilot: PRX1_TYPE was changed after its start, and it does not read obstacles yet"


class ProximityPresence:
    """Requests and reads SYS_STATUS. `due` returns requests, `take` gets every message of the autopilot."""

    def __init__(self) -> None:
        self._present: bool | None = None
        self._asked_ns = self._tries = 0

    def take(self, message: Any) -> None:
        """Handles SYS_STATUS and ignores other messages."""
        if message.get_type() == "SYS_STATUS":
            self._present = bool(int(message.onboard_control_sensors_present) & dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY)

    def due(self, now_ns: int, system_id: int) -> list[Any]:
        """Returns the request to send now, if any; TRIES in all."""
        waits = self._asked_ns and now_ns - self._asked_ns < ASK_AGAIN_NS
        if self._present is not None or self._tries >= TRIES or waits:
            return []
        self._asked_ns, self._tries = now_ns, self._tries + 1
        return [request_message(system_id, dialect.MAVLINK_MSG_ID_SYS_STATUS)]

    @property
    def settled(self) -> bool:
        """True if the state is known, or was requested TRIES times without an answer."""
        return self._present is not None or self._tries >= TRIES

    def restart_pending(self, facts: AutopilotFacts) -> bool:
        """True if PRX1_TYPE is set and the running autopilot has no proximity sensor."""
        wanted = facts.kind == ARDUPILOT and facts.values.get("PRX1_TYPE") == 2.0
        return wanted and self._present is False
