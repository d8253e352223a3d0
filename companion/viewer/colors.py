"""The colour scale of pictures and pages: a depth becomes one byte, the byte a colour.

0 is unknown (grey), 255 is "free to the maximum range" (pale), 1..254 go from near (red) to far (blue) on a logarithmic
scale, so that one metre nearby is as visible as ten metres far away."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from core.params import Params
from core.stages.classify import clear_range_m
from core.types import FAR_MM, SATURATED_MM, CameraInfo

UNKNOWN_INDEX, FAR_INDEX = 0, 255
FIRST, LAST = 1, 254
UNKNOWN_RGB = (140, 140, 140)
UNKNOWN_STRIPE_RGB = (112, 112, 112)
FAR_RGB = (226, 238, 250)


def range_index(range_m: NDArray[np.floating], info: CameraInfo) -> NDArray[np.uint8]:
    """Byte of each distance, m, between the camera's minimum and maximum range; same shape, clipped."""
    span = np.log(info.max_range_m / info.min_range_m)
    share = np.log(np.maximum(range_m, 1e-3) / info.min_range_m) / span
    steps = np.clip(np.rint(share * (LAST - FIRST)), 0, LAST - FIRST)
    return np.asarray(FIRST + steps, dtype=np.uint8)


def depth_index(depth_mm: NDArray[np.uint16], info: CameraInfo, ke_per_m: float | None = None) -> NDArray[np.uint8]:
    """(H, W) uint8 of a depth image in millimetres, classified as in the core: below the camera's minimum range
    unknown, beyond its reliable range far. ke_per_m: the frame's noise; None: the camera's prior."""
    clear_m = clear_range_m(info, info.ke_per_m if ke_per_m is None else ke_per_m, Params())
    index = range_index(depth_mm.astype(np.float32) / 1000.0, info)
    unknown = (depth_mm < info.least_mm) | (depth_mm == SATURATED_MM)
    index[depth_mm > 1000.0 * clear_m] = FAR_INDEX
    index[depth_mm == FAR_MM] = FAR_INDEX
    index[unknown] = UNKNOWN_INDEX
    return index


def index_range_m(index: int, info: CameraInfo) -> float:
    """The distance, m, of a byte 1..254."""
    share = (index - FIRST) / (LAST - FIRST)
    return float(info.min_range_m * (info.max_range_m / info.min_range_m) ** share)


def palette() -> NDArray[np.uint8]:
    """(256, 3) uint8 RGB of every byte."""
    ramp = np.linspace(240, 16, LAST - FIRST + 1).astype(np.uint8)  # the dark ends of the map are hard to distinguish
    table = np.zeros((256, 3), np.uint8)
    table[FIRST : LAST + 1] = cv2.applyColorMap(ramp[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    table[UNKNOWN_INDEX] = UNKNOWN_RGB
    table[FAR_INDEX] = FAR_RGB
    return table


def depth_rgb(depth_mm: NDArray[np.uint16], info: CameraInfo, ke_per_m: float | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 picture of a depth image, unknown pixels hatched."""
    index = depth_index(depth_mm, info, ke_per_m)
    rgb = palette()[index]
    rows, columns = np.indices(index.shape)
    stripe = max(4, index.shape[0] // 60)
    rgb[(index == UNKNOWN_INDEX) & ((rows + columns) // stripe % 2 == 0)] = UNKNOWN_STRIPE_RGB
    return np.ascontiguousarray(rgb)
