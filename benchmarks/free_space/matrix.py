"""Scenes of the fidelity run for short-range cameras at steep pitches, for the truth check of free space.

Only scenes whose objects are larger than a pixel of the camera: leaves and wires between pixels are covered by the thin
scenes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

from benchmarks.free_space.random_frames import RandomCamera, RandomFrame
from benchmarks.scenes.catalogue import FAMILIES, camera_pose, make_scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info

SHORT_RANGES_M = (3.0, 5.0, 6.0, 8.0, 12.0)
STEEP_PITCHES_DEG = (-55.0, -40.0, -20.0, 0.0, 20.0, 50.0)
ROLLS_DEG = (0.0, 20.0)
KE_PER_M = (0.0015, 0.005)
SCENES = (*FAMILIES["structured"], *FAMILIES["ground"], "stones")
WIDTH_PX = 160
_REACH_M = 40.0


def matrix_frames(seed: int) -> Iterator[RandomFrame]:
    """Every scene with every camera and tilt; noise, height, and whether the sensor measures past the clip go round."""
    each = itertools.product(SCENES, SHORT_RANGES_M, STEEP_PITCHES_DEG, ROLLS_DEG)
    for number, (name, range_m, pitch_deg, roll_deg) in enumerate(each):
        ke, past = KE_PER_M[number % 2], number // 2 % 2 == 0
        sensor = replace(TYPICAL, ke_per_m=ke, sky_is_far=number % 3 > 0).scaled_to(WIDTH_PX)
        info = camera_info(WIDTH_PX, WIDTH_PX * 3 // 4, max_range_m=range_m, ke_per_m=ke)
        camera = RandomCamera(info, replace(info, max_range_m=_REACH_M if past else range_m), sensor, seed)
        place, yaw = camera_pose(name, seed, (1.5, 2.0, 4.0)[number % 3])
        frame = camera.image(make_scene(name, seed), place, yaw, pitch_deg, roll_deg, number)
        yield RandomFrame(number, frame, camera, pitch_deg, roll_deg)


def size() -> int:
    """How many frames that are."""
    return math.prod(len(axis) for axis in (SCENES, SHORT_RANGES_M, STEEP_PITCHES_DEG, ROLLS_DEG))
