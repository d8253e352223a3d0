"""Connecting a socket to the service."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import zmq

from .curve_keys import use_client_keys

MOST_BYTES: Final = 16 << 20
"""Largest message of a stream that is received. Decoded, a message that is made for it takes up to 90 times as much memory."""
MOST_WORLD_BYTES: Final = 64 << 20
"""Largest message of the merged world that is received: four times the whole world of the default configuration."""


def connect(socket: zmq.Socket[bytes], address: str, keys: Path | None, most_bytes: int = MOST_BYTES) -> None:
    """Connects a socket to address. keys: folder of this client's CURVE keys; most_bytes: a sender of a larger message is
    disconnected, and no memory is taken for it. Raises KeyFileError, and ValueError for an address that cannot be used."""
    socket.setsockopt(zmq.MAXMSGSIZE, most_bytes)
    if keys is not None:
        use_client_keys(socket, keys)
    allow_ipv6(socket, address)
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        raise ValueError(f"{address}: {error.strerror or error}; use ipc://PATH or tcp://HOST:PORT") from error


def allow_ipv6(socket: zmq.Socket[bytes], address: str) -> None:
    """Call before bind or connect. ZeroMQ refuses IPv6 unless asked. It is not asked for names of hosts, which would then
    lead to an IPv6 address where a service may listen on IPv4 only."""
    if address.startswith("tcp://["):
        socket.setsockopt(zmq.IPV6, 1)
