"""The named scenes: what a drone meets, laid out northwards of the origin within 20 m, ground at z = 0."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .scenes import GroundTruth, Scene, SceneBuilder

WINDOW_M = (2.9, 2.1)
"""Width and height of the window of the paper's Fig. 8c: it must stay open."""
SLIT_M = (1.2, 0.6)
"""An opening too small to pass: it must be filled."""


def _street(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("street")
    s.ground()
    for side in (-1.0, 1.0):
        x = -6.0
        for i in range(4):
            length, back = rng.uniform(5.0, 9.0), rng.uniform(0.0, 1.5)
            s.box(f"house {i}", x + length / 2, side * (6.5 + back + 4), length, 8.0, rng.uniform(5.0, 11.0))
            x += length + (rng.uniform(0.0, 3.0) if i == 1 else 0.0)
    for i in range(4):
        side = -1.0 if i % 2 else 1.0
        s.pole("lamp", 5.0 + 4.0 * i, side * 4.6, 0.14, 5.5)
        s.box("car", 6.5 + 4.5 * i, -side * 4.2, 4.2, 1.8, 1.45, rng.uniform(-0.05, 0.05))
    s.box("kiosk", 13.0, 2.4, 2.0, 2.0, 2.6, 0.4)
    return s.build()


def _corner(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("corner")
    s.ground()
    turn = rng.uniform(-0.1, 0.1)
    s.wall("wall", (9.5, -7.0), (9.5 + 10 * math.sin(turn), 3.0), 5.0)
    s.wall("side wall", (10.0, 3.0), (2.0, 3.6), 4.0)
    s.box("house", 8.0, -6.5, 4.0, 5.0, 7.0, 0.35)
    return s.build()


def _alley(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("alley")
    s.ground()
    s.wall("left wall", (-2.0, -1.7), (16.0, -1.9), 6.0)
    s.wall("right wall", (15.0, 1.8), (-2.0, 1.6), 4.5)
    s.wall("end wall", (17.0, -4.0), (17.0, 6.0), 5.0)
    s.box("bin", 7.0, 1.2, 1.1, 0.7, 1.3)
    s.box("crate", 11.0, -1.3, 0.8, 0.8, 0.9, rng.uniform(0.0, 1.0))
    return s.build()


def _gable(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("gable")
    s.ground()
    s.gable("house", 12.0, 0.5, 9.0, 6.5, 3.2, 6.0, math.pi / 2 + rng.uniform(-0.35, 0.35))
    s.gable("shed", 7.0, -5.0, 3.0, 2.6, 2.0, 3.1, rng.uniform(-0.5, 0.5))
    return s.build()


def _window(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("window")
    s.ground()
    width, height = WINDOW_M
    start = 6.0 - width / 2 + rng.uniform(-0.2, 0.2)
    s.wall("facade", (6.5, -6.0), (6.5, 6.0), 5.5, ((start, 1.0, width, height), (9.0, 1.8, *SLIT_M)))
    s.wall("back wall", (14.0, -12.0), (14.0, 12.0), 7.0)
    return s.build()


def _wall(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("wall")
    s.ground()
    skew = rng.uniform(-1.5, 1.5)
    s.wall("wall", (8.0 - skew, -8.0), (8.0 + skew, 8.0), 4.0)
    return s.build()


def _trees(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("trees", structured=False)
    s.ground()
    for i, (x, y) in enumerate(((6.0, -2.4), (8.5, 3.0), (11.0, -5.5), (13.0, 0.5), (15.5, 6.0))):
        dx, dy = rng.uniform(-0.5, 0.5, 2)
        s.tree(f"tree {i}", x + dx, y + dy, rng.uniform(3.8, 6.0), rng.uniform(1.1, 1.7), 400, rng)
    return s.build()


def _stones(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("stones", structured=False)
    s.ground()
    for i in range(14):
        s.stone(f"stone {i}", rng.uniform(4.0, 17.0), rng.uniform(-6.5, 6.5), rng.uniform(1.2, 3.2), rng)
    return s.build()


def _poles(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("poles")
    s.ground()
    for x, y in ((4.0, -1.5), (6.0, 1.6), (8.0, -0.6), (10.0, 3.6), (12.0, -4.0), (15.0, 1.0)):
        s.pole(f"pole at {x:g} m", x + rng.uniform(-0.1, 0.1), y, 0.12, 5.0)
    return s.build()


def _wires(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("wires")
    s.ground()
    for i, (x, height) in enumerate(((4.0, 2.6), (6.0, 3.0), (9.0, 3.6), (12.0, 4.4))):
        s.cylinder(f"wire at {x:g} m", (x, -9.0, -height), (x + rng.uniform(-0.6, 0.6), 9.0, -height), 0.01 + 0.005 * i)
    return s.build()


def _mixture(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("mixture", structured=False)
    s.ground()
    s.box("house", 14.5, -5.0, 6.0, 8.0, 6.5, 0.2)
    s.tree("tree", 8.0, 3.2, rng.uniform(4.2, 5.5), 1.5, 450, rng)
    s.pole("pole", 6.0, -1.4, 0.12, 5.0)
    s.stone("stone", 5.0, 2.0, 1.9, rng)
    s.stone("boulder", 9.5, -2.8, 2.6, rng)
    s.wall("wall", (12.0, 4.5), (16.0, 9.0), 2.4)
    return s.build()


def _slope(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("slope")
    s.ground(math.tan(math.radians(-2.5)), math.tan(math.radians(1.0)))
    s.box("house", 12.0, -3.0, 5.0, 5.0, 8.0, rng.uniform(0.0, 0.5), base=-1.0)
    s.box("pillar", 7.0, 2.5, 1.0, 1.0, 4.0)
    return s.build()


def _ramp(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("ramp")
    s.ground()
    s.ramp("ramp", 9.0, 0.0, 6.0, 3.0, 2.0 + rng.uniform(-0.2, 0.2))
    s.box("hall", 15.0, 0.0, 4.0, 9.0, 5.0)
    return s.build()


def _shapes(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("cylinder_trapezoid_sphere")
    s.ground()
    s.pole("cylinder", 8.0, -3.6, 2.0, 3.5)
    s.trapezoid("trapezoid", 9.0, 0.3, 3.0, 1.4, 3.2, rng.uniform(0.3, 0.6))
    s.sphere("sphere", 8.5, 4.2, 1.8, 1.3)
    return s.build()


def _open(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("open")
    s.ground()
    return s.build()


def _tunnel(rng: np.random.Generator) -> Scene:
    s = SceneBuilder("tunnel")
    s.ground()
    s.box("ceiling", 8.0, 0.0, 24.0, 8.0, 0.3, base=2.9)
    s.wall("left wall", (-3.0, -1.6), (16.0, -1.6), 2.9, ((9.0, 0.0, 2.2, 2.2),))
    s.wall("right wall", (16.0, 1.6), (-3.0, 1.6), 2.9)
    s.wall("end wall", (15.5, -3.0), (15.5, 3.0), 2.9)
    s.box("cabinet", 10.0, 1.3, 1.0, 0.6, 1.9)
    return s.build()


def _no_ground(rng: np.random.Generator) -> Scene:
    """Things above a ground that is not drawn: water without texture, say."""
    s = SceneBuilder("no_ground", ground_truth=GroundTruth(30.0))
    s.wall("wall", (11.0, -3.0), (12.0, 4.0), 6.0)
    s.sphere("sphere", 7.0, -3.5, 2.5, 1.2)
    s.pole("pole", 6.0, 2.0, 0.15, 6.0)
    return s.build()


def _movers(rng: np.random.Generator) -> Scene:
    """A street with a person who crosses, one who walks away, and a car that crosses behind them. Positions at time 0."""
    s = SceneBuilder("movers")
    s.ground()
    s.wall("facade", (-3.0, -9.0), (19.0, -9.0), 6.0)
    s.wall("end wall", (18.0, -14.0), (18.0, 14.0), 5.0)
    for x in (5.0, 11.0):
        s.pole("lamp", x, 5.0, 0.14, 5.5)
    s.velocity_m_s = (0.0, 1.5, 0.0)
    s.person("person across", 5.0, -3.5)
    s.velocity_m_s = (1.2, 0.0, 0.0)
    s.person("person away", 3.5, 1.8)
    s.velocity_m_s = (0.0, -8.0, 0.0)
    s.box("car", 12.0, 12.0 + rng.uniform(-1.0, 1.0), 4.2, 1.8, 1.45, math.pi / 2)
    return s.build()


def _demo(rng: np.random.Generator) -> Scene:
    """A street 30 m long with houses, lamps, cars, trees and a kiosk, closed by a facade with a window."""
    s = SceneBuilder("demo")
    s.ground()
    for side in (-1.0, 1.0):
        for i, x in enumerate((-4.0, 5.5, 15.0)):
            s.box(f"house {i}", x + 3.7, side * (9.5 + rng.uniform(0.0, 1.0)), 7.5, 7.0, rng.uniform(5.0, 9.0))
    s.gable("gable house", 19.0, -10.5, 7.0, 7.0, 4.0, 6.5, math.pi / 2)
    for i, x in enumerate((4.0, 9.0, 14.0, 19.0)):
        s.pole("lamp", x, -3.6 if i % 2 else 3.6, 0.14, 5.0)
    s.box("car", 7.0, -4.6, 4.2, 1.8, 1.45, 0.03)
    s.box("van", 12.5, 4.7, 5.0, 2.0, 2.3, -0.04)
    s.tree("tree", 9.5, 4.0, 4.8, 1.4, 420, rng)
    s.tree("tree by the facade", 16.5, -4.2, 5.2, 1.5, 420, rng)
    width, height = WINDOW_M
    s.wall("facade", (22.0, -9.0), (22.0, 9.0), 6.0, ((9.0 - width / 2, 1.0, width, height),))
    s.wall("back wall", (28.0, -9.0), (28.0, 9.0), 6.0)
    return s.build()


SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "street": _street,
    "corner": _corner,
    "alley": _alley,
    "gable": _gable,
    "window": _window,
    "wall": _wall,
    "trees": _trees,
    "stones": _stones,
    "poles": _poles,
    "wires": _wires,
    "mixture": _mixture,
    "slope": _slope,
    "ramp": _ramp,
    "cylinder_trapezoid_sphere": _shapes,
    "open": _open,
    "tunnel": _tunnel,
    "no_ground": _no_ground,
    "demo": _demo,
    "movers": _movers,
}


def make_scene(name: str, seed: int = 0) -> Scene:
    """A named scene; the seed moves and shapes its things. Raises ValueError for a name that does not
    exist."""
    if name not in SCENES:
        raise ValueError(f"no scene {name!r}; there are: {', '.join(SCENES)}")
    return SCENES[name](np.random.Generator(np.random.PCG64(seed)))
