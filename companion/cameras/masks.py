"""Masks of pixels that show the vehicle or can never be measured.

Masked pixels are unknown whatever the camera measures there: they give no obstacle, and nothing behind them is free. A
direction in which masked pixels, or the columns that stereo matching cannot measure, take too large a share counts as
not observed by the camera: it is reported as unseen, and the camera's failure adds no obstacle there."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from core.types import UNKNOWN_MM, CameraInfo, Intrinsics

from ..config.camera import CameraConfig
from ..config.loader import Config

Mask = NDArray[np.bool_]


def polygons(text: str) -> list[list[tuple[float, float]]]:
    """The corners of each polygon of `masks`. Two corners define a rectangle."""
    out = []
    for part in filter(None, (p.strip() for p in text.split(";"))):
        corners = [(float(u), float(v)) for u, v in (pair.split(",") for pair in re.split(r"\s+", part))]
        if len(corners) == 2:
            (u0, v0), (u1, v1) = corners
            corners = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
        out.append(corners)
    return out


def configured_mask(section: CameraConfig, info: CameraInfo) -> Mask | None:
    """(H, W) pixels that the configuration masks; None: no mask."""
    if not section.masks:
        return None
    k = info.intrinsics
    out = np.zeros((k.height, k.width), bool)
    for corners in polygons(section.masks):
        out |= _inside(k, corners)
    return out


def masks_of(config: Config) -> Callable[[CameraInfo], Mask | None]:
    """A function that returns the `configured_mask` of a camera."""
    return lambda info: configured_mask(config.camera(info.camera), info)


def outside_text(section: CameraConfig, info: CameraInfo) -> str:
    """The polygons of `masks` that contain no pixel of the image, with the remedy; "": none, as for the size of the image that
    they were drawn in."""
    k = info.intrinsics
    outside = [corners for corners in polygons(section.masks) if not _inside(k, corners).any()]
    named = "; ".join(" ".join(f"{u:g},{v:g}" for u, v in corners) for corners in outside)
    if not outside:
        return ""
    return (
        f"masks: no pixel of the image of {k.width}x{k.height} is in {named}: nothing is hidden there; draw the masks in an image "
        "of this size"
    )


def unmeasured_mask(section: CameraConfig, info: CameraInfo, least_share: float) -> Mask | None:
    """(H, W) pixels that are never measured: masked ones, and columns at the left that stereo matching cannot measure. None: no
    such pixels, or a mistake that leaves too few for a valid frame: otherwise hardly a direction would be the camera's, and
    ArduPilot would receive unknown in its view, which it treats as clear, in place of the artificial wall. least_share: [expert]
    min_measured_share."""
    mask, columns = configured_mask(section, info), section.unmatched_px
    if mask is None and columns == 0:
        return None
    k = info.intrinsics
    out = np.zeros((k.height, k.width), bool) if mask is None else mask
    out[:, :columns] = True
    return None if 1.0 - out.mean() <= least_share else out


def apply_mask(depth_mm: NDArray[np.uint16], mask: Mask | None) -> NDArray[np.uint16]:
    """(H, W) uint16 mm with masked pixels set to unknown. An image of another size is returned unchanged; the pipeline
    refuses it."""
    if mask is None or mask.shape != depth_mm.shape:
        return depth_mm
    return np.where(mask, np.uint16(UNKNOWN_MM), depth_mm)


def _inside(image: Intrinsics, corners: list[tuple[float, float]]) -> Mask:
    """(H, W) whether pixels lie in a polygon, by the parity of its edges to their right. Points on the upper and left edges
    are inside."""
    v, u = np.mgrid[0 : image.height, 0 : image.width].astype(np.float64)
    out = np.zeros(u.shape, bool)
    for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
        if v0 != v1:
            crosses = (v0 > v) != (v1 > v)
            out ^= crosses & (u < u0 + (v - v0) * (u1 - u0) / (v1 - v0))
    return out
