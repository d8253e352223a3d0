"""A reduced depth image for viewers: a stream of a few images per second, sent only while a subscriber exists.

Planners use the model and need no image. Without a subscriber the cost is one query of the socket per frame (5 us).
With one, an image costs the pipeline thread 0.2 to 0.4 ms (640x480, a loaded cloud machine) after the prisms are
published."""

from __future__ import annotations

import time

import numpy as np
import zmq
from numpy.typing import NDArray

from core.types import DepthFrame
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import SCHEMA_VERSION
from ..streams.curve_auth import ServerKeys
from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher, Stream

NS = 1_000_000_000
ERRORS = (ArithmeticError, LookupError, OSError, TypeError, ValueError, zmq.ZMQError)
"""Errors of image or socket that end the stream but not the service."""
MOST_WAITING = 10
"""Greatest number of images, of all cameras, that wait for a slow subscriber: it shows the newest ones."""
MOST_CHANGES = 1000
"""Changes of subscriptions between two frames. More end the stream: they come faster than they can be read, and wait in memory."""
HZ = 5.0
"""Largest rate of images of each camera."""
WIDTH_PX = 320
"""Largest width of a reduced image."""


def subsample(depth_mm: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """(h, w) uint16: the centre pixel of each n x n block of a depth image (H, W), with the smallest n that gives at
    most WIDTH_PX columns. Pixels are not averaged: the mean of an edge and its background is a point where nothing is.
    """
    step = max(1, -(-depth_mm.shape[1] // WIDTH_PX))
    rows, columns = (max(1, n // step) for n in depth_mm.shape)
    at = min(step // 2, depth_mm.shape[0] - 1)
    return np.ascontiguousarray(depth_mm[at::step, step // 2 :: step][:rows, :columns])


class DepthPreviews:
    """The stream. hz: largest rate of images per camera. `show` is called from one thread, the other methods while it
    does not run."""

    def __init__(self, stamps: PublicationStamps, hz: float = HZ) -> None:
        self._period_ns, self._stamps = round(NS / hz), stamps
        self._publisher: Publisher | None = None
        self._subscribed: set[bytes] = set()
        self._due_ns: dict[str, int] = {}
        self.fault = ""

    def open(self, address: str, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys | None = None) -> None:
        """Binds the socket. An empty address disables the stream. Raises as Publisher does."""
        if address:
            stream = Stream("depth", address)
            self._publisher = Publisher(stream, context, keys, zmq.XPUB, newest_only=False, most_waiting=MOST_WAITING)

    @property
    def sent(self) -> int:
        """Number of images sent."""
        return 0 if self._publisher is None else self._publisher.published

    def close(self) -> None:
        """Closes the socket. May be called twice."""
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None

    def show(self, frame: DepthFrame) -> None:
        """Sends a frame if a subscriber exists and the interval has passed. Never blocks. An error ends the stream."""
        try:
            self._show(frame)
        except ERRORS as error:
            self.fault = f"no depth images for viewers any more ({type(error).__name__}: {error})"
            self.close()

    def _show(self, frame: DepthFrame) -> None:
        now_ns = time.monotonic_ns()
        publisher = self._publisher
        if publisher is None or now_ns < self._due_ns.get(frame.camera, 0) or not self._has_subscriber(publisher):
            return
        self._due_ns[frame.camera] = now_ns + self._period_ns
        small = subsample(frame.depth_mm)
        publisher.publish(
            pb.DepthPreview(
                schema_version=SCHEMA_VERSION,
                camera=frame.camera,
                sequence=frame.sequence,
                t_exposure_ns=frame.t_exposure_ns,
                width_px=small.shape[1],
                height_px=small.shape[0],
                depth_mm=small.astype("<u2", copy=False).tobytes(),
                publication=self._stamps.stamp(publisher.published, now_ns - frame.t_exposure_ns),
            )
        )

    def _has_subscriber(self, publisher: Publisher) -> bool:
        """Whether a subscriber exists. ZeroMQ reports the first and the last subscription of each topic. Raises ValueError for
        more than MOST_CHANGES."""
        for _ in range(MOST_CHANGES):
            if not int(publisher.socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
                return bool(self._subscribed)
            change = publisher.socket.recv(zmq.DONTWAIT)
            if change[:1] == b"\1":
                self._subscribed.add(change[1:])
            elif change[:1] == b"\0":
                self._subscribed.discard(change[1:])
        raise ValueError(f"a subscriber changes its subscriptions more than {MOST_CHANGES} times between two frames")
