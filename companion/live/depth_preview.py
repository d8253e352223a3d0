"""The depth for people's eyes: a stream of its own, made smaller, a few times a second, and only while somebody listens.

Whoever flies by the model needs no image, so nothing is made of it without a listener: one question to the socket a
frame (5 us). With one, a picture costs the pipeline's thread 0.2 to 0.4 ms (640x480, a busy cloud machine), after the prisms
have gone out."""

from __future__ import annotations

import time

import numpy as np
import zmq
from numpy.typing import NDArray

from core.types import DepthFrame
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import SCHEMA_VERSION
from ..streams.curve_auth import ServerKeys
from ..streams.publisher import Publisher, Stream

NS = 1_000_000_000
ERRORS = (ArithmeticError, LookupError, OSError, TypeError, ValueError, zmq.ZMQError)
"""What a picture or a socket may lead to that was not foreseen."""
WIDTH_PX = 320
"""Pixels are picked at whole steps until the image is no wider than this."""


def subsample(depth_mm: NDArray[np.uint16], width_px: int = WIDTH_PX) -> NDArray[np.uint16]:
    """(h, w) uint16 of a depth image (H, W): the middle one of each n x n pixels, n the least that makes it no wider than
    width_px. Never blended: between an edge and what lies behind it there is nothing."""
    step = max(1, -(-depth_mm.shape[1] // width_px))
    rows, columns = (max(1, n // step) for n in depth_mm.shape)
    at = min(step // 2, depth_mm.shape[0] - 1)
    return np.ascontiguousarray(depth_mm[at::step, step // 2 :: step][:rows, :columns])


class DepthPreviews:
    """The stream. hz: pictures a second of each camera, at most. `show` from one thread, the others while it rests."""

    def __init__(self, hz: float, boot_id: str) -> None:
        self._period_ns, self._boot = round(NS / hz), boot_id
        self._publisher: Publisher | None = None
        self._listeners: set[bytes] = set()
        self._due_ns: dict[str, int] = {}
        self.fault = ""

    def open(self, address: str, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys | None = None) -> None:
        """Binds the socket; an empty address: there is no such stream. Raises as Publisher does."""
        if address:
            self._publisher = Publisher(Stream("depth", address), context, keys, zmq.XPUB, newest_only=False)

    @property
    def sent(self) -> int:
        """Pictures so far."""
        return 0 if self._publisher is None else self._publisher.published

    def close(self) -> None:
        """May be called again."""
        if self._publisher is not None:
            self._publisher.close()
            self._publisher = None

    def show(self, frame: DepthFrame) -> None:
        """Sends a frame where one is wanted and due. Never waits. An error ends the stream and not the flight."""
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
                schema_version=SCHEMA_VERSION, camera=frame.camera, sequence=frame.sequence,
                t_exposure_ns=frame.t_exposure_ns, width_px=small.shape[1], height_px=small.shape[0],
                depth_mm=small.astype("<u2", copy=False).tobytes(),
                publication=pb.Publication(
                    boot_id=self._boot, number=publisher.published, age_ns=now_ns - frame.t_exposure_ns
                ),
            )
        )  # fmt: skip

    def _has_subscriber(self, publisher: Publisher) -> bool:
        """Whether somebody listens. ZeroMQ tells of the first and of the last one of each kind."""
        while int(publisher.socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            word = publisher.socket.recv(zmq.DONTWAIT)
            if word[:1] == b"\1":
                self._listeners.add(word[1:])
            elif word[:1] == b"\0":
                self._listeners.discard(word[1:])
        return bool(self._listeners)
