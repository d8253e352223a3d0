"""Random things outdoors that no family of odd_things.py covers: slack cables, blank roofs, awnings, boards, parts of the vehicle, fog,
wet ground, unequal imagers, motion blur, near fences with wide gaps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.open_air.odd_draft import Draft
from drivers.simulation.stereo.pair_renderer import GlassPane
from drivers.simulation.stereo.sky import CLEAR, HAZY, LOW_SUN, Sky
from drivers.simulation.stereo.textures import ASPHALT, Material, Pattern

_LIT_BY_CLEAR_SKY = 0.73
"""Brightness of an upright white surface that faces the camera, in the light of the clear sky."""


def _cable(d: Draft) -> None:
    """Slack cables across the view whose lowest place is near the height of the camera."""
    for i in range(int(d.rng.integers(1, 4))):
        name = f"cable pole {i}"
        d.paint(name)
        x, low, sag = d.log_between(2.0, 9.0), d.between(-0.5, 0.3), d.log_between(0.2, 3.0)
        radius, turn, aside = 0.5 * d.log_between(0.006, 0.04), d.between(-0.4, 0.4), d.between(-4.0, 4.0)
        along = np.linspace(-12.0, 12.0, 25)
        up = d.height_m + low + sag * ((along - aside) / 12.0) ** 2
        points = np.column_stack([x + along * math.sin(turn), along * math.cos(turn), -up])
        for a, b in itertools.pairwise(points):
            d.builder.cylinder(name, (a[0], a[1], a[2]), (b[0], b[1], b[2]), radius)


def _roof(d: Draft) -> None:
    """A house whose ridge is near the height of the camera; walls and roof have one brightness without texture."""
    d.albedo["blank roof"] = d.log_between(0.08, 0.9)
    length, width, rise = d.between(4.0, 14.0), d.between(4.0, 9.0), d.between(0.8, 3.0)
    ridge, near = max(1.2, d.height_m + d.between(-0.6, 0.6)), d.between(2.0, 7.0)
    yaw = d.between(-1.6, 1.6)
    x = near + 0.5 * (length * abs(math.cos(yaw)) + width * abs(math.sin(yaw)))
    d.builder.gable("blank roof", x, d.between(-2.0, 2.0), length, width, max(0.3, ridge - rise), ridge, yaw)


def _awning(d: Draft) -> None:
    """A thin inclined sheet with stripes before a wall; its lower edge is near the height of the camera."""
    front, deep, half = d.between(2.5, 7.0), d.between(1.0, 3.0), d.between(1.5, 5.0)
    low, rise, y = d.height_m + d.between(-0.3, 0.3), d.between(0.2, 1.2), d.between(-1.5, 1.5)
    points = [
        (front + deep * back, y + side * half, -(low + rise * back) - thick)
        for back in (0.0, 1.0)
        for side in (-1.0, 1.0)
        for thick in (0.0, 0.02)
    ]
    d.builder.convex("awning", np.array(points))
    step = d.log_between(0.05, 0.5)
    d.materials["awning"] = Material(
        albedo=d.between(0.5, 0.9),
        pattern=Pattern.VERTICAL_BARS,
        period_m=(step, 1.0),
        width_m=0.5 * step,
        line_albedo=d.between(0.05, 0.9),
    )
    if d.between(0.0, 1.0) < 0.5:
        d.builder.wall(
            "blank wall", (front + deep, y - half), (front + deep, y + half), low + rise + d.between(0.2, 4.0)
        )
        d.albedo["blank wall"] = d.between(0.2, 0.9)


def _sign(d: Draft) -> None:
    """Thin blank boards at any angle to the view, also edge-on."""
    for i in range(int(d.rng.integers(1, 4))):
        name = f"blank sign {i}"
        d.albedo[name] = d.log_between(0.1, 1.0)
        wide, high = d.log_between(0.3, 3.0), d.log_between(0.3, 3.0)
        base = max(0.0, d.height_m + d.between(-0.8, 0.3))
        d.builder.box(
            name, d.between(2.0, 9.0), d.between(-3.0, 3.0), 0.01, wide, high, d.between(-math.pi, math.pi), base
        )


def _gantry(d: Draft) -> None:
    """A wide blank board whose lower edge is near the height of the camera, before a camera that is pitched down in fast flight."""
    name, wide = "blank gantry", d.log_between(3.0, 40.0)
    d.albedo[name] = d.log_between(0.1, 1.0)
    x, base = d.between(2.0, 9.0), d.height_m + d.between(-0.3, 0.3)
    d.builder.box(name, x, d.between(-0.4, 0.4) * wide, 0.2, wide, d.between(0.4, 3.0), d.between(-0.3, 0.3), base)
    d.pitch_deg = d.between(-24.0, 0.0)


def _balloon(d: Draft) -> None:
    """A blank balloon that the upper border of the image cuts; its lower end is near the horizon."""
    d.albedo["blank balloon"] = d.log_between(0.2, 1.0)
    radius, x = d.between(0.6, 4.0), d.between(3.0, 9.0)
    d.builder.sphere(
        "blank balloon", x + radius, d.between(-2.0, 2.0), d.height_m + radius + d.between(-0.3, 0.2), radius
    )
    d.pitch_deg = d.between(-20.0, 0.0)


def _leg(d: Draft) -> None:
    """Parts of the vehicle: blank rods near the camera, from above or across."""
    for i in range(int(d.rng.integers(1, 3))):
        name = f"leg pole {i}"
        d.albedo[name] = d.log_between(0.1, 1.0)
        steep = d.between(0.0, 1.0) < 0.5
        angle = math.pi / 2.0 + d.between(-0.4, 0.4) if steep else d.between(-0.15, 0.15)
        above = 1.0 + d.between(-0.1, 0.05) if steep else d.between(-0.08, 0.05)
        d.beam(name, (d.log_between(0.2, 0.6), d.between(-0.2, 0.2)), above, 2.0, angle, d.log_between(0.008, 0.06))


def _fog(d: Draft) -> None:
    _blank_things(d)
    d.fog_per_m = d.log_between(0.005, 0.15)


def _blank_things(d: Draft) -> None:
    """A box, a pillar, and something level or inclined that hangs in the air."""
    for name in ("blank box", "blank pillar", "blank beam"):
        d.albedo[name] = d.log_between(0.1, 1.0)
    size = d.between(0.3, 3.0)
    d.builder.box(
        "blank box",
        d.between(3.0, 9.0),
        d.between(-4.0, 4.0),
        size,
        size,
        max(0.2, d.height_m + d.between(-0.6, 2.0)),
        d.between(-1.0, 1.0),
    )
    d.builder.pole(
        "blank pillar", d.between(2.0, 9.0), d.between(-3.0, 3.0), d.log_between(0.05, 0.6), d.height_m + 8.0
    )
    angle = math.radians(d.between(-15.0, 15.0))
    d.beam("blank beam", (d.between(3.0, 9.0), 0.0), d.between(-0.5, 0.4), 30.0, angle, d.log_between(0.05, 0.6))


def _gains(d: Draft) -> None:
    """One imager is brighter than the other one."""
    _blank_things(d)
    d.exposure = replace(d.exposure, right_gain=d.log_between(0.65, 1.5))


def _blur(d: Draft) -> None:
    """The camera turns during the exposure: 60 degrees a second in 10 ms are 4 px."""
    _blank_things(d)
    d.beam(
        "strut pole",
        (d.log_between(1.5, 8.0), 0.0),
        d.between(-0.4, 0.3),
        12.0,
        d.between(-1.5, 1.5),
        d.log_between(0.01, 0.1),
    )
    d.exposure = replace(d.exposure, blur_px=(d.between(-25.0, 25.0), d.between(-4.0, 4.0)))


def _wet(d: Draft) -> None:
    """Wet asphalt that mirrors sky and things."""
    _blank_things(d)
    d.ground = ASPHALT
    d.builder.box("glass wet", 40.0, 0.0, 79.0, 200.0, 0.01)
    d.builder.tree("tree", d.between(6.0, 14.0), d.between(-6.0, 6.0), 7.0, 2.0, 300, d.rng)
    d.panes = (
        GlassPane(
            name="glass wet",
            normal_ned=(0.0, 0.0, -1.0),
            point_ned_m=(0.0, 0.0, -0.01),
            outside=("blank box", "blank pillar", "blank beam", "tree"),
            reflects=d.between(0.1, 0.8),
            transmits=d.between(0.2, 0.9),
        ),
    )


def _sunset(d: Draft) -> None:
    """The sun at the horizon, and blank things in its glare."""
    _blank_things(d)
    d.sky = replace(
        LOW_SUN,
        sun_azimuth_rad=d.between(-0.5, 0.5),
        sun_elevation_rad=d.between(-0.02, 0.1),
        glare=d.between(0.3, 3.0),
    )


def _faint(d: Draft) -> None:
    """Blank things nearly as bright as the sky, before a camera that is pitched down, so that little sky is in view."""
    _blank_things(d)
    horizon = d.between(0.35, 0.6)
    for name in ("blank box", "blank pillar", "blank beam"):
        d.albedo[name] = min(1.0, horizon / _LIT_BY_CLEAR_SKY * (1.0 + d.between(-0.15, 0.15)))
    d.sky = Sky(horizon=horizon, zenith=0.9 * horizon)
    d.pitch_deg = d.between(-22.0, 0.0)


def _behind(d: Draft) -> None:
    """A hedge as high as the camera, and a blank front behind it that fills the view above."""
    x = d.between(2.5, 7.0)
    d.builder.box("hedge", x, 0.0, 0.6, 40.0, max(0.3, d.height_m + d.between(-0.2, 0.1)))
    d.albedo["blank front"] = d.log_between(0.2, 1.0)
    far = x + d.between(0.5, 4.0)
    d.builder.wall("blank front", (far, -d.between(1.0, 20.0)), (far, d.between(1.0, 20.0)), d.height_m + 15.0)
    d.sky = (HAZY, CLEAR)[int(d.rng.integers(2))]


def _railing(d: Draft) -> None:
    """Upright bars so near that their period in the image may exceed what is looked for."""
    x, gap, turn = d.between(0.55, 2.0), d.log_between(0.08, 0.3), d.between(-0.3, 0.3)
    d.paint("railing pole")
    high = d.height_m + d.between(0.1, 3.0)
    radius, count = 0.5 * d.log_between(0.008, 0.04), 40
    for i in range(-count, count + 1):
        y = i * gap
        d.builder.cylinder("railing pole", (x + turn * y, y, 0.0), (x + turn * y, y, -high), radius)
    side = count * gap
    for level in (0.1, high):
        d.builder.cylinder(
            "railing pole", (x - turn * side, -side, -level), (x + turn * side, side, -level), 1.2 * radius
        )


OUTDOORS: dict[str, Callable[[Draft], None]] = {
    "cable": _cable,
    "roof": _roof,
    "awning": _awning,
    "sign": _sign,
    "gantry": _gantry,
    "balloon": _balloon,
    "leg": _leg,
    "fog": _fog,
    "gains": _gains,
    "blur": _blur,
    "wet": _wet,
    "sunset": _sunset,
    "faint": _faint,
    "behind": _behind,
    "railing": _railing,
}
