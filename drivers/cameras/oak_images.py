"""Pixels and exposure times of the images of a Luxonis OAK."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import FAR_MM, UNKNOWN_MM


def decoded(message: Any) -> NDArray[Any]:
    """The pixels of a dai.ImgFrame, (H, W) for an image of one channel. Raises ValueError where bytes are missing, and RuntimeError for
    what the library cannot decode.

    The library compares the number of bytes with that of lines without padding: of padded lines it would read the missing ones from
    what lies behind them in memory."""
    line = round(message.getWidth() * message.getBytesPerPixel())
    least = message.getStride() * (message.getHeight() - 1) + line  # the last line needs no padding
    found = len(message.getData())
    if found < least:
        raise ValueError(f"{found} of {least} bytes")
    return np.asarray(message.getFrame())


def distances(depth_mm: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """(H, W) uint16 mm of a depth image, in which 0 is no measurement. The two greatest values, with which other software marks a pixel, are
    none either: FAR_MM would be free space."""
    return np.where(depth_mm < FAR_MM, depth_mm, np.uint16(UNKNOWN_MM))


def middle_ns(message: Any) -> int:
    """Mid-exposure of a dai.ImgFrame on the host's monotonic clock."""
    import depthai as dai

    return nanoseconds(message.getTimestamp(dai.CameraExposureOffset.MIDDLE))


def nanoseconds(time: timedelta) -> int:
    """A time in ns, to the microsecond."""
    return time // timedelta(microseconds=1) * 1000


def half_exposure_ns(message: Any) -> int:
    """Half of the exposure time that a dai.ImgFrame states."""
    exposure: timedelta = message.getExposureTime()
    return exposure // timedelta(microseconds=1) * 500
