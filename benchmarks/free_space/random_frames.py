"""Random scenes and cameras for the truth check of free space: whatever is drawn, nothing solid may be called free.

Everything follows from (seed, number). Things are large enough to be seen at the camera's resolution and range; thinner
ones are the subject of the thin scenes of the fidelity run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.free_space.volume import first_solids
from core.types import CameraInfo
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import Rendered, camera_info, render

RANGES_M = (3.0, 5.0, 6.0, 8.0, 12.0, 20.0)
PITCHES_DEG = (-55.0, 50.0)
ROLL_DEG = 30.0
WIDTHS_PX = (160, 160, 320)
_REACH_M = 40.0
"""How far a sensor measures that delivers depth past the range that is used."""
ROOM_M = 0.7
"""Free space around a camera."""
_TRIES = 100
_THIN_PX = 4.0
"""Least width of a pole at the camera's range."""


@dataclass(frozen=True, slots=True, eq=False)
class RandomCamera:
    """info: the camera's description for the extractor; measures: the same with the range of the sensor."""

    info: CameraInfo
    measures: CameraInfo
    sensor: SensorModel
    seed: int

    def image(
        self,
        scene: Scene,
        place_m: tuple[float, float, float],
        yaw_rad: float,
        pitch_deg: float,
        roll_deg: float,
        number: int,
    ) -> Rendered:
        """What it delivers of a scene at a place in ned; number: of the noise."""
        frame = render(
            scene,
            self.measures,
            roll_rad=math.radians(roll_deg),
            pitch_rad=math.radians(pitch_deg),
            yaw_rad=yaw_rad,
            position_ned_m=place_m,
            sensor=self.sensor,
            seed=self.seed,
            frame=number,
        )
        return replace(frame, info=self.info)


@dataclass(frozen=True, slots=True, eq=False)
class RandomFrame:
    """One image of a random scene."""

    number: int
    frame: Rendered
    camera: RandomCamera
    pitch_deg: float
    roll_deg: float

    @property
    def ke_per_m(self) -> float:
        """The true noise."""
        return self.camera.sensor.ke_per_m


def random_scene(rng: np.random.Generator, name: str, reach_m: float, thin_m: float) -> Scene:
    """Boxes, walls, poles, spheres, ramps and roofs around (0, 0), on flat or sloped ground or without ground.

    reach_m: largest distance of objects; thin_m: least diameter of a pole."""
    s = SceneBuilder(name)
    slope = rng.uniform(-0.12, 0.12, 2) if rng.random() < 0.4 else np.zeros(2)
    if rng.random() < 0.8:
        s.ground(float(slope[0]), float(slope[1]))

    def place(near_m: float) -> tuple[float, float, float]:
        """x, y, and the height of the ground there."""
        r, a = rng.uniform(near_m, reach_m), rng.uniform(-1.2, 1.2)
        x, y = float(r * math.cos(a)), float(r * math.sin(a))
        return x, y, float(-(slope[0] * x + slope[1] * y))

    for _ in range(rng.integers(0, 7)):
        x, y, low = place(1.5)
        length, width, height = (float(v) for v in rng.uniform(0.6, 4.0, 3))
        base = low - 0.3 + (float(rng.uniform(0.3, 6.0)) if rng.random() < 0.35 else 0.0)
        s.box("box", x, y, length, width, height + 0.3, float(rng.uniform(0, math.pi)), base)
    for _ in range(rng.integers(0, 3)):
        x, y, low = place(2.5)
        a, half = rng.uniform(0, math.tau), rng.uniform(1.0, 10.0)
        dx, dy = half * math.cos(a), half * math.sin(a)
        holes = ((float(half * 0.5), 1.0, 1.5, 1.5),) if half > 3.0 and rng.random() < 0.4 else ()
        s.wall("wall", (x - dx, y - dy), (x + dx, y + dy), float(rng.uniform(2.0, 14.0)), holes, base=low - 0.5)
    for _ in range(rng.integers(0, 4)):
        x, y, low = place(1.5)
        r = 0.5 * float(rng.uniform(thin_m, thin_m + 0.4))
        s.cylinder("pole", (x, y, -low + 0.5), (x, y, -low - float(rng.uniform(2.0, 12.0))), r)
    for _ in range(rng.integers(0, 3)):
        x, y, low = place(1.5)
        s.sphere("sphere", x, y, low + float(rng.uniform(0.0, 8.0)), float(rng.uniform(0.35, 1.5)))
    if rng.random() < 0.25:
        x, y, low = place(3.0)
        s.ramp("ramp", x, y, float(rng.uniform(2.0, 8.0)), float(rng.uniform(1.0, 5.0)), float(rng.uniform(0.8, 4.0)))
    if rng.random() < 0.3:
        x, y, low = place(2.0)
        size = rng.uniform(3.0, 12.0, 2)
        s.box(
            "roof",
            x,
            y,
            float(size[0]),
            float(size[1]),
            float(rng.uniform(1.0, 6.0)),
            float(rng.uniform(0, 3)),
            low - 0.3,
        )
    return s.build()


def has_room(scene: Scene, height_m: float, place_m: tuple[float, float] = (0.0, 0.0), room_m: float = ROOM_M) -> bool:
    """Whether nothing is nearer than about room_m to a camera at this height over a place in ned."""
    azimuth, z = np.meshgrid(np.linspace(-math.pi, math.pi, 24), height_m * -1.0 + np.linspace(-room_m, room_m, 7))
    n = azimuth.size
    origins = np.stack([np.full(n, place_m[0]), np.full(n, place_m[1]), z.ravel()], axis=1)
    directions = np.stack([np.cos(azimuth).ravel(), np.sin(azimuth).ravel(), np.zeros(n)], axis=1)
    _, which = first_solids(scene, False, origins, directions, np.zeros(n), np.full(n, room_m), 0.0)
    return bool((which == -2).all())


def random_sensor(rng: np.random.Generator) -> SensorModel:
    """From perfect to worse than typical."""
    bad = float(rng.choice([0.0, 1.0, 1.0]))
    return SensorModel(
        ke_per_m=float(rng.choice([0.001, 0.0015, 0.003, 0.005])),
        dropout_share=bad * float(rng.uniform(0.0, 0.08)),
        holes=int(bad * rng.integers(0, 6)),
        mismatch_share=bad * float(rng.uniform(0.0, 0.003)),
        flying_share=bad * float(rng.uniform(0.0, 0.6)),
        sky_is_far=bool(rng.random() < 0.6),
    )


def random_frame(seed: int, number: int) -> RandomFrame:
    """The frame of a number; the same for the same seed and number."""
    rng = np.random.Generator(np.random.PCG64([seed, number]))
    width, range_m = int(rng.choice(WIDTHS_PX)), float(rng.choice(RANGES_M))
    sensor = random_sensor(rng).scaled_to(width)
    info = camera_info(width, width * 3 // 4, max_range_m=range_m, ke_per_m=sensor.ke_per_m)
    pitch_deg, roll_deg = float(rng.uniform(*PITCHES_DEG)), float(rng.uniform(-ROLL_DEG, ROLL_DEG))
    if rng.random() < 0.25:
        roll_deg = 0.0
    # a sensor that delivers what lies past the range in use, or one that ends there
    measures = replace(info, max_range_m=_REACH_M if rng.random() < 0.5 else range_m)
    reach_m = 1.6 * range_m + 3.0
    height_m = float(rng.uniform(0.8, 2.5 if rng.random() < 0.5 else 12.0))
    for _ in range(_TRIES):
        scene = random_scene(rng, "random", reach_m, _THIN_PX * range_m / info.intrinsics.fx)
        if has_room(scene, height_m):
            break
    camera = RandomCamera(info, measures, sensor, seed)
    place = (0.0, 0.0, -height_m)
    frame = camera.image(scene, place, float(rng.uniform(-0.3, 0.3)), pitch_deg, roll_deg, number)
    return RandomFrame(number, frame, camera, pitch_deg, roll_deg)
