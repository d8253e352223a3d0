"""Ports for what a test opens later, or lets another process open."""

from __future__ import annotations

import contextlib
import secrets
import socket
from typing import Final

_FIRST: Final = 20_000
_COUNT: Final = 12_000
"""Below the ports that the system gives to sockets that ask for none (from 32768 on): such a socket of another test, of which
there are thousands in a run, cannot take the port before it is opened."""


def free_port() -> int:
    """Returns a port that is free for UDP and for TCP on all addresses of this machine."""
    while True:
        port = _FIRST + secrets.randbelow(_COUNT)
        with contextlib.suppress(OSError), socket.socket(type=socket.SOCK_DGRAM) as udp, socket.socket() as tcp:
            udp.bind(("", port))
            tcp.bind(("", port))
            return port
