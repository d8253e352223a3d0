"""The scenes of the experiments, by family and name, and the seeds.

Half of the seeds are for tuning, the other half for reporting only: parameters and code are chosen with TUNING_SEEDS,
and published figures come from HELD_OUT_SEEDS. A seed varies the objects of a scene, the camera's pose (camera_pose)
and the noise."""

from __future__ import annotations

import functools
import math

import numpy as np

from drivers.simulation import scene_library
from drivers.simulation.scenes import Scene

from .structured import CEILINGS_M, STRUCTURED
from .thin import GROUND, THIN
from .unstructured import UNSTRUCTURED

_OURS = {**STRUCTURED, **UNSTRUCTURED, **THIN, **GROUND}
_STRUCTURED = ("wall", "corner", "street", "alley", "gable", "window", "tunnel", "ramp", "cylinder_trapezoid_sphere")

FAMILIES: dict[str, tuple[str, ...]] = {
    "structured": (*_STRUCTURED, *STRUCTURED),
    "unstructured": ("trees", "stones", "mixture", *UNSTRUCTURED),
    "thin": ("poles", "wires", *THIN),
    "ground": ("open", "slope", "no_ground", *GROUND),
}
"""The families and the names of their scenes. thin: poles, wires, fences. ground: hardly anything but ground,
or none."""
SCENES: tuple[str, ...] = tuple(name for names in FAMILIES.values() for name in names)

TUNING_SEEDS = range(100)
HELD_OUT_SEEDS = range(100, 200)

HALF = len(TUNING_SEEDS)

HIGHEST_M = {"tunnel": 2.2, **CEILINGS_M}
"""Scenes with a ceiling: the camera stays below this height."""
LIFT_M = {"no_ground": 2.0, "trees_no_ground": 2.0}
"""Scenes without a drawn ground: height at which the camera faces their objects."""
_ASIDE_M, _TURN_RAD = 0.35, 0.1


@functools.lru_cache(maxsize=16)
def make_scene(name: str, seed: int) -> Scene:
    """A scene of FAMILIES; the same for the same name and seed. Raises ValueError for a name that does not
    exist."""
    if name not in SCENES:
        raise ValueError(f"no scene {name!r}; there are: {', '.join(SCENES)}")
    if name in _OURS:
        return _OURS[name](np.random.Generator(np.random.PCG64(seed)))
    return scene_library.make_scene(name, seed)


def family_of(scene: str) -> str:
    """The family of a scene, by its name; "other" for one that is in none."""
    return next((family for family, names in FAMILIES.items() if scene in names), "other")


def another_seed(seed: int, by: int) -> int:
    """A seed further on in the same half of the seeds."""
    return seed // HALF * HALF + (seed + by) % HALF


def camera_pose(scene: str, seed: int, height_m: float) -> tuple[tuple[float, float, float], float]:
    """(position in ned, heading in rad) of the camera: at a height above the ground, displaced by up to 0.35 m and
    turned by up to 0.1 rad by the seed, so that walls are not exactly perpendicular to the view."""
    rng = np.random.Generator(np.random.PCG64([seed, 1]))
    x, y, yaw = rng.uniform(-1.0, 1.0, 3) * [_ASIDE_M, _ASIDE_M, _TURN_RAD]
    height = LIFT_M.get(scene, min(height_m, HIGHEST_M.get(scene, math.inf)))
    return (float(x), float(y), -height), float(yaw)
