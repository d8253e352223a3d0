"""A TCP connection to an autopilot or a router."""

from __future__ import annotations

import contextlib
import fcntl
import socket
import sys
import termios
import time

from ..base import DeviceLost, DeviceNotFound
from .address import Address
from .transport import READ_BYTES, Chunk, reason, resolve, wait_readable

_CONNECT_S = 2.0
"""Longest wait for a connection."""
_BACKLOG_BYTES = 4096
"""Nothing is sent while more bytes are not confirmed: 0.2 to 0.5 s of the usual messages."""
SILENT_NS = 5_000_000_000
"""An autopilot sends a heartbeat each second. After a longer silence the connection is opened again: when a network is up
again, TCP itself waits about as long as it was down before it sends the rest."""


class TcpLine:
    """A TCP connection to an autopilot or a router."""

    bytes_per_s = None
    sends_first = False
    sources = None
    flood = None
    backlog_bytes = _BACKLOG_BYTES
    backlog_remedy = "check the network, and that the other end reads"

    def __init__(self, address: Address) -> None:
        self._address, self._received_ns = address, 0
        family, place = resolve(address)
        try:
            self._socket = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            raise DeviceNotFound(f"{address}: {reason(error)}; end programs that hold many files or memory") from error
        try:
            self._socket.settimeout(_CONNECT_S)
            self._socket.connect(place)
        except OSError as error:
            self._socket.close()
            raise DeviceNotFound(
                f"{address}: {reason(error)}; check the address, and that the other end listens there"
            ) from error
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the other end has not confirmed."""
        try:
            return int.from_bytes(fcntl.ioctl(self._socket, termios.TIOCOUTQ, bytes(4)), sys.byteorder)
        except OSError as error:
            raise DeviceLost(f"{self._address}: {reason(error)}") from error

    def wait(self, timeout_s: float) -> None:
        wait_readable(self._socket.fileno(), timeout_s)

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        if timeout_s > 0.0:
            self.wait(timeout_s)
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            self._check_silence()
            return []
        except OSError as error:
            raise DeviceLost(f"{self._address}: {reason(error)}") from error
        if not data:
            raise DeviceLost(f"{self._address}: the other end closed the connection")
        self._received_ns = time.monotonic_ns()
        return [(data, self._received_ns)]

    def _check_silence(self) -> None:
        """Raises DeviceLost if nothing arrives any more. Before the first bytes the autopilot may be switched off."""
        if self._received_ns and time.monotonic_ns() - self._received_ns > SILENT_NS:
            raise DeviceLost(f"{self._address}: nothing has arrived for {SILENT_NS / 1e9:g} s; check the network")

    def write(self, data: bytes) -> None:
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            return
        except OSError as error:
            raise DeviceLost(f"{self._address}: {reason(error)}") from error
        if sent < len(data):
            raise DeviceLost(f"{self._address}: the connection is stuck")

    def answer(self, chunk: int) -> None:
        pass  # a connection has one other end

    def close(self) -> None:
        self._socket.close()
