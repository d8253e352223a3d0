"""Depth images of a folder: 16-bit PNGs with intrinsics.json, or stereo pairs that are matched here."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo

from .frames_csv import FrameRow
from .intrinsics_json import DepthCoding
from .png import read_depth_png


class DepthImages(Protocol):
    """The images of one camera."""

    @property
    def info(self) -> CameraInfo:
        """The camera."""
        ...

    def read(self, row: FrameRow) -> NDArray[np.uint16]:
        """(H, W) uint16 millimetres of a row's image. Raises BadData."""
        ...


class PngImages:
    """16-bit grey PNGs."""

    def __init__(self, folder: Path, info: CameraInfo, coding: DepthCoding) -> None:
        self._folder, self.info, self._coding = folder, info, coding

    def read(self, row: FrameRow) -> NDArray[np.uint16]:
        """(H, W) uint16 millimetres. Raises BadData."""
        k = self.info.intrinsics
        return read_depth_png(self._folder / row.file, (k.width, k.height), self._coding.unit_mm, self._coding.invalid)
