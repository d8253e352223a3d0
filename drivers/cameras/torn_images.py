"""Detects images with old content: those of a USB video device that arrived in part, whose last rows are of an earlier image, and
a pair of which one image repeats.

A buffer that was not filled keeps at its end what it held before, as many bytes as were lost: the kernel's driver moves up what
follows a lost packet, so that the rows after it mix both eyes. The driver states how many bytes arrived, and marks the buffer as
faulty (kernel_capture.py). What the image itself shows is a second test: in a live image the noise changes every row that shows
anything."""

from __future__ import annotations

import functools
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..base import BadData

Pair = tuple[NDArray[np.uint8], NDArray[np.uint8]]
BUFFERS = 4
"""Images that may be in the buffers: one is requested, and a driver may have more."""
LEAST_STEP_GREY, LEAST_SHARE, LEAST_STEPS = 3, 0.01, 100
"""Rows that do not change count where steps of this size along the row make up this share of their pixels, and at least this
number. Black and saturated rows do not change either; nothing can be matched on them."""
END_PX, LEAST_END_STEPS = 480, 24
"""Pixels at the end of the last row that are compared, less than the 1012 bytes that one packet of USB carries, and least number of
steps in them where the row began anew."""
MOST_IN_A_ROW = 10
MOST_BLACK_GREY, LEAST_SATURATED_GREY = 30, 250
"""A row of one colour up to the first level, and from the second one on, may be that of a live image."""
_STEP_ROWS = 16
"""Some rows are compared before all."""


@dataclass(slots=True)
class TornImageCheck:
    """The check of one device since its opening."""

    camera: str
    _images: deque[NDArray[np.uint8]] = field(default_factory=lambda: deque(maxlen=BUFFERS))
    _torn: int = 0

    def is_torn(self, image: NDArray[np.uint8]) -> bool:
        """Whether an image (H, W, C) ends as an earlier one, or as a buffer that was not filled. An image that equals the one before is
        not torn: it is repeated, which the supervision of the camera judges. Raises BadData where many are torn in a row."""
        torn = self._shows_tear(image)
        self._images.append(image)
        self._torn = self._torn + 1 if torn else 0
        if self._torn >= MOST_IN_A_ROW:
            raise BadData(
                f"camera {self.camera}: the last {self._torn} images arrived in part only; check the cable, use a USB 3 port of "
                "its own, or lower fps"
            )
        return torn

    def _shows_tear(self, image: NDArray[np.uint8]) -> bool:
        if self._images and _is(image, self._images[-1]):
            return False
        if _ends_unfilled(image):
            return True
        ends = {_common_end(image, earlier) for earlier in self._images if _ends_alike(image, earlier)}
        return any(_end_shows_something(image, rows) for rows in ends)


def one_repeats(pair: Pair, before: Pair) -> bool:
    """Whether exactly one image (H, W) of a pair is that of the pair before, and shows something. If both are, the depth repeats,
    which the supervision of the camera judges."""
    same = [
        _is(image[::_STEP_ROWS], old[::_STEP_ROWS]) and _is(image, old) for image, old in zip(pair, before, strict=True)
    ]
    return same[0] != same[1] and _shows_something(pair[0] if same[0] else pair[1])


def _is(image: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    return bool(np.array_equal(image, other))


def _ends_unfilled(image: NDArray[np.uint8]) -> bool:
    """Whether the last row is no row of a live sensor, whose noise changes each pixel: it has one colour that is neither black nor
    saturated, as the green of zeros, or is that of the row above, which shows something. A dark ground may be black throughout."""
    last = image[-1, -END_PX:]
    if _is(last, np.broadcast_to(last[-1], last.shape)):
        return bool(last[-1].max() > MOST_BLACK_GREY and last[-1].min() < LEAST_SATURATED_GREY)
    return _is(last, image[-2, -END_PX:]) and _shows_something(_brightest(image[-1:, -END_PX:]), LEAST_END_STEPS)


def _ends_alike(image: NDArray[np.uint8], earlier: NDArray[np.uint8]) -> bool:
    """Whether both end with the same pixels."""
    return image.shape == earlier.shape and _is(image[-1, -END_PX:], earlier[-1, -END_PX:])


def _end_shows_something(image: NDArray[np.uint8], rows: int) -> bool:
    """Whether the end that an image has in common with an earlier one shows something. rows: number of whole rows in it."""
    if rows:
        return _shows_something(_brightest(image[-rows:]))
    return _shows_something(_brightest(image[-1:, -END_PX:]), LEAST_END_STEPS)


def _common_end(image: NDArray[np.uint8], earlier: NDArray[np.uint8]) -> int:
    """Number of last rows that are equal, by bisection: at night hundreds of rows are."""
    height = len(image)
    equal, most = 0, height
    while equal < most:
        rows = (equal + most + 1) // 2
        between = slice(height - rows, height - equal)
        if _is(image[between], earlier[between]):
            equal = rows
        else:
            most = rows - 1
    return equal


def _brightest(rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(N, W) the greatest channel of each pixel of rows (N, W, C)."""
    return functools.reduce(np.maximum, np.moveaxis(rows, 2, 0))


def _shows_something(rows: NDArray[np.uint8], least: int = LEAST_STEPS) -> bool:
    """Whether rows (N, W) have enough contrast that the noise would change them. least: number of steps."""
    steps = np.abs(np.diff(rows.astype(np.int16), axis=1)) >= LEAST_STEP_GREY
    return bool(np.count_nonzero(steps) >= max(least, LEAST_SHARE * steps.size))
