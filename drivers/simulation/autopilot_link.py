"""A simulated autopilot on a real line: UDP or a pty, with the faults of real lines."""

from __future__ import annotations

import heapq
import os
import pty
import random
import select
import socket
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from .autopilot import SimulatedAutopilot

_IDLE_S = 0.1
"""Longest wait for something to send."""


@dataclass(kw_only=True)
class Faults:
    """What the line does to the autopilot's messages."""

    # each is late by up to so much; the shares are of all messages: noise bytes put before one, sent twice, or a second
    # late
    jitter_s: float = 0.0
    noise_share: float = 0.0
    double_share: float = 0.0
    late_share: float = 0.0
    seed: int = 0


class UdpEnd:
    """Sends to one address from a port of its own. Raises ValueError for a host that is not known."""

    def __init__(self, host: str, port: int) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._peer = socket.getaddrinfo(host, port, family, socket.SOCK_DGRAM)[0][4]
        except (OSError, UnicodeError) as error:
            raise ValueError(f"{host}: not known ({error}); give the name or the IP address of a computer") from error
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            return self._socket.recv(65_536)
        except (BlockingIOError, ConnectionRefusedError):
            return b""

    def write(self, data: bytes) -> None:
        with suppress(OSError):  # the network is not there, or full: the message is lost, as on a real link
            self._socket.sendto(data, self._peer)

    def close(self) -> None:
        self._socket.close()


class PtyEnd:
    """The autopilot's side of a pty; `device` is what the companion opens as its serial port."""

    def __init__(self) -> None:
        self._own, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._own, False)
        self.device = os.ttyname(self._theirs)

    def fileno(self) -> int:
        return self._own

    def read(self) -> bytes:
        try:
            return os.read(self._own, 65_536)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> None:
        try:
            os.write(self._own, data)
        except (BlockingIOError, OSError):
            return

    def close(self) -> None:
        os.close(self._own)
        os.close(self._theirs)


class AutopilotLink:
    """Runs an autopilot in a thread until closed. Usable as a context manager."""

    def __init__(self, autopilot: SimulatedAutopilot, end: UdpEnd | PtyEnd, faults: Faults | None = None) -> None:
        self.autopilot = autopilot
        self.faults = faults or Faults()
        self._end = end
        self._lock = threading.Lock()
        self._random = random.Random(self.faults.seed)
        self._waiting: list[tuple[int, int, bytes]] = []
        self._count = 0
        self._stop = threading.Event()
        self._woken = os.eventfd(0, os.EFD_NONBLOCK)
        self._thread = threading.Thread(target=self._run, name="simulated autopilot", daemon=True)

    def __enter__(self) -> AutopilotLink:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stops and closes the line."""
        if self._stop.is_set():
            return
        self._stop.set()
        with self._lock:
            self._wake()
        if self._thread.ident is not None:
            self._thread.join(2.0)
        self._end.close()
        with self._lock:
            os.close(self._woken)
            self._woken = -1

    def _wake(self) -> None:
        """Lets the thread look at once. Under the lock."""
        if self._woken >= 0:
            os.eventfd_write(self._woken, 1)

    def change(self, act: Callable[[SimulatedAutopilot], Any]) -> Any:
        """Does something to the autopilot between two rounds, or asks it."""
        with self._lock:
            try:
                return act(self.autopilot)
            finally:
                self._wake()

    def _run(self) -> None:
        wait_s = 0.0
        while not self._stop.is_set():
            # until something is due or comes: looks at short intervals would take a processor from what is measured
            ready, _, _ = select.select([self._end, self._woken], [], [], wait_s)
            if self._woken in ready:
                os.eventfd_read(self._woken)
            data = self._end.read() if self._end in ready else b""
            now_ns = time.monotonic_ns()
            with self._lock:
                if data and not self.autopilot.silent:
                    self.autopilot.receive(data, now_ns)
                for message in self.autopilot.due(now_ns):
                    self._send_later(message, now_ns)
                next_ns = self.autopilot.next_due_ns(now_ns)
            while self._waiting and self._waiting[0][0] <= now_ns:
                self._end.write(heapq.heappop(self._waiting)[2])
            wait_s = self._wait_s(next_ns)

    def _wait_s(self, next_ns: int) -> float:
        """Until the autopilot's next message, or one that is held back."""
        if self._waiting:
            next_ns = min(next_ns, self._waiting[0][0])
        return min(max((next_ns - time.monotonic_ns()) * 1e-9, 0.0), _IDLE_S)

    def _send_later(self, message: bytes, now_ns: int) -> None:
        f, dice = self.faults, self._random
        copies = 2 if dice.random() < f.double_share else 1
        for _ in range(copies):
            delay_s = dice.random() * f.jitter_s + (1.0 if dice.random() < f.late_share else 0.0)
            noise = dice.randbytes(dice.randrange(1, 40)) if dice.random() < f.noise_share else b""
            self._count += 1
            heapq.heappush(self._waiting, (now_ns + round(delay_s * 1e9), self._count, noise + message))
