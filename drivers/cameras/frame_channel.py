"""Carries depth frames from a camera process to the service: pixels in shared memory, notifications on a socket.

The memory is anonymous (memfd): it has no name and is released when both processes have ended. The writer puts a frame
into the next of a few slots, then sends its notification; send and receive are the memory barrier. Each slot has the
frame's number before and after the pixels, so that a reader detects a slot that was overwritten. On processors with
weak ordering (ARM) these numbers may become visible before the pixels; the notification therefore contains a checksum
of some rows, which the reader compares with its copy. The reader takes the newest frame only and never blocks the
writer."""

from __future__ import annotations

import array
import json
import mmap
import os
import select
import socket
import struct
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from fastcrc.crc32 import iso_hdlc
from numpy.typing import NDArray

from core.types import DepthFrame

from ..base import BadData, DeviceLost

SLOTS = 4
_MARK = struct.Struct("<Q")
_PAGE = 4096
_MAX_NOTIFICATION_BYTES = 60_000
_CHECKSUM_ROW_STEP = 16
"""Row step of the checksum, which also includes the last row: a writer overwrites rows in order."""
_FRAME = struct.Struct("<cQqqqII")
"""Notification of a frame: b"f" and the fields of `_FrameNotice`. All other notifications are JSON objects."""
_DESCRIPTORS = array.array("i", [0])
"""Buffer for one descriptor that a notification carries."""


class _FrameNotice(NamedTuple):
    number: int
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    images_crc: int
    check: int


def checksum(depth_mm: NDArray[np.uint16]) -> int:
    """CRC-32 of some rows of a depth image (H, W)."""
    return int(iso_hdlc(depth_mm[-1].tobytes(), iso_hdlc(depth_mm[::_CHECKSUM_ROW_STEP].tobytes())))


def slot_bytes(width: int, height: int) -> int:
    """Bytes of one slot: number, pixels, number; a multiple of the page size."""
    return -(-(2 * _MARK.size + 2 * width * height) // _PAGE) * _PAGE


@dataclass(frozen=True, slots=True)
class Notification:
    """A message of the camera process besides frames. kind: opened, state, failed or alive; payload: its content."""

    kind: str
    payload: dict[str, Any]


class FrameWriter:
    """The side of the camera process. fd: the socket passed to it."""

    def __init__(self, fd: int, camera: str) -> None:
        self._socket = socket.socket(fileno=fd)
        self._socket.setblocking(False)
        self._camera = camera
        self._memory: mmap.mmap | None = None
        self._size = (0, 0)
        self._written = 0

    def send(self, kind: str, **payload: Any) -> None:
        """Sends a notification. Raises DeviceLost when the service has ended, BadData for a notification that is too large
        for the reader."""
        data = json.dumps({"kind": kind, **payload}).encode()
        if len(data) > _MAX_NOTIFICATION_BYTES:
            raise BadData(
                f"camera {self._camera}: the notification {kind!r} has {len(data)} bytes, more than "
                f"{_MAX_NOTIFICATION_BYTES}; report this with the camera's configuration"
            )
        self._deliver(lambda: self._socket.send(data))

    def write(self, frame: DepthFrame) -> None:
        """Writes a frame into the next slot and notifies the reader. Raises DeviceLost when the service has ended."""
        height, width = frame.depth_mm.shape
        if self._memory is None or self._size != (width, height):
            self._open_memory(width, height)
        if self._memory is None:
            return  # the reader was too slow to receive the memory
        self._written += 1
        size = slot_bytes(width, height)
        at = (self._written % SLOTS) * size
        pixels = at + _MARK.size
        end = pixels + 2 * width * height
        _MARK.pack_into(self._memory, at, self._written)
        target = np.ndarray((height, width), np.uint16, self._memory, pixels)
        target[...] = frame.depth_mm
        _MARK.pack_into(self._memory, end, self._written)
        stamps_ns = frame.t_exposure_ns, frame.t_arrival_ns
        notice = _FrameNotice(self._written, frame.sequence, *stamps_ns, frame.images_crc, checksum(frame.depth_mm))
        self._deliver(lambda: self._socket.send(_FRAME.pack(b"f", *notice)))

    def _open_memory(self, width: int, height: int) -> None:
        size = SLOTS * slot_bytes(width, height)
        fd = os.memfd_create(f"depth of {self._camera}")
        try:
            os.ftruncate(fd, size)
            self._memory = mmap.mmap(fd, size)
            self._size = (width, height)
            notification = json.dumps({"kind": "memory", "width": width, "height": height}).encode()
            if not self._deliver(lambda: socket.send_fds(self._socket, [notification], [fd])):
                self._memory = None
        finally:
            os.close(fd)

    def _deliver(self, send: Any) -> bool:
        """False: the socket is full; the reader will be notified of a newer frame."""
        try:
            send()
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceLost(f"camera {self._camera}: the service has ended ({error.strerror})") from error
        return True

    def close(self) -> None:
        """Closes the socket. May be called twice."""
        self._socket.close()


class FrameReader:
    """The side of the service. `child_fd` is passed to the camera process. dropped: number of superseded frames."""

    def __init__(self, camera: str) -> None:
        self._camera = camera
        self._buffer = bytearray(_MAX_NOTIFICATION_BYTES)
        self._socket, self._child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._memory: mmap.mmap | None = None
        self._size = (0, 0)
        self.dropped = 0

    @property
    def child_fd(self) -> int:
        """The descriptor for the camera process; call close_child() after passing it."""
        return self._child_socket.fileno()

    def close_child(self) -> None:
        """Closes the own copy of the child's end, so that the end of the child is detected."""
        self._child_socket.close()

    def read(self, timeout_s: float) -> tuple[DepthFrame | None, list[Notification]]:
        """The newest undelivered frame and all notifications, after waiting at most timeout_s for either. Raises
        DeviceLost when the process has ended, BadData when it sends invalid data."""
        until_s = time.monotonic() + timeout_s
        newest: _FrameNotice | None = None
        notifications: list[Notification] = []
        while newest is None and not notifications and self._wait_readable(until_s):
            try:
                while True:
                    payload = self._receive()
                    if isinstance(payload, Notification):
                        notifications.append(payload)
                    elif payload is not None:
                        self.dropped += 1 if newest is not None else 0
                        newest = payload
                    # polled, since the exception of an empty socket takes three times as long
                    if not self._poll.poll(0):
                        break
            except DeviceLost:
                if newest is None and not notifications:
                    raise
                # its last notifications contain the cause; the next call raises
        frame = self._frame(newest) if newest is not None else None
        return frame, notifications

    def _wait_readable(self, until_s: float) -> bool:
        """Waits for a notification; False on timeout."""
        return bool(self._poll.poll(max(0.0, 1000.0 * (until_s - time.monotonic()))))

    def _receive(self) -> _FrameNotice | Notification | None:
        """The next notification; None: none is waiting. Shared memory is taken without a notification."""
        while True:
            try:
                size, beside, _, _ = self._socket.recvmsg_into([self._buffer], socket.CMSG_SPACE(_DESCRIPTORS.itemsize))
            except BlockingIOError:
                return None
            except OSError as error:
                raise DeviceLost(f"camera {self._camera}: its process has ended ({error.strerror})") from error
            if not size:
                raise DeviceLost(f"camera {self._camera}: its process has ended")
            data = bytes(self._buffer[:size])
            try:
                if data[:1] == b"f":
                    return _FrameNotice(*_FRAME.unpack(data)[1:])
                notification = self._parse(data, beside)
            except (ValueError, KeyError, TypeError, struct.error, RecursionError) as error:
                raise BadData(
                    f"camera {self._camera}: its process sent a message that cannot be decoded ({error})"
                ) from error
            if notification is not None:
                return notification

    def _parse(self, data: bytes, beside: list[tuple[int, int, bytes]]) -> Notification | None:
        """A notification in JSON; None for one with shared memory, which is taken."""
        fds = array.array("i")
        for _, _, content in beside:
            fds.frombytes(content[: len(content) - len(content) % fds.itemsize])
        try:
            payload = dict(json.loads(data))
            kind = payload.pop("kind")
            if not isinstance(kind, str):
                raise TypeError("kind")
            if not fds:
                return Notification(kind, payload)
            self._take_memory(fds[0], int(payload["width"]), int(payload["height"]))
            return None
        finally:
            for fd in fds:
                os.close(fd)

    def _take_memory(self, fd: int, width: int, height: int) -> None:
        size = SLOTS * slot_bytes(width, height)
        if os.fstat(fd).st_size < size:
            raise BadData(f"camera {self._camera}: its memory is too small for {width}x{height} pixels")
        self._memory = mmap.mmap(fd, size, prot=mmap.PROT_READ)
        self._size = (width, height)

    def _frame(self, payload: _FrameNotice) -> DepthFrame | None:
        """The frame of a notification; None when the writer has overwritten its slot."""
        if self._memory is None:
            raise BadData(f"camera {self._camera}: its process announced a frame before the memory")
        width, height = self._size
        at = (payload.number % SLOTS) * slot_bytes(width, height)
        pixels = at + _MARK.size
        end = pixels + 2 * width * height
        behind = _MARK.unpack_from(self._memory, end)[0]
        depth = np.ndarray((height, width), np.uint16, self._memory, pixels).copy()
        before = _MARK.unpack_from(self._memory, at)[0]
        if before != payload.number or behind != payload.number or checksum(depth) != payload.check:
            self.dropped += 1
            return None
        return DepthFrame(
            camera=self._camera,
            sequence=payload.sequence,
            t_exposure_ns=payload.t_exposure_ns,
            t_arrival_ns=payload.t_arrival_ns,
            depth_mm=depth,
            images_crc=payload.images_crc,
        )

    def close(self) -> None:
        """Closes both sockets. May be called twice."""
        self._socket.close()
        self._child_socket.close()
