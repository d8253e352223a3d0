"""Age of messages that waited unread in a socket: a planner that was busy must not take an old message for a new one.

A socket does not tell when a message arrived. A message that was there at the first look arrived after the socket was last
seen empty; its age counts from then. On the service's own machine the time stamp of the exposure gives the age directly. From
another machine each message counts as having been on the way for as long as the fastest one, and for what it took more.
"""

from __future__ import annotations

from contextlib import suppress

import zmq

from .boot import boot_id
from .clock import clock_ns
from .proto import osape_v1_pb2 as pb

MS = 1_000_000
SILENCE_NS = 5_000 * MS
"""Time without a message after which a socket connects again. ZeroMQ gives a connection up for good where the other side is no
service, refuses the keys, or sends a message that is too large; the service may have taken its place since."""
CLOCK_DRIFT = 1e-3
"""Not tuning: largest difference in rate of the clocks of two machines, each corrected by up to 500 ppm. A delay that grows more
slowly is not noticed, and one that lasts counts for less by as much."""


class TimedSocket:
    """A receiving socket that bounds the arrival time of each message. It owns the socket and closes it.

    address: to which it connects again when no message comes; None: it does not."""

    def __init__(self, socket: zmq.Socket[bytes], address: str | None = None) -> None:
        self.socket = socket
        self._address = address
        self._empty_ns = self._heard_ns = clock_ns()

    def take(self, timeout_ms: int = 0) -> tuple[bytes, int] | None:
        """(message, the earliest time at which it can have arrived, by `clock_ns`); None when no message came within the
        timeout. Raises RuntimeError after `close`."""
        self.check_open()
        end_ns = clock_ns() + timeout_ms * MS
        while True:
            left_ms = max(0, (end_ns - clock_ns()) // MS)
            received = self._next(min(left_ms, SILENCE_NS // MS))
            now_ns = clock_ns()
            if received is not None:
                self._heard_ns = now_ns
                return received
            if now_ns - self._heard_ns >= SILENCE_NS:
                self._heard_ns = now_ns
                self._connect_again()
            if now_ns >= end_ns or left_ms == 0:
                return None

    def _next(self, timeout_ms: int) -> tuple[bytes, int] | None:
        """As `take`, without connecting again."""
        arrived_ns = self._empty_ns
        if self._is_empty():
            if timeout_ms <= 0:
                return None
            if not self.socket.poll(timeout_ms):
                self._is_empty()  # what comes next came after this wait
                return None
            arrived_ns = clock_ns()  # it arrived during the wait
        data = self.socket.recv()
        self._is_empty()  # a reader that always finds a message would never look at an empty socket otherwise
        return data, arrived_ns

    def _is_empty(self) -> bool:
        polled_ns = clock_ns()
        if self.socket.poll(0):
            return False
        self._empty_ns = polled_ns
        return True

    def _connect_again(self) -> None:
        if self._address is None:
            return
        with suppress(zmq.ZMQError):  # it is not connected any more
            self.socket.disconnect(self._address)
        with suppress(zmq.ZMQError):  # the next silence tries again
            self.socket.connect(self._address)

    def check_open(self) -> None:
        """Raises RuntimeError after `close`."""
        if self.socket.closed:
            to = f" to {self._address}" if self._address else ""
            raise RuntimeError(f"the subscription{to} is closed; create a new one, or receive inside its `with` block")

    def close(self) -> None:
        """May be called twice."""
        self.socket.close(0)


class Delays:
    """Finds messages that were longer on the way than the fastest one, as in a slow network or after it was interrupted. The two
    clocks need not agree: the least difference between receipt and sending is that of the fastest message."""

    def __init__(self) -> None:
        self._boot, self._least_ns, self._at_ns = "", 0, 0

    def arrival_ns(self, publication: pb.Publication, t_ns: int, received_ns: int) -> int:
        """The earliest time at which a message of an exposure at t_ns can have arrived with the least delay. received_ns: as
        `TimedSocket.take` returned it just now. t_ns 0: without an exposure, and nothing can be compared."""
        if t_ns == 0:
            return received_ns
        now_ns = clock_ns()
        apart_ns = now_ns - (t_ns + publication.suspended_ns + publication.age_ns)
        least_ns = self._least_ns + round(CLOCK_DRIFT * (now_ns - self._at_ns))
        is_first, self._boot = not self._at_ns or publication.boot_id != self._boot, publication.boot_id
        self._least_ns, self._at_ns = apart_ns if is_first else min(least_ns, apart_ns), now_ns
        return min(received_ns, now_ns - (apart_ns - self._least_ns))


def age_ns(publication: pb.Publication, t_ns: int, received_ns: int) -> int:
    """Upper bound of the present age of an exposure at t_ns on the service's monotonic clock. From another machine it lacks the
    least time on the network, and so for a stamp that was in the future when it was sent. received_ns: as `Delays.arrival_ns`
    returned it."""
    now_ns, published_ns = clock_ns(), publication.age_ns
    since_receipt_ns = max(0, published_ns) + now_ns - received_ns
    exposed_ns = t_ns + publication.suspended_ns
    if _has_this_clock(publication) and exposed_ns <= now_ns:
        return max(now_ns - exposed_ns, published_ns if published_ns >= 0 else since_receipt_ns)
    return since_receipt_ns


def earliest_sent_ns(publication: pb.Publication, t_ns: int, received_ns: int) -> int:
    """The earliest time at which a message can have been sent, by `clock_ns`, from another machine that at which it can have arrived.
    t_ns: of its exposure, 0: it has none; received_ns: as `TimedSocket.take` returned it."""
    sent_ns = t_ns + publication.suspended_ns + publication.age_ns
    return sent_ns if t_ns != 0 and _has_this_clock(publication) and sent_ns <= clock_ns() else received_ns


def _has_this_clock(publication: pb.Publication) -> bool:
    """True if stamps of the service are by the clock of this machine."""
    return publication.boot_id == boot_id() and publication.HasField("suspended_ns")
