"""A subscription that keeps only the newest message of a stream."""

from __future__ import annotations

from pathlib import Path

import zmq

from .connect import connect
from .receive_time import TimedSocket


class NewestSocket:
    """Connected to address. keys: folder of this client's CURVE keys. Raises KeyFileError, and ValueError for an address that
    cannot be used. Not thread-safe."""

    def __init__(self, address: str, keys: Path | None) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        try:
            self._socket = TimedSocket(self._connected(address, keys), address)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    def _connected(self, address: str, keys: Path | None) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.setsockopt(zmq.CONFLATE, 1)  # keep the newest message only
        socket.setsockopt(zmq.LINGER, 0)
        connect(socket, address, keys)
        return socket

    def take(self, timeout_ms: int = 0) -> tuple[bytes, int] | None:
        """As TimedSocket.take."""
        return self._socket.take(timeout_ms)

    def close(self) -> None:
        """May be called twice."""
        self._socket.close()
        self._context.term()
