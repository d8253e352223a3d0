"""Reads a depth PNG as uint16 millimetres; each kind of unsuitable file has its own error."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import FAR_MM, UNKNOWN_MM
from drivers.base import BadData
from drivers.regular_file import regular

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_SIDE_PX = 4096
"""Limit of the width and height of an image: a small file can state a size of gigabytes."""
COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey with alpha", 6: "RGBA"}


def read_depth_png(
    path: Path, size: tuple[int, int], unit_mm: float = 1.0, invalid: Sequence[int] = (0, 65535)
) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres; UNKNOWN_MM where the file's value is in `invalid` or cannot be represented.

    size: (width, height) of the intrinsics. unit_mm: millimetres per step. Raises BadData."""
    try:
        data = regular(path).read_bytes()
    except OSError as error:
        raise BadData(f"{path}: cannot be read ({error.strerror})") from error
    width, height = _checked(path, data)
    if (width, height) != size:
        raise BadData(
            f"{path}: {width}x{height} pixels, but intrinsics.json is for {size[0]}x{size[1]}; use the intrinsics of "
            "the images' resolution"
        )
    raw = decoded(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if raw is None or raw.dtype != np.uint16 or raw.shape != (height, width):
        raise BadData(f"{path}: its pixels cannot be decoded; save it again as a 16-bit grey PNG")
    depth = millimetres(raw, unit_mm)
    depth[np.isin(raw, np.array(list(invalid), dtype=np.int64))] = UNKNOWN_MM
    return depth


def decoded(data: NDArray[np.uint8], flags: int) -> Any:
    """The image of OpenCV; None where it cannot be decoded, which OpenCV reports in two ways."""
    try:
        return cv2.imdecode(data, flags) if len(data) else None
    except cv2.error:  # a size of more pixels than OpenCV reads
        return None


def millimetres(raw: NDArray[Any], unit_mm: float) -> NDArray[np.uint16]:
    """Millimetres of depths in steps of unit_mm, same shape, uint16. What is not finite, not positive or cannot be
    represented becomes unknown, also the two largest numbers, which mean "far" and "saturated" in this software."""
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = np.rint(raw.astype(np.float64) * unit_mm)
        valid = (scaled > 0.0) & (scaled < FAR_MM)  # false for NaN
    return np.where(valid, scaled, UNKNOWN_MM).astype(np.uint16)


def _checked(path: Path, data: bytes) -> tuple[int, int]:
    """(width, height) of a complete 16-bit grey PNG. OpenCV alone would convert other kinds and accept incomplete
    files."""
    if not data.startswith(SIGNATURE):
        raise BadData(f"{path}: not a PNG; depth images are 16-bit grey PNGs")
    at, header, ended = len(SIGNATURE), b"", False
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        tail = data[at + 8 + length : at + 12 + length]
        if len(tail) < 4:
            break
        if zlib.crc32(kind + body) != struct.unpack(">I", tail)[0]:
            raise BadData(f"{path}: damaged (wrong checksum); copy it again from the original")
        header = header or body
        at += 12 + length
        ended = kind == b"IEND"
        if ended:
            break
    if not ended or len(header) != 13:
        raise BadData(f"{path}: incomplete; copy it again from the original")
    width, height, bits, colour = struct.unpack_from(">IIBB", header)
    if bits != 16 or colour != 0:
        kind_name = COLOURS.get(colour, f"colour type {colour}")
        raise BadData(
            f"{path}: {bits}-bit {kind_name}, expected 16-bit grey; save the depth itself (uint16), not a rendered "
            "image"
        )
    return int(width), int(height)
