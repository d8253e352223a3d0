"""Ramps at edges of objects become unmeasured for cameras that smear edges, and only for those."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.buffers import Buffers
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL
from core.params import Params
from core.stages.ramps import RampLimits, ramp_limits
from core.stages.smeared_edges import (
    EdgeCounts,
    edges_of,
    height_line,
    observe_edges,
    remove_smeared_edges,
    smears,
)
from core.types import FAR_MM, CameraInfo, ExtractorState, Ground, Intrinsics
from drivers.simulation.sensor_model import SensorModel, measure

from .views import marks_of

P = Params()
KE = 0.0037
INFO = CameraInfo("front", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5), max_range_m=20.0, ke_per_m=KE)
WIDE = replace(INFO, intrinsics=Intrinsics(640, 120, 450.0, 450.0, 319.5, 59.5))
SMEARED = SensorModel(ke_per_m=0.0005, smear_px=3.0)
SHARP = replace(SMEARED, smear_px=0.0)
JUDGED = ExtractorState(edge_ramps=1.0)
"""Of a camera that has smeared all its edges for long."""
NO_GROUND = Ground(seen=False)
Depth = NDArray[np.uint16]
Metres = NDArray[np.float64]


def compiled(value: float) -> object:
    """A case that the pass without the JIT leaves out."""
    return pytest.param(value, marks=pytest.mark.compiled)


def limits(info: CameraInfo = INFO) -> RampLimits:
    return ramp_limits(info, info.ke_per_m or KE)


def stripes(near_m: float = 5.0, far_m: float = 9.0, info: CameraInfo = INFO) -> Metres:
    """Walls at two depths in turns."""
    k = info.intrinsics
    u = np.arange(k.width) * 10 // k.width % 2
    return np.repeat(np.where(u == 1, near_m, far_m)[None, :], k.height, axis=0)


def dropped(depth: Depth, ground: Ground = NO_GROUND, info: CameraInfo = INFO) -> tuple[NDArray[np.bool_], Depth]:
    """(which measured or far pixels are dropped, the image for the free space)."""
    marks = marks_of(depth, info, KE)
    before = marks.copy()
    heights = height_line(info, R_CAMFRD_OPTICAL, ground, P)
    smear = remove_smeared_edges(depth, marks, limits(info), heights, Buffers())
    free_marks, lost, lost_far = smear.free_marks, smear.measured, smear.far
    gone = (marks == 0) & (before > 0)
    assert lost == (gone & (before != FAR_MM)).sum()
    assert lost_far == (gone & (before == FAR_MM)).sum()
    np.testing.assert_array_equal(marks[~gone], before[~gone])
    np.testing.assert_array_equal(free_marks[~gone], before[~gone])
    return gone, free_marks


def test_a_ramp_between_two_walls_is_dropped_and_the_walls_are_kept() -> None:
    depth = measure(stripes(), INFO, SMEARED, 1)
    gone, _ = dropped(depth)
    between = (depth > 5300) & (depth < 8300)
    assert between.mean() > 0.04, "the scene has ramps"
    assert gone[between].mean() > 0.75
    assert gone[np.abs(depth - 5000.0) < 100].mean() < 0.05
    assert gone[np.abs(depth - 9000.0) < 300].mean() < 0.15


@pytest.mark.nojit
def test_a_ramp_that_ends_beyond_the_range_is_not_seen_through() -> None:
    wide = replace(INFO, intrinsics=Intrinsics(640, 24, 450.0, 450.0, 319.5, 11.5))
    sensor = replace(SMEARED, smear_px=9.0)
    depth = measure(stripes(5.0, 30.0, wide), replace(wide, max_range_m=60.0), sensor, 1)
    gone, free_marks = dropped(depth, info=wide)
    beyond = gone & (depth > 18000) & (depth < 25000)
    assert beyond.sum() > 100
    assert (free_marks[beyond] < 6500).all(), "free up to the near wall only"


def test_what_is_dropped_is_seen_through_to_the_near_surface_at_most() -> None:
    depth = measure(stripes(), INFO, SMEARED, 1)
    gone, free_marks = dropped(depth)
    assert gone.any()
    assert (free_marks[gone] <= depth[gone]).all()
    assert (free_marks[gone] < 5400).mean() > 0.99


@pytest.mark.parametrize("offset_m", [1.2, 2.0, 4.0])
def test_walls_seen_at_a_slant_stay(offset_m: float) -> None:
    """Both walls of a corridor, up to the end of the range."""
    aside = np.abs(np.arange(160) - 79.5) / 112.5
    depth_m = np.repeat(np.minimum(offset_m / aside, 60.0)[None, :], 120, axis=0)
    depth = measure(depth_m, INFO, SMEARED, 1)
    assert dropped(depth)[0].mean() < 0.01


@pytest.mark.nojit
def test_poles_and_wires_stay() -> None:
    """Their middles are nearer than both sides, however smeared."""
    depth_m = np.full((120, 160), 12.0)
    depth_m[:, 40:42] = 6.0
    depth_m[:, 100:103] = 4.0
    depth_m[60:62, 110:] = 5.0
    depth = measure(depth_m, INFO, SMEARED, 1)
    gone, _ = dropped(depth)
    assert not gone[:50, 40:42].all(axis=1).any()
    assert not gone[:50, 100:103].any()
    assert not gone[60:62, 120:].all(axis=0).any()


@pytest.mark.nojit
def test_the_near_sides_of_leaves_stay() -> None:
    rng = np.random.default_rng(4)
    depth_m = rng.uniform(5.0, 8.0, (30, 40)).repeat(4, axis=0).repeat(4, axis=1)
    depth = measure(depth_m, INFO, SMEARED, 1)
    gone, _ = dropped(depth)
    windows = np.lib.stride_tricks.sliding_window_view(depth, (5, 5))
    nearest = depth[2:-2, 2:-2] == windows.min(axis=(2, 3))
    assert nearest.sum() > 100
    assert not gone[2:-2, 2:-2][nearest].any()
    assert gone.mean() < 0.35
    assert dropped(measure(depth_m, INFO, SHARP, 1))[0].mean() < 0.01


@pytest.mark.nojit
@pytest.mark.parametrize("height_m", [0.1, compiled(0.3), compiled(0.6), 2.0])
def test_the_ground_stays_below_a_low_camera(height_m: float) -> None:
    """Close above it the ground is as steep as a ramp."""
    down = np.maximum((np.arange(120) - 59.5) / 112.5, 1e-3)
    depth_m = np.repeat(np.minimum(height_m / down, 60.0)[:, None], 160, axis=1)
    depth = measure(depth_m, replace(INFO, min_range_m=0.1), SHARP, 1)
    gone, _ = dropped(depth, Ground(seen=True, height_m=height_m))
    assert gone[62:].mean() < 0.002


@pytest.mark.parametrize("below_m", [0.3, 0.6, -0.5])
def test_the_tops_of_things_stay(below_m: float) -> None:
    """A horizontal surface close below or above the camera, without a ground, between a front at 3 m and a wall at 9 m."""
    down = (np.arange(120) - 59.5) / 112.5
    on_top = np.where(down * below_m > 0.0, below_m / down, np.inf)
    depth_m = np.repeat(np.clip(on_top, 3.0, 9.0)[:, None], 160, axis=1)
    for sensor in (SHARP, SMEARED):
        gone, _ = dropped(measure(depth_m, INFO, sensor, 1))
        top = (depth_m > 3.3) & (depth_m < 8.0)
        assert gone[top].mean() < 0.1


def test_the_verdict_on_a_camera_depends_on_its_edges() -> None:
    for sensor, expected in ((SMEARED, True), (SHARP, False)):
        state = ExtractorState()
        for frame in range(P.smear_min_frames):
            edges = edges_of(measure(stripes(), INFO, sensor, 1, frame), limits())
            state = observe_edges(state, edges, P)
            assert state.edge_ramps + state.edge_steps > 0.0
            assert smears(state, edges, P) is expected


def test_a_frame_without_edges_is_no_evidence() -> None:
    state = observe_edges(ExtractorState(), edges_of(measure(stripes(), INFO, SMEARED, 1), limits()), P)
    wall = edges_of(measure(np.full((120, 160), 5.0), INFO, SMEARED, 1), limits())
    assert observe_edges(state, wall, P) == state
    assert not smears(observe_edges(ExtractorState(), wall, P), wall, P)


def test_a_few_sharp_frames_do_not_turn_the_verdict_and_many_do() -> None:
    state = observe_edges(JUDGED, edges_of(measure(stripes(), INFO, SMEARED, 1), limits()), P)
    sharp = edges_of(measure(stripes(), INFO, SHARP, 1), limits())
    verdicts = []
    for _ in range(30):
        state = observe_edges(state, sharp, P)
        verdicts.append(smears(state, sharp, P))
    assert verdicts[0]
    assert not verdicts[-1]


def test_the_extractor_drops_ramps_of_a_camera_that_smears_and_reports_them() -> None:
    extractor = Extractor(P)
    smeared, _ = extractor.extract(measure(stripes(), INFO, SMEARED, 1), INFO, R_CAMFRD_OPTICAL, JUDGED)
    sharp, _ = extractor.extract(measure(stripes(), INFO, SHARP, 1), INFO, R_CAMFRD_OPTICAL)
    never, _ = Extractor(replace(P, smear_min_share=1.0)).extract(
        measure(stripes(), INFO, SMEARED, 1), INFO, R_CAMFRD_OPTICAL
    )
    assert smeared.stats.smeared_px > 500
    assert smeared.stats.unknown_share > never.stats.unknown_share
    assert len(smeared.planes) < len(never.planes)
    assert sharp.stats.smeared_px == 0 == never.stats.smeared_px


def test_the_free_range_ends_no_later_than_with_the_near_wall_in_place_of_the_ramps() -> None:
    depth = measure(stripes(), INFO, SMEARED, 1)
    gone, _ = dropped(depth)
    solid = np.where(gone, 5000, depth).astype(np.uint16)
    p = replace(P, profile_layer_m=0.5)
    state = observe_edges(JUDGED, edges_of(depth, limits()), P)
    free = Extractor(p).extract(depth, INFO, R_CAMFRD_OPTICAL, state)[0].free
    bound = Extractor(replace(p, smear_min_share=1.0)).extract(solid, INFO, R_CAMFRD_OPTICAL)[0].free
    assert free.free_to_m.max() > 3.0
    excess = (free.free_to_m - free.free_from_m).clip(0.0) - (bound.free_to_m - bound.free_from_m).clip(0.0)
    assert excess.max() <= p.profile_ring_m


def distance_at_pixel(planes: NDArray[np.float32], u: float, v: float) -> float:
    """Forward distance at which a level camera's ray through (u, v) meets the first plane, inf: none."""
    k = INFO.intrinsics
    t, down = (u - k.cx) / k.fx, (v - k.cy) / k.fy
    first = np.inf
    for ax, ay, bx, by, top, bottom in planes.astype(float):
        x = (ax * by - ay * bx) / ((by - ay) - t * (bx - ax))
        if min(ay / ax, by / bx) <= t <= max(ay / ax, by / bx) and top <= x * down <= bottom:
            first = min(first, x)
    return first


@pytest.mark.nojit
@pytest.mark.parametrize("ke_per_m", [KE, compiled(0.002)])
def test_thin_things_before_a_wall_stay_in_the_model(ke_per_m: float) -> None:
    """A pole, a wire and a branch, each two pixels wide, before a wall at 14 m."""
    depth_m = np.full((120, 160), 14.0)
    depth_m[:, 40:42] = 6.0
    depth_m[30:32, 90:140] = 5.0
    depth_m[80:82, 100:115] = 8.0
    info = replace(INFO, ke_per_m=ke_per_m)
    depth = measure(depth_m, info, SMEARED, 1)
    model, _ = Extractor(P).extract(depth, info, R_CAMFRD_OPTICAL, JUDGED)
    assert model.stats.smeared_px > 0, "the stage acts"
    for u, v, distance_m in ((40.5, 20, 6.0), (40.5, 100, 6.0), (115.0, 30.5, 5.0), (107.0, 80.5, 8.0)):
        assert distance_at_pixel(model.planes, u, v) == pytest.approx(distance_m, abs=0.7)
    assert distance_at_pixel(model.planes, 20.0, 60.0) == pytest.approx(14.0, abs=1.5)


def grazing_wall(offset_m: float, nearest_m: float) -> Depth:
    """A wall offset_m to the right, seen by a sharp camera, before another across at 16 m; unmeasured nearer than nearest_m."""
    info = WIDE
    aside = (np.arange(info.intrinsics.width) - info.intrinsics.cx) / info.intrinsics.fx
    depth_m = np.full(aside.shape, 16.0)
    depth_m[aside > 0.0] = np.minimum(offset_m / aside[aside > 0.0], 16.0)
    depth = measure(np.repeat(depth_m[None, :], 120, axis=0), info, SHARP, 1)
    depth[depth < 1000.0 * nearest_m] = 0
    return depth


@pytest.mark.parametrize("offset_m", [0.5, 0.7, 0.95])
@pytest.mark.parametrize("nearest_m", [4.0, 6.0, 8.0])
def test_a_wall_at_a_slant_beside_a_hole_is_neither_evidence_nor_dropped(offset_m: float, nearest_m: float) -> None:
    """Where the depth beyond the near end is unknown, a surface and a ramp look the same."""
    depth = grazing_wall(offset_m, nearest_m)
    low_noise = replace(WIDE, ke_per_m=0.002)
    edges = edges_of(depth, limits(low_noise))
    assert edges.ramps <= 0.1 * edges.steps or not edges.at_least(P.smear_min_edges)
    state = ExtractorState()
    for _ in range(2 * P.smear_min_frames):
        state = observe_edges(state, edges, P)
        assert not smears(state, edges, P)
    assert not dropped(depth, info=low_noise)[0].any()


def test_the_extractor_keeps_a_wall_at_a_slant_beside_a_hole() -> None:
    depth = grazing_wall(0.7, 5.0)
    extractor, state = Extractor(P), ExtractorState()
    for _ in range(2):
        model, state = extractor.extract(depth, replace(WIDE, ke_per_m=0.002), R_CAMFRD_OPTICAL, state)
        assert model.stats.smeared_px == 0


def test_sharp_edges_before_the_sky_are_steps() -> None:
    depth = np.full((120, 160), FAR_MM, np.uint16)
    for pole in range(12):
        depth[:, 8 + 12 * pole : 12 + 12 * pole] = 4000
    assert edges_of(depth, limits()) == EdgeCounts(ramps=0, rising=0, steps=2 * 12 * 30, rows=120)


def verdicts_over(edges: EdgeCounts, frames: int) -> list[bool]:
    """What `smears` says after each of so many frames with the same edges."""
    state, verdicts = ExtractorState(), []
    for _ in range(frames):
        state = observe_edges(state, edges, P)
        verdicts.append(smears(state, edges, P))
    return verdicts


def test_one_frame_is_enough_where_nearly_all_of_many_edges_are_ramps() -> None:
    edges = edges_of(measure(stripes(), INFO, SMEARED, 1), limits())
    assert edges.at_least(P.smear_clear_edges)
    assert edges.ramps > P.smear_clear_share * edges.total
    assert verdicts_over(edges, 1) == [True]


@pytest.mark.parametrize(
    ("share", "total"),
    [(0.5 * (P.smear_min_share + P.smear_clear_share), 2.0 * P.smear_clear_edges), (1.0, 0.9 * P.smear_clear_edges)],
    ids=["a share that is not clear", "few edges"],
)
def test_one_frame_is_not_enough_otherwise(share: float, total: float) -> None:
    ramps = round(share * total)
    edges = EdgeCounts(ramps=ramps, rising=ramps // 2, steps=round(total) - ramps, rows=480)
    assert edges.at_least(P.smear_min_edges)
    assert verdicts_over(edges, P.smear_min_frames + 1) == [False] * (P.smear_min_frames - 1) + [True, True]


@pytest.mark.parametrize("rising", [0, 30, 370, 400])
def test_ramps_of_one_side_are_no_evidence(rising: int) -> None:
    """A wall seen edge-on is a ramp on one side in each row."""
    edges = EdgeCounts(ramps=400, rising=rising, steps=0, rows=480)
    assert verdicts_over(edges, P.smear_min_frames + 1) == [False] * (P.smear_min_frames + 1)
    assert observe_edges(JUDGED, edges, P) == JUDGED


def test_few_ramps_of_one_side_leave_the_steps_as_evidence() -> None:
    edges = EdgeCounts(ramps=100, rising=100, steps=300, rows=480)
    assert observe_edges(JUDGED, edges, P).edge_steps > 0.0


def test_rising_ramps_are_those_with_the_near_side_on_the_right() -> None:
    for near_m, far_m, side in ((5.0, 9.0, 0), (9.0, 5.0, 1)):
        half = np.where(np.arange(160) < 80, near_m, far_m)
        edges = edges_of(measure(np.repeat(half[None, :], 120, axis=0), INFO, SMEARED, 1), limits())
        assert edges.ramps > 20
        assert edges.rising == side * edges.ramps


def test_a_clear_frame_after_one_of_sharp_edges_is_not_enough() -> None:
    sharp = EdgeCounts(ramps=0, rising=0, steps=400, rows=480)
    ramps = EdgeCounts(ramps=400, rising=200, steps=0, rows=480)
    state = observe_edges(observe_edges(ExtractorState(), sharp, P), ramps, P)
    assert not smears(state, ramps, P)
