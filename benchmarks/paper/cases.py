"""What the paper's experiments share: its printed figures, frames under three conditions, models and their figures.

Everything is flat and plain, so that results can be kept as JSON and tables drawn anew without measuring anew."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import Rays, distances, rays_of, score
from benchmarks.paper.forms import MODES as MODES
from benchmarks.paper.forms import AnyExtractor, extractor_of, mode_of
from benchmarks.paper.printed.params import PaperParams
from benchmarks.peers.cloud import cloud_of
from benchmarks.peers.grid_prisms import grid_prisms
from benchmarks.scenes import catalogue as scenes
from core.params import Params
from core.stages.classify import clear_range_m
from core.types import CameraInfo, ExtractorState, FrameModel, Intrinsics
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import PERFECT, TYPICAL, SensorModel
from drivers.simulation.source import Rendered, camera_info, render

Floats = NDArray[np.float64]

NAN = float("nan")

PRINTED = {
    "osape_ms": 18.6,
    "osape_sd_ms": 3.0,
    "grid_0.1_ms": 226.1,
    "grid_0.8_ms": 17.6,
    "drone_ms": 89.0,
    "drone_hz_low": 10.0,
    "drone_hz_high": 12.0,
    "fewer_planes_than_0.8": 0.40,
    "tilt_deg": 30.0,
    "ke_per_m": 0.01,
    "roll_threshold_deg": 2.0,
    "fit_threshold_m": 0.2,
}
"""Figures that the paper states in words or tables (its curves are not printed as numbers)."""
PRINTED_OPENINGS = {"window": ((2.9, 2.1), (2.7, 2.0)), "corridor": ((5.8, 2.2), (5.7, 2.0))}
"""Fig. 8 c, d: (true width, height), (what the paper's model gave), metres."""


@dataclass(frozen=True, slots=True)
class Condition:
    """How the depth image came about. ke_per_m: its noise, sigma_Z = ke Z^2; faults: holes, mismatches, flying pixels
    as well; told_per_m: the noise that the method is configured with."""

    name: str
    ke_per_m: float
    faults: bool
    configured_ke_per_m: float

    def sensor(self, width: int) -> SensorModel:
        """The simulated camera."""
        return replace(TYPICAL if self.faults else PERFECT, ke_per_m=self.ke_per_m).scaled_to(width)

    @property
    def blind_left_px(self) -> int:
        """Columns at 640 px of width that the camera never sees."""
        return TYPICAL.blind_left_px if self.faults else 0


EXACT = Condition("exact", 0.0, False, 0.0015)
NOISE = Condition("noise", 0.0015, False, 0.0015)
CAMERA = Condition("camera", 0.0015, True, 0.0015)
CONDITIONS = (EXACT, NOISE, CAMERA)
CONDITION_WORDS = {
    "exact": "exact depth",
    "noise": "noise, ke 0.0015",
    "camera": "noise, ke 0.0015, and a camera's faults",
}


def noise_condition(ke_per_m: float) -> Condition:
    """Noise alone of a given ke, which is also configured (0: exact depth, 0.0015 configured)."""
    return Condition(f"ke {ke_per_m:g}", ke_per_m, False, ke_per_m or 0.0015)


def zed_info(ke_per_m: float) -> CameraInfo:
    """A camera with the image size of the paper's drone, 672x376, and the field of view of such a camera."""
    return CameraInfo("front", Intrinsics(672, 376, 350.0, 350.0, 335.5, 187.5), ke_per_m=ke_per_m)


def frames_of(
    scene: Scene,
    condition: Condition,
    seed: int,
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -2.0),
    yaw_rad: float = 0.0,
    count: int = 2,
    info: CameraInfo | None = None,
) -> list[Rendered]:
    """`count` frames of a scene that differ in their noise only, 640x480 unless `info` is given."""
    info = info or camera_info(ke_per_m=condition.configured_ke_per_m)
    return [
        render(
            scene,
            info,
            roll_rad=math.radians(roll_deg),
            pitch_rad=math.radians(pitch_deg),
            yaw_rad=yaw_rad,
            position_ned_m=position_ned_m,
            sensor=condition.sensor(info.intrinsics.width),
            seed=seed,
            frame=frame,
        )
        for frame in range(count)
    ]


@functools.lru_cache(maxsize=4)
def named_frames(
    name: str,
    seed: int,
    condition: Condition,
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    count: int = 2,
    info: CameraInfo | None = None,
) -> tuple[Rendered, ...]:
    """Frames of a named scene from where the seed puts the camera, 2 m above the ground."""
    position, yaw = scenes.camera_pose(name, seed, 2.0)
    scene = scenes.make_scene(name, seed)
    return tuple(frames_of(scene, condition, seed, roll_deg, pitch_deg, position, yaw, count, info))


def model_of(frames: Sequence[Rendered], extractor: AnyExtractor, keep_strips: bool = False) -> FrameModel:
    """The model of the last frame; the state goes on from frame to frame, as in flight."""
    state = ExtractorState()
    for frame in frames[:-1]:
        _, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=state)
    last = frames[-1]
    return extractor.extract(last.depth_mm, last.info, last.R_level_optical, state=state, keep_strips=keep_strips)[0]


LEAST_RAYS = 300
"""A thousandth of the image. With fewer obstacle rays a frame says nothing about obstacles."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """The figures of one model of one frame (benchmarks.fidelity.metrics.Score; nan: it has fewer than LEAST_RAYS of them).

    method: safe, paper or the cell of the grid. silent: the frame came back as invalid, "I know nothing"; it has no other
    figures. bytes: 8 a vertex and 8 a prism or polygon. lost: share of the strips' pixels that no plane stands for (of the
    printed form only)."""

    scene: str
    family: str
    condition: str
    seed: int
    method: str
    planes: int
    bytes: int
    mean_m: float
    missed: float = NAN
    phantom: float = NAN
    open_stopped: float = NAN
    silent: bool = False
    lost: float = NAN


def prism_bytes(model: FrameModel) -> int:
    """Storage of a frame's prisms: two float32 a vertex, two heights a prism."""
    return sum(8 * len(p.vertices_m) + 8 for p in model.prisms)


def rays_under(frame: Rendered, condition: Condition, params: Params) -> Rays:
    """The true rays of a frame taken under a condition. Obstacles closer to the end of the range than three sigma of the
    noise that the method is configured with do not count, whatever the true noise: it gives that stretch up."""
    blind = round(condition.blind_left_px * frame.info.intrinsics.width / 640)
    rays = rays_of(frame, condition.ke_per_m, params.min_obstacle_height_m, blind)
    within = frame.truth.depth_m < clear_range_m(
        frame.info, max(condition.configured_ke_per_m, condition.ke_per_m), params
    )
    return replace(rays, obstacle=np.asarray(rays.obstacle & within))


def measure(
    frames: Sequence[Rendered], condition: Condition, scene: str, seed: int, params: Params, method: str = ""
) -> Figures:
    """The figures of the extractor on the last frame."""
    model = model_of(frames, extractor_of(params), keep_strips=True)
    rays = rays_under(frames[-1], condition, params)
    s = score(frames[-1], rays, model.planes.astype(np.float64))
    strips = 0 if model.strips is None else int(model.strips.support_px.sum())
    enough = model.valid and s.obstacle_rays >= LEAST_RAYS
    return Figures(
        scene=scene,
        family=scenes.family_of(scene),
        condition=condition.name,
        seed=seed,
        method=method or mode_of(params),
        planes=s.planes,
        bytes=prism_bytes(model),
        mean_m=s.mean_m if enough else NAN,
        missed=s.missed if enough else NAN,
        phantom=s.phantom if enough else NAN,
        open_stopped=s.open_stopped if model.valid else NAN,
        silent=not model.valid,
        lost=1.0 - int(model.support_px.sum()) / strips if strips and isinstance(params, PaperParams) else NAN,
    )


def measure_grid(
    frame: Rendered, condition: Condition, scene: str, seed: int, params: Params, cell_m: float
) -> Figures:
    """The figures of the grid baseline on one frame: storage and distance only."""
    rays = rays_under(frame, condition, params)
    cloud = cloud_of(frame, condition.ke_per_m)
    made = grid_prisms(cloud.points_m, cloud.ground_z_m, cell_m)
    points = frame.truth.points_level_cam_m[rays.obstacle]
    return Figures(
        scene=scene,
        family=scenes.family_of(scene),
        condition=condition.name,
        seed=seed,
        method=grid_name(cell_m),
        planes=len(made.planes),
        bytes=made.bytes,
        mean_m=float(distances(points, made.planes).mean()) if len(points) >= LEAST_RAYS else NAN,
    )


def grid_name(cell_m: float) -> str:
    """What the grid baseline of a cell size is called in tables."""
    return f"grid {cell_m:g} m"


def held_out(count: int) -> list[int]:
    """The first seeds of those that are for reporting only."""
    return list(scenes.HELD_OUT_SEEDS)[:count]


def middle(values: list[float]) -> float:
    """Median of what is known, nan without any."""
    known = [v for v in values if not math.isnan(v)]
    return float(np.median(known)) if known else NAN


def worst(values: list[float]) -> float:
    """Greatest of what is known, nan without any."""
    known = [v for v in values if not math.isnan(v)]
    return max(known) if known else NAN


def number(value: float, digits: int = 2) -> str:
    """A figure of a table; a dash where there is none."""
    return "-" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.{digits}f}"


def percent(value: float, digits: int = 1) -> str:
    """A share of a table, in %."""
    return "-" if math.isnan(value) else f"{100 * value:.{digits}f}"


def progress(text: str) -> None:
    """One line on stderr that the next one overwrites."""
    print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
