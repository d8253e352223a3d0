"""Structured scenes: what has planar faces. Each is laid out northwards of a camera near the origin."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.simulation.scenes import Scene, SceneBuilder

from .parts import Line, across

WINDOW_M, CORRIDOR_M = (2.9, 2.1), (5.8, 2.2)
"""Width and height of the openings of the paper's Fig. 8c and 8d: they must stay open."""
SLIT_M = (1.2, 0.6)
"""An opening too small to pass: it must be filled."""
SIZES_M = (WINDOW_M, (2.4, 2.4), (3.6, 1.8), (2.2, 1.3), (0.9, 1.3), (1.6, 1.4), SLIT_M)
"""Widths and heights of windows; the last three are too narrow or too low to pass."""

Make = Callable[[np.random.Generator], Scene]


def paper_window(rng: np.random.Generator) -> Scene:
    """The window of Fig. 8c and the slit in one facade, with or without a wall behind."""
    s = SceneBuilder("paper_window")
    s.ground()
    line = across(rng.uniform(5.5, 8.5), 7.0, rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5))
    sill = rng.uniform(0.8, 1.4)
    holes = ((5.0 + rng.uniform(-0.3, 0.3), sill, *WINDOW_M), (8.9, rng.uniform(1.6, 2.2), *SLIT_M))
    s.wall("facade", line.at(0.0), line.at(14.0), rng.uniform(4.6, 6.0), holes)
    if rng.uniform() < 0.6:
        line.box(s, "back wall", (-4.0, 18.0), (6.0, 6.3), 7.0)
    return s.build()


def paper_corridor(rng: np.random.Generator) -> Scene:
    """The passage of Fig. 8d through a building: 5.8 x 2.2 m, from the ground or over a low sill."""
    s = SceneBuilder("paper_corridor")
    s.ground()
    line = across(rng.uniform(6.5, 9.0), 9.0, rng.uniform(-0.2, 0.2), rng.uniform(-0.8, 0.8))
    width, height = CORRIDOR_M
    start, sill, deep = 9.0 - width / 2, float(rng.choice([0.0, 0.4])), rng.uniform(3.0, 8.0)
    s.wall("facade", line.at(0.0), line.at(18.0), 6.0, ((start, sill, width, height),))
    for name, side in (("left side", (start - 0.25, start)), ("right side", (start + width, start + width + 0.25))):
        line.box(s, name, side, (0.25, deep), sill + height)
    line.box(s, "ceiling", (start - 0.25, start + width + 0.25), (0.25, deep), 0.3, sill + height)
    return s.build()


def windows(rng: np.random.Generator) -> Scene:
    """A facade of two floors with windows of several sizes, open behind or with rooms."""
    s = SceneBuilder("windows")
    s.ground()
    line = across(rng.uniform(6.0, 9.0), 8.0, rng.uniform(-0.35, 0.35))
    for floor in (0.0, 3.4):
        holes, along = [], 0.8 + rng.uniform(0.0, 1.0)
        while True:
            width, height = SIZES_M[rng.integers(len(SIZES_M))]
            if along + width > 15.2:
                break
            holes.append((along, floor + rng.uniform(0.6, 3.1 - height), width, height))
            along += width + rng.uniform(0.8, 2.0)
        s.wall("facade", line.at(0.0), line.at(16.0), 3.4, tuple(holes), base=floor)
    if rng.uniform() < 0.5:
        line.box(s, "back wall", (0.0, 16.0), (4.5, 4.8), 6.8)
    return s.build()


def courtyard(rng: np.random.Generator) -> Scene:
    """Walls around a yard, with a way out in one corner."""
    s = SceneBuilder("courtyard")
    s.ground()
    turn = rng.uniform(-0.25, 0.25)
    far, left, right = rng.uniform(9.0, 15.0), rng.uniform(4.5, 7.0), rng.uniform(4.5, 7.0)
    gap = rng.uniform(2.4, 3.5)
    line = across(far, 9.0, turn)
    s.wall("far wall", line.at(9.0 - left - 1.0), line.at(9.0 + right - gap), rng.uniform(2.5, 6.0))
    s.wall("left wall", (-1.0, -left), (far - 0.5 + left * math.sin(turn), -left - 0.4), rng.uniform(2.5, 6.0))
    s.wall("right wall", (far + 3.0, right), (-1.0, right + 0.5), rng.uniform(2.5, 6.0))
    s.box("shed", rng.uniform(5.0, 7.5), left * -0.55, 2.0, 1.6, 2.2, rng.uniform(-0.6, 0.6))
    s.box("bench", rng.uniform(4.0, 6.0), right * 0.5, 0.5, 1.8, 0.75, rng.uniform(-0.6, 0.6))
    return s.build()


def balconies(rng: np.random.Generator) -> Scene:
    """A house front with balconies: slabs and parapets that stand out."""
    s = SceneBuilder("balconies")
    s.ground()
    line = across(rng.uniform(7.5, 11.0), 8.0, rng.uniform(-0.4, 0.4))
    line.box(s, "house", (0.0, 16.0), (0.0, 6.0), 9.5)
    for floor in (2.8, 5.6):
        along = rng.uniform(0.6, 2.5)
        while along < 12.5:
            width, deep = rng.uniform(2.0, 3.4), rng.uniform(1.0, 1.6)
            line.box(s, "slab", (along, along + width), (-deep, 0.0), 0.2, floor)
            line.box(s, "parapet", (along, along + width), (-deep, -deep + 0.1), 1.0, floor + 0.2)
            if rng.uniform() < 0.5:
                line.box(s, "side", (along, along + 0.1), (-deep + 0.1, 0.0), 1.0, floor + 0.2)
            along += width + rng.uniform(1.0, 2.5)
    return s.build()


def overhang(rng: np.random.Generator) -> Scene:
    """A building whose upper floors stand out over a set-back ground floor, on columns or without."""
    s = SceneBuilder("overhang")
    s.ground()
    line = across(rng.uniform(6.0, 9.0), 6.5, rng.uniform(-0.4, 0.4), rng.uniform(-1.0, 1.0))
    clear, deep = rng.uniform(2.4, 3.4), rng.uniform(1.5, 3.0)
    line.box(s, "ground floor", (0.0, 13.0), (deep, 8.0), clear)
    line.box(s, "upper floors", (0.0, 13.0), (0.0, 8.0), 9.0 - clear, clear)
    if rng.uniform() < 0.6:
        for along in (0.2, 4.2, 8.4, 12.5):
            line.box(s, "column", (along, along + 0.35), (0.1, 0.45), clear)
    s.box("car", rng.uniform(4.5, 5.5), rng.uniform(2.8, 3.6), 4.2, 1.8, 1.45, rng.uniform(-0.3, 0.3))
    return s.build()


def stairs(rng: np.random.Generator) -> Scene:
    """A flight of steps to a landing, with a wall and a house."""
    s = SceneBuilder("stairs")
    s.ground()
    yaw, foot = rng.uniform(-0.5, 0.5), rng.uniform(5.0, 7.0)
    line = Line(foot, rng.uniform(-1.0, 1.0), yaw)
    rise, tread, count = rng.uniform(0.15, 0.19), rng.uniform(0.27, 0.33), 12
    wide = rng.uniform(1.4, 2.4)
    for i in range(count):
        line.box(s, "step", (i * tread, (i + 1) * tread), (-wide, wide), (i + 1) * rise)
    line.box(s, "landing", (count * tread, count * tread + 2.5), (-wide, wide), count * rise)
    line.box(s, "side wall", (0.0, count * tread + 2.5), (wide, wide + 0.25), count * rise + 1.0)
    line.box(s, "house", (count * tread + 2.5, count * tread + 6.0), (-6.0, 6.0), 7.0)
    return s.build()


def arcade(rng: np.random.Generator) -> Scene:
    """A row of columns that carry a lintel, and a wall behind them."""
    s = SceneBuilder("arcade")
    s.ground()
    line = across(rng.uniform(6.0, 8.5), 8.0, rng.uniform(-0.5, 0.5))
    step, side, clear = rng.uniform(2.6, 4.0), rng.uniform(0.35, 0.6), rng.uniform(2.6, 3.4)
    round_ones = bool(rng.uniform() < 0.5)
    for i in range(int(16.0 / step) + 1):
        if round_ones:
            x, y = line.at(i * step, side / 2)
            s.pole("column", x, y, side, clear)
        else:
            line.box(s, "column", (i * step - side / 2, i * step + side / 2), (0.0, side), clear)
    line.box(s, "lintel", (-side, 16.0), (0.0, side), rng.uniform(0.6, 1.6), clear)
    line.box(s, "wall", (-2.0, 18.0), (3.5, 3.8), rng.uniform(3.0, 6.0))
    return s.build()


def carport(rng: np.random.Generator) -> Scene:
    """A flat roof on posts with a car below, a fence of boards and a house."""
    s = SceneBuilder("carport")
    s.ground()
    line = across(rng.uniform(6.0, 8.0), 3.0, rng.uniform(-0.6, 0.6), rng.uniform(-1.5, 1.5))
    clear, wide, deep = rng.uniform(2.2, 2.8), rng.uniform(5.0, 6.5), rng.uniform(4.5, 5.5)
    for along in (0.0, wide - 0.15):
        for behind in (0.0, deep - 0.15):
            line.box(s, "post", (along, along + 0.15), (behind, behind + 0.15), clear)
    line.box(s, "roof", (-0.3, wide + 0.3), (-0.3, deep + 0.3), 0.25, clear)
    line.box(s, "car", (1.0, 2.85), (0.3, 4.5), 1.5)
    line.box(s, "boards", (wide + 2.0, wide + 7.0), (1.0, 1.08), 1.8)
    line.box(s, "house", (-8.0, -2.0), (0.5, 8.0), rng.uniform(4.0, 7.0))
    return s.build()


def containers(rng: np.random.Generator) -> Scene:
    """Containers, some of them stacked, at odd angles."""
    s = SceneBuilder("containers")
    s.ground()
    for i, (x, y) in enumerate(((7.0, -4.0), (9.5, 3.5), (13.5, -1.5), (15.5, 6.5))):
        yaw = rng.uniform(0.0, math.pi)
        dx, dy = rng.uniform(-0.6, 0.6, 2)
        length = float(rng.choice([3.0, 6.06]))
        s.box(f"container {i}", x + dx, y + dy, length, 2.44, 2.59, yaw)
        if rng.uniform() < 0.5:
            s.box(f"upper {i}", x + dx, y + dy, length, 2.44, 2.59, yaw + rng.uniform(-0.15, 0.15), 2.59)
    return s.build()


def bridge(rng: np.random.Generator) -> Scene:
    """A deck across the way on piers, high enough to pass below; parapets above."""
    s = SceneBuilder("bridge")
    s.ground()
    line = across(rng.uniform(7.0, 12.0), 12.0, rng.uniform(-0.4, 0.4))
    clear, deep = rng.uniform(3.2, 5.0), rng.uniform(3.0, 5.0)
    line.box(s, "deck", (0.0, 24.0), (0.0, deep), 0.8, clear)
    for behind in ((0.0, 0.2), (deep - 0.2, deep)):
        line.box(s, "parapet", (0.0, 24.0), behind, 1.0, clear + 0.8)
    for along in np.arange(rng.uniform(2.0, 5.0), 24.0, rng.uniform(5.5, 7.5)).tolist():
        line.box(s, "pier", (along, along + 0.9), (0.6, deep - 0.6), clear)
    return s.build()


def crossing(rng: np.random.Generator) -> Scene:
    """The corners of four houses, lamps and signs, kerbs too low to be obstacles."""
    s = SceneBuilder("crossing")
    s.ground()
    for side in (-1.0, 1.0):
        s.box("kerb", 3.0, side * 3.3, 10.0, 0.4, 0.14)
        s.box("near house", 1.5, side * (9.0 + rng.uniform(0.0, 2.0)), 9.0, 9.0, rng.uniform(5.0, 12.0))
        s.box("far house", 19.0, side * (8.5 + rng.uniform(0.0, 2.0)), 9.0, 9.0, rng.uniform(5.0, 12.0), side * 0.06)
        s.pole("lamp", rng.uniform(5.0, 8.0), side * rng.uniform(3.8, 4.4), 0.14, 5.5)
        s.pole("sign post", rng.uniform(10.0, 13.0), side * rng.uniform(3.6, 4.4), 0.08, 2.6)
    s.box("van", rng.uniform(9.5, 12.5), rng.uniform(-2.5, 2.5), 5.2, 2.0, 2.4, rng.uniform(0.0, math.pi))
    return s.build()


def hall(rng: np.random.Generator) -> Scene:
    """The inside of a hall 6.5 m high with columns, shelves and a gate in the end wall."""
    s = SceneBuilder("hall")
    s.ground()
    half, far = rng.uniform(6.0, 8.0), rng.uniform(13.0, 17.0)
    s.box("ceiling", 8.0, 0.0, 26.0, 2 * half + 1.0, 0.3, base=6.5)
    s.wall("left wall", (-4.0, -half), (far, -half), 6.5)
    s.wall("right wall", (far, half), (-4.0, half), 6.5)
    gate = half + rng.uniform(-2.0, 2.0) - 1.9
    s.wall("end wall", (far, -half), (far, half), 6.5, ((gate, 0.0, 3.8, 3.4),))
    for x in (4.0, 8.5, 13.0):
        for side in (-1.0, 1.0):
            s.box("column", x, side * 0.5 * half, 0.4, 0.4, 6.5)
    for i in range(3):
        s.box(f"shelf {i}", 5.0 + 3.0 * i, (half - 0.7) * (-1.0 if i % 2 else 1.0), 2.6, 0.9, rng.uniform(1.8, 4.0))
    return s.build()


def towers(rng: np.random.Generator) -> Scene:
    """High buildings, which a camera at any height faces."""
    s = SceneBuilder("towers")
    s.ground()
    for i, (x, y) in enumerate(((9.0, -5.5), (14.0, 1.0), (10.5, 7.0))):
        dx, dy = rng.uniform(-0.8, 0.8, 2)
        side = rng.uniform(3.5, 6.0)
        s.box(
            f"tower {i}", x + dx, y + dy, side, rng.uniform(3.5, 6.0), rng.uniform(11.0, 22.0), rng.uniform(-0.7, 0.7)
        )
    s.pole("mast", 7.0, rng.uniform(0.0, 2.0), 0.2, 14.0)
    return s.build()


def roofs(rng: np.random.Generator) -> Scene:
    """Low houses with saddle roofs, chimneys and flat annexes: what is seen from above."""
    s = SceneBuilder("roofs")
    s.ground()
    for i, (x, y) in enumerate(((9.0, -4.5), (10.5, 5.0), (17.5, -1.0))):
        yaw, eaves = rng.uniform(0.0, math.pi), rng.uniform(2.6, 4.0)
        s.gable(f"house {i}", x, y, 6.5, 5.0, eaves, eaves + rng.uniform(1.5, 2.6), yaw)
        s.box("chimney", x + 1.0 * math.cos(yaw), y + 1.0 * math.sin(yaw), 0.6, 0.6, eaves + 3.4, yaw)
    s.box("annexe", 6.5, rng.uniform(-0.5, 1.0), 2.5, 2.0, 2.4, rng.uniform(-0.5, 0.5))
    return s.build()


STRUCTURED: dict[str, Make] = {
    f.__name__: f
    for f in (
        paper_window, paper_corridor, windows, courtyard, balconies, overhang, stairs, arcade, carport, containers,
        bridge, crossing, hall, towers, roofs,
    )
}  # fmt: skip
"""Name -> what makes it."""
CEILINGS_M: dict[str, float] = {"hall": 5.6}
"""Scenes with a ceiling: the camera stays below this height."""
