"""Random things that stereo measures badly, in 16 families from struts and nets to water, dusk and glare.

Each thing has a random size, place, inclination and brightness; odd_scenes.py adds a random height, sky and noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.open_air.odd_draft import Draft
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.exposure import Exposure
from drivers.simulation.stereo.pair_renderer import GlassPane
from drivers.simulation.stereo.sky import CLEAR, CLOUDED, FAINT_CLOUDS, HAZY, LOW_SUN, Sky
from drivers.simulation.stereo.textures import BLANK_PAINT


def _strut(d: Draft) -> None:
    for i in range(int(d.rng.integers(1, 4))):
        name = f"strut pole {i}"
        d.paint(name)
        angle = math.radians(d.between(-90.0, 90.0)) if i else math.radians(d.between(-12.0, 12.0))
        d.beam(
            name,
            (d.log_between(1.5, 9.0), d.between(-2.0, 2.0)),
            d.between(-0.6, 0.4),
            12.0,
            angle,
            d.log_between(0.006, 0.12),
            d.between(-0.5, 0.5),
        )


def _guys(d: Draft) -> None:
    x, y, top = d.between(4.0, 9.0), d.between(-2.5, 2.5), d.height_m + d.between(1.0, 6.0)
    d.builder.pole("mast", x, y, d.log_between(0.03, 0.3), top)
    d.paint("mast")
    for turn in d.between(0.0, 2.0) + np.arange(4) * math.pi / 2.0:
        reach, foot = d.between(0.5, 1.2) * top, (x, y)
        d.builder.cylinder(
            "guy wire",
            (foot[0] + reach * math.cos(turn), foot[1] + reach * math.sin(turn), 0.0),
            (x, y, -top),
            0.5 * d.log_between(0.004, 0.03),
        )


def _crane(d: Draft) -> None:
    x, above, size = d.between(4.0, 9.0), d.between(-0.5, 1.0), d.between(0.4, 1.2)
    tilt, tube = math.radians(d.between(-8.0, 8.0)), d.log_between(0.02, 0.12)
    d.paint("crane pole")
    for dz in (0.0, size):
        for dx in (0.0, size):
            d.beam("crane pole", (x + dx, 0.0), above + dz, 24.0, tilt, tube)
    step = d.between(0.6, 1.4) * size
    for i in range(-12, 12):
        a, b = i * step, (i + 1) * step
        z0, z1 = -(d.height_m + above + a * math.tan(tilt)), -(d.height_m + above + b * math.tan(tilt))
        for dx in (0.0, size):
            d.builder.cylinder("crane pole", (x + dx, a, z0), (x + dx, b, z1 - size), 0.4 * tube)


def _pole(d: Draft) -> None:
    for i in range(int(d.rng.integers(1, 4))):
        name = f"white pole {i}"
        d.albedo[name] = d.between(0.6, 1.0)
        d.builder.pole(
            name, d.between(2.0, 9.0), d.between(-3.0, 3.0), d.log_between(0.03, 0.5), d.height_m + d.between(-0.3, 6.0)
        )
    d.sky = (CLOUDED, FAINT_CLOUDS, HAZY)[int(d.rng.integers(3))]


def _net(d: Draft) -> None:
    x, mesh, wire, turn = (
        d.between(2.5, 8.0),
        d.log_between(0.03, 0.4),
        d.log_between(0.002, 0.02),
        d.between(-0.4, 0.4),
    )
    half, low, high = d.between(1.0, 3.0), max(0.0, d.height_m - 2.0), d.height_m + d.between(0.5, 3.0)
    d.paint("net wire")
    if (half / mesh) > 60.0:
        mesh = half / 60.0
    c, s = math.cos(turn), math.sin(turn)
    for t in np.arange(-half, half + 1e-6, mesh):
        d.builder.cylinder("net wire", (x + s * t, c * t, -low), (x + s * t, c * t, -high), 0.5 * wire)
    for h in np.arange(low, high, mesh):
        d.builder.cylinder("net wire", (x - s * half, -c * half, -h), (x + s * half, c * half, -h), 0.5 * wire)


def _banner(d: Draft) -> None:
    x, width, turn = d.between(2.5, 9.0), d.between(2.0, 10.0), d.between(-0.4, 0.4)
    height, base = d.log_between(0.1, 1.5), d.height_m + d.between(-0.8, 0.5)
    d.albedo["banner"] = d.log_between(0.1, 1.0)
    y = d.between(-1.5, 1.5)
    d.builder.box("banner", x, y, 0.02, width, height, turn, base)
    for side in (-1.0, 1.0):
        d.builder.pole(
            "banner pole",
            x - side * 0.5 * width * math.sin(turn),
            y + side * 0.5 * width * math.cos(turn),
            0.06,
            base + height,
        )
    if d.between(0.0, 1.0) < 0.5:
        d.sky = HAZY


def _snow(d: Draft) -> None:
    d.ground = replace(BLANK_PAINT, albedo=d.between(0.6, 0.95), contrast=d.log_between(0.001, 0.1))
    d.sky = (HAZY, CLEAR, FAINT_CLOUDS)[int(d.rng.integers(3))]
    for i in range(3):
        name = f"blank box {i}"
        d.albedo[name] = d.between(0.3, 0.95)
        size = d.between(0.3, 3.0)
        d.builder.box(
            name,
            d.between(3.0, 10.0),
            d.between(-4.0, 4.0),
            size,
            size,
            d.height_m + d.between(-0.5, 2.0),
            d.between(-1.0, 1.0),
        )


def _drone(d: Draft) -> None:
    for i in range(int(d.rng.integers(1, 3))):
        x, y, z, body = (
            d.between(2.0, 8.0),
            d.between(-1.5, 1.5),
            d.height_m + d.between(-0.2, 0.4),
            d.between(0.08, 0.4),
        )
        name = f"drone {i}"
        d.albedo[name] = d.between(0.4, 1.0)
        d.builder.ellipsoid(name, (x, y, -z), (body, body, 0.4 * body))
        for turn in d.between(0.0, 1.0) + np.arange(4) * math.pi / 2.0:
            rx, ry = x + 2.0 * body * math.cos(turn), y + 2.0 * body * math.sin(turn)
            d.builder.cylinder(name + " pole", (x, y, -z), (rx, ry, -z), 0.01)
            d.albedo[name + " pole"] = 0.05
            d.builder.box(name + " rotor", rx, ry, body, body, 0.01, 0.0, z + 0.03)
            d.albedo[name + " rotor"] = 0.05


def _beam(d: Draft) -> None:
    name = "blank beam"
    d.albedo[name] = d.log_between(0.05, 1.0)
    x, thick = d.between(2.0, 9.0), d.log_between(0.03, 1.2)
    d.beam(name, (x, 0.0), d.between(-0.8, 0.6), 60.0, math.radians(d.between(-4.0, 4.0)), thick, d.between(-0.2, 0.2))


def _slab(d: Draft) -> None:
    """A blank slab with an inclined lower edge, as eaves, a wing or a ship's side; its top lies above the image."""
    name = "blank slab"
    d.albedo[name] = d.log_between(0.1, 1.0)
    x, base, tilt, wide = (
        d.between(2.0, 9.0),
        d.height_m + d.between(-0.4, 0.4),
        math.radians(d.between(-6.0, 6.0)),
        40.0,
    )
    y = 0.0 if d.between(0.0, 1.0) < 0.5 else 20.0 + d.between(-2.0, 2.0)
    points = [
        (x + dx, y + side * 20.0, -(base + side * 20.0 * math.tan(tilt)) - up)
        for dx in (0.0, 1.0)
        for side in (-1.0, 1.0)
        for up in (0.0, wide)
    ]
    d.builder.convex(name, np.array(points))
    d.sky = (HAZY, CLEAR)[int(d.rng.integers(2))]


def _blade(d: Draft) -> None:
    d.albedo["blank blade"] = d.between(0.5, 1.0)
    length = d.between(2.0, 8.0)
    x, y, z = d.between(2.5, 9.0), d.between(-2.0, 2.0), d.height_m + d.between(-0.5, 0.5)
    d.builder.ellipsoid(
        "blank blade", (x, y, -z), (d.between(0.05, 0.3), 0.5 * length, d.log_between(0.05, 0.6)), d.between(-0.5, 0.5)
    )
    d.sky = (HAZY, CLEAR, FAINT_CLOUDS)[int(d.rng.integers(3))]


def _rope(d: Draft) -> None:
    for i in range(3):
        name = f"rope pole {i}"
        d.paint(name)
        x, y, low = d.between(1.5, 8.0), d.between(-2.0, 2.0), d.height_m + d.between(-2.0, 0.2)
        d.builder.cylinder(
            name,
            (x, y, -max(low, 0.1)),
            (x + d.between(-1.0, 1.0), y + d.between(-1.0, 1.0), -low - 20.0),
            0.5 * d.log_between(0.006, 0.08),
        )


def _dusk(d: Draft) -> None:
    _strut(d)
    _pole(d)
    d.sky = Sky(horizon=d.log_between(0.05, 0.4), zenith=0.04, ambient=0.9)
    d.exposure = Exposure(noise_grey=d.between(2.0, 8.0), target=d.between(0.15, 0.45))


def _glare(d: Draft) -> None:
    _pole(d)
    _strut(d)
    d.sky = replace(
        LOW_SUN, sun_azimuth_rad=d.between(-0.6, 0.6), sun_elevation_rad=d.between(0.02, 0.5), glare=d.between(0.3, 2.0)
    )


def _glass(d: Draft) -> None:
    x = d.between(4.0, 8.0)
    wide, count = d.between(0.8, 2.5), 4
    d.builder.wall(
        "wall",
        (x, -8.0),
        (x, 8.0),
        d.height_m + 4.0,
        tuple((0.3 + i * (wide + 0.3), d.height_m - 1.2, wide, 2.2) for i in range(count)),
    )
    d.albedo["wall"] = d.between(0.3, 0.9)
    d.builder.wall("glass", (x + 0.1, -8.0), (x + 0.1, 8.0), d.height_m + 3.0, thickness=0.02)
    d.builder.wall("back wall", (x + 6.0, -9.0), (x + 6.0, 9.0), d.height_m + 3.0)
    for i in range(3):
        d.builder.tree(f"tree {i}", d.between(-14.0, -6.0), d.between(-8.0, 8.0), 7.0, 2.0, 300, d.rng)
    d.panes = (
        GlassPane(
            name="glass",
            normal_ned=(-1.0, 0.0, 0.0),
            point_ned_m=(x + 0.1, 0.0, 0.0),
            outside=("tree 0", "tree 1", "tree 2"),
            reflects=d.between(0.05, 0.6),
            transmits=d.between(0.1, 0.8),
        ),
    )


def _water(d: Draft) -> None:
    """A lake that mirrors the sky and the other bank, with piles and a boat without texture. Its banks are solids."""
    far = d.between(9.0, 40.0)
    d.builder = SceneBuilder("water")
    d.builder.box("meadow near", -48.0, 0.0, 100.0, 400.0, 2.0, 0.0, -2.0)
    d.builder.box("meadow far", far + 150.0, 0.0, 300.0, 600.0, 2.0, 0.0, -2.0)
    d.builder.box("glass lake", 0.5 * (2.0 + far), 0.0, far - 2.0, 400.0, 0.5, 0.0, -0.8)
    for i in range(3):
        d.builder.tree(f"tree {i}", far + d.between(2.0, 8.0), d.between(-12.0, 12.0), 7.0, 2.0, 300, d.rng)
    for i in range(3):
        name = f"pile pole {i}"
        d.paint(name)
        d.builder.pole(
            name,
            d.between(3.0, min(far, 9.0)),
            d.between(-3.0, 3.0),
            d.log_between(0.03, 0.4),
            d.height_m + d.between(-0.5, 2.0),
        )
    d.builder.box(
        "blank boat",
        d.between(4.0, 8.0),
        d.between(-3.0, 3.0),
        4.0,
        2.0,
        d.height_m + d.between(-0.5, 0.5),
        d.between(-2.0, 2.0),
    )
    outside = ("meadow far", "blank boat", *(f"tree {i}" for i in range(3)), *(f"pile pole {i}" for i in range(3)))
    d.panes = (
        GlassPane(
            name="glass lake",
            normal_ned=(0.0, 0.0, -1.0),
            point_ned_m=(0.0, 0.0, 0.3),
            outside=outside,
            reflects=d.between(0.3, 0.9),
            transmits=0.05,
        ),
    )


THINGS: dict[str, Callable[[Draft], None]] = {
    "strut": _strut, "guys": _guys, "crane": _crane, "pole": _pole, "net": _net, "banner": _banner, "snow": _snow, "drone": _drone,
    "beam": _beam, "slab": _slab, "blade": _blade, "rope": _rope, "dusk": _dusk, "glare": _glare, "glass": _glass, "water": _water,
}  # fmt: skip
