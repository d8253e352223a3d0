"""Views that random frames seldom hold: thin things at the ends of the range, things at the border of the image, very near
ones, steps of the ground, and cameras that look steeply up or down.

Each view has a name and is seen by each camera of `hard_frames`. Unmeasured sky is marked textureless, so that open space
is judged too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.free_space.random_frames import RandomCamera, RandomFrame
from core.types import TEXTURELESS_MM
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import camera_info

WIDTH_PX, HEIGHT_PX = 320, 240
FOCAL_PX = 450.0 * WIDTH_PX / 640.0
_REACH_M = 40.0
_NEAR_M = 0.8
"""Minimum range of the cameras that see very near things."""
_SENSORS = (
    SensorModel(ke_per_m=0.0015, sky_is_far=True),
    SensorModel(ke_per_m=0.003, dropout_share=0.04, flying_share=0.5),
)


@dataclass(frozen=True, slots=True)
class HardView:
    """A scene and the camera in it: height_m above z = 0, over (0, 0). range_m, min_range_m: of the camera; past: the sensor
    measures past its range."""

    scene: SceneBuilder
    height_m: float = 2.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    range_m: float = 8.0
    min_range_m: float = 0.3
    past: bool = False


def _scene(name: str, *, ground: bool = True, wall_m: float = 0.0) -> SceneBuilder:
    """A scene with ground, and with a wall across the view at a distance, 0: none."""
    s = SceneBuilder(name)
    if ground:
        s.ground()
    if wall_m > 0.0:
        s.wall("wall", (wall_m, -30.0), (wall_m, 30.0), 20.0, base=-8.0)
    return s


def _thin(range_m: float) -> float:
    """Diameter of a thing that is 4.5 pixels wide at the end of the range."""
    return 4.5 * range_m / FOCAL_PX


def thin_at_the_range() -> Iterator[HardView]:
    """Poles, bars and slabs of 4.5 pixels a little nearer than the range, at it and a little farther."""
    for range_m in (3.0, 6.0, 12.0, 20.0):
        for share in (0.85, 0.96, 1.02):
            s = _scene(f"pole at {share:g} of {range_m:g} m")
            for y in (-0.31, 0.02, 0.37):
                s.pole("pole", share * range_m, y * share * range_m, _thin(range_m), 6.0)
            yield HardView(s, range_m=range_m, past=share != 0.96)
    for range_m in (4.0, 12.0):
        s = _scene(f"bar at the end of {range_m:g} m", wall_m=1.6 * range_m)
        at, r = 0.93 * range_m, 0.5 * _thin(range_m)
        s.cylinder("bar", (at, -20.0, -2.3), (at, 20.0, -2.3), r)
        yield HardView(s, range_m=range_m, past=True)
        s = _scene(f"slanted bar at the end of {range_m:g} m")
        s.cylinder("bar", (at, -0.5 * at, -0.7), (at, 0.5 * at, -4.5), r)
        yield HardView(s, range_m=range_m)


def at_the_border() -> Iterator[HardView]:
    """Things of which a few pixels at the border of the image show."""
    half_t, tall_t = 0.5 * WIDTH_PX / FOCAL_PX, 0.5 * HEIGHT_PX / FOCAL_PX
    for side in (-1.0, 1.0):
        for px in (1.0, 4.0):
            s, x = _scene(f"box {px:g} px within the {'left' if side < 0 else 'right'} border", wall_m=12.0), 3.0
            s.box("box", x, side * (x * (half_t - px / FOCAL_PX) + 0.5), 1.0, 1.0, 4.0)
            yield HardView(s)
            yield HardView(s, roll_deg=20.0 * side, pitch_deg=-10.0)
    for px in (1.0, 4.0, 9.0):
        s, x = _scene(f"roof {px:g} px within the upper border", wall_m=12.0), 4.0
        s.box("roof", x + 2.0, 0.0, 4.0, 20.0, 1.0, base=2.0 + x * (tall_t - px / FOCAL_PX))
        yield HardView(s)
        yield HardView(s, roll_deg=12.0)
        s = _scene(f"ledge {px:g} px within the lower border", ground=False, wall_m=12.0)
        s.box("ledge", x + 2.0, 0.0, 4.0, 20.0, 1.0, base=2.0 - x * (tall_t - px / FOCAL_PX) - 1.0)
        yield HardView(s, height_m=2.0)
    s = _scene("pole at the corner", wall_m=9.0)
    s.cylinder("pole", (2.0, 1.3, 0.0), (2.0, 1.3, -6.0), 0.05)
    yield HardView(s, roll_deg=-25.0, pitch_deg=15.0)


def very_near() -> Iterator[HardView]:
    """Things at about the minimum range, which are measured in part or not at all."""
    for share in (0.6, 0.98, 1.05, 1.4):
        x = share * _NEAR_M
        s = _scene(f"pole at {share:g} of the least range", wall_m=7.0)
        s.cylinder("pole", (x, 0.15, 0.0), (x, 0.15, -6.0), 0.04)
        yield HardView(s, min_range_m=_NEAR_M)
        s = _scene(f"bar at {share:g} of the least range", wall_m=7.0)
        s.cylinder("bar", (x, -3.0, -2.1), (x, 3.0, -2.1), 0.04)
        yield HardView(s, min_range_m=_NEAR_M, pitch_deg=8.0)
    s = _scene("slab that passes the camera", wall_m=9.0)
    s.box("slab", 3.0, 0.55, 6.0, 0.1, 6.0)
    yield HardView(s, min_range_m=_NEAR_M)
    s = _scene("ceiling that passes the camera", wall_m=9.0)
    s.box("ceiling", 3.0, 0.0, 8.0, 8.0, 0.3, base=2.45)
    yield HardView(s)
    yield HardView(s, pitch_deg=25.0, min_range_m=_NEAR_M)


def steps_of_the_ground() -> Iterator[HardView]:
    """Terraces, trenches and edges."""
    for rise in (0.35, 1.0, 2.2):
        s = _scene(f"terrace {rise:g} m up")
        s.box("terrace", 14.0, 0.0, 20.0, 60.0, rise)
        yield HardView(s, range_m=12.0)
        yield HardView(s, pitch_deg=-25.0, height_m=rise + 1.0, range_m=6.0)
    for drop in (0.5, 3.0):
        s = _scene(f"edge {drop:g} m down", ground=False)
        s.box("near", 0.0, 0.0, 8.0, 60.0, 20.0, base=-20.0)
        s.box("far", 24.0, 0.0, 40.0, 60.0, 20.0, base=-20.0 - drop)
        yield HardView(s, range_m=12.0)
        yield HardView(s, pitch_deg=-40.0, height_m=3.0, range_m=12.0)
    s = _scene("kerb across a slope", ground=False)
    s.ground(-0.1, 0.05)
    s.box("kerb", 5.0, 0.0, 0.4, 30.0, 1.3)
    yield HardView(s, height_m=1.6, roll_deg=8.0)


def steep() -> Iterator[HardView]:
    """Cameras that look far up or down, past beams, ledges and wells."""
    for pitch in (35.0, 50.0):
        s = _scene(f"beams above, {pitch:g} degrees", ground=False, wall_m=7.0)
        for k in range(4):
            s.box("beam", 1.5 + 1.4 * k, 0.0, 0.2, 20.0, 0.3, base=3.6 + 0.4 * k)
        yield HardView(s, pitch_deg=pitch)
        yield HardView(s, pitch_deg=pitch, roll_deg=28.0)
        s = _scene(f"eaves above, {pitch:g} degrees", wall_m=4.0)
        s.box("eaves", 3.2, 0.0, 1.8, 20.0, 0.1, base=4.2)
        yield HardView(s, pitch_deg=pitch, range_m=5.0)
    for pitch in (-35.0, -55.0):
        s = _scene(f"branch below, {pitch:g} degrees")
        s.cylinder("branch", (2.2, -6.0, -4.0), (2.6, 6.0, -4.4), 0.06)
        s.pole("mast", 3.5, 0.9, 0.12, 5.6)
        yield HardView(s, pitch_deg=pitch, height_m=6.0)
        yield HardView(s, pitch_deg=pitch, height_m=6.0, roll_deg=-28.0, past=True, range_m=5.0)
        s = _scene(f"well below, {pitch:g} degrees", ground=False)
        for x, y, a, b in ((-2.0, 0.0, 4.0, 9.0), (6.0, 0.0, 4.0, 9.0), (2.0, -4.0, 5.0, 3.0), (2.0, 4.0, 5.0, 3.0)):
            s.box("rim", x, y, a, b, 9.0, base=-9.0)
        yield HardView(s, pitch_deg=pitch, height_m=1.5, range_m=12.0)


def hard_views() -> Iterator[HardView]:
    """All views."""
    for part in (thin_at_the_range, at_the_border, very_near, steps_of_the_ground, steep):
        yield from part()


def hard_frames(seed: int) -> Iterator[RandomFrame]:
    """Each view from two sensors, with the sky marked textureless; the same for the same seed."""
    number = 0
    for v in hard_views():
        for sensor in _SENSORS:
            info = camera_info(
                WIDTH_PX, HEIGHT_PX, max_range_m=v.range_m, min_range_m=v.min_range_m, ke_per_m=sensor.ke_per_m
            )
            info = replace(info, marks_smooth=True)
            measures = replace(info, max_range_m=_REACH_M if v.past else v.range_m)
            camera = RandomCamera(info, measures, sensor, seed)
            frame = camera.image(v.scene.build(), (0.0, 0.0, -v.height_m), 0.0, v.pitch_deg, v.roll_deg, number)
            sky = ~np.isfinite(frame.truth.depth_m)
            depth_mm = np.where(sky, TEXTURELESS_MM, frame.depth_mm).astype(np.uint16)
            yield RandomFrame(number, replace(frame, depth_mm=depth_mm), camera, v.pitch_deg, v.roll_deg)
            number += 1
