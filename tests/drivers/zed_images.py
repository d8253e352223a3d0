"""Calibrations of a ZED, images of a wall, and a video device."""

from __future__ import annotations

import functools

import cv2
import numpy as np

from drivers.cameras.zed_calibration import (
    EyeCalibration,
    StereoCalibration,
    parse_zed_calibration,
)

OLD = "\r\n".join(
    [
        "", "[LEFT_CAM_VGA] ", "fx=350.179 ", "fy=350.179 ", "cx=349.218 ", "cy=190.017 ", "k1=-0.173243 ", "k2=0.0253571 ",
        "p1=0 ", "p2=0 ", "", "[RIGHT_CAM_VGA] ", "fx=349.791 ", "fy=349.791 ", "cx=348.013 ", "cy=193.637 ",
        "k1=-0.17398 ", "k2=0.0272116 ", "p1=0 ", "p2=0 ", "", "[STEREO] ", "Baseline=120 ", "CV_VGA=0.0228216 ",
        "RX_VGA=-0.00325192 ", "RZ_VGA=-0.00116869",
    ]
)  # fmt: skip
NEW = OLD.replace("p2=0 ", "p2=0.0001\r\nk3=-0.002").replace("Baseline=120 ", "Baseline=119.9\r\nTY=0.05\r\nTZ=-0.3")


def texture(points: np.ndarray) -> np.ndarray:
    """(...,) 0..255 gray of points (..., 2) on a plane, metres: structure at many scales, the same from everywhere."""
    rng = np.random.Generator(np.random.PCG64(5))
    value = np.zeros(points.shape[:-1])
    for scale_m in (0.6, 0.25, 0.11, 0.05):
        for _ in range(6):
            angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            along = points[..., 0] * np.cos(angle) + points[..., 1] * np.sin(angle)
            value += np.sin(2.0 * np.pi * along / scale_m + phase)
    return np.asarray(np.clip(128.0 + 18.0 * value, 0, 255))


def eye_image(
    eye: EyeCalibration, size: tuple[int, int], R: np.ndarray, T: np.ndarray, z_m: float, seed: int
) -> np.ndarray:
    """What a real, distorted eye sees of a wall at depth z_m of the left eye; p_eye = R p_left + T."""
    width, height = size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None, :]
    rays = cv2.undistortPoints(pixels, eye.matrix, eye.distortion)[:, 0, :]
    in_left = np.hstack([rays, np.ones((len(rays), 1))]) @ R  # R^T, row by row
    centre = -R.T @ T
    scale = (z_m - centre[2]) / in_left[:, 2]
    hit = centre[None, :2] + scale[:, None] * in_left[:, :2]
    noise = np.random.Generator(np.random.PCG64(seed)).normal(0.0, 2.0, len(hit))
    return np.clip(texture(hit) + noise, 0, 255).astype(np.uint8).reshape(height, width)


@functools.lru_cache(maxsize=8)
def pair(c: StereoCalibration, z_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A raw pair of a wall at z_m, read-only."""
    size = (c.width, c.height)
    left, right = eye_image(c.left, size, np.eye(3), np.zeros(3), z_m, 1), eye_image(c.right, size, c.R, c.T, z_m, 2)
    left.flags.writeable = right.flags.writeable = False
    return left, right


CALIBRATION = parse_zed_calibration(NEW, "SN2.conf", 672, 376)


def side_by_side(z_m: float = 3.0) -> np.ndarray:
    return cv2.cvtColor(np.hstack(pair(CALIBRATION, z_m)), cv2.COLOR_GRAY2BGR)
