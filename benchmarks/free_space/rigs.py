"""Sectors around vehicles with one to four random cameras, against the solids of random scenes.

Cameras are those of unusual_frames.py, mounted in any heading, beside the vehicle's middle, pitched and rolled; the vehicle leans. A
clear sector is wrong where a solid stands in its height band between its nearest and its farthest distance, one with an obstacle
where a solid stands before the part of the way to it that must have been seen free, both by more than the slack of volume.py."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.free_space.random_frames import RandomCamera, has_room
from benchmarks.free_space.unusual_frames import LEAST_THING_PX, unusual_camera, unusual_scene
from benchmarks.free_space.volume import SLACK_M, SLACK_SIGMAS, Floats, above_ground, first_solids, has_ground
from companion.autopilot.polar_histogram import SHORT_SIGMAS, STEP_RAD, SectorState, centres_rad, scan
from companion.autopilot.view_free import RING_M, View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.frames import rotation_frd_optical, rotation_from_euler, rotation_level_cam_optical
from core.types import CameraMount
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import measure
from drivers.simulation.source import look

MOST_CAMERAS = 4
LEAN_DEG, MOUNT_PITCH_DEG = 20.0, 40.0
NOISES_PER_M = (0.0005, 0.0015, 0.003, 0.005)
_RAYS, _SLICES = 5, 8
_EDGE_SHARE = 0.1
"""Part of the height band at its upper and lower edge that is not judged: it may be unmeasured, see docs/reference/limits.md."""
_TRIES = 60
_ROOM_M = 0.8
_LEVER_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """A vehicle in a scene. place_m: of the origin of frd in ned; R_ned_frd: (3, 3); cameras: with their mounts in frd."""

    number: int
    seed: int
    scene: Scene
    place_m: Floats
    R_ned_frd: Floats
    heading_rad: float
    cameras: tuple[RandomCamera, ...]
    avoid: AvoidParams


def _mounted(rng: np.random.Generator, camera: RandomCamera, name: str) -> RandomCamera:
    """The camera with a name and a random mount."""
    pitch, roll = (
        math.radians(float(rng.uniform(-1, 1)) * MOUNT_PITCH_DEG),
        float(rng.choice([0.0, 0.0, math.pi, 0.5, 1.57])),
    )
    x, y, z = (float(v) for v in rng.uniform(-_LEVER_M, _LEVER_M, 3))
    mount = CameraMount(roll, pitch, float(rng.uniform(-math.pi, math.pi)), x, y, z)
    ke = float(rng.choice(NOISES_PER_M))
    info = replace(camera.info, camera=name, mount=mount, ke_per_m=ke)
    return replace(
        camera,
        info=info,
        measures=replace(info, max_range_m=camera.measures.max_range_m),
        sensor=replace(camera.sensor, ke_per_m=ke),
    )


def random_rig(seed: int, number: int) -> Rig:
    """The rig of a number; the same for the same seed and number."""
    rng = np.random.Generator(np.random.PCG64([seed, number, 4]))
    cameras = tuple(
        _mounted(rng, unusual_camera(rng, seed + i), f"c{i}") for i in range(int(rng.integers(1, MOST_CAMERAS + 1)))
    )
    far_m = max(3.0, float(rng.uniform(0.2, 0.8)) * min(c.info.max_range_m for c in cameras))
    avoid = AvoidParams(
        max_distance_m=far_m,
        near_m=min(float(rng.uniform(0.6, 4.0)), 0.7 * far_m),
        radius_m=float(rng.uniform(0.0, 0.8)),
        band_above_m=float(rng.uniform(0.2, 1.5)),
        band_below_m=float(rng.uniform(0.2, 1.5)),
    )
    height_m = float(np.exp(rng.uniform(math.log(1.0), math.log(30.0))))
    least_f = min(min(c.info.intrinsics.fx, c.info.intrinsics.fy) for c in cameras)
    for _ in range(_TRIES):
        scene = unusual_scene(rng, 1.5 * far_m + 3.0, LEAST_THING_PX / least_f, all_around=True)
        if has_room(scene, height_m, room_m=_ROOM_M):
            break
    roll, pitch = (math.radians(v) for v in rng.uniform(-LEAN_DEG, LEAN_DEG, 2))
    heading = float(rng.uniform(-math.pi, math.pi))
    R = rotation_from_euler(roll, pitch, heading)
    return Rig(number, seed, scene, np.array([0.0, 0.0, -height_m]), R, heading, cameras, avoid)


def view_of(rig: Rig, camera: RandomCamera, extractor: Extractor) -> View:
    """The view of one camera in level, as the service makes it."""
    info, mount = camera.info, camera.info.mount
    R = rig.R_ned_frd @ rotation_frd_optical(mount)
    lever = rig.R_ned_frd @ np.array([mount.x_m, mount.y_m, mount.z_m])
    truth = look(rig.scene, camera.measures, R, rig.place_m + lever)
    depth_mm = measure(truth.depth_m, camera.measures, camera.sensor, camera.seed, rig.number)
    model, _ = extractor.extract(depth_mm, info, rotation_level_cam_optical(R))
    c, s = math.cos(rig.heading_rad), math.sin(rig.heading_rad)
    R_level_ned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = (float(v) for v in R_level_ned @ lever)
    yaw = math.remainder(math.atan2(R[1, 2], R[0, 2]) - rig.heading_rad, math.tau)
    to_level = LevelTransform(yaw, (x, y, z))
    R_optical_level = (R_level_ned @ R).T
    return View(
        transform_model(model, to_level), to_level, info.intrinsics, R_optical_level, extractor.params.profile_ring_m
    )


@dataclass(frozen=True, slots=True)
class RigCounts:
    """clear, obstacles: sectors with that state; wrong: (sector, distance at which a solid stands, distance to which the
    sector must have been seen free)."""

    clear: int
    obstacles: int
    wrong: tuple[tuple[int, float, float], ...]


def judge_rig(rig: Rig, extractor: Extractor) -> RigCounts:
    """Checks the sectors of a rig. An obstacle that may be sent without the way to it having been seen is not judged."""
    views, avoid = [view_of(rig, c, extractor) for c in rig.cameras], rig.avoid
    found = scan(views, avoid)
    clear = found.state == SectorState.CLEAR
    ke = max(c.info.ke_per_m for c in rig.cameras)
    plane_m = found.distance_m + avoid.radius_m
    # the last stretch before a plane need not be seen, see docs/reference/obstacle-output.md
    seen_m = plane_m - avoid.step_m - RING_M - SHORT_SIGMAS * ke * np.where(np.isfinite(plane_m), plane_m, 0.0) ** 2
    to_m = np.where(clear, avoid.max_distance_m, seen_m)
    known = np.flatnonzero(clear | ((found.state == SectorState.OBSTACLE) & (to_m > avoid.near_m)))
    if not len(known):
        return RigCounts(0, 0, ())
    pixel = max(1.0 / c.info.intrinsics.fx for c in rig.cameras)
    across = np.linspace(-0.4 * STEP_RAD + pixel, 0.4 * STEP_RAD - pixel, _RAYS)
    share = _EDGE_SHARE + (1.0 - 2.0 * _EDGE_SHARE) * (np.arange(_SLICES) + 0.5) / _SLICES
    heights = -avoid.band_above_m + share * (avoid.band_above_m + avoid.band_below_m)
    sector, azimuth, z = (g.ravel() for g in np.meshgrid(known, across, heights, indexing="ij"))
    azimuth, z = centres_rad()[sector] + azimuth, z.astype(np.float64)
    lo, hi = np.full(len(z), avoid.near_m), to_m[sector]
    for view in views:
        lo, hi = above_ground_of(view, azimuth, z, lo, hi, extractor)
    ray = rig.heading_rad + azimuth
    origins = np.tile(rig.place_m, (len(z), 1))
    origins[:, 2] += z
    to = np.stack([np.cos(ray), np.sin(ray), np.zeros(len(z))], axis=1)
    range_m, which = first_solids(
        rig.scene, has_ground(rig.scene), origins, to, lo, hi, extractor.params.min_obstacle_height_m
    )
    slack = np.fmax(SLACK_M, SLACK_SIGMAS * ke * np.where(which >= 0, range_m, 0.0) ** 2)
    wrong = (which >= 0) & (range_m < to_m[sector] - slack)
    worst: dict[int, float] = {}
    for i in np.flatnonzero(wrong):
        worst[int(sector[i])] = min(worst.get(int(sector[i]), math.inf), float(range_m[i]))
    return RigCounts(
        int(clear.sum()),
        len(known) - int(clear.sum()),
        tuple((s, at, float(to_m[s])) for s, at in sorted(worst.items())),
    )


def above_ground_of(
    view: View, azimuth_rad: Floats, z_m: Floats, begins: Floats, ends: Floats, extractor: Extractor
) -> tuple[Floats, Floats]:
    """`volume.above_ground` for rays from the vehicle's middle: the ground of the view as seen from there."""
    ground = view.model.ground
    if not (view.model.valid and ground.seen):
        return begins, ends
    x, y, z = view.place_m
    here = replace(ground, height_m=ground.height_m + z - ground.slope_x * x - ground.slope_y * y)
    return above_ground(here, azimuth_rad, z_m, begins, ends, view.model.ke_per_m, extractor.params)
