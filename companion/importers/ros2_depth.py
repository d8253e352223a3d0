"""Depth images of ROS messages: sensor_msgs/Image, and CompressedImage of the compressedDepth transport."""

from __future__ import annotations

import struct
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import UNKNOWN_MM
from drivers.base import BadData

from .png import MAX_SIDE_PX, SIGNATURE, decoded, millimetres
from .ros2_decode import COMPRESSED
from .ros2_frames import depth_from_image
from .rvl import decode_rvl

_CONFIG: Final = struct.Struct("<iff")
"""Before the PNG or RVL data of compressedDepth: format, and two parameters A, B of the quantised inverse depth."""

_PNG_SIZE_AT: Final = len(SIGNATURE) + 8
_PNG_SIZE: Final = struct.Struct(">II")
"""Width and height in the first chunk of a PNG."""


def encoding_of(kind: str, message: Any) -> str:
    """The encoding of an image message, such as 16UC1; of a compressed image, its whole format where it is no depth."""
    if kind != COMPRESSED:
        return str(message.encoding)
    encoding, _, transport = str(message.format).partition(";")
    is_depth = "compressedDepth" in transport or ("png" in transport and encoding.strip() in ("16UC1", "mono16"))
    return encoding.strip() if is_depth else str(message.format)


def depth_of(kind: str, message: Any) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres of an image message. Raises BadData."""
    return depth_from_image(message) if kind != COMPRESSED else _compressed_depth(message)


def _compressed_depth(message: Any) -> NDArray[np.uint16]:
    """16UC1: millimetres. 32FC1: 16 bits of the inverse depth, Z = A / (value - B) metres, 0: unknown."""
    data, transport = bytes(message.data), str(message.format)
    raw = decode_rvl(data[_CONFIG.size :]) if "rvl" in transport.lower() else _png(data)
    if not transport.startswith("32FC1"):
        return millimetres(raw, 1.0)
    if data.startswith(SIGNATURE):
        raise BadData("a compressed 32FC1 image without the parameters of its inverse depth")
    _, a, b = _CONFIG.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_mm = 1000.0 * a / (raw.astype(np.float64) - b)
    return millimetres(np.where(raw > 0, depth_mm, UNKNOWN_MM), 1.0)


def _png(data: bytes) -> NDArray[np.uint16]:
    """(H, W) uint16; the parameters may be absent. Raises BadData."""
    header = 0 if data.startswith(SIGNATURE) else _CONFIG.size
    if not data[header:].startswith(SIGNATURE):
        raise BadData("a compressed depth image that contains no PNG")
    if len(data) >= header + _PNG_SIZE_AT + _PNG_SIZE.size:
        width, height = _PNG_SIZE.unpack_from(data, header + _PNG_SIZE_AT)
        if max(width, height) > MAX_SIDE_PX:
            raise BadData(
                f"a compressed depth image that is damaged, or of {width} x {height} pixels; at most {MAX_SIDE_PX} x {MAX_SIDE_PX} "
                "are read"
            )
    raw = decoded(np.frombuffer(data, np.uint8, offset=header), cv2.IMREAD_UNCHANGED)
    if raw is None or raw.dtype != np.uint16 or raw.ndim != 2:
        raise BadData("a compressed depth image whose PNG is damaged or not 16-bit grey")
    return np.asarray(raw, np.uint16)
