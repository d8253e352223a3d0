"""Raw stereo pairs of a ZED as depth images: rectified and matched as by the camera's driver.

A pair is one side-by-side image (column `file`), or two images (columns `file` and `file_right`). The factory calibration
SN<serial>.conf lies in the same folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo
from drivers.base import BadData
from drivers.cameras.row_alignment import RowAlignment
from drivers.cameras.row_check import matched_corners
from drivers.cameras.stereo import MatchParams, StereoDepth, nearest_m
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient
from drivers.cameras.zed_calibration import load_zed_calibration
from drivers.cameras.zed_uvc import DISPARITY_SIGMA_PX, halves
from drivers.regular_file import regular

from .frames_csv import FrameRow
from .png import decoded
from .report import ImportOptions, Report

Gray = NDArray[np.uint8]
ALIGNED_PAIRS = 10
"""Pairs of a recording by which the rows of its images are aligned, at most."""


def find_calibration(folder: Path) -> Path | None:
    """The calibration of a folder with stereo pairs; None: it has none. Raises BadData for several."""
    found = sorted(folder.glob("SN*.conf"))
    if len(found) > 1:
        raise BadData(f"{folder}: several calibrations ({', '.join(f.name for f in found)}); leave that of the camera")
    return found[0] if found else None


class StereoImages:
    """Pairs of one calibration; the first one gives the size of the images. Raises DriverError."""

    def __init__(
        self, folder: Path, calibration: Path, rows: list[FrameRow], options: ImportOptions, report: Report
    ) -> None:
        self._folder = folder
        left, right = self._pair(rows[0])
        height, width = left.shape
        c = options.camera
        match = MatchParams(
            disparities=c.disparities, correlation=c.match_correlation, texture=c.match_texture, period=c.match_period
        )
        self._stereo = StereoDepth(load_zed_calibration(calibration, width, height), match)
        self._check(calibration, left, right, report)
        row_error_px = self._align(c.name, calibration, rows)
        optics = self._stereo.intrinsics.fx, self._stereo.baseline_m
        info = CameraInfo(
            c.name,
            self._stereo.intrinsics,
            ke_per_m=noise_coefficient(DISPARITY_SIGMA_PX, *optics),
            bias_per_m=bias_coefficient(self._stereo.intrinsics, optics[1], row_error_px),
        )
        nearest = nearest_m(optics[0] * optics[1], match.searched)
        info = c.applied_to(info)
        self.info = replace(info, min_range_m=max(info.min_range_m, nearest))
        report.note(
            f"stereo pairs matched with {calibration.name}: {width}x{height} px, baseline "
            f"{1000 * self._stereo.baseline_m:.0f} mm, {c.disparities} disparities (nearest {nearest:.2f} m); rows of the "
            f"images aligned by up to {self._stereo.rotation.greatest_row_px(self._stereo.intrinsics):.2f} px"
        )

    def _check(self, calibration: Path, left: Gray, right: Gray, report: Report) -> None:
        """Raises BadData when the corners of both rectified images do not fit."""
        found = matched_corners(*self._stereo.rectified(left, right))
        if found.fault:
            raise BadData(
                f"{calibration}: {found.fault} in the first pair; the calibration belongs to another camera, or left and "
                "right are exchanged"
            )
        if not found.enough:
            report.warning("stereo", f"too few corners in the first pair ({found.corners}) to check {calibration}")

    def _align(self, camera: str, calibration: Path, rows: list[FrameRow]) -> float:
        """Aligns the rows of both images by pairs from the whole recording; returns the error of the calibration in pixels. Raises
        BadData where these pairs show that the calibration is wrong."""
        k = self._stereo.intrinsics
        remedy = f"{calibration} belongs to another camera, or left and right are exchanged"
        alignment = RowAlignment(camera, remedy, corrects=True)
        for row in rows[:: -(-len(rows) // ALIGNED_PAIRS)]:
            try:
                left, right = self._pair(row)
            except BadData:  # `read` reports an image that cannot be used
                continue
            if not alignment.settled and left.shape == (k.height, k.width):
                alignment.take(*self._stereo.rectified(left, right), k)
        self._stereo.align(alignment.rotation)
        alignment.opened(k)
        return alignment.row_error_px

    def read(self, row: FrameRow) -> NDArray[np.uint16]:
        """(H, W) uint16 millimetres in the rectified left image. Raises BadData."""
        left, right = self._pair(row)
        k = self.info.intrinsics
        if left.shape != (k.height, k.width):
            raise BadData(
                f"{self._folder / row.file}: {left.shape[1]}x{left.shape[0]} px, the first pair has {k.width}x{k.height}"
            )
        return self._stereo.depth(left, right)

    def _pair(self, row: FrameRow) -> tuple[Gray, Gray]:
        left = self._image(row.file)
        if not row.file_right:
            if left.shape[1] < 2 * left.shape[0]:
                raise BadData(
                    f"{self._folder / row.file}: {left.shape[1]}x{left.shape[0]} px is not a side-by-side pair; name the "
                    "right image in a column file_right"
                )
            return halves(left)
        right = self._image(row.file_right)
        if right.shape != left.shape:
            raise BadData(f"{self._folder / row.file_right}: its size differs from that of {row.file}")
        return left, right

    def _image(self, name: str) -> Gray:
        path = self._folder / name
        try:
            data = np.frombuffer(regular(path).read_bytes(), np.uint8)
        except OSError as error:
            raise BadData(f"{path}: cannot be read ({error.strerror})") from error
        image = decoded(data, cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise BadData(f"{path}: no readable image")
        return np.asarray(image, np.uint8)
