"""Depth from two images by OpenCV: rectification, semi-global matching, left-right check, test of each match."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from fastcrc.crc32 import iso_hdlc
from numpy.typing import NDArray

from core.types import UNKNOWN_MM, Intrinsics

from .match_confidence import ConfidenceLimits, accepted_matches
from .right_rotation import RightRotation
from .subpixel import refined
from .textureless import limits_of, mark_unmeasured
from .zed_calibration import StereoCalibration

Gray = NDArray[np.uint8]
_SUBPIXEL = 16.0
"""Steps per pixel of the matcher's disparity."""
_MAX_MM = 65_000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchParams:
    """Cost and filters of the matching."""

    disparities: int = 96  # px searched, rounded up to a multiple of 16: the smallest depth is f B over one less
    block_px: int = 5  # side of the matched block, odd
    uniqueness: int = 8  # %, by which the best match must be better than the next
    check_px: int = 1  # largest difference between left-to-right and right-to-left disparity
    speckle_px: int = 120  # smaller patches are removed
    speckle_range: int = 2  # px, disparity step within one patch
    edge_px: int = 4  # border of the rectified image that is not used
    window_px: int = 7  # side of the window in which a match is tested, odd
    correlation: float = 0.7  # least of both images in the window; lower values accept weaker texture; 0: off
    texture: float = 3.0  # least variance of the texture in the window over that of the sensor noise; 0: off
    period: float = 0.9  # correlation of the image with itself from which on it repeats and is not matched; 1: off
    period_px: int = 48  # longest period of a repetition that is looked for
    # the same as correlation where the texture is far above the noise; less than correlation: no difference
    strong_correlation: float = 0.85
    far_correlation: float = 0.91  # the same as strong_correlation, for matches of less than 4 px of disparity
    smear_px: int = 1  # columns beside an unmeasured area that are dropped from an accepted one; 0: none
    smear_rows: int = 4  # rows above and below an unmeasured area that are dropped; 0: none
    patch_px: int = 25  # smaller patches of accepted pixels are dropped; 0: off
    patch_per_px: float = 3.0  # patches of fewer pixels for each pixel of their disparity are dropped; 0: off
    # patches of an edge are dropped of which a greater share lies where other matches lie in the right image; 1: off
    shared: float = 0.5
    level_px: int = 61  # matches on level lines of this length count only where their own row agrees; 0: off
    mark_smooth: bool = False  # mark unmeasured pixels whose image is smooth; [open_sky] needs it

    @property
    def searched(self) -> int:
        """Number of disparities that are searched, from 0 on."""
        return -(-self.disparities // 16) * 16


class StereoDepth:
    """Depth of raw pairs of one calibration. Not for two threads at once."""

    def __init__(self, calibration: StereoCalibration, params: MatchParams | None = None) -> None:
        c = calibration
        size = (c.width, c.height)
        # T as a column: newer OpenCV rejects a flat array
        R1, R2, P1, P2, _, _, _ = cv2.stereoRectify(
            c.left.matrix, c.left.distortion, c.right.matrix, c.right.distortion, size, c.R, c.T.reshape(3, 1), alpha=0
        )
        self._left = cv2.initUndistortRectifyMap(c.left.matrix, c.left.distortion, R1, P1, size, cv2.CV_16SC2)
        self._calibration, self._R_rectified_raw_right, self._P_right = c, np.asarray(R2), np.asarray(P2)
        self.align(RightRotation())
        self.R_rectified_raw: NDArray[np.float64] = np.asarray(R1)
        """Rotation of the rectified left view from the raw one, about a degree; the mount refers to the rectified view.
        """
        self.baseline_m = float(-P2[0, 3] / P2[0, 0])
        self.intrinsics = Intrinsics(
            c.width, c.height, float(P1[0, 0]), float(P1[1, 1]), float(P1[0, 2]), float(P1[1, 2])
        )
        self._matcher = StereoMatcher(params)

    def align(self, rotation: RightRotation) -> None:
        """Rectifies the right images by a calibration whose right camera is rotated so much more."""
        c = self._calibration
        R = rotation.R_rectified_right @ self._R_rectified_raw_right
        size = (c.width, c.height)
        self._right = cv2.initUndistortRectifyMap(
            c.right.matrix, c.right.distortion, R, self._P_right, size, cv2.CV_16SC2
        )
        self.rotation = rotation

    def rectified(self, left: Gray, right: Gray) -> tuple[Gray, Gray]:
        """Both images with rows along the epipolar lines."""
        return (
            np.asarray(cv2.remap(left, *self._left, cv2.INTER_LINEAR), np.uint8),
            np.asarray(cv2.remap(right, *self._right, cv2.INTER_LINEAR), np.uint8),
        )

    def depth(self, left: Gray, right: Gray) -> NDArray[np.uint16]:
        """(H, W) uint16 mm of a raw pair of gray images, in the rectified left one."""
        return self._matcher.depth(*self.rectified(left, right), self.intrinsics.fx, self.baseline_m)


class StereoMatcher:
    """Disparity of rectified pairs. Not for two threads at once."""

    def __init__(self, params: MatchParams | None = None) -> None:
        self._params = params or MatchParams()
        self._sgbm = matcher(self._params)
        self._limits = confidence_limits(self._params)

    def disparity(self, left: Gray, right: Gray) -> NDArray[np.float32]:
        """(H, W) float32 px of a rectified pair; negative: no accepted match."""
        found = accepted_matches(left, right, compute_disparity(self._sgbm, left, right, self._params), self._limits)
        edge = self._params.edge_px
        if edge:
            found[:edge], found[-edge:], found[:, :edge], found[:, -edge:] = -1, -1, -1, -1
        return found

    def depth(self, left: Gray, right: Gray, f_px: float, baseline_m: float) -> NDArray[np.uint16]:
        """(H, W) uint16 mm of a rectified pair, in the left image, with the marks of smooth pixels where they are on.
        f_px: focal length of the rectified images."""
        disparity = self.disparity(left, right)
        depth = depth_mm(disparity, f_px * baseline_m)
        if not self._params.mark_smooth:
            return depth
        return mark_unmeasured(depth, disparity, left, right, limits_of(f_px, baseline_m))


def confidence_limits(params: MatchParams) -> ConfidenceLimits:
    """The limits of the confidence rules."""
    return ConfidenceLimits(
        window_px=params.window_px | 1,
        correlation=params.correlation,
        strong_correlation=params.strong_correlation,
        far_correlation=params.far_correlation,
        texture=params.texture,
        period=params.period,
        period_px=params.period_px,
        patch_px=params.patch_px,
        patch_per_px=params.patch_per_px,
        shared=params.shared,
        smear_px=params.smear_px,
        smear_rows=params.smear_rows,
        level_px=params.level_px,
    )


def matcher(params: MatchParams) -> cv2.StereoSGBM:
    """The semi-global matcher of these parameters.

    The penalties of a step are a quarter and a half of what the library's examples take, and the gradients are cut
    late: the stronger smoothing is against the contrast, the more subpixels are pulled to whole ones. Measured on drawn
    walls: median error 0.08-0.11 px instead of 0.17-0.23, nine tenths below 0.2 instead of 0.33, the same pixels found."""
    block = params.block_px | 1
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=params.searched,
        blockSize=block,
        P1=2 * block * block,
        P2=16 * block * block,
        preFilterCap=63,
        disp12MaxDiff=params.check_px,
        uniquenessRatio=params.uniqueness,
        speckleWindowSize=params.speckle_px,
        speckleRange=params.speckle_range,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def compute_disparity(sgbm: cv2.StereoSGBM, left: Gray, right: Gray, params: MatchParams) -> NDArray[np.float32]:
    """(H, W) float32 px, negative: none. What has no counterpart in the right image, or another one, is none. Fractions of a pixel of
    far matches are those of `refined`."""
    added = sgbm.getNumDisparities()
    if left.shape[1] <= added:  # nothing can be matched; the library would access memory outside of the image
        return np.full(left.shape, -1.0, np.float32)
    found = np.asarray(sgbm.compute(left, right), np.float32) / np.float32(_SUBPIXEL)
    # the same search from the right: mirrored, to keep the direction of the search. The matcher leaves out as many columns as it
    # searches: they are added, or the right border would never be confirmed
    mirrored = [cv2.copyMakeBorder(image[:, ::-1], 0, 0, added, 0, cv2.BORDER_REPLICATE) for image in (right, left)]
    back = np.asarray(sgbm.compute(*mirrored), np.float32)[:, : added - 1 : -1] / _SUBPIXEL
    columns = np.arange(left.shape[1], dtype=np.float32)[None, :]
    there = np.rint(columns - found).astype(np.int32)
    inside = (found >= 0.0) & (there >= 0)
    other = np.take_along_axis(back, np.clip(there, 0, left.shape[1] - 1), axis=1)
    agreed = inside & (other >= 0.0) & (np.abs(other - found) <= params.check_px)
    return refined(left, right, np.where(agreed, found, np.float32(-1.0)))


def pair_crc(left: Gray, right: Gray) -> int:
    """CRC-32 of both images of a pair before their rows are aligned, for `DepthFrame.images_crc`."""
    return int(iso_hdlc(right.tobytes(), iso_hdlc(left.tobytes())))


def nearest_m(f_b_px_m: float, searched: int) -> float:
    """Least depth that a search finds, Z = f B / d of its greatest disparity. f_b_px_m: focal length times baseline; searched: number
    of disparities, from 0 on."""
    return f_b_px_m / (searched - 1)


def depth_mm(disparity: NDArray[np.float32], f_b_px_m: float) -> NDArray[np.uint16]:
    """Z = f B / d as uint16 mm; no match, and what lies beyond 65 m, is unknown. f_b_px_m: focal length times
    baseline."""
    with np.errstate(divide="ignore"):
        mm = np.float32(1000.0 * f_b_px_m) / disparity
    good = (disparity > 0.0) & (mm < _MAX_MM)
    return np.where(good, mm + np.float32(0.5), np.float32(UNKNOWN_MM)).astype(np.uint16)
