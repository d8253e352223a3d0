"""Writes RVL as the paper describes it, pixel by pixel: the other side of `companion.importers.rvl`."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray


def encode_rvl(image: NDArray[np.uint16]) -> bytes:
    """Width, height and words of an image (H, W)."""
    numbers: list[int] = []
    pixels = image.ravel().tolist()
    at = before = 0
    while at < len(pixels):
        zeros = at
        while at < len(pixels) and pixels[at] == 0:
            at += 1
        others = at
        while at < len(pixels) and pixels[at] != 0:
            at += 1
        numbers += [others - zeros, at - others]
        for value in pixels[others:at]:
            difference = value - before
            numbers.append(2 * difference if difference >= 0 else -2 * difference - 1)
            before = value
    return struct.pack("<II", image.shape[1], image.shape[0]) + words_of(numbers)


def words_of(numbers: list[int]) -> bytes:
    """Numbers of variable length, in 32-bit words."""
    groups = []
    for number in numbers:
        rest = number >> 3
        groups.append((number & 7) | (8 if rest else 0))
        while rest:
            following = rest >> 3
            groups.append((rest & 7) | (8 if following else 0))
            rest = following
    groups += [0] * (-len(groups) % 8)
    return b"".join(
        struct.pack("<I", int("".join(f"{g:x}" for g in groups[i : i + 8]), 16)) for i in range(0, len(groups), 8)
    )
