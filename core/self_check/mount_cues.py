"""Cues of one frame on the camera's mount: the apparent slope of the ground, and whether walls lean with it.

A wrong mount inclines everything that is measured by the same angle. Terrain inclines the ground and leaves walls
vertical."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .surface_types import Surface, Surfaces

MAX_INCLINATION_RAD = math.radians(35.0)
"""Greatest inclination of a surface that may be the ground, and of the normal of a wall."""
MIN_GROUND_SHARE = 0.03
"""Least share of the image's patches on the ground."""
MAX_BELOW_SHARE = 0.05
"""Greatest share of the measured patches below the ground."""
MIN_SPREAD = 2.0
"""Least standard deviation of the ground's inverse depth, over the noise that the driver states: with 0.3 px, ground over two pixels
of disparity. Matchers prefer whole pixels. Less ground is inclined by that, in each frame alike: flat ground by up to 20 degrees."""
FIT_SDS = 3.0
"""Standard deviations of the fit within which the slope of the ground is known: noise is correlated, and ground is
not quite plane."""
EDGE_NOISE = 0.2
"""Inclination by other objects at the edge of the ground, in noise at its distance, for a ground of this share of the
image."""
BELOW_M, BELOW_SIGMAS = 0.15, 4.0
MIN_VERTICAL_SHARE, MIN_LEANING_SHARE = 0.08, 0.03
"""Least share of the image's patches on walls that are vertical, or that lean as for a wrong mount. The former needs
more, since an error there makes frames valid that should not be."""
MIN_WALL_SHARE, MAX_MISFIT = 0.015, 1.5
"""Least share and greatest misfit of a wall: smaller or rougher surfaces are often several objects."""
LEAN_TOLERANCE = 0.35
"""Deviation of a wall from vertical, or from the lean of a wrong mount, as a share of the expected lean."""
MIN_LEAN_RAD, MIN_LEAN_SHARE = math.radians(1.2), 0.4
"""Least expected lean of a wall that counts: an angle, and a share of the slope."""
MIN_SLOPE_RAD = math.radians(2.0)
"""Least slope at which walls count: their own inclination is of that order."""
MAX_WALL_WEIGHT = 0.1
"""Greatest weight of one wall as a share of the image, so that one inclined surface does not outweigh several."""


class Walls(StrEnum):
    """What the walls show about an inclined ground."""

    UNDECIDED = "undecided"
    VERTICAL = "vertical"
    LEANING = "leaning"


@dataclass(frozen=True, slots=True)
class MountCues:
    """Cues of one frame, in level_cam."""

    ground: bool  # a ground was found
    # slope_x_rad, slope_y_rad: its inclination along x and y as angles, positive where it descends
    slope_x_rad: float = 0.0
    slope_y_rad: float = 0.0
    distance_m: float = math.nan  # distance to its plane
    slope_sd_rad: float = 0.0  # standard deviation of the slope from this frame
    walls: Walls = Walls.UNDECIDED  # what the walls show about that slope

    @property
    def slope_rad(self) -> float:
        """Magnitude of the inclination."""
        return math.hypot(self.slope_x_rad, self.slope_y_rad)


NO_CUES = MountCues(False)


def cues_of(surfaces: Surfaces) -> MountCues:
    """Returns the cues in the surfaces of a frame."""
    ground = next((plane for plane in surfaces.planes if _is_ground(plane, surfaces)), None)
    if ground is None:
        return NO_CUES
    x, y, z = ground.normal
    across = math.hypot(x, y)
    scale = -math.atan2(across, z) / across if across > 1e-12 else 0.0
    slope = (scale * x, scale * y)
    sd_rad = FIT_SDS * ground.lean_sd_rad * max(1.0, ground.misfit) ** 2
    sd_rad += EDGE_NOISE * surfaces.noise_per_m * ground.distance_m / math.sqrt(ground.share)
    return MountCues(True, *slope, ground.distance_m, sd_rad, walls_of(surfaces.planes, *slope))


def _is_ground(plane: Surface, surfaces: Surfaces) -> bool:
    if plane.share < MIN_GROUND_SHARE or plane.normal[2] < math.cos(MAX_INCLINATION_RAD):
        return False
    if plane.spread_per_m < MIN_SPREAD * surfaces.prior_per_m:
        return False
    beyond_m = surfaces.centres_m @ np.array(plane.normal) - plane.distance_m
    noise_m = BELOW_SIGMAS * surfaces.noise_per_m * np.linalg.norm(surfaces.centres_m, axis=1) * plane.distance_m
    return float(np.mean(beyond_m > BELOW_M + noise_m)) <= MAX_BELOW_SHARE


def walls_of(planes: tuple[Surface, ...], slope_x_rad: float, slope_y_rad: float) -> Walls:
    """Returns whether the walls among the planes are vertical, or lean as with a mount that is wrong by this slope.

    A vertical wall with the horizontal normal (x, y) then has a normal with the inclination slope_x x + slope_y y."""
    vertical, leaning = 0.0, 0.0
    if math.hypot(slope_x_rad, slope_y_rad) < MIN_SLOPE_RAD:
        return Walls.UNDECIDED
    least = max(MIN_LEAN_RAD, MIN_LEAN_SHARE * math.hypot(slope_x_rad, slope_y_rad))
    for plane in planes:
        x, y, z = plane.normal
        if abs(z) > math.sin(MAX_INCLINATION_RAD) or plane.share < MIN_WALL_SHARE or plane.misfit > MAX_MISFIT:
            continue
        across = math.hypot(x, y)
        expected, lean = (slope_x_rad * x + slope_y_rad * y) / across, math.atan2(z, across)
        tolerance = LEAN_TOLERANCE * abs(expected)
        if abs(expected) < least or plane.lean_sd_rad > tolerance:
            continue
        weight = min(plane.share, MAX_WALL_WEIGHT)
        vertical += weight * (abs(lean) <= tolerance)
        leaning += weight * (abs(lean - expected) <= tolerance)
    if vertical >= MIN_VERTICAL_SHARE and vertical >= 2.0 * leaning:
        return Walls.VERTICAL
    return Walls.LEANING if leaning >= MIN_LEANING_SHARE and leaning >= 2.0 * vertical else Walls.UNDECIDED
