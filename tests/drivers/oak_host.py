"""A depthai pipeline that runs on the host alone: real messages, real queues, no device."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

os.environ.setdefault("DEPTHAI_LEVEL", "error")
os.environ.setdefault("DEPTHAI_INSTALL_SIGNAL_HANDLER", "0")

import depthai as dai
import numpy as np

from drivers.cameras.oak_pipeline import OakSettings, synchronised
from drivers.cameras.stereo import MatchParams

WIDTH, HEIGHT = 64, 40
DEVICE_ALONE = MatchParams(correlation=0.0, texture=0.0, period=1.0)
"""No rule of the host: the images are not requested."""
PERIOD_S = 0.04
"""Of frames with images, in settings and in the pipeline of the host."""
MATRIX = [[45.0, 0.0, 31.5], [0.0, 45.0, 19.5], [0.0, 0.0, 1.0]]


def now() -> timedelta:
    """The host's monotonic clock."""
    return timedelta(microseconds=time.monotonic_ns() // 1000)


def stamp_ns(message: dai.ImgFrame) -> int:
    """The stamp of an image, ns."""
    return message.getTimestamp() // timedelta(microseconds=1) * 1000


def depth_message(number: int, **changes: Any) -> dai.ImgFrame:
    """A RAW16 frame as StereoDepth sends it. changes: pixels, age_s or stamp, matrix, kind, size of its transformation."""
    message = dai.ImgFrame()
    pixels = changes.get("pixels", np.full((HEIGHT, WIDTH), 1000 + number, np.uint16))
    message.setCvFrame(pixels, changes.get("kind", dai.ImgFrame.Type.RAW16))
    message.setTimestamp(changes.get("stamp", now() - timedelta(seconds=changes.get("age_s", 0.02))))
    message.setSequenceNum(number)
    transformation = dai.ImgTransformation(*changes.get("size", pixels.shape[::-1]))
    transformation.setIntrinsicMatrix(changes.get("matrix", MATRIX))
    message.setTransformation(transformation)
    return message


def image_message(
    number: int, pixels: np.ndarray, stamp: timedelta, kind: Any = dai.ImgFrame.Type.RAW8
) -> dai.ImgFrame:
    """A rectified image as StereoDepth sends it."""
    message = dai.ImgFrame()
    message.setCvFrame(pixels, kind)
    message.setTimestamp(stamp)
    message.setSequenceNum(number)
    return message


def group_message(parts: dict[str, dai.ImgFrame]) -> dai.MessageGroup:
    """A group as a Sync node sends it."""
    group = dai.MessageGroup()
    for name, message in parts.items():
        group[name] = message
    return group


QUEUE = 1000
"""Length of the queue before the driver: it never fills. A message that was made in Python and is dropped by a full queue needs the
GIL under the lock of the queue, for which `tryGetAll` waits with the GIL: both wait for ever. Messages of a device need no GIL."""


class HostPair(dai.node.ThreadedHostNode):
    """Sends what `make` gives for 0, 1, 2, ..., each part at the output of its name; a part may be missing."""

    def __init__(self, names: tuple[str, ...], make: Callable[[int], dict[str, dai.ImgFrame]], period_s: float) -> None:
        super().__init__()
        self._make, self._period_s = make, period_s
        self.outs = {name: self.createOutput(name) for name in names}

    def run(self) -> None:
        number = 0
        while self.isRunning():
            for name, message in self._make(number).items():
                self.outs[name].send(message)
            number += 1
            time.sleep(self._period_s)


class HostCamera(dai.node.ThreadedHostNode):
    """Sends what `make` gives for 0, 1, 2, ...; ends with the first None."""

    def __init__(self, make: Callable[[int], dai.ImgFrame | None], period_s: float) -> None:
        super().__init__()
        self._make, self._period_s = make, period_s
        self.out = self.createOutput()

    def run(self) -> None:
        number = 0
        while self.isRunning():
            message = self._make(number)
            if message is None:
                return
            self.out.send(message)
            number += 1
            time.sleep(self._period_s)


class HostLink:
    """What drivers.cameras.oak_pipeline.connect_device gives, on the host."""

    baseline_m: float = 0.075
    identity = "OAK 19443010AA"

    def __init__(self, make: Callable[[int], dai.ImgFrame | None], period_s: float = 0.01) -> None:
        self._pipeline = dai.Pipeline(createImplicitDevice=False)
        node = self._pipeline.create(HostCamera, make, period_s)
        self.queue = node.out.createOutputQueue(QUEUE, False)
        self._pipeline.start()
        self._stopped = False

    def __call__(self, settings: OakSettings) -> HostLink:
        return self

    def running(self) -> bool:
        return not self._stopped and bool(self._pipeline.isRunning())

    def stop(self) -> None:
        """As if it were unplugged."""
        self._stopped = True
        self._pipeline.stop()

    def close(self) -> None:
        self._pipeline.stop()
        self._pipeline.wait()


class HostPairLink(HostLink):
    """The same with rectified images: the driver's synchronisation of several streams."""

    def __init__(
        self,
        make: Callable[[int], dict[str, dai.ImgFrame]],
        baseline_m: float = 0.075,
        streams: tuple[str, ...] = ("depth", "left", "right"),
    ) -> None:
        self.baseline_m = baseline_m
        self._pipeline = dai.Pipeline(createImplicitDevice=False)
        node = self._pipeline.create(HostPair, streams, make, PERIOD_S)
        self.queue = synchronised(self._pipeline, node.outs, 0.4 * PERIOD_S).createOutputQueue(QUEUE, False)
        self._pipeline.start()
        self._stopped = False
