"""Scenes for rendered stereo: open country, blank and thin things, glass, fog; in ned, looked at northwards from the origin.

Heights are those of the camera above `stand_m`. Flight heights of 2, 5 and 10 m fit in each scene that does not say
otherwise by `highest_m`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.simulation.scenes import GroundTruth, SceneBuilder
from drivers.simulation.stereo.pair_renderer import GlassPane
from drivers.simulation.stereo.stereo_scene import StereoScene, surfaces_of
from drivers.simulation.stereo.textures import ASPHALT, BLANK_PAINT, GRASS, GRAVEL, WOOD, Material

GROUNDS: dict[str, Material] = {
    "grass": GRASS,
    "asphalt": ASPHALT,
    "gravel": GRAVEL,
    "wood": WOOD,
    "blank": BLANK_PAINT,
}


@dataclass(slots=True)
class _Draft:
    """Collects what a scene is made of."""

    name: str
    ground: str = "grass"
    builder: SceneBuilder = field(init=False)

    def __post_init__(self) -> None:
        self.builder = SceneBuilder(self.name)
        self.builder.ground()

    def done(self, **what: object) -> StereoScene:
        return StereoScene(
            name=self.name,
            surfaces=surfaces_of(self.builder.build(), GROUNDS[self.ground]),
            **what,  # type: ignore[arg-type]
        )


def _trees(
    s: SceneBuilder, rng: np.random.Generator, places: tuple[tuple[float, float], ...], word: str = "tree"
) -> None:
    for i, (x, y) in enumerate(places):
        dx, dy = rng.uniform(-0.6, 0.6, 2)
        s.tree(f"{word} {i}", x + dx, y + dy, rng.uniform(6.0, 11.0), rng.uniform(1.6, 2.6), 700, rng)


def _field(rng: np.random.Generator) -> StereoScene:
    return _Draft("field").done()


def _field_with_trees(rng: np.random.Generator) -> StereoScene:
    d = _Draft("field_with_trees")
    _trees(d.builder, rng, ((9.0, -6.0), (12.0, 5.0), (18.0, -1.5), (24.0, 9.0), (26.0, -11.0)))
    return d.done()


def _meadow_by_wood(rng: np.random.Generator) -> StereoScene:
    d = _Draft("meadow_by_wood")
    _trees(d.builder, rng, tuple((7.0 + 2.4 * i, -4.0 - 0.25 * i - 2.0 * (i % 2)) for i in range(10)), "wood")
    return d.done()


def _street(rng: np.random.Generator) -> StereoScene:
    d = _Draft("street", "asphalt")
    s = d.builder
    for side in (-1.0, 1.0):
        for i, x in enumerate((-2.0, 8.5, 19.0)):
            name = f"house {i}" if (i + side) % 2 else f"plaster wall house {i}".replace("house", "block")
            s.box(name, x + 4.5, side * (10.0 + rng.uniform(0.0, 1.0)), 9.0, 7.0, rng.uniform(6.0, 13.0))
    for i, x in enumerate((6.0, 12.0, 18.0)):
        s.pole("lamp", x, 4.2 if i % 2 else -4.2, 0.14, 5.5)
        s.box("car", x + 2.0, -4.6 if i % 2 else 4.6, 4.2, 1.8, 1.45, rng.uniform(-0.05, 0.05))
    return d.done()


def _container(rng: np.random.Generator, distance_m: float) -> StereoScene:
    d = _Draft(f"container_{distance_m:g}m", "asphalt")
    # tall enough to stand at each flight height
    d.builder.box("container", distance_m + 1.25, rng.uniform(-0.5, 0.5), 2.5, 6.0, 12.0, rng.uniform(-0.3, 0.3))
    return d.done(blank=("container",))


def _blank_wall(rng: np.random.Generator, distance_m: float, name: str) -> StereoScene:
    d = _Draft(name, "asphalt")
    skew = rng.uniform(-0.1, 0.1) * distance_m
    d.builder.wall("blank wall", (distance_m - skew, -60.0), (distance_m + skew, 60.0), 60.0)
    return d.done(blank=("blank wall",))


def _white_pillars(rng: np.random.Generator) -> StereoScene:
    d = _Draft("white_pillars")
    for x, y in ((4.0, -1.2), (6.0, 1.5), (8.0, -3.0), (12.0, 2.0)):
        d.builder.pole(f"pillar at {x:g} m", x, y + rng.uniform(-0.2, 0.2), 0.5, 14.0)
    return d.done(blank=tuple(f"pillar at {x} m" for x in (4, 6, 8, 12)))


def _white_balloons(rng: np.random.Generator) -> StereoScene:
    d = _Draft("white_balloons")
    for height in (2.0, 5.0, 10.0):
        d.builder.sphere("balloon", 5.0, rng.uniform(-1.0, 1.0), height, 0.6)
    return d.done(blank=("balloon",))


def _overhang(rng: np.random.Generator) -> StereoScene:
    d = _Draft("overhang", "asphalt")
    for base in (2.3, 5.3, 10.3):
        d.builder.box("overhang", 7.0, rng.uniform(-1.0, 1.0), 2.0, 5.0, 0.6, base=base)
    d.builder.box("house", 16.0, 0.0, 4.0, 12.0, 14.0)
    return d.done(blank=("overhang",))


def _bridge(rng: np.random.Generator) -> StereoScene:
    d = _Draft("bridge", "asphalt")
    for base in (1.6, 4.6, 9.6):
        d.builder.box("bridge", 9.0, 0.0, 3.0, 60.0, 0.9, rng.uniform(-0.15, 0.15), base=base)
    return d.done(blank=("bridge",))


def _white_room(rng: np.random.Generator) -> StereoScene:
    d = _Draft("white_room", "wood")
    s = d.builder
    s.box("ceiling", 3.0, 0.0, 12.0, 10.0, 0.3, base=2.8)
    s.wall("blank wall", (5.5, -3.5), (5.5, 3.5), 2.8)
    s.wall("wall left", (-2.0, -3.0), (6.0, -3.0), 2.8)
    s.wall("blank wall right", (6.0, 3.0), (-2.0, 3.0), 2.8)
    s.wall("wall behind", (-2.0, 3.5), (-2.0, -3.5), 2.8)
    s.box("table", 3.2, -1.0 + rng.uniform(-0.3, 0.3), 1.2, 0.8, 0.75)
    s.box("cupboard", 5.1, 1.8, 0.6, 1.2, 2.0)
    return d.done(blank=("blank wall", "blank wall right", "ceiling"), highest_m=1.4)


def _roof_edge(rng: np.random.Generator) -> StereoScene:
    d = _Draft("roof_edge", "asphalt")
    # heights count from the roof, which is what one flies over
    d.builder.ground_truth = GroundTruth(-12.0)
    d.builder.box("roof", -7.0, 0.0, 26.0, 60.0, 12.0)
    d.builder.box("house", 32.0, rng.uniform(-4.0, 4.0), 8.0, 14.0, 9.0)
    return d.done(stand_m=12.0)


def _hill_crest(rng: np.random.Generator) -> StereoScene:
    d = _Draft("hill_crest")
    d.builder.ramp("hill", 14.0, 0.0, 18.0, 120.0, 1.5 + rng.uniform(-0.1, 0.1))
    return d.done()


def _wires(rng: np.random.Generator) -> StereoScene:
    d = _Draft("wires")
    for height in (2.2, 5.2, 10.2):
        for x in (5.0, 9.0):
            y = rng.uniform(-0.5, 0.5)
            d.builder.cylinder(
                f"wire at {x:g} m", (x - 3.0, -12.0 + y, -height), (x + 3.0, 12.0 + y, -height - 0.3), 0.012
            )
    d.builder.pole("mast", 9.0, -4.5, 0.3, 12.0)
    return d.done()


def _fence(rng: np.random.Generator) -> StereoScene:
    d = _Draft("fence")
    turn = rng.uniform(-0.1, 0.1)
    for i in range(-40, 41):
        y = 0.12 * i
        d.builder.cylinder("fence", (6.0 + turn * y, y, 0.0), (6.0 + turn * y, y, -12.0), 0.012)
    for base in (0.5, 3.0, 6.0, 9.0, 11.9):
        d.builder.cylinder("fence", (6.0 - 4.8 * turn, -4.8, -base), (6.0 + 4.8 * turn, 4.8, -base), 0.02)
    return d.done()


def _blinds(rng: np.random.Generator) -> StereoScene:
    d = _Draft("blinds", "asphalt")
    d.builder.box("house", 12.0, 8.0, 6.0, 6.0, 12.0)
    d.builder.box("blinds", 7.0 + rng.uniform(-0.3, 0.3), 0.0, 0.3, 5.0, 12.0, 0.05)
    return d.done()


def _glass_front(rng: np.random.Generator) -> StereoScene:
    d = _Draft("glass_front", "asphalt")
    s = d.builder
    x = 6.0 + rng.uniform(-0.3, 0.3)
    s.wall("glass", (x, -6.0), (x, 6.0), 14.0, thickness=0.02)
    s.box("table", x + 3.0, 1.0, 1.0, 1.5, 9.0)
    s.wall("back wall", (x + 6.0, -8.0), (x + 6.0, 8.0), 14.0)
    _trees(s, rng, ((-8.0, -5.0), (-10.0, 4.0)))
    pane = GlassPane(name="glass", normal_ned=(-1.0, 0.0, 0.0), point_ned_m=(x, 0.0, 0.0), outside=("tree 0", "tree 1"))
    return d.done(panes=(pane,))


def _hand(rng: np.random.Generator) -> StereoScene:
    d = _Draft("hand")
    for height in (2.0, 5.0, 10.0):
        d.builder.ellipsoid("hand", (0.25, 0.1 + rng.uniform(-0.03, 0.03), -height), (0.03, 0.06, 0.09))
    return d.done()


def _fog(rng: np.random.Generator) -> StereoScene:
    made = _street(rng)
    return StereoScene(name="fog", surfaces=made.surfaces, fog_per_m=0.12)


def _snow(rng: np.random.Generator) -> StereoScene:
    """A field without texture under the sky: nothing to match at all."""
    d = _Draft("snow", "blank")
    d.builder.box("house", 14.0, 3.0, 5.0, 6.0, 12.0, rng.uniform(-0.3, 0.3))
    return d.done()


STEREO_SCENES: dict[str, Callable[[np.random.Generator], StereoScene]] = {
    "field": _field,
    "field_with_trees": _field_with_trees,
    "meadow_by_wood": _meadow_by_wood,
    "street": _street,
    "container_4m": lambda rng: _container(rng, 4.0),
    "container_8m": lambda rng: _container(rng, 8.0),
    "container_12m": lambda rng: _container(rng, 12.0),
    "blank_wall_with_base": lambda rng: _blank_wall(rng, 14.0, "blank_wall_with_base"),
    "blank_wall_without_base": lambda rng: _blank_wall(rng, 2.5, "blank_wall_without_base"),
    "white_pillars": _white_pillars,
    "white_balloons": _white_balloons,
    "overhang": _overhang,
    "bridge": _bridge,
    "white_room": _white_room,
    "roof_edge": _roof_edge,
    "hill_crest": _hill_crest,
    "wires": _wires,
    "fence": _fence,
    "blinds": _blinds,
    "glass_front": _glass_front,
    "hand": _hand,
    "fog": _fog,
    "snow": _snow,
}


def make_stereo_scene(name: str, seed: int = 0) -> StereoScene:
    """A named scene; the seed moves its things. Raises ValueError for a name that does not exist."""
    if name not in STEREO_SCENES:
        raise ValueError(f"no stereo scene {name!r}; there are: {', '.join(STEREO_SCENES)}")
    return STEREO_SCENES[name](np.random.Generator(np.random.PCG64(seed)))
