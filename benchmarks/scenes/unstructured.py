"""Unstructured scenes: leaves, branches, stones, rubble, and mixtures of them with houses."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.simulation.scenes import Scene

from .parts import across, bare_tree, begin, bush, chunk, conifer, hedge, reeds, spread

Make = Callable[[np.random.Generator], Scene]


def forest(rng: np.random.Generator) -> Scene:
    """High trees whose crowns begin above the camera, trunks close together."""
    s = begin("forest")
    for i, (x, y) in enumerate(spread(rng, 9, 5.0, 18.0, 2.2)):
        height = rng.uniform(6.0, 10.0)
        s.tree(f"tree {i}", x, y, height, rng.uniform(1.4, 2.2), 260, rng)
    return s.build()


def bushes(rng: np.random.Generator) -> Scene:
    """Bushes of 0.8 to 2.2 m."""
    s = begin("bushes")
    for i, (x, y) in enumerate(spread(rng, 9, 4.5, 16.0, 2.0)):
        bush(s, f"bush {i}", x, y, rng.uniform(0.8, 2.2), rng.uniform(0.6, 1.4), rng)
    return s.build()


def hedges(rng: np.random.Generator) -> Scene:
    """Two rows of hedge with a gap to pass, one behind the other."""
    s = begin("hedges")
    line = across(rng.uniform(6.0, 8.0), 6.0, rng.uniform(-0.5, 0.5))
    gap, wide = rng.uniform(3.0, 6.0), rng.uniform(2.4, 3.5)
    hedge(s, "hedge", line, (0.0, gap), rng.uniform(1.2, 2.4), 0.8, rng)
    hedge(s, "hedge", line, (gap + wide, 12.0), rng.uniform(1.2, 2.4), 0.8, rng)
    back = across(rng.uniform(11.5, 15.0), 8.0, rng.uniform(-0.3, 0.3))
    hedge(s, "far hedge", back, (0.0, 13.0), rng.uniform(1.5, 3.0), 1.0, rng)
    return s.build()


def rubble(rng: np.random.Generator) -> Scene:
    """Heaps of broken pieces in front of what is left of a wall."""
    s = begin("rubble")
    for x, y in spread(rng, 4, 5.5, 13.0, 3.0):
        high = rng.uniform(0.8, 2.0)
        for _ in range(22):
            turn, out = rng.uniform(0.0, 2 * math.pi), 1.9 * math.sqrt(rng.uniform())
            up = high * (1.0 - out / 1.9) * rng.uniform(0.2, 1.0)
            place = (x + out * math.cos(turn), y + out * math.sin(turn), -up)
            chunk(s, "heap", place, rng.uniform(0.4, 1.3), rng)
    line = across(rng.uniform(14.0, 16.0), 7.0, rng.uniform(-0.2, 0.2))
    for i in range(7):
        line.box(s, "wall", (2.0 * i, 2.0 * i + 2.0), (0.0, 0.3), rng.uniform(0.8, 4.0))
    return s.build()


def boulders(rng: np.random.Generator) -> Scene:
    """A few rocks of 2.5 to 5 m and small ones between them."""
    s = begin("boulders")
    for i, (x, y) in enumerate(spread(rng, 4, 7.0, 16.0, 4.0)):
        s.stone(f"boulder {i}", x, y, rng.uniform(2.5, 4.6), rng)
    for i, (x, y) in enumerate(spread(rng, 8, 4.0, 14.0, 1.5)):
        s.stone(f"stone {i}", x, y, rng.uniform(0.5, 1.4), rng)
    return s.build()


def conifers(rng: np.random.Generator) -> Scene:
    """Cones of needles down to the knee."""
    s = begin("conifers")
    for i, (x, y) in enumerate(spread(rng, 6, 5.0, 16.0, 2.6)):
        conifer(s, f"conifer {i}", x, y, rng.uniform(3.5, 8.0), rng.uniform(1.0, 1.8), rng)
    return s.build()


def bare_trees(rng: np.random.Generator) -> Scene:
    """Trees without leaves: nothing but branches."""
    s = begin("bare_trees")
    for i, (x, y) in enumerate(spread(rng, 5, 4.5, 14.0, 2.8)):
        bare_tree(s, f"bare tree {i}", x, y, rng.uniform(3.5, 6.5), rng)
    return s.build()


def reed_beds(rng: np.random.Generator) -> Scene:
    """Patches of thin stems up to 1.9 m, a stone and a post among them."""
    s = begin("reed_beds")
    for i, (x, y) in enumerate(spread(rng, 4, 4.5, 11.0, 2.5)):
        reeds(s, f"reeds {i}", x, y, rng.uniform(0.8, 1.6), 130, rng)
    s.stone("stone", rng.uniform(9.0, 12.0), rng.uniform(-3.0, 3.0), 2.2, rng)
    s.pole("post", rng.uniform(6.0, 9.0), rng.uniform(-2.0, 2.0), 0.15, 2.2)
    return s.build()


def park(rng: np.random.Generator) -> Scene:
    """Trees, bushes, a hedge, a lamp, a bench."""
    s = begin("park")
    places = spread(rng, 6, 5.0, 15.0, 2.8)
    for i, (x, y) in enumerate(places[:2]):
        s.tree(f"tree {i}", x, y, rng.uniform(4.5, 7.0), rng.uniform(1.3, 2.0), 380, rng)
    for i, (x, y) in enumerate(places[2:4]):
        bush(s, f"bush {i}", x, y, rng.uniform(0.9, 1.8), rng.uniform(0.7, 1.2), rng)
    s.pole("lamp", *places[4], 0.12, 4.2)
    s.box("bench", *places[5], 1.8, 0.6, 0.85, rng.uniform(0.0, math.pi))
    hedge(s, "hedge", across(rng.uniform(15.0, 17.0), 8.0, rng.uniform(-0.2, 0.2)), (0.0, 14.0), 1.8, 0.8, rng)
    return s.build()


def tree_before_wall(rng: np.random.Generator) -> Scene:
    """A tree and a bush one to three metres in front of a house."""
    s = begin("tree_before_wall")
    far = rng.uniform(9.0, 12.0)
    line = across(far, 9.0, rng.uniform(-0.3, 0.3))
    line.box(s, "house", (0.0, 18.0), (0.0, 6.0), rng.uniform(5.0, 8.0))
    s.tree("tree", far - rng.uniform(2.2, 3.4), rng.uniform(-2.5, 2.5), rng.uniform(4.0, 6.0), 1.4, 400, rng)
    bush(s, "bush", far - rng.uniform(1.8, 2.4), rng.uniform(3.0, 4.5), 1.5, 0.9, rng)
    bush(s, "bush by the wall", far - rng.uniform(1.8, 2.4), rng.uniform(-5.0, -3.5), 1.2, 1.0, rng)
    return s.build()


def avenue(rng: np.random.Generator) -> Scene:
    """Two rows of trees along a road with houses behind them."""
    s = begin("avenue")
    for side in (-1.0, 1.0):
        s.box("house", rng.uniform(8.0, 11.0), side * 10.5, rng.uniform(8.0, 14.0), 6.0, rng.uniform(5.0, 9.0))
        for i, x in enumerate((5.0, 9.5, 14.0)):
            place = (x + rng.uniform(-0.6, 0.6), side * (3.6 + rng.uniform(-0.4, 0.4)))
            s.tree(f"tree {i}", *place, rng.uniform(4.5, 7.0), rng.uniform(1.2, 1.8), 280, rng)
    s.box("car", rng.uniform(8.0, 12.0), rng.uniform(-1.0, 1.0), 4.2, 1.8, 1.45, rng.uniform(-0.1, 0.1))
    return s.build()


def garden(rng: np.random.Generator) -> Scene:
    """A shed, a fence of boards, a hedge, bushes, stones and a young tree."""
    s = begin("garden")
    places = spread(rng, 6, 4.5, 12.0, 2.4)
    s.gable("shed", *places[0], 2.6, 2.2, 2.0, 2.8, rng.uniform(0.0, math.pi))
    for i, (x, y) in enumerate(places[1:3]):
        bush(s, f"bush {i}", x, y, rng.uniform(0.8, 1.7), rng.uniform(0.6, 1.1), rng)
    for i, (x, y) in enumerate(places[3:5]):
        s.stone(f"stone {i}", x, y, rng.uniform(0.8, 2.0), rng)
    s.tree("tree", *places[5], rng.uniform(2.8, 4.0), rng.uniform(0.8, 1.2), 240, rng)
    line = across(rng.uniform(13.0, 15.0), 8.0, rng.uniform(-0.2, 0.2))
    line.box(s, "boards", (0.0, 8.0), (0.0, 0.08), 1.7)
    hedge(s, "hedge", line, (8.0, 16.0), 1.6, 0.7, rng)
    return s.build()


def gorge(rng: np.random.Generator) -> Scene:
    """Rock on both sides and scree at its foot."""
    s = begin("gorge")
    for side in (-1.0, 1.0):
        for i in range(4):
            x, y = 3.0 + 4.6 * i + rng.uniform(-0.8, 0.8), side * rng.uniform(5.5, 7.5)
            s.stone(f"rock {i}", x, y, rng.uniform(5.0, 6.5), rng)
    for i, (x, y) in enumerate(spread(rng, 10, 4.5, 16.0, 1.4)):
        s.stone(f"scree {i}", x, y, rng.uniform(0.5, 1.8), rng)
    return s.build()


UNSTRUCTURED: dict[str, Make] = {
    f.__name__: f
    for f in (
        forest, bushes, hedges, rubble, boulders, conifers, bare_trees, reed_beds, park, tree_before_wall, avenue,
        garden, gorge,
    )
}  # fmt: skip
"""Name -> what makes it."""
