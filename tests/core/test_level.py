"""The levelled view against direct projection with the rotation matrix."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages.level import level_into, level_nearest
from core.stages.pooling import pool_columns
from core.stages.view_geometry import (
    ViewGeometry,
    homography_area,
    outside_source,
    pooled_geometry,
    view_geometry,
)
from core.types import FAR_MM, UNKNOWN_MM, CameraInfo, Intrinsics
from drivers.simulation.source import camera_info

from . import naive
from .views import INFO, SMALL, flat_wall, level

ODD = CameraInfo("odd", Intrinsics(40, 30, 36.0, 28.0, 22.3, 11.8))
P = Params()


def random_marks(rng: np.random.Generator) -> np.ndarray:
    image = (1000.0 / rng.uniform(0.06, 2.0, (30, 40))).astype(np.uint16)
    image[rng.random(image.shape) < 0.2] = UNKNOWN_MM
    image[rng.random(image.shape) < 0.1] = FAR_MM
    return image


def levelled(marks: np.ndarray, info: CameraInfo, R: np.ndarray) -> tuple[np.ndarray, np.ndarray, ViewGeometry]:
    g = view_geometry(info, R, P)
    out, picked = np.full((g.cols, g.rows), 7, np.uint16), np.ones(marks.size, np.uint8)
    k = info.intrinsics
    level_into(marks, np.ascontiguousarray(R), np.array([k.fx, k.fy, k.cx, k.cy]), g, out, picked)
    return out, picked.reshape(marks.shape), g


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.floats(-1.0, 1.0), st.floats(-3.1, 3.1), st.sampled_from([INFO, ODD]))
def test_every_cell_and_every_pixel_against_direct_projection(
    seed: int, pitch: float, roll: float, info: CameraInfo
) -> None:
    """Nearest pixel of each cell; then each pixel that no cell took reaches its own cell, the nearest thing winning."""
    marks, R, k = random_marks(np.random.default_rng(seed)), level(pitch, roll), info.intrinsics
    out, picked, g = levelled(marks, info, R)
    inverse = naive.inverse_image(marks, 0.0, 65.0, 0.0)
    gain = g.f_px * g.lsb_per_px
    want = np.zeros(out.shape, int)
    sure = np.ones(out.shape, bool)
    took = np.zeros(inverse.shape, bool)
    for (u, v), _ in np.ndenumerate(out):
        at = naive.source_pixel(u, v, R, k, g.f_px, g.cu, g.cv)
        if at is None:
            continue
        sure[u, v] = not naive.near_half(at[0], at[1])
        x, y = round(at[0]), round(at[1])
        if 0 <= x < k.width and 0 <= y < k.height:
            took[y, x] |= sure[u, v]
            d = float(inverse[y, x])
            want[u, v] = naive.code_of(d, at[2], gain) if d > 0 else (1 if d < 0 else 0)
    assert (picked[took] == 1).all()
    for (y, x), d in np.ndenumerate(inverse):
        cell = naive.own_cell(x, y, R, k, g.f_px, g.cu, g.cv)
        if picked[y, x] or d <= 0.0 or cell is None:  # far may not make a neighbour's unknown cell free
            continue
        u, v = math.floor(cell[0] + 0.5), math.floor(cell[1] + 0.5)
        if not (0 <= u < g.cols and 0 <= v < g.rows):
            continue
        code = naive.code_of(float(d), 1.0 / cell[2], gain)
        if naive.near_half(cell[0], cell[1]):
            sure[max(u - 1, 0) : u + 2, max(v - 1, 0) : v + 2] = False
        want[u, v] = max(want[u, v], code)
    assert np.mean(sure) > 0.7
    off = np.abs(out.astype(int) - want)[sure]
    # float32 arithmetic: one code of rounding, three parts in a million of large codes
    assert (off <= 1 + 3e-6 * want[sure]).all()
    assert ((out == 0) == (want == 0))[sure].all()


@pytest.mark.nojit
def test_a_level_camera_keeps_its_pixels() -> None:
    marks = random_marks(np.random.default_rng(4))
    out, _, g = levelled(marks, INFO, level())
    assert (g.cols, g.rows, g.f_px, g.cu, g.cv) == (40, 30, 30.0, 19.5, 14.5)
    np.testing.assert_array_equal(out == 0, marks.T == UNKNOWN_MM)
    np.testing.assert_array_equal(out == 1, marks.T == FAR_MM)
    near = (out > 1).T
    gain = 30.0 * g.lsb_per_px
    np.testing.assert_allclose(out.T[near] / gain, 1000.0 / marks[near], atol=0.51 / gain)


@pytest.mark.nojit
@pytest.mark.parametrize("roll", [0.0, 1e-17, -1e-18, 1e-38])
@pytest.mark.parametrize("pitch", [0.0, -1e-17, 1e-18, -1e-300])
def test_a_tilt_of_rounding_errors_loses_no_pixel(roll: float, pitch: float) -> None:
    out, _, _ = levelled(np.full((30, 40), 5000, np.uint16), INFO, level(pitch, roll))
    assert (out[1:39, 1:29] > 1).all()


@pytest.mark.parametrize("pitch_deg", [-30, 0, 30])
@pytest.mark.parametrize("roll_deg", [-30, 10, 30])
def test_the_window_covers_every_source_pixel(pitch_deg: float, roll_deg: float) -> None:
    info = camera_info()
    k, R = info.intrinsics, level(math.radians(pitch_deg), math.radians(roll_deg))
    g = view_geometry(info, R, P)
    assert g.cols * g.rows <= 1.05 * P.max_view_ratio * k.width * k.height
    u, v = np.meshgrid(np.arange(-0.5, k.width, 0.5), np.arange(-0.5, k.height, 0.5))
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ R.T
    cell_u, cell_v = g.f_px * rays[..., 1] / rays[..., 0] + g.cu, g.f_px * rays[..., 2] / rays[..., 0] + g.cv
    assert rays[..., 0].min() > 0
    assert cell_u.min() >= -0.5 - 1e-6
    assert cell_u.max() <= g.cols - 0.5 + 1e-6
    assert cell_v.min() >= -0.5 - 1e-6
    assert cell_v.max() <= g.rows - 0.5 + 1e-6


@pytest.mark.parametrize("tilt", [(0.5, 0.5), (-0.5, 0.3), (0.0, -0.5)])
def test_no_measured_pixel_is_lost(tilt: tuple[float, float]) -> None:
    """A picture of unknown pixels but for a few single ones: each is found in the view, at its own distance."""
    info = camera_info(320, 240)
    R = level(*tilt)
    rng = np.random.default_rng(2)
    marks = np.zeros((240, 320), np.uint16)
    at = rng.integers(0, 240, 200), rng.integers(0, 320, 200)
    marks[at] = 1000.0 / rng.uniform(0.06, 1.0, 200)
    out, _, g = levelled(marks, info, R)
    for y, x in zip(*at, strict=True):
        u, v, forward = naive.own_cell(x, y, R, info.intrinsics, g.f_px, g.cu, g.cv)
        code = naive.code_of(1000.0 / float(marks[y, x]), 1.0 / forward, g.f_px * g.lsb_per_px)
        around = out[max(round(u) - 1, 0) : round(u) + 2, max(round(v) - 1, 0) : round(v) + 2].astype(int)
        assert around.max() >= code * (1 - 0.02) - 2


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.5), (0.2, -0.5), (-0.17, 0.17)])
def test_a_vertical_wall_is_one_distance_in_the_levelled_view(tilt: tuple[float, float]) -> None:
    info = camera_info(320, 240)
    R = level(*tilt)
    out, _, g = levelled(flat_wall(info, 8.0, *tilt), info, R)
    x = g.f_px * g.lsb_per_px / out[out > 1]
    assert out[out > 1].size > 30000
    # nearest neighbour: half a pixel of a wall tilted by 30 degrees and 34 degrees off the axis is within 2 cm at 8 m
    assert np.abs(x - 8.0).max() < 0.04
    assert np.std(x) < 0.02


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 12), st.integers(0, 40))
def test_pooled_columns_are_the_mean_of_what_agrees_with_the_nearest(
    seed: int, step: int, cols: int, apart: int
) -> None:
    rng = np.random.default_rng(seed)
    codes = rng.choice([0, 1, 2, 65535, *rng.integers(0, 100, 6)], (cols, 6)).astype(np.uint16)
    out = np.zeros((-(-cols // step), 6), np.uint16)
    pool_columns(codes, step, apart, out)
    for (j, v), pooled in np.ndenumerate(out):
        group = codes[j * step : (j + 1) * step, v].astype(int)
        agreeing = [c for c in group if c >= 2 and c + apart >= max(group)]
        assert pooled == (math.floor(np.mean(agreeing) + 0.5) if agreeing else max(group))


@pytest.mark.nojit
def test_pooled_columns_keep_what_is_near_what_is_unknown_and_what_is_far() -> None:
    unknown, far, near, wall = 0, 1, 5000, 1000
    codes = np.array([[wall, wall, unknown, far, unknown, wall], [near, wall + 4, wall, wall, far, unknown]], np.uint16)
    out = np.zeros((1, 6), np.uint16)
    pool_columns(codes, 2, 10, out)
    assert out[0].tolist() == [near, wall + 2, wall, wall, far, wall]


@pytest.mark.nojit
def test_a_pooled_column_stands_in_the_middle_of_its_group() -> None:
    g = view_geometry(INFO, level(0.3, 0.2), P)
    pooled = pooled_geometry(g, 4)
    for j in range(3):
        middle = np.mean([(u - g.cu) / g.f_px for u in range(4 * j, 4 * j + 4)])
        assert (j - pooled.cu) / pooled.f_px * pooled.lateral[0] == pytest.approx(middle)
        at = pooled.H @ [j, 5, 1]
        np.testing.assert_allclose(at, g.H @ [4 * j + 1.5, 5, 1])


@pytest.mark.nojit
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.4, 0.3), (-0.5, -0.2)])
def test_area_and_edge_of_cells(tilt: tuple[float, float]) -> None:
    """Source pixels per cell by projecting the cell's corners; outside by projecting its centre."""
    R = level(*tilt)
    g = view_geometry(INFO, R, P)
    for u in range(0, g.cols, 5):
        for v in range(0, g.rows, 5):
            h = 0.05
            corners = [
                naive.source_pixel(u + a, v + b, R, SMALL, g.f_px, g.cu, g.cv)
                for a, b in ((-h, -h), (h, -h), (h, h), (-h, h))
            ]
            centre = naive.source_pixel(u, v, R, SMALL, g.f_px, g.cu, g.cv)
            if centre is None or None in corners:
                continue
            x, y = np.array([c[0] for c in corners]), np.array([c[1] for c in corners])
            area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / (4 * h * h)
            w = g.H[2] @ (u, v, 1.0)
            assert homography_area(g.H) / w**3 == pytest.approx(area, rel=1e-2)
            inside = 0 <= centre[0] <= SMALL.width - 1 and 0 <= centre[1] <= SMALL.height - 1
            if min(abs(centre[0]), abs(centre[0] - 39), abs(centre[1]), abs(centre[1] - 29)) > 1e-6:
                assert outside_source(g.H, u, v, SMALL.width, SMALL.height) == (not inside)


@pytest.mark.nojit
def test_nearest_leaves_no_old_cells_and_no_old_marks() -> None:
    g = view_geometry(INFO, level(0.6, 0.5), P)
    out, picked = np.full((g.cols, g.rows), 9, np.uint16), np.full(1200, 9, np.uint8)
    level_nearest(np.zeros((30, 40), np.uint16), g.H, 100.0, out, picked)
    assert (out == 0).all()
    assert set(np.unique(picked)) <= {0, 1}
