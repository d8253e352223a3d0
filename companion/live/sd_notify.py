"""Notifications to systemd over its socket; without a socket nothing is sent.

While systemd reads nothing, as during a reload of its units, its queue is full after some ten notifications. The main loop
must not wait for it: a notification that cannot be sent is dropped. READY and a new status are then sent later."""

from __future__ import annotations

import os
import socket

STOPPING_S = 15.0
"""Longer than the unit's TimeoutStopSec, which limits the shutdown."""
LEAST_STATUS_S = 1.0
NUMBERS_S = 10.0
"""Least time after a STATUS to another one, and to one in which only numbers differ, such as an age: systemd signals each STATUS
on D-Bus."""
_STOPPING_WAIT_S = 0.2
"""Longest wait for room in systemd's queue at the shutdown, when nothing is sent later."""


class Notifier:
    """Sends READY, STATUS and WATCHDOG for a unit of Type=notify. watchdog_s: interval of the watchdog; None: no
    watchdog."""

    def __init__(self, environment: dict[str, str] | None = None) -> None:
        env = os.environ if environment is None else environment
        address = env.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if self._address else None
        if self._socket is not None:
            self._socket.setblocking(False)
        usec = env.get("WATCHDOG_USEC", "")
        for_this_process = env.get("WATCHDOG_PID", "") in ("", str(os.getpid()))
        self.watchdog_s: float | None = int(usec) / 1e6 if usec.isdecimal() and for_this_process else None
        self._status, self._status_kind, self._status_s = "", "", -NUMBERS_S
        self._ready_unsent = False

    def ready(self) -> None:
        """Reports that the service is ready; where that fails, `feed_watchdog` repeats it."""
        self._ready_unsent = not self._send("READY=1")

    def status(self, text: str, kind: str, now_s: float) -> None:
        """One line for `systemctl status`. It is sent when it differs, but not more often than LEAST_STATUS_S says.

        kind: the same for texts that differ in their numbers only, which are sent every NUMBERS_S; now_s: a monotonic time."""
        line = text.replace("\n", " ")
        least_s = NUMBERS_S if kind == self._status_kind else LEAST_STATUS_S
        if line != self._status and now_s - self._status_s >= least_s and self._send(f"STATUS={line}"):
            self._status, self._status_kind, self._status_s = line, kind, now_s

    def feed_watchdog(self) -> None:
        """Resets the watchdog."""
        if self._ready_unsent:
            self.ready()
        self._send("WATCHDOG=1")

    def extend_timeout(self, seconds: float) -> None:
        """Extends the start timeout to at least these seconds from now."""
        self._send(f"EXTEND_TIMEOUT_USEC={round(seconds * 1e6)}")

    def stopping(self) -> None:
        """Reports the shutdown and extends the watchdog beyond it: finishing a log on a slow disk takes longer than the
        interval."""
        watchdog = f"\nWATCHDOG_USEC={round(STOPPING_S * 1e6)}" if self.watchdog_s is not None else ""
        if self._socket is not None:
            self._socket.settimeout(_STOPPING_WAIT_S)
        self._send("STOPPING=1" + watchdog)

    def _send(self, text: str) -> bool:
        """Sends without waiting; returns False where it could not be sent."""
        if self._socket is None:
            return True
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            return False  # systemd is busy or has ended; its watchdog covers this case
        return True
