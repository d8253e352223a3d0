"""A fixed piece of work that has nothing to do with the algorithm, timed between the frames of the same run.

Times of two machines, or of one on two days, are best compared as ratios to it."""

from __future__ import annotations

import cv2
import numpy as np

from companion.bench.timing import Clock, Times

WORDS = (
    "a transposed copy of a 640x480 uint16 image, its Sobel derivative of 5 x 5 taps in float32, and the sum of that, "
    "by NumPy and OpenCV on one thread"
)


class Reference:
    """Runs the piece of work and keeps its times."""

    def __init__(self) -> None:
        cv2.setNumThreads(1)
        rng = np.random.Generator(np.random.PCG64(1))
        self._image = rng.integers(300, 20000, (480, 640), np.uint16)
        self._clock = Clock()
        self._work()

    def run(self) -> None:
        """Once more."""
        self._clock.run(self._work)

    def times(self) -> Times:
        """Of all runs so far."""
        return self._clock.times()

    def _work(self) -> float:
        turned = np.ascontiguousarray(self._image.T)
        return float(cv2.Sobel(turned.astype(np.float32), cv2.CV_32F, 1, 0, ksize=5).sum())
