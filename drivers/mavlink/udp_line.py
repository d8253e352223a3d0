"""A UDP socket to an autopilot, as server or as client."""

from __future__ import annotations

import errno
import select
import socket
import time

from ..base import DeviceLost, DeviceNotFound
from .address import Address
from .transport import READ_BYTES, Chunk, Source, reason, resolve, wait_readable
from .udp_flood import FloodFilter

_MOST_DATAGRAMS = 1024
"""Greatest number of datagrams per read. Dropping one as a flood takes some microseconds; the buffer of the socket
holds about as many."""
_LONGEST_NS = 10_000_000
"""Longest time of one read during a flood, since a frame may wait for it."""
_BUFFER_BYTES = 1 << 20
"""Buffer of the socket, if the system allows it: room for the autopilot beside a flood until the next read."""
_NETWORK_DOWN = frozenset({errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTUNREACH, errno.EPERM})
"""EPERM: a firewall."""


class UdpLine:
    """A UDP socket. udpin sends to the last sender until `answer` selects one; udpout always sends to its host."""

    bytes_per_s = None
    waiting_bytes = backlog_bytes = 0  # a datagram is sent at once or not at all
    backlog_remedy = ""

    def __init__(self, address: Address) -> None:
        self._address = address
        self.flood = FloodFilter()
        self._room = memoryview(bytearray(READ_BYTES))
        self.sends_first = address.kind == "udpout"
        family, place = resolve(address)
        try:
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise DeviceNotFound(f"{address}: {reason(error)}; end programs that hold many files or memory") from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._more = select.poll()
        self._more.register(self._socket, select.POLLIN)
        self._peer: Source = place if self.sends_first else None
        self.sources: list[Source] = []
        self._chosen = self.sends_first
        try:
            self._socket.bind(("", 0) if self.sends_first else place)
        except OSError as error:
            self._socket.close()
            raise DeviceNotFound(
                f"{address}: {reason(error)}; end the other program on this port, or choose another port"
            ) from error

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def wait(self, timeout_s: float) -> None:
        wait_readable(self._socket.fileno(), timeout_s)

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        if timeout_s > 0.0:
            self.wait(timeout_s)
        chunks: list[Chunk] = []
        self.sources = []
        begun_ns, dropped = time.monotonic_ns(), False
        for _ in range(_MOST_DATAGRAMS):  # then the rest of the loop has its turn
            # asked, since after a pause an empty socket's exception takes three times as long; in a flood more is there
            if not dropped and not self._more.poll(0):
                break
            try:
                size, peer = self._socket.recvfrom_into(self._room)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # the port of the receiver was closed when the last datagram arrived
            except OSError as error:
                raise DeviceLost(f"{self._address}: {reason(error)}") from error
            arrival_ns = time.monotonic_ns()
            dropped = not self.flood.passes(peer, arrival_ns, self._room[:size])
            if dropped:
                if arrival_ns - begun_ns > _LONGEST_NS:
                    break
                continue
            chunks.append((bytes(self._room[:size]), arrival_ns))
            self.sources.append(peer)
            if not self._chosen:
                self._peer = peer
        return chunks

    def write(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, ConnectionRefusedError):
            return
        except OSError as error:
            # a network that is down for a moment (no route) is as good as a lost datagram
            if error.errno not in _NETWORK_DOWN:
                raise DeviceLost(f"{self._address}: {reason(error)}") from error

    def answer(self, chunk: int) -> None:
        source = self.sources[chunk]
        if source is not None:
            self.flood.trust(source, time.monotonic_ns())
        if not self.sends_first:
            self._peer, self._chosen = source, True

    def close(self) -> None:
        self._socket.close()
