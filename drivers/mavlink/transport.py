"""What transports to an autopilot have in common. They give bytes with their arrival times.

A transport does not depend on MAVLink. Every failure is a DriverError that names the address, the cause and the
remedy; the owner then closes the transport and opens a new one later."""

from __future__ import annotations

import math
import os
import select
import socket
import termios
from typing import Protocol, cast

from ..base import DeviceNotFound
from .address import Address, SocketAddress
from .udp_flood import FloodFilter

READ_BYTES = 65_536
"""Greatest number of bytes of one read."""
Chunk = tuple[bytes, int]
"""Bytes and their arrival time, monotonic ns: after the last of them has arrived."""
Source = SocketAddress | None
"""Address of the sender; None: the transport has one other end."""


class Transport(Protocol):
    """An open transport."""

    @property
    def bytes_per_s(self) -> float | None:
        """Data rate; None: no relevant limit."""
        ...

    @property
    def waiting_bytes(self) -> int:
        """Bytes in the buffer of the line that are not sent yet; 0: not known. Raises DeviceLost."""
        ...

    @property
    def backlog_bytes(self) -> int:
        """While more bytes are in the buffer nothing is sent, since distances would arrive old; the newest ones wait."""
        ...

    @property
    def backlog_remedy(self) -> str:
        """What to do about a buffer that stays full."""
        ...

    @property
    def sends_first(self) -> bool:
        """True if the other end sends nothing before it has received a message."""
        ...

    @property
    def sources(self) -> list[Source] | None:
        """The sender of each chunk of the newest `read`; None: there is one other end."""
        ...

    @property
    def flood(self) -> FloodFilter | None:
        """The filter of floods from other addresses; None: there is one other end."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Waits until something has arrived, for at most timeout_s. Raises DeviceLost."""
        ...

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        """Returns what has arrived, after waiting for at most timeout_s. Raises DeviceLost."""
        ...

    def write(self, data: bytes) -> None:
        """Sends at once. A message of which nothing can be sent now is lost. Raises DeviceLost."""
        ...

    def answer(self, chunk: int) -> None:
        """Makes `write` send to the sender of this chunk of the newest `read`, since others may send to the port,
        too."""
        ...

    def close(self) -> None: ...


def resolve(address: Address) -> tuple[socket.AddressFamily, SocketAddress]:
    """Returns family and address; IPv6 only where it was given as an address. Raises DeviceNotFound. A name server may
    take 20 s."""
    family = socket.AF_INET6 if address.place.startswith("[") else socket.AF_INET
    try:
        found = socket.getaddrinfo(address.place.strip("[]"), address.number, family, socket.SOCK_DGRAM)
    except OSError as error:
        raise DeviceNotFound(f"{address}: {reason(error)}; use an address such as 127.0.0.1") from error
    return family, cast(SocketAddress, found[0][4])


def wait_readable(descriptor: int, timeout_s: float) -> bool:
    """Waits for at most timeout_s until something can be read; returns whether that is so. Raises OSError.

    It polls, because select() takes no descriptor above 1023: the connections of many subscribers take those below."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(math.ceil(1000.0 * timeout_s)))


def reason(error: BaseException) -> str:
    """The system's text of the cause, without the sentence that pyserial puts around it."""
    if isinstance(error, socket.gaierror):  # its numbers are not those of the system
        return error.strerror or str(error)
    number = error.args[0] if isinstance(error, termios.error) else getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) else str(error) or type(error).__name__
