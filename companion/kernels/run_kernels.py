"""Runs every kernel once on small inputs, so that numba compiles or loads it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from core.types import CameraInfo, ExtractorState, Ground, Intrinsics

MODES = ("extractor", "world", "tracking", "sharing", "simulated")
"""Groups of kernels: the extractor, the merged world, the tracked obstacles, the alignment with neighbours and the
simulated camera."""


def run_kernels(modes: Sequence[str] = MODES, metres: bool = True) -> None:
    """Runs the kernels of these groups on small frames: uint16 millimetres, as cameras deliver, and for the extractor
    optionally float32 metres."""
    from core.extractor import Extractor
    from core.open_sky_params import OpenSkyParams
    from core.params import Params

    info = CameraInfo("warmup", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5), marks_smooth=True)
    tilt = 0.2
    c, s = np.cos(tilt), np.sin(tilt)
    level = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    tilted = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ level
    frame = _frame()
    for mode in modes:
        if mode == "world":
            _run_world_kernels()
            continue
        if mode == "simulated":
            _run_simulation_kernels()
            continue
        if mode == "tracking":
            _run_tracking_kernels()
            continue
        if mode == "sharing":
            _run_sharing_kernels()
            continue
        extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
        for depth in (frame, (frame / np.float32(1000.0)).astype(np.float32))[: 2 if metres else 1]:
            state = ExtractorState()
            for R in (level, tilted):
                _, state = extractor.extract(depth, info, R, state, keep_strips=True)
        _run_rare_kernels(frame, info)


def _run_rare_kernels(depth: np.ndarray[tuple[int, int], np.dtype[np.uint16]], info: CameraInfo) -> None:
    """Runs kernels that only some frames or parameters need: noise over time, noise check, ramps at smeared
    edges, pooling of columns."""
    from core.buffers import Buffers
    from core.params import Params
    from core.self_check.depth_registration import inverse_depth_grid, rotation_between
    from core.self_check.surfaces import find_surfaces
    from core.stages.classify import depth_to_mm, measured_mm
    from core.stages.noise_check import flying_off_ramps, noisy_share
    from core.stages.pooling import pool_columns
    from core.stages.ramps import ramp_limits
    from core.stages.smeared_edges import drop_smeared_edges
    from core.stages.temporal_noise import SAMPLE_COLS, SAMPLE_ROWS, still_sigma

    find_surfaces(depth, info, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), info.ke_per_m)
    p, ke = Params(), info.ke_per_m
    samples = np.full((SAMPLE_ROWS, SAMPLE_COLS), 3000, np.uint16)
    still_sigma(samples, samples, (1, 60000), p)
    depth_mm = depth_to_mm(depth, np.empty(depth.shape, np.uint16))
    noisy_share(depth_mm, *measured_mm(info, ke, p), ke, p)
    flying_off_ramps(depth_mm, *measured_mm(info, ke, p), p.flying_relative, p.flying_sigmas * ke)
    limits = ramp_limits(info, ke)
    drop_smeared_edges(depth_mm, depth.copy(), info, np.eye(3), Ground(seen=False), limits, p, Buffers())
    pool_columns(np.zeros((2, 8), np.uint16), 2, 1, np.zeros((1, 8), np.uint16))
    grid = inverse_depth_grid(depth_mm, info)
    rotation_between(grid, grid, np.eye(3))


def _run_world_kernels() -> None:
    """Runs the merged world on two small frames, and on its own planes as saved ones."""
    from core.extractor import Extractor
    from core.params import Params
    from core.world.params import WorldParams
    from core.world.world import Observation, World

    info = CameraInfo("warmup", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5))
    level = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    model, _ = Extractor(Params()).extract(_frame(), info, level)
    world = World(WorldParams(most_planes=1024, most_free_blocks=64))
    for k in range(2):
        world.add(Observation(model=model, place_m=(0.01 * k, 0.0, 0.0), t_ns=k))
    world.load(world.saved())


def _run_simulation_kernels() -> None:
    """Renders a small frame of a scene with all kinds of solids."""
    from drivers.simulation.sensor_model import TYPICAL
    from drivers.simulation.source import camera_info, render

    render("street", camera_info(64, 48), pitch_rad=0.1, sensor=TYPICAL, seed=1)


def _run_tracking_kernels() -> None:
    """Tracks the obstacles of small frames, with a position and without."""
    from core.extractor import Extractor
    from core.params import Params
    from core.tracking.free_view import free_view
    from core.tracking.movers import support_by_view
    from core.tracking.objects import OBJECT
    from core.tracking.params import TrackingParams
    from core.tracking.snapshot import TrackingFrame
    from core.tracking.tracker import Tracker, rules_of

    info = CameraInfo("warmup", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5))
    level = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    model, _ = Extractor(Params()).extract(_frame(), info, level)
    tracker = Tracker()
    for k, positioned in enumerate((True, True, False, False)):
        tracker.observe(TrackingFrame(model=model, camera_m=(0.0, 0.0, 0.0), t_ns=k, positioned=positioned))
    Tracker(state=tracker.state())
    # only obstacles that have begun to move are compared with earlier views
    support_by_view(np.zeros(1, OBJECT), rules_of(TrackingParams())[0], free_view(model, (0.0, 0.0, 0.0)))


def _run_sharing_kernels() -> None:
    """Compares the samples of two planes, and a plane with one that was sent."""
    from core.sharing.correlation import Grid, scores
    from core.sharing.cover import covered
    from core.sharing.records import SharedPlanes

    points = np.column_stack([np.arange(20) * 0.2, np.zeros(20)])
    scores(points, np.zeros((1, 2)), np.zeros(1), 1.0, points, Grid(0.4, 0.01, 0.3))
    none = SharedPlanes.empty().box  # read-only, as all planes to send
    covered(none, np.zeros(0, np.intp), np.zeros((0, 6)), np.zeros(0, np.bool_), np.zeros(0, np.int64))


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
