"""Receiving the obstacles of neighbours: the newest message and its age.

with NeighboursSubscriber() as subscriber:
    neighbours = subscriber.newest(section=mirror.section)
    answers = neighbours.added_to_segments(own_answers, from_m, to_m, radius_m)
"""

from __future__ import annotations

from pathlib import Path

from google.protobuf.message import DecodeError

from .clock import LONGEST_WAIT_S, clock_ns
from .neighbours import NeighbourObstacles, no_obstacles
from .proto import osape_v1_pb2 as pb
from .receive_time import Delays
from .sources import CONFLICT_TEXT, Sources, Verdict
from .stream_subscriber import StreamSubscriber, check_complete

NS = 1_000_000_000
SCHEMA_VERSION = 1


class NeighboursSubscriber(StreamSubscriber):
    """Receives the stream `neighbours`. undecodable: number of messages of another schema, or whose parts do not fit together;
    conflicting: of those that were not used because two services publish to the address; last_error: the address and the cause of
    the last one. Not thread-safe.

    address: None: the service on this machine; timeout_s: obstacles of an older message are not returned; keys: folder of this
    client's CURVE keys. Raises KeyFileError."""

    def __init__(self, address: str | None = None, *, timeout_s: float = 1.0, keys: Path | None = None) -> None:
        super().__init__("neighbours", address, keys)
        self.undecodable, self.conflicting, self.last_error = 0, 0, ""
        self._timeout_s = timeout_s
        self._newest: NeighbourObstacles | None = None
        self._received_ns = self._sent_age_ns = self._late_ns = 0
        self._delays, self._sources = Delays(), Sources()

    def newest(self, section: int | None = None, wait_s: float = 0.0) -> NeighbourObstacles:
        """The newest obstacles, the moving ones where they are now. None of them: where the newest are older than timeout_s, the
        time on the network not counted, or where they stand in another section of the own world than `section`. wait_s: for a
        message."""
        received = self._socket.take(round(1000 * min(wait_s, LONGEST_WAIT_S)))
        if received is not None:
            self._take(*received)
        found = self._newest
        age_s = (clock_ns() - self._received_ns + self._sent_age_ns) / NS
        if found is None or age_s > self._timeout_s or section not in (None, found.section):
            return no_obstacles()
        return found.later(age_s + self._late_ns / NS)

    def _take(self, data: bytes, received_ns: int) -> None:
        message = pb.NeighbourObstacles()
        try:
            message.ParseFromString(data)
            check_complete(message, SCHEMA_VERSION)
            found = NeighbourObstacles(message)
            verdict = self._sources.take(message.publication, message.t_ns, received_ns)
            if verdict is Verdict.CONFLICT:
                self.conflicting += 1
                self.last_error = f"{self.address}: {CONFLICT_TEXT}"
            if verdict is not Verdict.USED:
                return
            self._newest, self._received_ns = found, received_ns
            self._sent_age_ns = max(0, message.publication.age_ns)
            self._late_ns = received_ns - self._delays.arrival_ns(message.publication, message.t_ns, received_ns)
        except (DecodeError, ValueError) as error:
            self.undecodable += 1
            self.last_error = f"{self.address}: {error}"
