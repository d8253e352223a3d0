"""Words to systemd over its notification socket; nothing happens where there is none."""

from __future__ import annotations

import os
import socket

STOPPING_S = 15.0
"""More than the unit's TimeoutStopSec, which is what bounds the end."""


class Notifier:
    """READY, STATUS and WATCHDOG of a unit of Type=notify. watchdog_s: how often systemd wants a sign of life."""

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
        """The loops run."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """One line for `systemctl status`; the same one twice is sent once."""
        line = text.replace("\n", " ")
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def feed_watchdog(self) -> None:
        """Feeds the watchdog."""
        self._send("WATCHDOG=1")

    def extend_timeout(self, seconds: float) -> None:
        """Starting goes on for so long: kernels are compiled."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def stopping(self) -> None:
        """We end because we were told to. Nobody feeds the watchdog while a log is finished on a slow disk: it is
        given more time than the unit gives us to stop."""
        watchdog = f"\nWATCHDOG_USEC={round(STOPPING_S * 1e6)}" if self.watchdog_s is not None else ""
        self._send("STOPPING=1" + watchdog)

    def _send(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            return  # systemd is busy or gone: it will judge by the watchdog
