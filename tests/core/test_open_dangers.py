"""Blank things that leave no measurement of their own: none of them may be open. Cameras of three focal lengths, of which the two longer
ones have half of their columns: what is open depends on rows."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import (
    BEYOND_MM,
    CONTINUED_MM,
    TEXTURED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    CameraInfo,
    FrameModel,
    Intrinsics,
)
from drivers.cameras.stereo import depth_mm
from drivers.cameras.textureless import SmoothLimits, mark_unmeasured

from ..nightly import nightly

ABOVE_GROUND_M, BASELINE_M = 2.0, 0.12
Depth = NDArray[np.uint16]
CAMERAS = {120.0: (200, 160), 350.0: (336, 376), 700.0: (640, 720)}
FOCAL = pytest.mark.parametrize("f_px", list(CAMERAS))


def info_of(f_px: float) -> CameraInfo:
    width, height = CAMERAS[f_px]
    intrinsics = Intrinsics(width, height, f_px, f_px, 0.5 * (width - 1), 0.5 * (height - 1))
    return CameraInfo("front", intrinsics, max_range_m=16.0, ke_per_m=0.002, marks_smooth=True)


def row_at(f_px: float, elevation_deg: float) -> int:
    """The image row of a level camera that looks this much above the horizon."""
    return round(info_of(f_px).intrinsics.cy - f_px * math.tan(math.radians(elevation_deg)))


def ground_mm(f_px: float) -> NDArray[np.float64]:
    """(H,) depth of flat ground 2 m below a level camera, 0 above the horizon."""
    k = info_of(f_px).intrinsics
    rows = np.arange(k.height) - k.cy
    return np.divide(1000.0 * ABOVE_GROUND_M * f_px, rows, out=np.zeros(k.height), where=rows > 0)


def field(f_px: float) -> Depth:
    """That ground, measured up to 65 m and matched beyond, under a clear sky."""
    mm = ground_mm(f_px)
    column = np.where(mm <= 0.0, TEXTURELESS_MM, np.where(mm < 65_000.0, mm, BEYOND_MM)).astype(np.uint16)
    return np.repeat(column[:, None], CAMERAS[f_px][0], axis=1)


def model_of(f_px: float, depth: Depth) -> FrameModel:
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    model, _ = Extractor(Params(), OpenSkyParams(mode="presume")).extract(depth, info_of(f_px), R)
    assert model.valid
    return model


def open_m(model: FrameModel, z_m: float) -> float:
    """Greatest range up to which the layer at height z_m is open beyond what is free, in any direction."""
    layer = int(np.searchsorted(model.free.layer_edges_m, z_m, side="right")) - 1
    return float(model.free.open_to_m[:, layer].max())


def open_forward_m(model: FrameModel, z_m: float) -> float:
    """`open_m` as a forward distance, at which a rail across the view ends what is open: at the azimuth of each direction that is
    nearest to the middle of the image."""
    f = model.free
    layer = int(np.searchsorted(f.layer_edges_m, z_m, side="right")) - 1
    edges = f.azimuth_edges_rad
    nearer = np.where(edges[:-1] * edges[1:] < 0.0, 0.0, np.minimum(np.abs(edges[:-1]), np.abs(edges[1:])))
    return float((f.open_to_m[:, layer] * np.cos(nearer)).max())


@FOCAL
def test_the_field_itself_is_open(f_px: float) -> None:
    assert open_m(model_of(f_px, field(f_px)), 0.25) >= 10.0


@pytest.mark.parametrize("shift", range(4))
@pytest.mark.parametrize(("rows", "is_open"), [(11, True), (12, True), (13, False), (16, False)])
def test_what_is_not_measured_at_the_horizon_is_judged_by_its_rows_whatever_the_blocks(
    shift: int, rows: int, is_open: bool
) -> None:
    """An edge marks three rows of the sky above it. A beam whose upper edge lies at the horizon marks three rows below it as well: one
    of 7 rows takes 13, and 1.5 degrees are 9 rows. Counted in blocks, 11 rows were open in one of four alignments."""
    f_px = 350.0
    depth = field(f_px)
    edge = row_at(f_px, 0.0) + shift
    depth[: edge - 3] = TEXTURELESS_MM
    depth[edge - 3 : edge - 3 + rows] = TEXTURED_MM
    assert (open_m(model_of(f_px, depth), 0.25) >= 10.0) == is_open


@pytest.mark.parametrize(("rows", "is_open"), [(5, True), (7, False)])
def test_the_edge_of_a_crest_below_the_horizon_is_seen_past_and_a_rail_there_is_not(rows: int, is_open: bool) -> None:
    """Smooth plain between the horizon and a crest: both edges lie within 1.5 degrees. A rail makes that more."""
    f_px = 350.0
    depth = field(f_px)
    edge = row_at(f_px, 0.0)
    depth[: edge - 3] = TEXTURELESS_MM
    depth[edge - 3 : edge + 3] = TEXTURED_MM
    depth[edge + 3] = CONTINUED_MM
    depth[edge + 4 : edge + 4 + rows] = TEXTURED_MM
    assert (open_m(model_of(f_px, depth), 0.0) >= 10.0) == is_open


@pytest.mark.parametrize(("rows", "is_open"), [(3, True), (9, False)])
def test_the_border_of_smooth_ground_is_filled_and_a_rail_before_it_is_not(rows: int, is_open: bool) -> None:
    f_px = 350.0
    depth = field(f_px)
    depth[row_at(f_px, 0.0) : row_at(f_px, -1.0)] = TEXTURED_MM
    depth[row_at(f_px, -1.0) : row_at(f_px, -3.0)] = CONTINUED_MM
    depth[row_at(f_px, -3.0) : row_at(f_px, -3.0) + rows] = TEXTURED_MM
    assert (open_m(model_of(f_px, depth), 0.0) >= 10.0) == is_open


@functools.cache
def normal_noise(f_px: float) -> tuple[NDArray[np.float64], ...]:
    """Three images of standard normal noise: of the ground, of the left and of the right camera."""
    width, height = CAMERAS[f_px]
    return tuple(np.random.default_rng(7).standard_normal((3, height, width)))


def marked_girder(
    f_px: float, top_row: int, bottom_row: int, lost_rows: int, lip_rows: int = 0, teeth_px: int = 0
) -> Depth:
    """A blank girder of the mean brightness of the ground below it, before a brighter sky, through the marks of the driver. lip_rows:
    of a darker lower edge; teeth_px: greatest width of random teeth of up to 20 rows at this edge, 0: it is straight."""
    width, height = CAMERAS[f_px]
    rng = np.random.default_rng(7)
    bottom = np.full(width, bottom_row)
    if teeth_px:
        for u in range(0, width, teeth_px):
            bottom[u : u + int(rng.integers(1, teeth_px + 1))] += int(rng.integers(0, 21))
    rows = np.arange(height)[:, None]
    left = np.full((height, width), 200.0) + 0.2 * (rows - row_at(f_px, 0.0))
    left[max(0, top_row) :] = 120.0
    ground = rows >= bottom
    texture, *sensors = normal_noise(f_px)
    left[ground] += 18.0 * texture[ground]
    left[(rows >= bottom - lip_rows) & ~ground] = 70.0
    images = [np.clip(np.rint(left + noise), 0, 255).astype(np.uint8) for noise in sensors]
    matched = rows >= bottom + lost_rows
    true_px = f_px * BASELINE_M / (0.001 * np.maximum(ground_mm(f_px), 1.0))[:, None]
    disparity = np.where(matched, true_px, -1.0).astype(np.float32)
    depth = depth_mm(disparity, f_px * BASELINE_M)
    return mark_unmeasured(depth, disparity, images[0], images[1], SmoothLimits())


@FOCAL
@pytest.mark.parametrize(
    ("top_deg", "bottom_deg"), [*nightly((5.0, -4.0)), (6.0, -2.0), *nightly((3.0, -6.0)), (90.0, -6.0)]
)
@pytest.mark.parametrize("lost_rows", [0, 1])
def test_a_girder_of_the_brightness_of_the_ground_is_not_open(
    f_px: float, top_deg: float, bottom_deg: float, lost_rows: int
) -> None:
    top = -1 if top_deg >= 90.0 else row_at(f_px, top_deg)
    for shift in range(4):  # all alignments with the blocks
        depth = marked_girder(f_px, top, row_at(f_px, bottom_deg) + shift, lost_rows)
        assert not model_of(f_px, depth).free.open_to_dm.any(), shift


@pytest.mark.parametrize("f_px", [350.0, 700.0])
@pytest.mark.parametrize("bottom_deg", [-3.0, *nightly(-5.0), -7.0])
@pytest.mark.parametrize(("lost_rows", "lip_rows"), [(2, 2), (0, 4)])
def test_the_visible_lower_edge_of_a_girder_is_no_border_of_smooth_ground(
    f_px: float, bottom_deg: float, lost_rows: int, lip_rows: int
) -> None:
    """Its top lies at the horizon, and the ground below it is farther away than the girder. Without such an edge nothing distinguishes
    it from smooth ground: see the dangers in docs/explanation/open-space.md."""
    for shift in range(4):
        depth = marked_girder(f_px, row_at(f_px, 0.4), row_at(f_px, bottom_deg) + shift, lost_rows, lip_rows)
        assert open_m(model_of(f_px, depth), 0.2) <= 2.0, shift


@pytest.mark.parametrize("bottom_deg", [-3.0, -7.0])
@pytest.mark.parametrize("teeth_px", [1, *nightly(2), 3, *nightly(4), 8])
def test_the_visible_ragged_lower_edge_of_a_girder_is_no_border_of_smooth_ground(
    bottom_deg: float, teeth_px: int
) -> None:
    """In columns between teeth its face is continued from the ground; columns of a tooth must not be continued from those."""
    f_px = 350.0
    for shift in range(4):
        depth = marked_girder(f_px, row_at(f_px, 0.4), row_at(f_px, bottom_deg) + shift, 2, 2, teeth_px)
        assert open_m(model_of(f_px, depth), 0.2) <= 2.0, shift


@FOCAL
@pytest.mark.parametrize("mark", [UNKNOWN_MM, TEXTURELESS_MM])
@pytest.mark.parametrize("top_deg", [-1.5, -2.2, -3.0])
def test_a_rail_below_the_horizon_ends_what_is_open(f_px: float, mark: int, top_deg: float) -> None:
    depth = field(f_px)
    depth[row_at(f_px, top_deg) : row_at(f_px, top_deg - 1.4)] = mark
    assert open_forward_m(model_of(f_px, depth), 0.25) <= 5.0


def marked_field(rod_deg: float | None) -> Depth:
    """Unmatched texture for 1.2 degrees below the sky, matched ground below that, and a level rod of two rows so far below the horizon,
    through the marks of the driver."""
    f_px = 350.0
    width, height = CAMERAS[f_px]
    rng = np.random.default_rng(8)
    horizon, first = row_at(f_px, 0.0), row_at(f_px, -1.2)
    left = np.full((height, width), 200.0) + 0.2 * (np.arange(height)[:, None] - horizon)
    left[horizon:] = 110.0 + rng.normal(0.0, 12.0, (height - horizon, width))
    if rod_deg is not None:
        left[row_at(f_px, -rod_deg) :][:2] = 170.0
    images = [np.clip(np.rint(left + rng.normal(0.0, 1.0, left.shape)), 0, 255).astype(np.uint8) for _ in range(2)]
    disparity = np.full((height, width), -1.0, np.float32)
    disparity[first:] = (f_px * BASELINE_M / (0.001 * ground_mm(f_px)[first:]))[:, None]
    return mark_unmeasured(depth_mm(disparity, f_px * BASELINE_M), disparity, images[0], images[1], SmoothLimits())


@pytest.mark.parametrize(("rod_deg", "is_open"), [(None, True), (0.9, False), (1.0, False), (1.1, False)])
def test_a_level_rod_close_below_the_horizon_is_not_open(rod_deg: float | None, is_open: bool) -> None:
    """It lies in texture without a match, which is passed over for 1.5 degrees below the sky."""
    assert (open_m(model_of(350.0, marked_field(rod_deg)), 0.0) >= 10.0) == is_open


@FOCAL
def test_a_blank_arch_is_not_open_through_its_face(f_px: float) -> None:
    depth = field(f_px)
    k = info_of(f_px).intrinsics
    far, ground = row_at(f_px, 14.0), row_at(f_px, 0.0)
    depth[far:ground] = 40_000
    v, u = np.mgrid[0 : k.height, 0 : k.width]
    y, z = 8.0 * (u - k.cx) / f_px, 8.0 * (v - k.cy) / f_px  # on the face
    outside = np.hypot(y, np.minimum(z - 2.0, 0.0)) > 3.0
    depth[outside & (v < row_at(f_px, -13.0))] = TEXTURELESS_MM
    model = model_of(f_px, depth)
    for z_m in (-1.25, -1.75):
        assert open_m(model, z_m) <= 8.0


@FOCAL
def test_an_unknown_strip_at_the_horizon_is_not_open(f_px: float) -> None:
    depth = field(f_px)
    depth[row_at(f_px, 0.7) : row_at(f_px, -0.7)] = UNKNOWN_MM
    assert not model_of(f_px, depth).free.open_to_dm.any()


@pytest.mark.parametrize("width_px", [8, 30])
@pytest.mark.parametrize("mark", [TEXTURED_MM, TEXTURELESS_MM])
def test_an_unmatched_thing_whose_top_lies_at_the_horizon_is_not_open(mark: int, width_px: int) -> None:
    """Its uppermost rows look like the edge of the sky, and ground is measured on both sides of it. Seen over 1.3 degrees, the layer
    of the camera would be open behind it from 11 m on, and with the rays to there before it."""
    f_px = 350.0
    depth = field(f_px)
    k = info_of(f_px).intrinsics
    u0 = round(k.cx) - width_px // 2
    depth[row_at(f_px, 0.0) - 2 : row_at(f_px, 0.0) + 6] = TEXTURED_MM  # the marks of the edge of the sky
    depth[row_at(f_px, 0.0) + 3 : row_at(f_px, -15.0), u0 : u0 + width_px] = mark
    f = model_of(f_px, depth).free
    d = int(np.searchsorted(f.azimuth_edges_rad, 0.0, side="right")) - 1
    layer = int(np.searchsorted(f.layer_edges_m, 0.0, side="right")) - 1
    assert f.open_to_m[d + 6, layer] >= 10.0
    assert f.open_to_m[d, layer] == 0.0 or f.open_to_m[d - 1, layer] == 0.0


@FOCAL
@pytest.mark.parametrize("above", [TEXTURED_MM, CONTINUED_MM])
def test_what_is_matched_beyond_the_range_is_not_open_in_columns_without_evidence(f_px: float, above: int) -> None:
    """The side of a blank container is measured too far away, beyond the range less its noise, and has no sky above it."""
    depth, k = field(f_px), info_of(f_px).intrinsics
    u0, u1 = (round(k.cx + f_px * math.tan(math.radians(a))) for a in (4.0, 11.0))
    top, base = row_at(f_px, 0.0), row_at(f_px, -8.0)  # its foot stands on ground 14 m away
    depth[:top, u0:u1] = above
    depth[top:base, u0:u1] = 15_500
    noisy = dataclasses.replace(info_of(f_px), ke_per_m=0.006)
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    f = Extractor(Params(), OpenSkyParams(mode="presume")).extract(depth, noisy, R)[0].free
    side, beside = (int(np.searchsorted(f.azimuth_edges_rad, math.radians(a), side="right")) - 1 for a in (7.5, -7.5))
    layer = int(np.searchsorted(f.layer_edges_m, 0.5, side="right")) - 1
    free_m = float(f.free_to_m[side, layer])
    assert f.open_to_m[beside, layer] > free_m + 0.5
    assert f.open_to_m[side, layer] <= free_m


@pytest.mark.parametrize("f_px", [350.0, 700.0])
def test_what_may_hide_a_thing_nearer_than_the_minimum_range_is_not_open(f_px: float) -> None:
    """A hole of 1 degree below the horizon: less than 5 % of each ring up to 2.5 m, and not in those behind."""
    depth, k = field(f_px), info_of(f_px).intrinsics
    row, middle, px = row_at(f_px, -5.0), round(k.cx), round(f_px / 350.0)
    depth[row : row + 7 * px, middle - 3 * px : middle + 3 * px] = TEXTURED_MM
    near = dataclasses.replace(info_of(f_px), min_range_m=1.5)
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    begins = {}
    for info in (info_of(f_px), near):
        model, _ = Extractor(Params(), OpenSkyParams(mode="presume")).extract(depth, info, R)
        f = model.free
        d = int(np.searchsorted(f.azimuth_edges_rad, 0.0, side="right")) - 1
        layer = int(np.searchsorted(f.layer_edges_m, 0.0, side="right")) - 1
        assert f.open_to_m[d, layer] >= 10.0
        begins[info.min_range_m] = float(f.open_from_m[d, layer])
    assert begins[info_of(f_px).min_range_m] < 1.5
    assert 1.5 * 1.5 < begins[1.5] < 4.5
