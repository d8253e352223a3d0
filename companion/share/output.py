"""Where the obstacles of other vehicles go: the stream of this service, and its log."""

from __future__ import annotations

from google.protobuf.message import Message

from osape_client.proto import osape_v1_pb2 as pb

from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher
from .record_limit import Log, RecordLimit


class SharingOutput:
    """publisher: of the stream, owned by this object; None: it is not published. log: see RecordLimit."""

    def __init__(self, publisher: Publisher | None, stamps: PublicationStamps, log: Log) -> None:
        self._publisher, self._stamps, self._limit = publisher, stamps, RecordLimit(log)

    def publish(self, message: pb.NeighbourObstacles, age_ns: int) -> None:
        """Publishes the obstacles. age_ns: of their state; it completes the message."""
        if self._publisher is not None:
            message.publication.CopyFrom(self._stamps.stamp(self._publisher.published, age_ns))
            self._publisher.publish(message)

    def record(self, key: str, message: Message, t_ns: int) -> None:
        """Records a message, unless there are too many. It is serialised later, in the recorder's thread: nothing may change
        it afterwards."""
        self._limit.record(key, message, t_ns)

    @property
    def unrecorded(self) -> int:
        """Number of messages left out of the log."""
        return self._limit.unrecorded

    def close(self) -> None:
        """Closes the stream. May be called twice."""
        if self._publisher is not None:
            self._publisher.close()
