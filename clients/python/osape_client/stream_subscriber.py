"""Base class of the subscribers of one stream."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

import zmq

from .connect import connect
from .proto import osape_v1_pb2 as pb
from .receive_time import TimedSocket
from .run_folder import run_folder


class StreamSubscriber:
    """A subscription that keeps only the newest message of one stream, usable as a context manager. Not thread-safe.

    stream: name of the stream; address: None: the service on this machine; keys: folder of this client's CURVE keys. Raises
    KeyFileError, and ValueError for an address that cannot be used."""

    def __init__(self, stream: str, address: str | None, keys: Path | None) -> None:
        self.address = address or f"ipc://{run_folder()}/{stream}"
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        try:
            self._socket = TimedSocket(self._connected(keys), self.address)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    def _connected(self, keys: Path | None) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.setsockopt(zmq.CONFLATE, 1)  # keep the newest message only
        socket.setsockopt(zmq.LINGER, 0)
        connect(socket, self.address, keys)
        return socket

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the subscription: to receive then raises RuntimeError. May be called twice."""
        self._socket.close()
        self._context.term()


def check_complete(message: pb.Tracks | pb.NeighbourObstacles, schema_version: int) -> None:
    """Raises ValueError for a message of another schema, and for one without the part that is written last."""
    if message.schema_version != schema_version:
        raise ValueError(
            f"schema version {message.schema_version}; this client reads {schema_version}: update osape-client"
        )
    if not message.HasField("publication"):
        raise ValueError("a message is cut short: the part that is written last is missing")
