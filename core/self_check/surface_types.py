"""The plane surfaces of one depth image, as `core.self_check.surfaces` finds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Surface:
    """One plane surface in level_cam: n . P = distance_m.

    normal: unit vector away from the camera, so that that of the ground points down (z about 1) and that of a vertical
    wall is horizontal. share: of the image's patches. lean_sd_rad: standard deviation of the normal's inclination.
    misfit: residual of the fit over the noise; far above 1 it is no single plane."""

    normal: tuple[float, float, float]
    distance_m: float
    share: float
    lean_sd_rad: float
    misfit: float = 1.0


@dataclass(frozen=True, slots=True)
class Surfaces:
    """What `find_surfaces` found. measured_share: patches with enough measurements, of all. planes: by falling size.

    centres_m: (M, 3) float64, the mean place of each measured patch in level_cam; noise_per_m: standard deviation of the
    inverse depth that the search assumed."""

    planes: tuple[Surface, ...]
    measured_share: float
    centres_m: Floats
    noise_per_m: float
