"""Rotation between both rectified cameras of a stereo pair that the calibration has left, from the rows of corners."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from core.types import Intrinsics

from .corner_matches import CornerMatches

MIN_CORNERS = 60
OUTLIER_PX = 0.1
"""Row error from which on a corner has little weight (scale of the Cauchy loss)."""
MOST_SIGMA_PX = 0.15
"""Greatest robust standard deviation of the rows about the fit: in images without repetition it is 0.01 to 0.08."""
MOST_UNCERTAIN_PX = 0.05
"""Greatest standard deviation of the fitted row at any corner of the image."""
STRETCH_SLACK_PX = 0.5
"""Error of a column at the border by another focal length that is not counted: up to 0.4 px are found in images without one."""


@dataclass(frozen=True, slots=True)
class RightRotation:
    """Small rotation of the right camera in its rectified view, radians about the axes x (right) and z (forward), and the share
    by which its focal length is too great. The latter is measured and not corrected: it makes depths wrong as well.

    The rotation about y moves points along the rows. It cannot be distinguished from a change of their depth."""

    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    stretch: float = 0.0

    def __add__(self, other: RightRotation) -> RightRotation:
        return RightRotation(
            self.pitch_rad + other.pitch_rad, self.roll_rad + other.roll_rad, self.stretch + other.stretch
        )

    def __sub__(self, other: RightRotation) -> RightRotation:
        return RightRotation(
            self.pitch_rad - other.pitch_rad, self.roll_rad - other.roll_rad, self.stretch - other.stretch
        )

    @property
    def R_rectified_right(self) -> NDArray[np.float64]:
        """(3, 3) from the right camera's view to one whose rows are those of the left image."""
        return np.asarray(cv2.Rodrigues(np.array([self.pitch_rad, 0.0, self.roll_rad]))[0], np.float64)

    def turned(self, right: NDArray[np.uint8], k: Intrinsics) -> NDArray[np.uint8]:
        """The right image (H, W) as a camera without this rotation sees it."""
        if not (self.pitch_rad or self.roll_rad):
            return right
        matrix = np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]])
        homography = matrix @ self.R_rectified_right @ np.linalg.inv(matrix)
        return np.asarray(cv2.warpPerspective(right, homography, (k.width, k.height)), np.uint8)

    def error_px(self, k: Intrinsics) -> float:
        """The greater of both angles in pixels at the middle of the image, and of what the focal length makes of a column at the
        border, less STRETCH_SLACK_PX."""
        stretch_px = 0.5 * k.width * abs(self.stretch) - STRETCH_SLACK_PX
        return float(max(k.fx * abs(self.pitch_rad), k.fx * abs(self.roll_rad), stretch_px))

    def greatest_row_px(self, k: Intrinsics) -> float:
        """Greatest difference of rows that it makes in the image."""
        return float(np.abs(_row_equations(_border(k), k) @ (self.pitch_rad, self.roll_rad, self.stretch)).max())


def measure_rotation(matches: CornerMatches, k: Intrinsics) -> RightRotation | None:
    """Fits the rotation to refined corners; None: they do not determine it.

    A right camera that is rotated by (pitch, 0, roll), with a focal length that is too great by the share s, shows the point
    (x, y, 1) of its rectified view lower by (1 + y^2) pitch - x roll + y s, to first order."""
    if len(matches.left_px) < MIN_CORNERS:
        return None
    rows, equations = matches.rows_px.astype(np.float64), _row_equations(matches.right_px, k)
    begin = np.array([np.median(rows) / k.fy, 0.0, 0.0])
    fit = least_squares(
        lambda angles: equations @ angles - rows,
        begin,
        jac=lambda _: equations,
        loss="cauchy",
        f_scale=OUTLIER_PX,
        x_scale=1e-3,
    )
    sigma_px = 1.4826 * float(np.median(np.abs(equations @ fit.x - rows)))
    covariance = np.linalg.pinv(equations.T @ equations) * max(sigma_px, 0.01) ** 2
    border = _row_equations(_border(k), k)
    uncertain_px = float(np.sqrt(np.einsum("ni,ij,nj->n", border, covariance, border).max()))
    if sigma_px > MOST_SIGMA_PX or uncertain_px > MOST_UNCERTAIN_PX:
        return None
    return RightRotation(*(float(value) for value in fit.x))


def _border(k: Intrinsics) -> NDArray[np.float64]:
    """(4, 2) the corners of the image, px."""
    return np.array([(x, y) for x in (0.0, k.width - 1.0) for y in (0.0, k.height - 1.0)])


def _row_equations(at_px: NDArray[np.floating], k: Intrinsics) -> NDArray[np.float64]:
    """(N, 3) px per radian of pitch and of roll, and per share of the focal length."""
    x, y = (at_px[:, 0] - k.cx) / k.fx, (at_px[:, 1] - k.cy) / k.fy
    return np.asarray(k.fy * np.stack([1.0 + y * y, -x, y], axis=1), np.float64)
