"""Where the obstacles of other vehicles go: the stream of this service, and its log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from google.protobuf.message import Message

from osape_client.proto import osape_v1_pb2 as pb

from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher

NS: Final = 1_000_000_000
MOST_LOGGED_PER_S: Final = 100
"""A log has priority for what a replay needs."""
Log = Callable[[str, Message, int], None]


class SharingOutput:
    """publisher: of the stream, owned by this object; None: it is not published. log: records a message (key of the table of
    topics, message, time). unrecorded: number of messages left out of the log."""

    def __init__(self, publisher: Publisher | None, stamps: PublicationStamps, log: Log) -> None:
        self._publisher, self._stamps, self._log = publisher, stamps, log
        self._second_ns = self._recorded = 0
        self.unrecorded = 0

    def publish(self, message: pb.NeighbourObstacles, age_ns: int) -> None:
        """Publishes the obstacles. age_ns: of their state; it completes the message."""
        if self._publisher is not None:
            message.publication.CopyFrom(self._stamps.stamp(self._publisher.published, age_ns))
            self._publisher.publish(message)

    def record(self, key: str, message: Message, t_ns: int) -> None:
        """Records a message, at most MOST_LOGGED_PER_S of them; others are counted. It is serialised later, in the recorder's
        thread: nothing may change it afterwards."""
        if t_ns - self._second_ns >= NS:
            self._second_ns, self._recorded = t_ns, 0
        self._recorded += 1
        if self._recorded <= MOST_LOGGED_PER_S:
            self._log(key, message, t_ns)
        else:
            self.unrecorded += 1

    def close(self) -> None:
        """Closes the stream. May be called twice."""
        if self._publisher is not None:
            self._publisher.close()
