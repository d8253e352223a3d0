"""Surfaces of a depth image against planes whose place is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.self_check.mount_cues import NO_CUES, Walls, cues_of
from core.self_check.surface_types import Surface
from core.self_check.surfaces import find_surfaces
from core.types import CameraInfo, Intrinsics

INFO = CameraInfo("front", Intrinsics(160, 120, 112.5, 112.5, 79.5, 59.5), max_range_m=20.0)


def image(planes: list[tuple[tuple[float, float, float], float]], R: np.ndarray, ke: float = 0.0) -> np.ndarray:
    """(120, 160) uint16 mm: the nearest of planes n . P = d given in level_cam; 0 beyond the range."""
    k = INFO.intrinsics
    v, u = np.mgrid[0 : k.height, 0 : k.width]
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ R.T
    inverse = np.full(u.shape, 0.0)
    for normal, distance in planes:
        inverse = np.maximum(inverse, rays @ np.array(normal) / distance)
    inverse = inverse + np.random.default_rng(1).normal(0.0, ke, u.shape)
    with np.errstate(divide="ignore"):
        z = np.where(inverse > 1.0 / INFO.max_range_m, 1.0 / inverse, 0.0)
    return np.round(1000.0 * z).astype(np.uint16)


def tilted(roll_deg: float, pitch_deg: float) -> np.ndarray:
    R = rotation_from_euler(math.radians(roll_deg), math.radians(pitch_deg), 0.0) @ R_CAMFRD_OPTICAL
    return rotation_level_cam_optical(R)


GROUND = ((0.0, 0.0, 1.0), 1.5)
WALL = ((0.6, 0.8, 0.0), 6.0)
FRONT = ((1.0, 0.0, 0.0), 8.0)


def test_ground_and_walls_are_found_where_they_are() -> None:
    R = tilted(3.0, -8.0)
    found = find_surfaces(image([GROUND, WALL, FRONT], R, 0.0015), INFO, R, 0.0015)
    for normal, distance in (GROUND, WALL, FRONT):
        near = [p for p in found.planes if np.dot(p.normal, normal) > 0.9999]
        assert len(near) == 1, normal
        assert near[0].distance_m == pytest.approx(distance, rel=0.02)
        assert near[0].misfit < 1.3
    assert found.measured_share > 0.5


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, -5.0), (0.0, 5.0), (10.0, 0.0), (-4.0, 6.0)])
def test_a_wrong_attitude_inclines_ground_and_walls_alike(roll: float, pitch: float) -> None:
    """The attitude used is the true one plus an error."""
    configured = tilted(roll, -8.0 + pitch)
    cues = cues_of(find_surfaces(image([GROUND, WALL, FRONT], tilted(0.0, -8.0), 0.0015), INFO, configured, 0.0015))
    assert cues.ground
    # by the attitude the nose is higher: the ground seems to rise ahead, so z falls with x
    assert math.degrees(cues.slope_x_rad) == pytest.approx(-pitch, abs=0.5)
    assert math.degrees(cues.slope_y_rad) == pytest.approx(roll, abs=0.5)
    assert cues.walls is Walls.LEANING


@pytest.mark.parametrize("slope_deg", [5.0, -8.0])
def test_walls_stay_vertical_on_a_slope(slope_deg: float) -> None:
    a, R = math.radians(slope_deg), tilted(0.0, -5.0)
    ground = ((-math.sin(a), 0.0, math.cos(a)), 1.5)
    cues = cues_of(find_surfaces(image([ground, WALL, FRONT], R, 0.0015), INFO, R, 0.0015))
    assert math.degrees(cues.slope_x_rad) == pytest.approx(slope_deg, abs=0.3)
    assert cues.walls is Walls.VERTICAL


def test_ground_alone_leaves_walls_undecided() -> None:
    R = tilted(0.0, -15.0)
    cues = cues_of(find_surfaces(image([GROUND], R, 0.003), INFO, R, 0.003))
    assert cues.ground
    assert cues.walls is Walls.UNDECIDED


def test_noise_and_nothing_give_no_cues() -> None:
    R = tilted(0.0, 0.0)
    noise = np.random.default_rng(2).integers(500, 15000, (120, 160)).astype(np.uint16)
    for depth in (noise, np.zeros((120, 160), np.uint16), np.full((120, 160), 65534, np.uint16)):
        assert cues_of(find_surfaces(depth, INFO, R, 0.0015)) == NO_CUES


def test_what_lies_above_other_objects_is_no_ground() -> None:
    """A table top above the floor."""
    R = tilted(0.0, -30.0)
    found = find_surfaces(image([((0.1, 0.0, 0.995), 0.8)], R), INFO, R, 0.0015)
    k = INFO.intrinsics
    depth = image([GROUND], R)
    table = image([((0.1, 0.0, 0.995), 0.8)], R)
    depth[60:, : k.width // 2] = table[60:, : k.width // 2]
    assert found.planes
    cues = cues_of(find_surfaces(depth, INFO, R, 0.0015))
    assert cues.ground
    assert cues.slope_rad < math.radians(0.5)


def test_surfaces_are_plain_numbers() -> None:
    R = tilted(0.0, -8.0)
    for plane in find_surfaces(image([GROUND, FRONT], R), INFO, R, 0.0015).planes:
        assert isinstance(plane, Surface)
        assert math.hypot(*plane.normal) == pytest.approx(1.0)


@pytest.mark.parametrize(("height_m", "found"), [(2.0, True), (3.0, True), (4.8, False), (5.0, False), (5.2, False)])
def test_ground_over_one_pixel_of_disparity_is_no_cue(height_m: float, found: bool) -> None:
    """A ZED that leans by 2 degrees over flat ground, range 12 m. Its matcher prefers whole pixels, by 0.12 px."""
    f_px, baseline_m, prior_px = 350.0, 0.12, 0.3
    intrinsics = Intrinsics(672, 376, f_px, f_px, 335.5, 187.5)
    info = CameraInfo("front", intrinsics, max_range_m=12.0, ke_per_m=prior_px / (f_px * baseline_m))
    R = tilted(0.0, -2.0)
    down = R[2, 1] * (np.arange(376) - 187.5) / f_px + R[2, 2]
    disparity = f_px * baseline_m * np.maximum(down, 1e-3)[:, None] / height_m
    disparity = disparity - 0.12 * np.sin(2.0 * np.pi * disparity)
    disparity = np.maximum(disparity + np.random.default_rng(1).normal(0.0, 0.05, (376, 672)), 0.7)
    image_mm = 1000.0 * f_px * baseline_m / disparity
    cues = cues_of(find_surfaces(image_mm.astype(np.uint16), info, R, 0.0025))
    assert cues.ground is found
    assert math.degrees(cues.slope_rad) < 1.0
