"""Random scenes seen by a camera whose calibration is wrong: it measures every depth too great, by its whole bias_per_m.

Everything follows from (seed, number), as in random_frames.py. The description of the camera states the bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.free_space.random_frames import RandomFrame, random_frame
from core.types import SATURATED_MM, is_measured

BIASES_PER_M = (0.002, 0.005, 0.01)
"""An OAK or ZED of a good and of the assumed calibration, and a V4L2 camera."""


def biased_frame(seed: int, number: int) -> RandomFrame:
    """The random frame of a number with all depths Z too great by bias_per_m Z^2; the same for the same seed and number."""
    r = random_frame(seed, number)
    bias_per_m = BIASES_PER_M[number % len(BIASES_PER_M)]
    info = replace(r.frame.info, bias_per_m=bias_per_m)
    return replace(r, frame=replace(r.frame, depth_mm=too_far(r.frame.depth_mm, bias_per_m), info=info))


def too_far(depth_mm: NDArray[np.uint16], bias_per_m: float) -> NDArray[np.uint16]:
    """Depths (H, W) with a constant error of the inverse depth; what has no inverse then, or is beyond 65 m, is not measured."""
    with np.errstate(divide="ignore"):
        shifted_mm = 1.0 / (1.0 / depth_mm - 1e-3 * bias_per_m)
    shifted_mm = np.where((shifted_mm > 0.0) & (shifted_mm < 65_000.0), np.rint(shifted_mm), SATURATED_MM)
    return np.where(is_measured(depth_mm), shifted_mm, depth_mm).astype(np.uint16)
