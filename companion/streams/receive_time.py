"""How old a message is that waited unread: a planner that was busy must not take for new what is not.

A socket does not tell when a message came, only that it is there. One that was there before anybody looked came after the
socket was last seen empty, and no sooner: its age is counted from then. On the service's own machine the stamp of the
exposure tells the age by itself.
"""

from __future__ import annotations

import time
from functools import cache

import zmq

from drivers.proto import osape_v1_pb2 as pb

from .boot import boot_id


class Ear:
    """A socket that is listened to. It takes over the closing of it."""

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        self.socket = socket
        self._empty_ns = time.monotonic_ns()

    def take(self, timeout_ms: int = 0) -> tuple[bytes, int] | None:
        """(a message, the instant since which it may have waited, on this process's clock); None: none came in time."""
        looked_ns = time.monotonic_ns()
        if self.socket.poll(0):
            return self.socket.recv(), self._empty_ns
        self._empty_ns = looked_ns
        if timeout_ms <= 0 or not self.socket.poll(timeout_ms):
            return None
        return self.socket.recv(), time.monotonic_ns()  # it came while we waited

    def close(self) -> None:
        """May be called twice."""
        self.socket.close(0)


def age_ns(publication: pb.Publication, t_ns: int, came_ns: int) -> int:
    """Of an exposure at t_ns on the service's clock, now, at the most: from another machine it lacks the time on the
    network. came_ns: since when the message may have waited."""
    now_ns = time.monotonic_ns()
    if publication.boot_id == own_boot_id():
        return max(now_ns - t_ns, publication.age_ns)  # one clock
    return publication.age_ns + now_ns - came_ns


@cache
def own_boot_id() -> str:
    """Of this machine."""
    return boot_id()
