"""Notifications to systemd over its socket; without a socket nothing is sent."""

from __future__ import annotations

import os
import socket

STOPPING_S = 15.0
"""Longer than the unit's TimeoutStopSec, which limits the shutdown."""


class Notifier:
    """Sends READY, STATUS and WATCHDOG for a unit of Type=notify. watchdog_s: interval of the watchdog; None: no
    watchdog."""

    def __init__(self, environment: dict[str, str] | None = None) -> None:
        env = os.environ if environment is None else environment
        address = env.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if self._address else None
        usec = env.get("WATCHDOG_USEC", "")
        for_this_process = env.get("WATCHDOG_PID", "") in ("", str(os.getpid()))
        self.watchdog_s: float | None = int(usec) / 1e6 if usec.isdecimal() and for_this_process else None
        self._status = ""

    def ready(self) -> None:
        """Reports that the service is ready."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """One line for `systemctl status`. An unchanged line is not sent again."""
        line = text.replace("\n", " ")
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def feed_watchdog(self) -> None:
        """Resets the watchdog."""
        self._send("WATCHDOG=1")

    def extend_timeout(self, seconds: float) -> None:
        """Extends the start timeout to at least these seconds from now."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def stopping(self) -> None:
        """Reports the shutdown and extends the watchdog beyond it: finishing a log on a slow disk takes longer than the
        interval."""
        watchdog = f"\nWATCHDOG_USEC={round(STOPPING_S * 1e6)}" if self.watchdog_s is not None else ""
        self._send("STOPPING=1" + watchdog)

    def _send(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            return  # systemd is busy or has ended; its watchdog covers this case
