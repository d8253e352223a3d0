"""Checks the free space of the merged world and the clear sectors against the solids of random scenes.

A world is built from a short flight past a random scene with changing pitch and roll. A free cell is wrong where its
centre lies in a solid, above or below the ground that was found, deeper than max(0.3 m, 3 sigma of its distance) from
the solid's sides, or where no camera of the flight can have seen it: in each frame a solid stands before its centre by more
than that, and by a pixel to each side. Most walls and poles are thinner than twice the slack, so that nothing is deep in
them: what was not seen behind them shows that they were called free. A clear sector is wrong where a solid lies in it between its nearest and farthest distance, less the
same slack."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import world_space
from benchmarks.free_space.random_frames import RandomFrame, has_room, random_frame
from benchmarks.free_space.readers import deep_in_solid
from benchmarks.free_space.volume import SLACK_M, SLACK_SIGMAS, above_ground, first_solids, has_ground, heading_of
from companion.autopilot.polar_histogram import STEP_RAD, SectorState, centres_rad, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.types import ExtractorState, FrameModel
from core.world.free_grid import CELL_M, SIDE, TALL
from core.world.world import Observation, World
from drivers.simulation.source import Rendered
from osape_client.query.space import Occupancy

Floats = NDArray[np.float64]
FRAMES = 12
_STEP_NS = 100_000_000
_RAYS, _SLICES = 5, 8
_FLATTER = 0.3
"""Share of the random tilt that is left where sectors are judged."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """One frame of a flight and its model in level_cam."""

    frame: Rendered
    model: FrameModel


def flight(seed: int, number: int, extractor: Extractor) -> tuple[list[Flown], float]:
    """(frames with their models, true noise) of a flight of FRAMES frames past the scene of random frame `number`."""
    first = random_frame(seed, number)
    rng = np.random.Generator(np.random.PCG64([seed, number, 1]))
    ahead, x, y, z = rng.uniform(-0.6, 0.6), 0.0, 0.0, float(first.frame.position_ned_m[2])
    state, flown = ExtractorState(), []
    for k in range(FRAMES):
        pitch, roll = first.pitch_deg + rng.uniform(-12.0, 12.0), first.roll_deg + rng.uniform(-8.0, 8.0)
        frame = first.camera.image(
            first.frame.scene,
            (x, y, z),
            float(rng.uniform(-0.5, 0.5)),
            max(-55.0, min(50.0, pitch)),
            roll,
            FRAMES * number + k,
        )
        model, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state)
        flown.append(Flown(frame, model))
        to = x + 0.4 * math.cos(ahead), y + 0.4 * math.sin(ahead)
        if has_room(frame.scene, -z, to):
            x, y = to
    return flown, first.ke_per_m


def _free_cells(world: World, now_ns: int) -> Floats:
    """(N, 3) middles in ned of the cells that the world answers to be free."""
    picture = world.picture(now_ns)
    cells = []
    for (bx, by, bz), masks in zip(picture.blocks, picture.masks, strict=True):
        bits = np.unpackbits(masks.view(np.uint8).reshape(len(masks), 8), axis=1, bitorder="little")
        column, iz = np.nonzero(bits)
        cells.append(np.stack([bx * SIDE + (column >> 4), by * SIDE + (column & 15), bz * TALL + iz], axis=1))
    if not cells:
        return np.zeros((0, 3))
    middles = (np.concatenate(cells) + 0.5) * CELL_M
    return middles[world_space(picture).points(middles) == Occupancy.FREE]


def out_of_sight(flown: list[Flown], points: Floats, slack_m: Floats, least_m: float) -> NDArray[np.bool_]:
    """(N,) whether in each valid frame a solid stands more than slack_m (N,) before points (N, 3) of ned, on the ray to the
    point and on those a pixel beside, above and below it."""
    hidden = np.ones(len(points), np.bool_)
    for f in flown:
        if not f.model.valid:
            continue
        k, place = f.frame.info.intrinsics, np.tile(f.frame.position_ned_m, (len(points), 1))
        range_m = np.linalg.norm(points - place, axis=1)
        ahead = (points - place) / range_m[:, None]
        beside = np.cross([0.0, 0.0, 1.0], ahead)
        beside /= np.maximum(np.linalg.norm(beside, axis=1), 1e-9)[:, None]
        above = np.cross(ahead, beside)
        for across, up in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            to = ahead + across / k.fx * beside + up / k.fy * above
            to /= np.linalg.norm(to, axis=1)[:, None]
            solid_m, _ = first_solids(
                f.frame.scene, has_ground(f.frame.scene), place, to, np.zeros(len(points)), range_m, least_m
            )
            hidden &= solid_m < range_m - slack_m
    return hidden


def judge_world(seed: int, number: int, extractor: Extractor) -> tuple[Floats, int, int]:
    """((N, 3) centres in ned of wrong free cells, number of free cells, valid frames)."""
    flown, ke = flight(seed, number, extractor)
    world = World()
    for k, f in enumerate(flown):
        x, y, z = (float(c) for c in f.frame.position_ned_m)
        model = transform_model(f.model, LevelTransform(heading_of(f.frame), (x, y, z)))
        world.add(Observation(model=model, place_m=(x, y, z), t_ns=(1 + k) * _STEP_NS))
    valid = sum(f.model.valid for f in flown)
    points = _free_cells(world, (1 + len(flown)) * _STEP_NS)
    if not len(points):
        return points, 0, valid
    range_m = np.max([np.hypot(*(points - f.frame.position_ned_m)[:, :2].T) for f in flown], axis=0)
    slack = np.fmax(SLACK_M, SLACK_SIGMAS * ke * np.minimum(range_m, flown[0].frame.info.max_range_m) ** 2)
    least_m = extractor.params.min_obstacle_height_m
    wrong = deep_in_solid(flown[0].frame, points, slack, least_m) | out_of_sight(flown, points, slack, least_m)
    return points[wrong], len(points), valid


def judge_sectors(r: RandomFrame, extractor: Extractor) -> tuple[list[int], int]:
    """(wrong clear sectors, how many are clear) of one scene, the camera being the vehicle's middle and nearly level: what is
    tilted more never sees the band of heights whole."""
    info, place = r.frame.info, r.frame.position_ned_m
    at = (float(place[0]), float(place[1]), float(place[2]))
    f = r.camera.image(r.frame.scene, at, heading_of(r.frame), _FLATTER * r.pitch_deg, _FLATTER * r.roll_deg, r.number)
    model, _ = extractor.extract(f.depth_mm, info, f.R_level_optical)
    far_m = max(2.0, 0.6 * info.max_range_m)
    avoid = AvoidParams(max_distance_m=far_m, near_m=min(2.5, 0.7 * far_m), radius_m=0.0)
    view = View(model, LevelTransform(0.0, (0.0, 0.0, 0.0)))
    clear = np.flatnonzero(scan([view], avoid).state == SectorState.CLEAR)
    if not len(clear):
        return [], 0
    pixel = 1.0 / info.intrinsics.fx
    across = np.linspace(-0.4 * STEP_RAD + pixel, 0.4 * STEP_RAD - pixel, _RAYS)
    z = -avoid.band_above_m + (np.arange(_SLICES) + 0.5) / _SLICES * (avoid.band_above_m + avoid.band_below_m)
    sector, azimuth, height = (g.ravel() for g in np.meshgrid(clear, across, z, indexing="ij"))
    height = height.astype(np.float64)
    azimuth = centres_rad()[sector] + azimuth
    n = len(azimuth)
    lo, hi = above_ground(
        model.ground, azimuth, height, np.full(n, avoid.near_m), np.full(n, far_m), model.ke_per_m, extractor.params
    )
    heading = heading_of(f) + azimuth
    origins = np.tile(f.position_ned_m, (n, 1))
    origins[:, 2] += height
    to = np.stack([np.cos(heading), np.sin(heading), np.zeros(n)], axis=1)
    range_m, which = first_solids(
        f.scene, has_ground(f.scene), origins, to, lo, hi, extractor.params.min_obstacle_height_m
    )
    slack = np.fmax(SLACK_M, SLACK_SIGMAS * r.ke_per_m * np.where(which >= 0, range_m, 0.0) ** 2)
    wrong = np.unique(sector[(which >= 0) & (range_m < far_m - slack)])
    return [int(s) for s in wrong], len(clear)
