"""Base class of the subscribers of one stream."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from .newest_socket import NewestSocket
from .run_folder import run_folder


class StreamSubscriber:
    """A subscription that keeps the newest message of one stream, usable as a context manager. Not thread-safe.

    stream: name of the stream; address: None: the service on this machine; keys: folder of this client's CURVE keys. Raises
    KeyFileError."""

    def __init__(self, stream: str, address: str | None, keys: Path | None) -> None:
        self.address = address or f"ipc://{run_folder()}/{stream}"
        self._socket = NewestSocket(self.address, keys)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the subscription. May be called twice."""
        self._socket.close()
