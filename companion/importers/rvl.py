"""Depth images compressed with RVL, as ROS's compressedDepth transport writes them with the parameter `format = rvl`.

Source: A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017. The image is a sequence of runs: a number of zero
pixels, a number of other pixels, and for each of these the difference from the other pixel before it. All numbers have a
variable length: four bits at a time, of which three are data (lowest first) and the highest says that more follow. Eight
of these groups fill a 32-bit word, highest bits first; words are little-endian.

ROS puts the width and the height, as 32-bit numbers, before the words."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadData

from .png import MAX_SIDE_PX

_SIZE: Final = struct.Struct("<II")
_MOST_GROUPS: Final = 11
"""Groups of the longest number, of 32 bits."""
_MOST_PIXELS: Final = MAX_SIDE_PX**2
_DAMAGED: Final = "a compressed depth image whose RVL data are damaged: "


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """(H, W) uint16: the image. data: width, height and words. Raises BadData."""
    if len(data) < _SIZE.size:
        raise BadData(f"{_DAMAGED}they end before the size of the image")
    width, height = _SIZE.unpack_from(data)
    pixels = width * height
    if not 0 < pixels <= _MOST_PIXELS:
        raise BadData(f"{_DAMAGED}an image of {width} x {height} pixels")
    numbers = _numbers(data[_SIZE.size :])
    places, others = _runs(numbers, pixels)
    values = np.cumsum(_signed(numbers[others]))
    if ((values < 1) | (values > np.iinfo(np.uint16).max)).any():
        raise BadData(f"{_DAMAGED}a depth outside of 1 to 65535")
    image = np.zeros(pixels, np.uint16)
    image[places] = values
    return image.reshape(height, width)


def _numbers(data: bytes) -> NDArray[np.int64]:
    """(N,) int64: the numbers of variable length; a number that the data cut short is left out. Raises BadData."""
    words = np.frombuffer(data, "<u4", count=len(data) // 4)
    groups = (words[:, None] >> np.arange(28, -1, -4, dtype=np.uint32)).ravel() & 0xF
    ends = np.flatnonzero(groups < 8) + 1
    if not len(ends):
        return np.zeros(0, np.int64)
    groups = groups[: ends[-1]].astype(np.int64)
    starts = np.concatenate(([0], ends[:-1]))
    lengths = ends - starts
    if lengths.max() > _MOST_GROUPS:
        raise BadData(f"{_DAMAGED}a number of more than 32 bits")
    shifts = 3 * (np.arange(len(groups)) - np.repeat(starts, lengths))
    return np.asarray(np.add.reduceat((groups & 7) << shifts, starts), np.int64)


def _runs(numbers: NDArray[np.int64], pixels: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of all pixels that are not zero: (K,) their indices in the image, and (K,) those of their numbers. Raises BadData."""
    places, others = [], []
    pixel = at = 0
    while pixel < pixels:
        if at + 2 > len(numbers):
            raise BadData(f"{_DAMAGED}they end at pixel {pixel} of {pixels}")
        zeros, count = int(numbers[at]), int(numbers[at + 1])
        pixel, at = pixel + zeros, at + 2
        if zeros + count == 0 or pixel + count > pixels:
            raise BadData(f"{_DAMAGED}a run of {zeros + count} pixels at pixel {pixel - zeros} of {pixels}")
        if at + count > len(numbers):
            raise BadData(f"{_DAMAGED}they end at pixel {pixel + len(numbers) - at} of {pixels}")
        places.append(np.arange(pixel, pixel + count))
        others.append(np.arange(at, at + count))
        pixel, at = pixel + count, at + count
    return np.concatenate(places), np.concatenate(others)


def _signed(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, 2, 3, 4 ... stand for 0, -1, 1, -2, 2 ..."""
    return (numbers >> 1) ^ -(numbers & 1)
