"""IPv6 addresses of streams, in brackets: tcp://[::1]:5601."""

from __future__ import annotations

import zmq


def allow_ipv6(socket: zmq.Socket[bytes], address: str) -> None:
    """Call before bind or connect. ZeroMQ refuses IPv6 unless asked. It is not asked for names of hosts, which would then
    lead to an IPv6 address where a service may listen on IPv4 only."""
    if address.startswith("tcp://["):
        socket.setsockopt(zmq.IPV6, 1)
