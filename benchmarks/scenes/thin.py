"""Thin objects (poles, wires, fences), and ground with few or no objects.

Each scene extends northwards of a camera near the origin."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from drivers.simulation.scenes import GroundTruth, Scene, SceneBuilder

from .parts import Line, across, begin, hanging_wire, spread

Make = Callable[[np.random.Generator], Scene]


def pole_ranges(rng: np.random.Generator) -> Scene:
    """Poles of 0.12 m from 4 to 18 m, none hiding another: for recall over range."""
    s = begin("pole_ranges", structured=True)
    azimuth = np.linspace(-0.5, 0.5, 9) + rng.uniform(-0.03, 0.03, 9)
    for x, turn in zip(rng.permutation(np.linspace(4.0, 18.0, 9)).tolist(), azimuth.tolist(), strict=True):
        s.pole(f"pole at {x:.1f} m", x, x * math.tan(turn), 0.12, 6.0)
    return s.build()


def pole_sizes(rng: np.random.Generator) -> Scene:
    """Poles of 0.04 to 0.2 m between 9 and 10 m away, so far apart that the vehicle passes between them."""
    s = begin("pole_sizes", structured=True)
    for i, size in enumerate(rng.permutation([0.04, 0.06, 0.08, 0.12, 0.2]).tolist()):
        x = rng.uniform(9.3, 9.9)
        s.pole(f"post of {100 * size:.0f} cm", x, x * math.tan(-0.48 + 0.24 * i), size, 4.0)
    return s.build()


def power_line(rng: np.random.Generator) -> Scene:
    """Poles that carry hanging wires across and along the view."""
    s = begin("power_line", structured=True)
    far, turn = rng.uniform(7.0, 12.0), rng.uniform(-0.7, 0.7)
    line = across(far, 12.0, turn)
    posts = [line.at(along) for along in (2.0, 12.0, 22.0)]
    for x, y in posts:
        s.pole("mast", x, y, 0.25, 7.0)
    for height, radius in ((6.6, 0.012), (5.6, 0.012), (4.4, 0.02)):
        for (ax, ay), (bx, by) in itertools.pairwise(posts):
            sag = rng.uniform(0.3, 1.0)
            hanging_wire(s, f"wire at {height:g} m", (ax, ay, -height), (bx, by, -height), sag, radius)
    return s.build()


def wire_ranges(rng: np.random.Generator) -> Scene:
    """Horizontal wires of 2 cm across the view at 4 to 14 m, each at another height."""
    s = begin("wire_ranges", structured=True)
    for i, x in enumerate(np.array([4.0, 6.0, 8.5, 11.0, 14.0]) + rng.uniform(-0.4, 0.4, 5)):
        height, turn = 2.0 + x * math.tan(0.035 + 0.07 * i), rng.uniform(-0.25, 0.25)
        line = Line(x - 12.0 * math.sin(turn), -12.0 * math.cos(turn), math.pi / 2 - turn)
        a, b = line.at(0.0), line.at(24.0)
        s.cylinder(f"wire at {x:.1f} m", (*a, -height), (*b, -height), 0.01)
    return s.build()


def fences(rng: np.random.Generator) -> Scene:
    """Posts with rails or wires between them, near and far."""
    s = begin("fences", structured=True)
    for name, near, far, radius in (("rail", 5.0, 7.0, 0.04), ("wire", 9.0, 12.0, 0.008)):
        line = across(rng.uniform(near, far), 9.0, rng.uniform(-0.5, 0.5))
        step = rng.uniform(2.0, 3.0)
        for i in range(int(18.0 / step) + 1):
            x, y = line.at(i * step)
            s.pole(f"{name} post", x, y, 0.1, 1.5)
        for height in (0.7, 1.05, 1.4):
            a, b = line.at(0.0), line.at(int(18.0 / step) * step)
            s.cylinder(name, (*a, -height), (*b, -height), radius)
    return s.build()


def scaffold(rng: np.random.Generator) -> Scene:
    """Tubes of 5 cm in fields of about 2.5 x 2 m, with boards, in front of a wall."""
    s = begin("scaffold", structured=True)
    line = across(rng.uniform(6.0, 9.0), 6.0, rng.uniform(-0.4, 0.4))
    step, rise = rng.uniform(2.2, 2.8), rng.uniform(1.9, 2.2)
    count = int(12.0 / step)
    for behind in (0.0, 0.9):
        for i in range(count + 1):
            x, y = line.at(i * step, behind)
            s.pole("tube", x, y, 0.05, 3 * rise + 1.0)
        for floor in (1, 2, 3):
            a, b = line.at(0.0, behind), line.at(count * step, behind)
            s.cylinder("tube across", (*a, -floor * rise), (*b, -floor * rise), 0.025)
    for floor in (1, 2):
        line.box(s, "boards", (0.0, count * step), (0.05, 0.85), 0.05, floor * rise)
    line.box(s, "wall", (-2.0, 14.0), (1.4, 1.7), 8.0)
    return s.build()


THIN: dict[str, Make] = {f.__name__: f for f in (pole_ranges, pole_sizes, power_line, wire_ranges, fences, scaffold)}
"""Name -> what makes it."""


def low_things(rng: np.random.Generator) -> Scene:
    """Kerbs, flower beds and flat stones, all too low to be obstacles, and one bollard."""
    s = begin("low_things", structured=True)
    s.box("kerb", 8.0, rng.uniform(-4.0, -3.0), 10.0, 0.3, 0.15, rng.uniform(-0.1, 0.1))
    s.box("bed", 6.5, rng.uniform(1.0, 2.5), 2.0, 1.4, 0.35, rng.uniform(0.0, 1.5))
    s.box("step", rng.uniform(10.0, 13.0), 0.0, 2.0, 6.0, 0.3, rng.uniform(-0.4, 0.4))
    s.pole("bollard", rng.uniform(5.0, 8.0), rng.uniform(-1.5, 0.5), 0.2, 1.0)
    return s.build()


def mounds(rng: np.random.Generator) -> Scene:
    """Uneven ground: swellings up to 0.4 m high and many metres wide."""
    s = begin("mounds")
    for i, (x, y) in enumerate(spread(rng, 7, 4.0, 18.0, 3.0)):
        rise = rng.uniform(0.1, 0.4)
        s.ellipsoid(
            f"mound {i}", (x, y, 0.6), (rng.uniform(2.5, 5.0), rng.uniform(2.5, 5.0), 0.6 + rise), rng.uniform(0, 3)
        )
    return s.build()


def trees_no_ground(rng: np.random.Generator) -> Scene:
    """Tree tops and a wall far above a ground that is not drawn."""
    s = SceneBuilder("trees_no_ground", structured=False, ground_truth=GroundTruth(30.0))
    for i, (x, y) in enumerate(spread(rng, 4, 5.0, 13.0, 3.0)):
        s.tree(f"tree {i}", x, y, rng.uniform(4.0, 6.0), rng.uniform(1.2, 1.8), 350, rng)
    line = across(rng.uniform(13.0, 16.0), 5.0, rng.uniform(-0.4, 0.4))
    line.box(s, "wall", (0.0, 6.0), (0.0, 0.3), 5.0)
    return s.build()


def platform(rng: np.random.Generator) -> Scene:
    """A loading platform: a second level of 1.1 to 1.5 m with boxes on it."""
    s = begin("platform", structured=True)
    line = across(rng.uniform(6.0, 8.0), 6.0, rng.uniform(-0.4, 0.4), rng.uniform(-2.0, 2.0))
    high = rng.uniform(1.1, 1.5)
    line.box(s, "platform", (0.0, 12.0), (0.0, 7.0), high)
    for i in range(3):
        along = 1.5 + 3.5 * i + rng.uniform(0.0, 1.0)
        line.box(s, f"box {i}", (along, along + rng.uniform(0.8, 2.0)), (1.5, 2.8), rng.uniform(0.8, 2.0), high)
    return s.build()


GROUND: dict[str, Make] = {f.__name__: f for f in (low_things, mounds, trees_no_ground, platform)}
"""Name -> what makes it."""
