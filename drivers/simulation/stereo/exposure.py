"""From brightness to grey levels: automatic exposure, motion blur, response curve, sensor noise, quantisation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """How a pair of imagers turns brightness into grey levels."""

    # standard deviation of the noise at mid grey (128), half of its variance from reading, half from photons
    noise_grey: float = 1.0
    target: float = 0.45  # mean grey level that the automatic exposure aims at, 0..1
    gamma: float = 2.2  # of the response curve
    vignetting: float = 0.15  # loss of light in the corners
    right_gain: float = 1.01  # brightness of the right imager over that of the left one
    blur_px: tuple[float, float] = (0.0, 0.0)  # motion of the image during the exposure (to the right, down)
    # min_gain, max_gain: limits of the automatic exposure
    min_gain: float = 0.02
    max_gain: float = 8.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise_grey <= 20.0:
            raise ValueError(f"exposure: noise_grey={self.noise_grey:g}, expected 0..20")
        if not 0.05 <= self.target <= 0.95 or not 1.0 <= self.gamma <= 3.0:
            raise ValueError(f"exposure: target={self.target:g}, gamma={self.gamma:g}, expected 0.05..0.95 and 1..3")


def automatic_gain(brightness: Image, exposure: Exposure) -> float:
    """The gain at which the mean grey level of an image is the target, as far as saturation allows."""
    sample = brightness[::4, ::4]
    low, high = exposure.min_gain, exposure.max_gain
    for _ in range(20):
        gain = math.sqrt(low * high)
        mean = float(np.minimum(sample * np.float32(gain), 1.0).__pow__(1.0 / exposure.gamma).mean())
        low, high = (gain, high) if mean < exposure.target else (low, gain)
    return math.sqrt(low * high)


def blurred(image: Image, blur_px: tuple[float, float]) -> Image:
    """The mean of an image over a straight motion; the same motion everywhere, as that of a turn of the camera."""
    length = math.hypot(*blur_px)
    if length < 0.05:
        return image
    steps = max(3, math.ceil(2.0 * length))
    total = np.zeros_like(image)
    size = (image.shape[1], image.shape[0])
    for i in range(steps):
        share = (i + 0.5) / steps - 0.5
        move = np.array([[1.0, 0.0, share * blur_px[0]], [0.0, 1.0, share * blur_px[1]]])
        total += cv2.warpAffine(image, move, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(total / np.float32(steps), np.float32)


def _vignette(shape: tuple[int, int], loss: float) -> Image:
    v, u = np.ogrid[: shape[0], : shape[1]]
    r2 = ((u - shape[1] / 2) ** 2 + (v - shape[0] / 2) ** 2) / (shape[0] ** 2 + shape[1] ** 2) * 4.0
    return np.asarray(1.0 - loss * r2, np.float32)


def expose(brightness: Image, gain: float, exposure: Exposure, rng: np.random.Generator) -> Gray:
    """(H, W) uint8 of a brightness image at a gain."""
    light = blurred(brightness, exposure.blur_px) * _vignette(brightness.shape, exposure.vignetting)
    grey = 255.0 * np.clip(light * np.float32(gain), 0.0, 1.0) ** np.float32(1.0 / exposure.gamma)
    if exposure.noise_grey > 0.0:
        sigma = exposure.noise_grey * np.sqrt(0.5 + 0.5 * grey / 128.0)
        grey = grey + sigma * rng.standard_normal(grey.shape, np.float32)
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)
