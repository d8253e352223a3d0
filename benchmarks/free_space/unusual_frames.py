"""Random scenes seen by cameras that random_frames.py never draws: other image sizes, lenses, principal points, attitudes, heights,
noise and ranges, and images of which a regular part is not measured.

Everything follows from (seed, number), as in random_frames.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.free_space.random_frames import RandomCamera, RandomFrame, has_room, random_sensor
from core.types import SATURATED_MM, UNKNOWN_MM, CameraInfo, Intrinsics
from drivers.simulation.scenes import Scene, SceneBuilder

SIZES_PX = ((160, 120), (320, 240), (424, 240), (240, 320), (400, 120), (97, 131), (336, 188), (640, 400))
"""Widths and heights. A device has up to 1280 x 800; a part of its pixels is enough for lenses of all angles."""
FIELDS_DEG = (28.0, 45.0, 60.0, 80.0, 100.0, 120.0, 135.0)
"""Horizontal angles of view with the principal point in the middle."""
PITCH_DEG = 62.0
RANGES_M = (5.0, 10.0, 20.0, 40.0, 60.0, 65.0)
NOISES_PER_M = (1e-5, 0.0005, 0.0015, 0.005, 0.01, 0.02, 0.05)
LEAST_RANGES_M = (0.05, 0.2, 0.5, 1.0, 2.0)
_LEAST_FOCAL_PX = 45.0
"""A pixel of a lens of less focal length is a tenth of a cell at steep elevations, more than the check allows for."""
LEAST_THING_PX = 6.0
"""Least width and height of a thing at its distance: 4 pixels are found, and where rows or columns are missing more."""
_PASSED_M = 40.0
_TRIES = 60
_ROOM_M = 0.25
_OFF_CENTRE = 0.45
"""Greatest distance of the principal point from the middle of the image in three of four draws, as a share of its size; else 0.9."""


def unusual_intrinsics(rng: np.random.Generator) -> Intrinsics:
    """A pinhole camera with an image of any shape, pixels that are not always square, and its principal point anywhere."""
    width, height = SIZES_PX[int(rng.integers(len(SIZES_PX)))]
    fx = max(_LEAST_FOCAL_PX, 0.5 * width / math.tan(math.radians(0.5 * float(rng.choice(FIELDS_DEG)))))
    fy = fx * (float(rng.uniform(0.6, 1.6)) if rng.random() < 0.4 else 1.0)
    off = (_OFF_CENTRE if rng.random() < 0.75 else 0.9) * rng.uniform(-1.0, 1.0, 2) * (rng.random() < 0.6)
    return Intrinsics(width, height, fx, fy, (width - 1) / 2 + off[0] * width, (height - 1) / 2 + off[1] * height)


def unusual_scene(rng: np.random.Generator, reach_m: float, thin_per_m: float, *, all_around: bool = False) -> Scene:
    """Boxes, walls, poles and spheres around (0, 0), over flat or steep ground, ground at one side only, or none.

    reach_m: largest distance of objects; thin_per_m: least width and height of each, per metre of its distance; all_around: behind the
    camera too."""
    s = SceneBuilder("unusual")
    half_turn = math.pi if all_around else 1.4
    ground = rng.random()
    slope = np.zeros(2)
    if ground < 0.35:
        s.ground()
    elif ground < 0.65:  # a slope of 3 to 30 degrees in any direction
        a, steep = rng.uniform(0.0, math.tau), math.tan(math.radians(float(rng.uniform(3.0, 30.0))))
        slope = steep * np.array([math.cos(a), math.sin(a)])
        s.ground(float(slope[0]), float(slope[1]))
    elif ground < 0.8:  # the edge of a flat roof, which runs past the camera or across its view
        a, off = float(rng.uniform(-1.6, 1.6)), float(rng.uniform(0.0, 0.4 * reach_m))
        x, y = off * math.cos(a + 0.5 * math.pi), off * math.sin(a + 0.5 * math.pi)
        side = 1.0 if rng.random() < 0.5 else -1.0
        half = 2.0 * reach_m
        x, y = x - side * half * math.sin(a), y + side * half * math.cos(a)
        s.box("roof", x, y, 2.5 * half, 2.0 * half, 30.0, a, -30.0)

    def place(near_m: float) -> tuple[float, float, float, float]:
        """x, y, the height of the ground there, and the least size."""
        r, a = (
            float(np.exp(rng.uniform(math.log(near_m), math.log(reach_m)))),
            float(rng.uniform(-half_turn, half_turn)),
        )
        x, y = r * math.cos(a), r * math.sin(a)
        return x, y, float(-(slope[0] * x + slope[1] * y)), thin_per_m * (r + 2.0)

    for _ in range(rng.integers(0, 8)):
        x, y, low, thin = place(1.0)
        length, width, height = (thin + float(v) for v in rng.uniform(0.3, 3.0, 3))
        base = low - 0.3 + (float(rng.uniform(0.3, 8.0)) if rng.random() < 0.4 else 0.0)
        s.box("box", x, y, length, width, height + 0.7, float(rng.uniform(0, math.pi)), base)
    for _ in range(rng.integers(0, 3)):
        x, y, low, thin = place(1.5)
        a, half = rng.uniform(0, math.tau), thin + rng.uniform(1.0, 10.0)
        dx, dy = half * math.cos(a), half * math.sin(a)
        s.wall("wall", (x - dx, y - dy), (x + dx, y + dy), thin + float(rng.uniform(1.0, 20.0)), base=low - 1.0)
    for _ in range(rng.integers(0, 4)):
        x, y, low, thin = place(1.0)
        r = 0.5 * (thin + float(rng.uniform(0.02, 0.4)))
        s.cylinder("pole", (x, y, -low + 1.0), (x, y, -low - thin - float(rng.uniform(1.0, 15.0))), r)
    for _ in range(rng.integers(0, 3)):
        x, y, low, thin = place(1.0)
        s.sphere("sphere", x, y, low + float(rng.uniform(0.0, 10.0)), 0.5 * thin + float(rng.uniform(0.3, 1.5)))
    if rng.random() < 0.25:  # a bar across the view
        x, y, low, thin = place(1.5)
        z, a, half = low + float(rng.uniform(0.8, 6.0)), float(rng.uniform(-0.5, 0.5)), float(rng.uniform(1.0, 20.0))
        dx, dy = -half * math.sin(a), half * math.cos(a)
        s.cylinder("bar", (x - dx, y - dy, -z), (x + dx, y + dy, -z - float(rng.uniform(-1.0, 1.0))), 0.6 * thin + 0.05)
    return s.build()


def _rows_unknown(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    mm[int(rng.integers(2)) :: 2] = UNKNOWN_MM


def _columns_unknown(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    mm[:, int(rng.integers(2)) :: 2] = UNKNOWN_MM


def _chequered(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    v, u = np.indices(mm.shape)
    mm[(u + v) % 2 == int(rng.integers(2))] = UNKNOWN_MM


def _saturated_rows(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    mm[:: int(rng.integers(3, 9))] = SATURATED_MM


def _border_masked(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    """Rectangles at each border, as the vehicle's legs and arms are masked."""
    rows, cols = mm.shape
    for _ in range(rng.integers(1, 5)):
        high, wide = int(rng.integers(2, 1 + rows // 2)), int(rng.integers(2, 1 + cols // 3))
        top, left = int(rng.choice([0, rows - high])), int(rng.integers(0, cols - wide))
        if rng.random() < 0.5:
            top, left = int(rng.integers(0, rows - high)), int(rng.choice([0, cols - wide]))
        mm[top : top + high, left : left + wide] = UNKNOWN_MM


def _bands_unknown(rng: np.random.Generator, mm: NDArray[np.uint16]) -> None:
    """Every few rows or columns a band of 1 to 3 that is not measured, as a rolling defect of the link leaves it."""
    step, wide = int(rng.integers(5, 24)), int(rng.integers(1, 4))
    lines = mm if rng.random() < 0.5 else mm.T
    for first in range(0, len(lines), step):
        lines[first : first + wide] = UNKNOWN_MM


_DEFECTS: tuple[Callable[[np.random.Generator, NDArray[np.uint16]], None], ...] = (
    _rows_unknown,
    _columns_unknown,
    _chequered,
    _saturated_rows,
    _border_masked,
    _border_masked,
    _bands_unknown,
)
DEFECT_SHARE = 0.35
"""Share of the frames of which a regular part is not measured."""


def unusual_camera(rng: np.random.Generator, seed: int) -> RandomCamera:
    """A camera with the intrinsics of `unusual_intrinsics` and any noise and ranges."""
    k = unusual_intrinsics(rng)
    sensor = replace(random_sensor(rng).scaled_to(k.width), ke_per_m=float(rng.choice(NOISES_PER_M)))
    info = CameraInfo(
        "front",
        k,
        min_range_m=float(rng.choice(LEAST_RANGES_M)),
        max_range_m=float(rng.choice(RANGES_M)),
        ke_per_m=sensor.ke_per_m,
    )
    past = rng.random() < 0.5
    return RandomCamera(
        info, replace(info, max_range_m=max(_PASSED_M, info.max_range_m)) if past else info, sensor, seed
    )


def unusual_frame(seed: int, number: int) -> RandomFrame:
    """The frame of a number; the same for the same seed and number."""
    rng = np.random.Generator(np.random.PCG64([seed, number, 3]))
    camera = unusual_camera(rng, seed)
    k, range_m = camera.info.intrinsics, camera.info.max_range_m
    pitch_deg = float(rng.uniform(-PITCH_DEG, PITCH_DEG))
    roll_deg = float(rng.choice([0.0, rng.uniform(-30.0, 30.0), rng.uniform(-180.0, 180.0)]))
    height_m = float(np.exp(rng.uniform(math.log(0.3), math.log(50.0))))
    reach_m = min(1.6 * range_m + 3.0, 50.0)
    for _ in range(_TRIES):
        scene = unusual_scene(rng, reach_m, LEAST_THING_PX / min(k.fx, k.fy))
        if has_room(scene, height_m, room_m=_ROOM_M):
            break
    frame = camera.image(scene, (0.0, 0.0, -height_m), float(rng.uniform(-0.3, 0.3)), pitch_deg, roll_deg, number)
    if rng.random() < DEFECT_SHARE:
        depth_mm = frame.depth_mm.copy()
        _DEFECTS[int(rng.integers(len(_DEFECTS)))](rng, depth_mm)
        frame = replace(frame, depth_mm=depth_mm)
    return RandomFrame(number, frame, camera, pitch_deg, roll_deg)
