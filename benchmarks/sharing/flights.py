"""A street and a row of trees, flown by several vehicles that each observe a part of it, with errors of their frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.cases import CAMERA
from benchmarks.world.flights import Pose, frame
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.frames import horizontal_heading_rad, rotation_from_euler, rotation_level_cam_optical
from core.params import Params
from core.types import ExtractorState, FrameModel
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
HZ = 5.0
STEP_M = 0.4
OVERLAP_M = 18.0
PART_M = 26.0
"""Length of the part of a vehicle, with the overlap at both ends."""
NOISE_M, NOISE_DEG = 0.05, 0.3
"""Of position and attitude, from frame to frame."""
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.0, 8.0, 400.0


@dataclass(frozen=True, slots=True)
class FrameError:
    """The local frame of a vehicle: p_local = Rz(-yaw_rad) (p_true - (x_m, y_m)). It states an origin that is wrong by
    (off_x_m, off_y_m), and north as its x axis."""

    x_m: float
    y_m: float
    yaw_rad: float
    off_x_m: float
    off_y_m: float

    def local(self, p: Floats) -> Floats:
        """(N, 3) true points in the local frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y = p[:, 0] - self.x_m, p[:, 1] - self.y_m
        return np.column_stack([c * x + s * y, c * y - s * x, p[:, 2]])

    def true(self, p: Floats) -> Floats:
        """(N, 3) local points in the true frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.column_stack([c * p[:, 0] - s * p[:, 1] + self.x_m, s * p[:, 0] + c * p[:, 1] + self.y_m, p[:, 2]])

    def true_boxes(self, box: Floats) -> Floats:
        """(N, 6) planes of the local frame in the true one."""
        ends = [self.true(np.column_stack([box[:, k : k + 2], box[:, 4]]))[:, :2] for k in (0, 2)]
        return np.column_stack([*ends, box[:, 4:]])

    def origin(self) -> tuple[float, float, float]:
        """The origin as the vehicle states it: latitude, longitude (deg), altitude (m)."""
        north, east = self.x_m + self.off_x_m, self.y_m + self.off_y_m
        e2, lat = 0.00669437999014, math.radians(LATITUDE_DEG)
        w = math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
        meridian, normal = 6_378_137.0 * (1.0 - e2) / w**3, 6_378_137.0 / w
        return (
            LATITUDE_DEG + math.degrees(north / (meridian + ALTITUDE_M)),
            LONGITUDE_DEG + math.degrees(east / ((normal + ALTITUDE_M) * math.cos(lat))),
            ALTITUDE_M,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One frame: model in the local ned, and the place of the camera there."""

    model: FrameModel
    place_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The part of one vehicle. true: the same models in the true frame, for a vehicle that flies all parts."""

    error: FrameError
    seen: tuple[Seen, ...]
    true: tuple[Seen, ...]
    rendered: tuple[Rendered, ...]


def scene_of(name: str, length_m: float, seed: int) -> Scene:
    """street or trees, northwards from the origin."""
    rng = np.random.Generator(np.random.PCG64([seed, 21]))
    s = SceneBuilder(name, structured=name == "street")
    s.ground()
    if name == "trees":
        for i, x in enumerate(np.arange(2.0, length_m, 3.2)):
            y = (-1.0 if i % 2 else 1.0) * rng.uniform(3.0, 7.0)
            s.tree(f"tree {i}", float(x), float(y), rng.uniform(3.8, 6.0), rng.uniform(1.1, 1.7), 400, rng)
        return s.build()
    for side in (-1.0, 1.0):
        x, i = -8.0, 0
        while x < length_m + 8.0:
            house_m, back_m = rng.uniform(5.0, 9.0), rng.uniform(0.0, 1.5)
            s.box(
                f"house {side} {i}", x + house_m / 2, side * (6.5 + back_m + 4.0), house_m, 8.0, rng.uniform(5.0, 11.0)
            )
            x, i = x + house_m + (rng.uniform(0.5, 3.0) if i % 2 else 0.0), i + 1
    for i in range(int(length_m // 9)):
        side = -1.0 if i % 2 else 1.0
        s.pole(f"lamp {i}", 5.0 + 9.0 * i, side * 4.6, 0.14, 5.5)
        s.box(f"car {i}", 8.0 + 9.0 * i, -side * 4.2, 4.2, 1.8, 1.45, rng.uniform(-0.05, 0.05))
    return s.build()


def length_of(vehicles: int) -> float:
    """Length of what is flown."""
    return PART_M + (vehicles - 1) * (PART_M - OVERLAP_M)


def ways(vehicles: int, *, same_way: bool) -> list[list[Pose]]:
    """Each vehicle flies its part; every second one from the other end, unless same_way."""
    found = []
    for k in range(vehicles):
        begin = k * (PART_M - OVERLAP_M)
        count = int(PART_M / STEP_M)
        poses = [
            (begin + i * STEP_M, 0.6 * math.sin(0.3 * i), -2.0, 0.25 * math.sin(0.11 * i), 0.0) for i in range(count)
        ]
        if k % 2 and not same_way:
            poses = [(x, y, z, heading + math.pi, pitch) for x, y, z, heading, pitch in reversed(poses)]
        found.append(poses)
    return found


def judged_poses(vehicles: int) -> list[Pose]:
    """Poses that no flight contains."""
    length_m = length_of(vehicles)
    ahead = [(x, -0.9, -2.6, 0.3, 0.0) for x in np.arange(1.0, length_m - 4.0, 6.0)]
    back = [(x, 0.9, -1.7, math.pi - 0.3, 0.0) for x in np.arange(6.0, length_m, 6.0)]
    return [*ahead, *back]


def errors(vehicles: int, seed: int) -> list[FrameError]:
    """Frames far apart and turned; stated origins 3 m apart for two vehicles, 1.5 m from the truth for each of more."""
    rng = np.random.Generator(np.random.PCG64([seed, 22]))
    found = []
    for k in range(vehicles):
        angle = rng.uniform(0.0, math.tau)
        off_m = 1.5 if vehicles > 2 else 3.0 * k
        found.append(
            FrameError(
                x_m=rng.uniform(-40.0, 40.0),
                y_m=rng.uniform(-40.0, 40.0),
                yaw_rad=math.radians(rng.uniform(-2.0, 2.0)),
                off_x_m=off_m * math.cos(angle),
                off_y_m=off_m * math.sin(angle),
            )
        )
    return found


def flown(scene: Scene, way: list[Pose], error: FrameError, seed: int) -> Part:
    """The frames of one vehicle, modelled with the default parameters."""
    rng = np.random.Generator(np.random.PCG64([seed, 23]))
    extractor, state = Extractor(Params()), ExtractorState()
    seen, true, rendered = [], [], []
    for k, pose in enumerate(way):
        r = frame(scene, pose, CAMERA, seed, k)
        noise = rng.normal(0.0, 1.0, 6)
        R = rotation_from_euler(*(math.radians(NOISE_DEG) * noise[:3])) @ r.R_ned_optical
        model, state = extractor.extract(r.depth_mm, r.info, rotation_level_cam_optical(R), state=state)
        heading = horizontal_heading_rad(R)
        place = r.position_ned_m + NOISE_M * noise[3:]
        local = error.local(place[None])[0]
        seen.append(_seen(model, heading - error.yaw_rad, local))
        true.append(_seen(model, heading, place))
        rendered.append(r)
    return Part(error, tuple(seen), tuple(true), tuple(rendered))


def _seen(model: FrameModel, heading_rad: float, place: Floats) -> Seen:
    at = float(place[0]), float(place[1]), float(place[2])
    return Seen(transform_model(model, LevelTransform(heading_rad, at)), at)
