"""Results of `core.self_check.surfaces`: the plane surfaces of one depth image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Surface:
    """A plane surface n . P = distance_m in level_cam."""

    # unit vector away from the camera. That of the ground points down (z about 1), that of a wall is horizontal.
    normal: tuple[float, float, float]
    distance_m: float  # distance to the camera
    share: float  # share of the image's patches
    lean_sd_rad: float  # standard deviation of the inclination of the normal
    misfit: float = 1.0  # residual of the fit over the noise; far above 1 it is not a single plane
    spread_per_m: float = math.inf  # standard deviation of inverse depth over the surface, without noise


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Result of `find_surfaces`."""

    planes: tuple[Surface, ...]  # surfaces, the largest first
    measured_share: float  # share of the patches with enough measurements
    centres_m: Floats  # (M, 3) float64, mean place of each measured patch in level_cam
    noise_per_m: float  # standard deviation of inverse depth that the search used
    prior_per_m: float = 0.0  # the same as the driver states it
