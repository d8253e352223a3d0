"""Firmware version of the autopilot (AUTOPILOT_VERSION). PX4's version decides which MPC_POS_MODE brakes, ArduCopter's whether
FOLLOW does."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Final

from drivers.mavlink.commands import request_capabilities, request_message
from drivers.mavlink.dialect import dialect

NS: Final = 1_000_000_000
ASK_AGAIN_NS, RENEW_NS, TRIES = NS, 60 * NS, 6


@dataclass(frozen=True, slots=True, order=True)
class FirmwareVersion:
    """Release number of a firmware."""

    major: int
    minor: int
    patch: int = 0

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.patch}"


PX4_ACCELERATION_MODE: Final = FirmwareVersion(1, 16)
"""From this version on PX4 brakes only with MPC_POS_MODE 4; before it, only with 0 or 3."""
COPTER_FOLLOWS_POSITIONS: Final = FirmwareVersion(4, 7)
"""From this version on ArduCopter's FOLLOW gives positions to the position controller, which simple avoidance does not limit."""


def version_of(message: Any) -> FirmwareVersion | None:
    """Returns the version in an AUTOPILOT_VERSION, with a byte each for major, minor, patch and release type; None:
    not filled in."""
    number = int(message.flight_sw_version)
    found = FirmwareVersion(number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF)
    return found if (found.major, found.minor) != (0, 0) else None


class VersionReader:
    """Requests and reads the version. `due` returns requests, `take` gets every message of the autopilot.
    Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: tuple[str, int] = ("", 0)
        self._version: FirmwareVersion | None = None
        self._tries = 0
        self._asked_ns = 0

    def begin(self, kind: str, system_id: int) -> None:
        """Sets the received autopilot; a change of it restarts the reading."""
        with self._lock:
            if (kind, system_id) != self._of:
                self._of, self._version, self._tries, self._asked_ns = (kind, system_id), None, 0, 0

    def take(self, message: Any) -> None:
        """Handles AUTOPILOT_VERSION and ignores other messages."""
        if message.get_type() == "AUTOPILOT_VERSION":
            with self._lock:
                self._version, self._tries = version_of(message) or self._version, 0

    def due(self, now_ns: int, system_id: int) -> list[Any]:
        """Returns the request to send now, if any: one per second, TRIES times or until it is answered, then one per
        minute."""
        with self._lock:
            if not self._of[0]:
                return []
            wait_ns = RENEW_NS if self._version is not None or self._tries >= TRIES else ASK_AGAIN_NS
            if self._asked_ns and now_ns - self._asked_ns < wait_ns:
                return []
            in_turn = self._tries % 2
            self._tries, self._asked_ns = self._tries + 1, now_ns
        if in_turn:
            return [request_capabilities(system_id)]
        return [request_message(system_id, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)]

    @property
    def version(self) -> FirmwareVersion | None:
        """The version; None: not read."""
        with self._lock:
            return self._version

    @property
    def settled(self) -> bool:
        """True if the version is known, or was requested TRIES times without an answer."""
        with self._lock:
            return self._version is not None or self._tries >= TRIES
