"""Publishers on ZeroMQ: one protobuf message per frame, one stream per socket.

The default is ipc, for planners on the same computer; a lock file beside the socket refuses a second service on the
same path. tcp beyond the loopback interface requires CURVE keys (`companion keys`, `curve_auth.py`). A slow or blocked
subscriber does not affect the others: messages are dropped for it alone."""

from __future__ import annotations

import fcntl
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import zmq
from google.protobuf.message import Message

from drivers.base import DeviceNotFound
from osape_client.connect import allow_ipv6

from ..config.endpoints import beyond_loopback, without_keys_text
from ..pipeline.encode import wire_bytes
from .curve_auth import ServerKeys, serve

MOST_RECEIVED_BYTES = 4096
"""Largest message that is received; the sender of a larger one is disconnected."""


@dataclass(frozen=True, slots=True)
class Stream:
    """Name and address of a stream, such as ipc:///run/osape-companion/prisms or tcp://127.0.0.1:5601."""

    name: str
    address: str


class Publisher:
    """One stream. kind: zmq.PUB, or zmq.REP for answers; newest_only: a slow subscriber receives the newest message
    only, otherwise every message in order while at most `most_waiting` wait. Raises DeviceNotFound where the address cannot be
    bound or closed to others, ValueError where other machines could connect without keys."""

    def __init__(
        self,
        stream: Stream,
        context: zmq.Context[zmq.Socket[bytes]],
        keys: ServerKeys | None = None,
        kind: int = zmq.PUB,
        newest_only: bool = True,
        most_waiting: int = 100,
    ) -> None:
        self.stream = stream
        self.published = 0
        self._lock: IO[str] | None = None
        if beyond_loopback(stream.address) and keys is None:
            raise ValueError(without_keys_text(stream.name, stream.address))
        self._lock = _locked(stream)
        self._socket: zmq.Socket[bytes] | None = None
        try:
            self._socket = context.socket(kind)
            if newest_only:
                self._socket.setsockopt(zmq.CONFLATE, 1)
            self._socket.setsockopt(zmq.SNDHWM, most_waiting)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.setsockopt(zmq.MAXMSGSIZE, MOST_RECEIVED_BYTES)
            if keys is not None:
                serve(self._socket, keys)
            allow_ipv6(self._socket, stream.address)
            self._socket.bind(stream.address)
            _close_to_others(stream)
        except (zmq.ZMQError, OSError) as error:
            self.close()
            raise DeviceNotFound(
                f"stream {stream.name}: {stream.address} cannot be bound ({error.strerror}); check that its directory "
                "exists and the port is free"
            ) from error

    @property
    def socket(self) -> zmq.Socket[bytes]:
        """The socket, for receiving requests."""
        assert self._socket is not None
        return self._socket

    def publish(self, message: Message | bytes) -> None:
        """Sends a message or its encoding to all subscribers. Never blocks."""
        data = message if isinstance(message, bytes) else wire_bytes(message)
        self.socket.send(data, zmq.DONTWAIT)
        self.published += 1

    def close(self) -> None:
        """Closes the socket, deletes its file and releases the lock. May be called twice."""
        if self._socket is not None:
            self._socket.close(0)
        if self._lock is not None:
            # libzmq leaves the file of an ipc socket: clients would take it for a service
            Path(self.stream.address.removeprefix("ipc://")).unlink(missing_ok=True)
            self._lock.close()
            self._lock = None


def _locked(stream: Stream) -> IO[str] | None:
    """Takes the lock file beside an ipc socket; it is released when closed."""
    if not stream.address.startswith("ipc://"):
        return None  # the system refuses a second bind of a tcp port
    place = Path(stream.address.removeprefix("ipc://"))
    if not place.parent.is_dir():
        raise DeviceNotFound(
            f"stream {stream.name}: the directory {place.parent} does not exist; create it, or change the address in "
            "[publish]"
        )
    path = place.with_name(place.name + ".lock")
    try:
        lock = path.open("a+")
    except OSError as error:
        raise DeviceNotFound(
            f"stream {stream.name}: {path}: {error.strerror}; check the rights of the directory, or change the address in "
            "[publish]"
        ) from error
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
    """Restricts an ipc socket to its owner and group."""
    if stream.address.startswith("ipc://"):
        os.chmod(stream.address.removeprefix("ipc://"), 0o660)
