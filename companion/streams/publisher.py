"""The streams on ZeroMQ: one protobuf message a frame, one stream a socket, the newest only.

ipc by default, for planners on the same machine; a lock beside the socket refuses a second service, which would
otherwise take the path over in silence. tcp beyond this machine only with CURVE: keys by `companion keys`, and a list
of the clients that may listen (`curve.py`). A subscriber that hangs or is slow costs nothing: what it does not take is
dropped for it alone.
"""

from __future__ import annotations

import fcntl
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import zmq
from google.protobuf.message import Message

from drivers.base import DeviceNotFound

from ..pipeline.encode import wire_bytes
from .curve_auth import ServerKeys, beyond_loopback, serve


@dataclass(frozen=True, slots=True)
class Stream:
    """Where a stream is published: ipc:///run/osape-companion/prisms or tcp://127.0.0.1:5601."""

    name: str
    address: str


class Publisher:
    """One stream. kind: zmq.PUB, or zmq.REP for one that answers; newest_only: a slow listener gets the newest message, else
    each one in its order as long as at most 1000 wait. Raises DeviceNotFound where its address cannot be had, ValueError
    where it would be open to all."""

    def __init__(
        self, stream: Stream, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys | None = None, kind: int = zmq.PUB,
        newest_only: bool = True,
    ) -> None:  # fmt: skip
        self.stream = stream
        self.published = 0
        self._lock: IO[str] | None = None
        if beyond_loopback(stream.address) and keys is None:
            raise ValueError(
                f"stream {stream.name}: {stream.address} can be reached from other machines and needs keys: make them "
                "with `companion keys`, and name their folder in [publish] keys"
            )
        self._lock = _locked(stream)
        self._socket = context.socket(kind)
        try:
            if newest_only:
                self._socket.setsockopt(zmq.CONFLATE, 1)
            self._socket.setsockopt(zmq.LINGER, 0)
            if keys is not None:
                serve(self._socket, keys)
            self._socket.bind(stream.address)
            _close_to_others(stream)
        except zmq.ZMQError as error:
            self.close()
            raise DeviceNotFound(
                f"stream {stream.name}: {stream.address} cannot be bound ({error.strerror}); does its folder exist, is "
                "the port free?"
            ) from error

    @property
    def socket(self) -> zmq.Socket[bytes]:
        """To take requests from."""
        return self._socket

    def publish(self, message: Message | bytes) -> None:
        """Sends a message, or its bytes, to whoever listens. Never waits."""
        data = message if isinstance(message, bytes) else wire_bytes(message)
        self._socket.send(data, zmq.DONTWAIT)
        self.published += 1

    def close(self) -> None:
        """May be called again."""
        if not self._socket.closed:
            self._socket.close(0)
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def _locked(stream: Stream) -> IO[str] | None:
    """The lock beside an ipc socket, held as long as it is open."""
    if not stream.address.startswith("ipc://"):
        return None  # a second binder of a tcp port is refused by the system
    place = Path(stream.address.removeprefix("ipc://"))
    if not place.parent.is_dir():
        raise DeviceNotFound(
            f"stream {stream.name}: the folder {place.parent} does not exist; make it, or publish elsewhere"
        )
    lock = place.with_name(place.name + ".lock").open("a+")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise DeviceNotFound(
            f"stream {stream.name}: another service (process {holder}) publishes on {stream.address}; stop it, or choose "
            "another address"
        ) from error
    lock.truncate(0)
    lock.write(f"{os.getpid()}\n")
    lock.flush()
    return lock


def _close_to_others(stream: Stream) -> None:
    """The socket is for the owner and the group, as the folder allows."""
    if stream.address.startswith("ipc://"):
        os.chmod(stream.address.removeprefix("ipc://"), 0o660)
