"""Checks that the images of a Luxonis OAK state the same intrinsics.

Rectified images of a pair have the same intrinsics. The firmware states them with each image and is not public, so nothing else shows
which camera a statement belongs to. Where two images contradict each other, at least one states a camera before the rectification:
directions would be wrong by the difference of both cameras, 2.5 degrees on one published device.

A stated distortion or pose is not compared: neither shows that the intrinsics are wrong, and what the firmware states of them for a
rectified image is not documented."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import BadData

SAME_INTRINSICS_PX = 0.5
"""Intrinsics that differ by less are the same: an error of less than a pixel in the direction of a point."""


def check_view(images: dict[str, Any], camera: str) -> None:
    """Compares what the images of one exposure state. images: dai.ImgFrame by name, the one whose intrinsics are used first. An image
    that states nothing is not compared. Raises BadData."""
    stated = {name: image.getTransformation() for name, image in images.items()}
    stated = {name: transformation for name, transformation in stated.items() if transformation.isValid()}
    first, *others = stated.items() if stated else [("", None)]
    for name, transformation in others:
        apart_px = _apart_px(first[1], transformation)
        if not apart_px <= SAME_INTRINSICS_PX:  # also catches NaN
            raise BadData(
                f"camera {camera}: the device states intrinsics for its {first[0]} and {name} image that differ by {apart_px:.1f} px, "
                "although rectified images have the same; all directions would be wrong. Restart the device; if this stays, install "
                "another version of depthai and report it"
            )


def _apart_px(one: Any, other: Any) -> float:
    """Greatest difference of focal lengths and principal points; infinite for images of different sizes."""
    if tuple(one.getSize()) != tuple(other.getSize()):
        return math.inf
    difference: NDArray[np.float64] = np.array(one.getIntrinsicMatrix(), np.float64)
    difference = difference - np.array(other.getIntrinsicMatrix(), np.float64)
    return float(np.abs(difference[:2]).max())
