"""Checks that the images of a Luxonis OAK state one and the same rectified view.

Rectified images of a pair have the same intrinsics and no distortion, and a depth that is aligned with the left image has its pose.
The firmware states them with each image and is not public, so nothing else shows which camera a statement belongs to. Where two
images contradict each other, at least one states the camera before the rectification: directions would be wrong by the difference
of both cameras, 2.5 degrees on one published device."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import BadData

SAME_INTRINSICS_PX = 0.5
"""Intrinsics that differ by less are the same: an error of less than a pixel in the direction of a point."""
MOST_DISTORTION = 1e-6
MOST_TURNED_RAD, MOST_OFFSET = math.radians(0.1), 0.1
"""Greatest rotation and offset, the latter as a share of the baseline, between the poses of the depth and of the left image."""
_REMEDY = (
    "all directions or positions would be wrong. Restart the device; if this stays, install another version of depthai and "
    "report it"
)


def check_view(images: dict[str, Any], left: str, baseline_m: float, camera: str) -> None:
    """Compares what the images of one exposure state. images: dai.ImgFrame by name, the one whose intrinsics are used first; left: the
    name of the left one. An image that states nothing is not compared. Raises BadData."""
    stated = {name: image.getTransformation() for name, image in images.items()}
    stated = {name: transformation for name, transformation in stated.items() if transformation.isValid()}
    for name, transformation in stated.items():
        if np.abs(np.array(transformation.getDistortionCoefficients() or [0.0])).max() > MOST_DISTORTION:
            raise BadData(
                f"camera {camera}: the device states a distortion for its {name} image, so its intrinsics are those before the "
                f"rectification; {_REMEDY}"
            )
    first, *others = stated.items() if stated else [("", None)]
    for name, transformation in others:
        apart_px = _apart_px(first[1], transformation)
        if not apart_px <= SAME_INTRINSICS_PX:  # also catches NaN
            raise BadData(
                f"camera {camera}: the device states intrinsics for its {first[0]} and {name} image that differ by {apart_px:.1f} px, "
                f"although rectified images have the same; {_REMEDY}"
            )
    if first[0] != left and left in stated:
        _check_pose(first[1], stated[left], baseline_m, camera)


def _apart_px(one: Any, other: Any) -> float:
    """Greatest difference of focal lengths and principal points; infinite for images of different sizes."""
    if tuple(one.getSize()) != tuple(other.getSize()):
        return math.inf
    difference: NDArray[np.float64] = np.array(one.getIntrinsicMatrix(), np.float64)
    difference = difference - np.array(other.getIntrinsicMatrix(), np.float64)
    return float(np.abs(difference[:2]).max())


def _check_pose(depth: Any, left: Any, baseline_m: float, camera: str) -> None:
    """Raises BadData where the depth is stated to be seen from another place or in another direction than the left image."""
    try:
        T_left_depth_cm = np.array(depth.getExtrinsicsTransformationMatrixTo(left), np.float64)
    except (AttributeError, RuntimeError):  # stated since DepthAI 3.6, and not by all devices
        return
    offset_m = float(np.linalg.norm(T_left_depth_cm[:3, 3])) / 100.0
    turned_rad = math.acos(min(1.0, max(-1.0, (float(np.trace(T_left_depth_cm[:3, :3])) - 1.0) / 2.0)))
    if not (offset_m <= MOST_OFFSET * baseline_m and turned_rad <= MOST_TURNED_RAD):  # also catches NaN
        raise BadData(
            f"camera {camera}: the device states that its depth is seen {100.0 * offset_m:.1f} cm and "
            f"{math.degrees(turned_rad):.2f} degrees from its rectified left image, although that one was requested; {_REMEDY}"
        )
