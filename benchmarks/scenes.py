"""The scenes that the experiments run on: by family, by name, and which seeds are for what.

Half of the seeds are for tuning, the other half only for reporting: parameters and code are chosen by looking
at TUNING_SEEDS alone; figures that are published come from HELD_OUT_SEEDS, and nothing is changed because of
what those showed in one scene. A seed moves and shapes the things of a scene and is the seed of the noise."""

from __future__ import annotations

from drivers import scene_library
from drivers.scenes import Scene

FAMILIES: dict[str, tuple[str, ...]] = {
    "structured": ("wall", "corner", "street", "alley", "gable", "window", "tunnel", "cylinder_trapezoid_sphere"),
    "unstructured": ("trees", "stones", "mixture"),
    "thin": ("poles", "wires"),
    "ground": ("open", "slope", "ramp", "no_ground"),
}
"""The families and the names of their scenes."""
SCENES: tuple[str, ...] = tuple(name for names in FAMILIES.values() for name in names)

TUNING_SEEDS = range(100)
HELD_OUT_SEEDS = range(100, 200)


def make_scene(name: str, seed: int) -> Scene:
    """A scene of FAMILIES; the same for the same name and seed. Raises ValueError for a name that does not
    exist."""
    if name not in SCENES:
        raise ValueError(f"no scene {name!r}; there are: {', '.join(SCENES)}")
    return scene_library.make_scene(name, seed)


def family_of(scene: str) -> str:
    """The family of a scene, by its name; "other" for one that is in none."""
    return next((family for family, names in FAMILIES.items() if scene in names), "other")
