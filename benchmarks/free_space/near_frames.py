"""Random scenes with things nearer than the minimum range of the camera, which leave holes in the image.

Everything follows from (seed, number), as in random_frames.py.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.free_space.random_frames import RandomCamera, RandomFrame, has_room, random_sensor
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import camera_info

LEAST_RANGES_M = (0.3, 0.5, 0.8, 1.2, 1.8, 2.5)
RANGES_M = (5.0, 8.0, 12.0, 20.0)
TILT_DEG = 30.0
_ROOM_M = 0.12
_TRIES = 100


def near_scene(rng: np.random.Generator, least_range_m: float, height_m: float) -> Scene:
    """One to three things around the minimum range of a camera at a height, before a wall, mostly over ground."""
    s = SceneBuilder("near")
    for _ in range(rng.integers(1, 4)):
        r, a = (
            float(rng.uniform(0.35, 1.2)) * least_range_m + float(rng.uniform(0.0, 0.2)),
            float(rng.uniform(-0.7, 0.7)),
        )
        x, y, z = r * math.cos(a), r * math.sin(a), height_m + float(rng.uniform(-0.5, 0.5))
        sizes = least_range_m * rng.uniform(0.1, 0.5, 3)
        shape = rng.integers(3)
        if shape == 0:
            s.sphere("sphere", x, y, z, float(0.5 * sizes[0]))
        elif shape == 1:
            s.box("box", x, y, float(sizes[0]), float(sizes[1]), float(sizes[2]), float(rng.uniform(0, math.pi)), z)
        else:
            low, high = -z + float(sizes[1]), -z - float(sizes[2])
            s.cylinder("pole", (x, y, low), (x, y, high), float(0.25 * sizes[0]))
    x = least_range_m + float(rng.uniform(1.0, 8.0))
    s.wall("wall", (x, -30.0), (x, 30.0), 20.0, base=-1.0)
    if rng.random() < 0.7:
        s.ground()
    return s.build()


def near_frame(seed: int, number: int) -> RandomFrame:
    """The frame of a number; the same for the same seed and number."""
    rng = np.random.Generator(np.random.PCG64([seed, number]))
    width, least_range_m = int(rng.choice([160, 320])), float(rng.choice(LEAST_RANGES_M))
    sensor = random_sensor(rng).scaled_to(width)
    info = replace(
        camera_info(width, width * 3 // 4, max_range_m=float(rng.choice(RANGES_M)), ke_per_m=sensor.ke_per_m),
        min_range_m=least_range_m,
    )
    pitch_deg, roll_deg = (float(v) for v in rng.uniform(-TILT_DEG, TILT_DEG, 2))
    height_m = float(rng.uniform(1.0, 6.0))
    for _ in range(_TRIES):
        scene = near_scene(rng, least_range_m, height_m)
        if has_room(scene, height_m, room_m=_ROOM_M):
            break
    camera = RandomCamera(info, info, sensor, seed)
    frame = camera.image(scene, (0.0, 0.0, -height_m), float(rng.uniform(-0.3, 0.3)), pitch_deg, roll_deg, number)
    return RandomFrame(number, frame, camera, pitch_deg, roll_deg)
