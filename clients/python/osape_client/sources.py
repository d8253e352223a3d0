"""Refuses the messages of two services that reach one client, as through a proxy: the free space of one vehicle is none of another.

A service that starts again takes the place of the one before it. If the one before goes on sending, there are two, and which of them
is that of the own vehicle is not known: nothing of either is used until only one has been heard for CONFLICT_NS."""

from __future__ import annotations

from collections import deque
from enum import Enum

from .clock import clock_ns
from .proto import osape_v1_pb2 as pb
from .receive_time import earliest_sent_ns

CONFLICT_NS = 10_000_000_000
_MOST_FORMER = 16
CONFLICT_TEXT = "two services publish to this address; nothing of either is used: connect to that of this vehicle alone"


class Verdict(Enum):
    """What may be done with a message."""

    USED = 0
    LATE = 1
    """It waited while its service was replaced."""
    CONFLICT = 2
    """Two services publish to this address."""


class Sources:
    """Follows which services the messages of one subscription are of."""

    def __init__(self) -> None:
        self._present: tuple[str, int] | None = None
        self._since_ns = 0
        self._former: deque[tuple[str, int]] = deque(maxlen=_MOST_FORMER)
        self._conflict_ns: int | None = None

    def take(self, publication: pb.Publication, t_ns: int, received_ns: int) -> Verdict:
        """Judges a message. t_ns: of its exposure, 0: it has none; received_ns: as `TimedSocket.take` returned it."""
        source, now_ns = (publication.boot_id, publication.start_ns), clock_ns()
        if source != self._present:
            sent_ns = earliest_sent_ns(publication, t_ns, received_ns)
            if source in self._former:
                if sent_ns <= self._since_ns:
                    return Verdict.LATE
                self._conflict_ns = now_ns
                self._former.remove(source)
            if self._present is not None:
                self._former.append(self._present)
            self._present, self._since_ns = source, sent_ns
        if self._conflict_ns is not None and now_ns - self._conflict_ns < CONFLICT_NS:
            return Verdict.CONFLICT
        return Verdict.USED
