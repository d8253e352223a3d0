"""Random scenes of things that stereo measures badly: a family of odd_things.py or odd_outdoors.py, with a random height, sky and noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.open_air.odd_draft import Draft, Rng
from benchmarks.open_air.odd_outdoors import OUTDOORS
from benchmarks.open_air.odd_things import THINGS
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.exposure import Exposure
from drivers.simulation.stereo.shading import Surfaces
from drivers.simulation.stereo.sky import CLEAR, HAZY
from drivers.simulation.stereo.stereo_scene import StereoScene, surfaces_of
from drivers.simulation.stereo.textures import ASPHALT, GRASS, GRAVEL, Material

_GROUNDS = (GRASS, GRASS, ASPHALT, GRAVEL)
FAMILIES: dict[str, Callable[[Draft], None]] = THINGS | OUTDOORS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OddScene:
    """A scene, its exposure, and the height of the camera above the ground. pitch_deg: of the camera, None: any."""

    scene: StereoScene
    exposure: Exposure
    height_m: float
    pitch_deg: float | None


def odd_scene(family: str, rng: Rng) -> OddScene:
    """A random scene of a family."""
    height_m = float(rng.choice([1.5, 2.0, 2.0, 3.0, 5.0, 8.0]))
    builder = SceneBuilder(family)
    builder.ground()
    d = Draft(
        rng=rng,
        height_m=height_m,
        builder=builder,
        albedo={},
        ground=_GROUNDS[int(rng.integers(len(_GROUNDS)))],
        sky=(CLEAR, CLEAR, HAZY)[int(rng.integers(3))],
        exposure=Exposure(noise_grey=float(rng.uniform(0.5, 2.0))),
    )
    FAMILIES[family](d)
    paints = {name: Material(albedo=value) for name, value in d.albedo.items()} | d.materials
    surfaces = painted(surfaces_of(d.builder.build(), d.ground), paints)
    scene = StereoScene(name=family, surfaces=surfaces, sky=d.sky, panes=d.panes, fog_per_m=d.fog_per_m)
    return OddScene(scene=scene, exposure=d.exposure, height_m=d.height_m, pitch_deg=d.pitch_deg)


def painted(surfaces: Surfaces, paints: dict[str, Material]) -> Surfaces:
    """The same with these materials for things by name."""
    materials, material_of = list(surfaces.materials), np.array(surfaces.material_of)
    for name, paint in paints.items():
        mine = surfaces.scene.label == surfaces.scene.names.index(name) if name in surfaces.scene.names else None
        if mine is None or not mine.any():
            continue
        material_of[mine] = len(materials)
        materials.append(paint)
    return Surfaces(scene=surfaces.scene, material_of=material_of, materials=tuple(materials))
