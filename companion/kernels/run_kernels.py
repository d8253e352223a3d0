"""Runs every kernel once on small inputs, so that numba compiles or loads it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from core.types import CameraInfo, ExtractorState, FrameModel, Ground, Intrinsics

GROUPS = ("extractor", "world", "tracking", "sharing", "simulated")
"""Groups of kernels: the extractor, the merged world, the tracked obstacles, the alignment with neighbours and the
simulated camera."""
LEVEL: Final = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation of a camera that looks ahead."""


def run_kernels(groups: Sequence[str] = GROUPS) -> None:
    """Runs the kernels of these groups on small frames."""
    run = {
        "extractor": _run_extractor_kernels,
        "world": _run_world_kernels,
        "tracking": _run_tracking_kernels,
        "sharing": _run_sharing_kernels,
        "simulated": _run_simulation_kernels,
    }
    for group in groups:
        run[group]()


def _run_extractor_kernels() -> None:
    """Extracts a frame, level and tilted, and runs what only some frames need."""
    from core.extractor import Extractor
    from core.open_sky_params import OpenSkyParams
    from core.params import Params

    info, frame = _camera(), _frame()
    c, s = np.cos(0.2), np.sin(0.2)
    tilted = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ LEVEL
    extractor, state = Extractor(Params(), OpenSkyParams(mode="presume")), ExtractorState()
    for R in (LEVEL, tilted):
        _, state = extractor.extract(frame, info, R, state, keep_strips=True)
    _run_rare_kernels(frame, info)


def _run_rare_kernels(depth: np.ndarray[tuple[int, int], np.dtype[np.uint16]], info: CameraInfo) -> None:
    """Runs kernels that only some frames or parameters need: depth in metres, noise over time, noise check, ramps at
    smeared edges, pooling of columns."""
    from core.buffers import Buffers
    from core.params import Params
    from core.self_check.depth_registration import depth_pyramid, motion_between
    from core.self_check.surfaces import find_surfaces
    from core.stages.classify import depth_to_mm, pixel_limits
    from core.stages.noise_check import flying_off_ramps, noisy_share
    from core.stages.pooling import pool_columns
    from core.stages.ramps import ramp_limits
    from core.stages.smeared_edges import height_line, remove_smeared_edges
    from core.stages.temporal_noise import SAMPLE_COLS, SAMPLE_ROWS, still_sigma

    find_surfaces(depth, info, LEVEL, info.ke_per_m)
    p, ke = Params(), info.ke_per_m
    limits = pixel_limits(info, ke, p)
    samples = np.full((SAMPLE_ROWS, SAMPLE_COLS), 3000, np.uint16)
    still_sigma(samples, samples, limits, p)
    depth_to_mm((depth / 1000.0).astype(np.float32), np.empty(depth.shape, np.uint16))
    depth_mm = depth_to_mm(depth, np.empty(depth.shape, np.uint16))
    noisy_share(depth_mm, limits, p)
    flying_off_ramps(depth_mm, limits)
    heights = height_line(info, np.eye(3), Ground(seen=False), p)
    remove_smeared_edges(depth_mm, depth.copy(), ramp_limits(info, ke), heights, Buffers())
    pool_columns(np.zeros((2, 8), np.uint16), 2, 1, np.zeros((1, 8), np.uint16))
    pyramid = depth_pyramid(depth_mm, info)
    motion_between(pyramid, pyramid, np.eye(3))


def _run_world_kernels() -> None:
    """Runs the merged world on three small frames, of which one comes late, and on its own planes as saved ones."""
    from core.world.params import WorldParams
    from core.world.world import Observation, World

    model = _model()
    world = World(WorldParams(most_planes=1024, most_free_blocks=64))
    for k in (0, 2, 1):
        world.add(Observation(model=model, place_m=(0.01 * k, 0.0, 0.0), t_ns=k))
    world.load(world.saved())


def _run_simulation_kernels() -> None:
    """Renders a small frame of a scene with all kinds of solids."""
    from drivers.simulation.sensor_model import TYPICAL
    from drivers.simulation.source import camera_info, render

    render("street", camera_info(64, 48), pitch_rad=0.1, sensor=TYPICAL, seed=1)


def _run_tracking_kernels() -> None:
    """Tracks the obstacles of small frames, with a position and without."""
    from core.free_view import free_view
    from core.tracking.movers import support_by_view
    from core.tracking.objects import OBJECT
    from core.tracking.snapshot import TrackingFrame
    from core.tracking.tracker import Tracker

    model = _model()
    tracker = Tracker()
    for k, positioned in enumerate((True, True, False, False)):
        tracker.observe(TrackingFrame(model=model, camera_m=(0.0, 0.0, 0.0), t_ns=k, positioned=positioned))
    Tracker(state=tracker.state())
    # only obstacles that have begun to move are compared with earlier views
    support_by_view(np.zeros(1, OBJECT), free_view(model, (0.0, 0.0, 0.0)))


def _run_sharing_kernels() -> None:
    """Compares the samples of two planes, and a plane with one that was sent."""
    from core.sharing.correlation import Grid, scores
    from core.sharing.cover import covered
    from core.sharing.records import SharedPlanes

    points = np.column_stack([np.arange(20) * 0.2, np.zeros(20)])
    scores(points, np.zeros((1, 2)), np.zeros(1), 1.0, points, Grid(0.4, 0.01, 0.3))
    none = SharedPlanes.empty().box  # read-only, as all planes to send
    covered(none, np.zeros(0, np.intp), np.zeros((0, 6)), np.zeros(0, np.bool_), np.zeros(0, np.int64))


def _model() -> FrameModel:
    from core.extractor import Extractor
    from core.params import Params

    return Extractor(Params()).extract(_frame(), _camera(), LEVEL)[0]


def _camera() -> CameraInfo:
    return CameraInfo("warmup", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5), marks_smooth=True)


def _frame() -> np.ndarray[tuple[int, int], np.dtype[np.uint16]]:
    """(120, 160) uint16: ground 1.5 m below, a wall with a hole, a pole, scattered and unknown pixels."""
    rng = np.random.default_rng(1)
    depth = np.full((120, 160), 6000, np.uint16)
    rows = np.arange(70, 120)
    depth[70:] = np.minimum(6000, 1500 * 112.5 / (rows - 59.5)).astype(np.uint16)[:, None]
    depth[20:50, 100:130] = 9000
    depth[10:100, 40:43] = 3000
    depth[5:60, 5:30] = rng.integers(4000, 5500, (55, 25)).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.05] = 0
    return depth
