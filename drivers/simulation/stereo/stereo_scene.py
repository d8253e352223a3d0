"""A scene as rendered stereo needs it: the material of each solid, by its name, sky, fog and glass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..ray_caster import CYLINDER
from ..scenes import Scene
from .pair_renderer import GlassPane
from .shading import Surfaces
from .sky import CLEAR, Sky
from .textures import (
    ASPHALT,
    BARK,
    BLANK_PAINT,
    BLINDS,
    BRICK,
    CONCRETE,
    GRASS,
    GRAVEL,
    LEAVES,
    METAL,
    PLASTER,
    SKIN,
    WHITE_PAINT,
    WOOD,
    Material,
)

_BY_WORD: tuple[tuple[str, Material], ...] = (
    ("tree", LEAVES), ("bush", LEAVES), ("hedge", LEAVES), ("wood", LEAVES), ("hill", GRASS), ("meadow", GRASS),
    ("house", BRICK), ("gable", BRICK), ("facade", BRICK), ("kiosk", WOOD), ("shed", WOOD), ("table", WOOD), ("floor", WOOD),
    ("lamp", METAL), ("car", METAL), ("van", METAL), ("pole", METAL), ("wire", METAL), ("fence", METAL), ("mast", METAL),
    ("container", BLANK_PAINT), ("pillar", WHITE_PAINT), ("balloon", WHITE_PAINT), ("ceiling", WHITE_PAINT),
    ("overhang", BLANK_PAINT), ("bridge", BLANK_PAINT), ("blank", BLANK_PAINT), ("glass", BLANK_PAINT), ("blinds", BLINDS),
    ("stone", GRAVEL), ("boulder", GRAVEL), ("hand", SKIN), ("roof", GRAVEL), ("wall", PLASTER), ("ramp", CONCRETE),
)  # fmt: skip
"""The first of these words that stands in a solid's name chooses its material."""
DEFAULT_MATERIAL = CONCRETE
_ON_ASPHALT = ("street", "alley", "corner", "window", "tunnel", "demo", "gable")


def material_named(name: str, kind: int) -> Material:
    """The material of a solid by its name; trunks of trees are cylinders."""
    if kind == CYLINDER and ("tree" in name or "wood" in name):
        return BARK
    return next((m for word, m in _BY_WORD if word in name), DEFAULT_MATERIAL)


def surfaces_of(scene: Scene, ground: Material | None = None) -> Surfaces:
    """A scene with materials by the names of its things. ground: default grass, asphalt in streets."""
    below = ground or (ASPHALT if scene.name in _ON_ASPHALT else GRASS)
    names = [(int(k), scene.names[i] if i >= 0 else "") for k, i in zip(scene.kinds, scene.label, strict=True)]
    each = [material_named(name, kind) if name else below for kind, name in names]
    table = list(dict.fromkeys(each))
    return Surfaces(scene=scene, material_of=np.array([table.index(m) for m in each], np.int32), materials=tuple(table))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoScene:
    """A scene with all that decides how it looks."""

    name: str
    surfaces: Surfaces
    sky: Sky = CLEAR
    fog_per_m: float = 0.0
    panes: tuple[GlassPane, ...] = ()  # its glass
    blank: tuple[str, ...] = ()  # names of untextured things whose outlines are to be found
    stand_m: float = 0.0  # height of the surface over which the camera flies
    highest_m: float = math.inf  # no camera above it

    @property
    def scene(self) -> Scene:
        """The geometry."""
        return self.surfaces.scene
