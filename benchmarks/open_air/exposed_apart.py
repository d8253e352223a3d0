"""Depth of a drawn wall whose right image is exposed later than the left one, while the vehicle turns.

    python -m benchmarks.open_air.exposed_apart

The camera is an OAK that is matched on the host. A rotation between both exposures moves the whole right image."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.cameras.stereo import StereoMatcher

F_PX, BASELINE_M, WIDTH, HEIGHT = 450.0, 0.075, 640, 400
MARGIN_PX = 100
APART_MS = (0.02, 1.0, 2.0, 5.0, 12.0)
TURN_DEG_S = 60.0


def wall(shift_px: float, seed: int) -> NDArray[np.uint8]:
    """(H, W) view of one texture, moved to the right by shift_px, with noise of one grey level."""
    texture = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH + 2 * MARGIN_PX)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 1.5)
    texture = 255.0 * (texture - texture.min()) / (texture.max() - texture.min())
    move = np.array([[1.0, 0.0, shift_px - MARGIN_PX], [0.0, 1.0, 0.0]])
    image = cv2.warpAffine(texture, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    noise = np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(image + noise, 0.0, 255.0).astype(np.uint8)


def median_m(distance_m: float, apart_ms: float, turn_deg_s: float) -> float:
    """Median depth of the accepted pixels, NaN: none."""
    turned_px = F_PX * math.radians(turn_deg_s) * apart_ms / 1000.0
    right = wall(-F_PX * BASELINE_M / distance_m - turned_px, 3)
    depth_mm = StereoMatcher().depth(wall(0.0, 2), right, F_PX, BASELINE_M)
    measured = depth_mm[depth_mm > 0]
    return float(np.median(measured)) / 1000.0 if len(measured) else math.nan


def main() -> None:
    """Prints a table."""
    for distance_m in (3.0, 5.0):
        for apart_ms in APART_MS:
            found = [median_m(distance_m, apart_ms, turn) for turn in (-TURN_DEG_S, TURN_DEG_S)]
            print(f"wall at {distance_m:g} m, {apart_ms:g} ms apart: {found[0]:.2f} and {found[1]:.2f} m")


if __name__ == "__main__":
    main()
