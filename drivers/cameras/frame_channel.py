"""Depth frames from a camera's process to ours: pixels in shared memory, word of them on a socket.

The memory is anonymous (memfd): it has no name to collide with and goes when both processes are gone, however they
end. A frame's pixels are written into the next of a few slots, then its word is sent; the socket's send and receive are
the barrier between them. Each slot carries the number of its frame before and behind the pixels, so that a reader that
was overtaken sees it and takes the next. Processors with weak ordering (ARM) may show these marks before the pixels: the
word therefore carries a checksum of some rows, too, which the reader compares with those of its copy. A reader wants the
newest frame only and never makes the writer wait.
"""

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
"""Every so many rows, and the last, are in the checksum: a writer that overtakes goes through all rows in their order."""
_FRAME = struct.Struct("<cQqqqI")
"""The word of a frame: b"f" and what `_Told` holds. All other words are JSON objects."""
_DESCRIPTORS = array.array("i", [0])
"""As long as those that come along with a word."""


class _FrameNotice(NamedTuple):
    number: int
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    check: int


def checksum(depth_mm: NDArray[np.uint16]) -> int:
    """CRC-32 of some rows of a depth image (H, W)."""
    return int(iso_hdlc(depth_mm[-1].tobytes(), iso_hdlc(depth_mm[::_CHECKSUM_ROW_STEP].tobytes())))


def slot_bytes(width: int, height: int) -> int:
    """Bytes of one slot: a mark, the pixels, a mark; whole pages."""
    return -(-(2 * _MARK.size + 2 * width * height) // _PAGE) * _PAGE


@dataclass(frozen=True, slots=True)
class Notification:
    """What the camera's process said besides frames. kind: opened, state, failed or alive; told: its content."""

    kind: str
    payload: dict[str, Any]


class FrameWriter:
    """The camera's side. fd: the socket given at its start."""

    def __init__(self, fd: int, camera: str) -> None:
        self._socket = socket.socket(fileno=fd)
        self._socket.setblocking(False)
        self._camera = camera
        self._memory: mmap.mmap | None = None
        self._size = (0, 0)
        self._written = 0

    def send(self, kind: str, **payload: Any) -> None:
        """A word. Raises DeviceLost when nobody is left to hear it."""
        self._send({"kind": kind, **payload})

    def write(self, frame: DepthFrame) -> None:
        """Puts a frame into the next slot and tells of it. Raises DeviceLost when nobody is left."""
        height, width = frame.depth_mm.shape
        if self._memory is None or self._size != (width, height):
            self._open_memory(width, height)
        if self._memory is None:
            return  # the reader is so slow that it does not even hear of the memory
        self._written += 1
        size = slot_bytes(width, height)
        at = (self._written % SLOTS) * size
        pixels = at + _MARK.size
        end = pixels + 2 * width * height
        _MARK.pack_into(self._memory, at, self._written)
        target = np.ndarray((height, width), np.uint16, self._memory, pixels)
        target[...] = frame.depth_mm
        _MARK.pack_into(self._memory, end, self._written)
        payload = (self._written, frame.sequence, frame.t_exposure_ns, frame.t_arrival_ns, checksum(frame.depth_mm))
        self._deliver(lambda: self._socket.send(_FRAME.pack(b"f", *payload)))

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

    def _send(self, notification: dict[str, Any]) -> None:
        data = json.dumps(notification).encode()[:_MAX_NOTIFICATION_BYTES]
        self._deliver(lambda: self._socket.send(data))

    def _deliver(self, send: Any) -> bool:
        """False: the reader is slow and will hear of a newer frame."""
        try:
            send()
        except BlockingIOError:
            return False
        except OSError as error:
            raise DeviceLost(f"camera {self._camera}: the service is gone ({error.strerror})") from error
        return True

    def close(self) -> None:
        """May be called again."""
        self._socket.close()


class FrameReader:
    """Our side. `child_fd` is for the camera's process. dropped: frames never delivered since a newer one was there."""

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
        """To be passed on; close_child() when that is done."""
        return self._child_socket.fileno()

    def close_child(self) -> None:
        """Closes our copy of the child's end, so that its death is seen."""
        self._child_socket.close()

    def read(self, timeout_s: float) -> tuple[DepthFrame | None, list[Notification]]:
        """The newest frame not yet delivered, and all words, waiting at most timeout_s for either. Raises DeviceLost
        when the process is gone and BadData when it sends what cannot be."""
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
                    # asked, since after a pause an empty socket's exception takes three times as long
                    if not self._poll.poll(0):
                        break
            except DeviceLost:
                if newest is None and not notifications:
                    raise
                # its last words say why; the next call says that it is gone
        frame = self._frame(newest) if newest is not None else None
        return frame, notifications

    def _wait_readable(self, until_s: float) -> bool:
        """Waits for a word; False when there is none by then."""
        return bool(self._poll.poll(max(0.0, 1000.0 * (until_s - time.monotonic()))))

    def _receive(self) -> _FrameNotice | Notification | None:
        """The next word, None when there is none; of the memory none is made."""
        while True:
            try:
                size, beside, _, _ = self._socket.recvmsg_into([self._buffer], socket.CMSG_SPACE(_DESCRIPTORS.itemsize))
            except BlockingIOError:
                return None
            except OSError as error:
                raise DeviceLost(f"camera {self._camera}: its process is gone ({error.strerror})") from error
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
        """A word in JSON; None when it came with the memory, which is taken."""
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
        """The frame of a word; None when the writer has overtaken us meanwhile."""
        if self._memory is None:
            raise BadData(f"camera {self._camera}: its process told of a frame before it gave the memory")
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
        )

    def close(self) -> None:
        """May be called again."""
        self._socket.close()
        self._child_socket.close()
