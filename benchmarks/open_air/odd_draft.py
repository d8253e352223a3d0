"""What a random scene is made of, before it is built: things, ground, sky, exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.exposure import Exposure
from drivers.simulation.stereo.pair_renderer import GlassPane
from drivers.simulation.stereo.sky import Sky
from drivers.simulation.stereo.textures import Material

Rng = np.random.Generator


@dataclass(slots=True)
class Draft:
    """What a scene is made of. height_m: of the camera above the ground; albedo, materials: of the things by name; pitch_deg: of the camera,
    None: any."""

    rng: Rng
    height_m: float
    builder: SceneBuilder
    albedo: dict[str, float]
    ground: Material
    sky: Sky
    exposure: Exposure
    panes: tuple[GlassPane, ...] = ()
    materials: dict[str, Material] = field(default_factory=dict)
    fog_per_m: float = 0.0
    pitch_deg: float | None = None

    def between(self, low: float, high: float) -> float:
        """A uniform number."""
        return float(self.rng.uniform(low, high))

    def log_between(self, low: float, high: float) -> float:
        """A number whose logarithm is uniform."""
        return math.exp(self.between(math.log(low), math.log(high)))

    def paint(self, name: str) -> None:
        """Gives a thing one random brightness without texture, in two of three cases."""
        if self.between(0.0, 1.0) < 2.0 / 3.0:
            self.albedo[name] = self.log_between(0.03, 1.0)

    def beam(
        self,
        name: str,
        middle: tuple[float, float],
        above_m: float,
        length_m: float,
        angle_rad: float,
        diameter_m: float,
        turn_rad: float = 0.0,
    ) -> None:
        """A cylinder about a point `above_m` above the camera, inclined by angle_rad to the horizontal; turn_rad: out of the plane
        across the view."""
        x, y = middle
        c, s, half = math.cos(angle_rad), math.sin(angle_rad), 0.5 * length_m
        dx, dy = half * c * math.sin(turn_rad), half * c * math.cos(turn_rad)
        z = -(self.height_m + above_m)
        self.builder.cylinder(name, (x - dx, y - dy, z + half * s), (x + dx, y + dy, z - half * s), 0.5 * diameter_m)
