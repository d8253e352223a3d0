"""Connecting a socket to the service."""

from __future__ import annotations

from pathlib import Path

import zmq

from .curve_keys import use_client_keys
from .ipv6 import allow_ipv6


def connect(socket: zmq.Socket[bytes], address: str, keys: Path | None) -> None:
    """Connects a socket to address. keys: folder of this client's CURVE keys. Raises KeyFileError, and ValueError for an
    address that cannot be used."""
    if keys is not None:
        use_client_keys(socket, keys)
    allow_ipv6(socket, address)
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        raise ValueError(f"{address}: {error.strerror or error}; use ipc://PATH or tcp://HOST:PORT") from error
