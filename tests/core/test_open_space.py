"""Open space: which unmeasured, textureless pixels are presumed free, and the one rule that each case depends on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.classify import pixel_limits
from core.stages.open_space import far_m
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

WIDTH, HEIGHT, F_PX, CENTRE = 200, 160, 120.0, 79.5
INFO = CameraInfo(
    "front",
    Intrinsics(WIDTH, HEIGHT, F_PX, F_PX, 99.5, CENTRE),
    max_range_m=16.0,
    ke_per_m=0.002,
    marks_smooth=True,
)
ABOVE_GROUND_M = 2.0
Depth = NDArray[np.uint16]


def field() -> Depth:
    """Flat ground 2 m below a level camera, measured up to 65 m and matched beyond, under a clear sky."""
    rows = np.arange(HEIGHT) - CENTRE
    with np.errstate(divide="ignore"):
        mm = np.where(rows > 0, 1000.0 * ABOVE_GROUND_M * F_PX / rows, 0.0)
    column = np.where(rows < 0, TEXTURELESS_MM, np.where(mm < 65_000.0, mm, BEYOND_MM)).astype(np.uint16)
    return np.repeat(column[:, None], WIDTH, axis=1)


def row_at(elevation_deg: float) -> int:
    """The image row of a level camera that looks this much above the horizon."""
    return round(CENTRE - F_PX * math.tan(math.radians(elevation_deg)))


def model_of(depth: Depth, pitch_deg: float = 0.0, info: CameraInfo = INFO, **rules: float | bool) -> FrameModel:
    """The model with open space; rules: of OpenSkyParams."""
    R = rotation_level_cam_optical(rotation_from_euler(0.0, math.radians(pitch_deg), 0.0) @ R_CAMFRD_OPTICAL)
    model, _ = Extractor(Params(), OpenSkyParams(mode="presume", **rules)).extract(depth, info, R)  # type: ignore[arg-type]
    assert model.valid
    return model


def open_m(model: FrameModel, azimuth_deg: float = 0.0, z_m: float = 0.0) -> float:
    """Range up to which the layer at height z_m is free or open in a direction; 0: not at all."""
    f = model.free
    d = int(np.searchsorted(f.azimuth_edges_rad, math.radians(azimuth_deg), side="right")) - 1
    layer = int(np.searchsorted(f.layer_edges_m, z_m, side="right")) - 1
    return max(
        float(to[d, layer]) if to[d, layer] > begin[d, layer] else 0.0
        for begin, to in ((f.free_from_m, f.free_to_m), (f.open_from_m, f.open_to_m))
    )


def gain(model: FrameModel) -> int:
    """Number of cells that are open farther than they are free."""
    return int((model.free.open_to_m > model.free.free_to_m).sum())


@pytest.mark.nojit
def test_the_sky_over_a_field_is_open() -> None:
    model = model_of(field())
    assert min(open_m(model, a) for a in (-30.0, -10.0, 0.0, 10.0, 30.0)) >= 10.0
    opened = model.free.open_to_dm > 0
    assert (model.free.open_to_m > model.free.free_to_m)[opened].all()
    assert (model.free.open_to_dm > model.free.open_from_dm)[opened].all()
    assert (model.free.open_from_dm == 0)[~opened].all()


def test_nothing_is_open_by_default_and_the_marks_change_nothing() -> None:
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    depth = field()
    unmarked = np.where(depth <= TEXTURED_MM, np.uint16(UNKNOWN_MM), depth)
    marked, _ = Extractor().extract(depth, INFO, R)
    plain, _ = Extractor().extract(unmarked, INFO, R)
    assert not marked.free.has_open
    assert marked.free.open_to_dm.shape == (0, 0)
    assert np.array_equal(marked.free.free_to_m, plain.free.free_to_m)
    assert np.array_equal(marked.planes, plain.planes)
    assert marked.stats == plain.stats


def test_open_space_never_changes_what_is_free() -> None:
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    off, _ = Extractor().extract(field(), INFO, R)
    on = model_of(field())
    assert np.array_equal(off.free.free_to_m, on.free.free_to_m)
    assert np.array_equal(off.free.free_from_m, on.free.free_from_m)


def test_a_sky_without_marks_is_not_open() -> None:
    depth = field()
    depth[depth == TEXTURELESS_MM] = UNKNOWN_MM
    assert gain(model_of(depth)) == 0


def test_a_blank_wall_to_the_lower_border_is_not_open() -> None:
    depth = field()
    depth[:, 100:] = TEXTURELESS_MM
    model = model_of(depth)
    assert open_m(model, -20.0) >= 10.0
    assert open_m(model, 20.0) == 0.0


def test_a_blank_wall_with_its_base_at_5_m_is_not_open() -> None:
    depth = field()
    depth[: row_at(-math.degrees(math.atan(ABOVE_GROUND_M / 5.0)))] = TEXTURELESS_MM
    assert open_m(model_of(depth)) == 0.0


def bridge(bottom_deg: float) -> Depth:
    """A blank bridge across the view and the sky above it in one: its lower edge lies bottom_deg above the horizon, and far
    country is seen below it."""
    depth = field()
    depth[row_at(bottom_deg) : row_at(-0.5)] = BEYOND_MM
    return depth


def test_an_edge_above_the_horizon_is_no_evidence() -> None:
    assert open_m(model_of(bridge(4.0))) == 0.0
    assert open_m(model_of(bridge(4.0), horizon_deg=6.0)) >= 10.0


def balloon() -> Depth:
    """A field with a patch in the sky, measured at 5 m, 12 degrees above the horizon."""
    depth = field()
    depth[row_at(14.0) : row_at(10.0), 96:104] = 5000
    return depth


def test_a_floating_thing_limits_what_is_open_around_it() -> None:
    azimuth_deg = 8.0
    assert 0.0 < open_m(model_of(balloon()), azimuth_deg) <= 5.0
    assert open_m(model_of(balloon(), floating=False), azimuth_deg) >= 10.0
    assert open_m(model_of(balloon()), 25.0) >= 10.0


def test_what_stands_beside_a_column_limits_it() -> None:
    depth = field()
    depth[: row_at(-21.0), 98:102] = 5000  # a pole from the ground to the upper border

    def clear(model: FrameModel) -> int:
        f = model.free
        layer = int(np.searchsorted(f.layer_edges_m, 0.0, side="right")) - 1
        return int((f.open_to_m[:, layer] >= 10.0).sum())

    assert clear(model_of(depth)) < clear(model_of(depth, neighbours=False))


@pytest.mark.compiled  # the whole extractor: test_the_sky_over_a_field_is_open, its blocks tests/core/test_open_blocks.py
@pytest.mark.parametrize("first_px", [96, 104, 120])
@pytest.mark.nojit
def test_a_column_beside_one_without_evidence_and_measurement_is_not_open(first_px: int) -> None:
    """A blank thing from the upper to the lower border. The direction beside it holds no column of the thing, and one to three
    columns of the block beside it, where the side of the thing may be."""
    depth = field()
    depth[:, first_px:] = TEXTURELESS_MM
    beside_deg = math.degrees(math.atan((first_px - 6.0 - 99.5) / F_PX))
    assert open_m(model_of(depth, neighbours=False), beside_deg) >= 10.0
    model = model_of(depth)
    assert open_m(model, beside_deg) == 0.0
    assert open_m(model, beside_deg - 5.0) >= 10.0


@pytest.mark.parametrize(("edge_deg", "is_open"), [(0.0, True), (10.0, False)])
def test_the_sky_of_narrow_columns_without_ground_is_open_where_it_ends_beside_that_of_the_others(
    edge_deg: float, is_open: bool
) -> None:
    """Eight columns below whose edge nothing is known: above the horizon it may be the lower edge of a blank thing."""
    depth = field()
    depth[row_at(edge_deg) :, 96:104] = UNKNOWN_MM
    f = model_of(depth).free
    d = int(np.searchsorted(f.azimuth_edges_rad, 0.0, side="right")) - 1
    assert (f.open_to_dm[d].max() > 0) == is_open


def test_textureless_pixels_below_something_else_are_not_open() -> None:
    depth = field()
    depth[: row_at(20.0)] = UNKNOWN_MM
    assert gain(model_of(depth)) == 0
    assert gain(model_of(depth, upper_border=False)) > 0


def test_a_wide_gap_below_the_sky_is_not_open() -> None:
    depth = field()
    depth[row_at(0.0) : row_at(-6.0)] = TEXTURED_MM
    assert open_m(model_of(depth), z_m=-1.0) == 0.0
    assert open_m(model_of(depth, gap_deg=8.0), z_m=-1.0) >= 10.0


def test_smooth_ground_below_the_horizon_continues_what_is_measured() -> None:
    depth = field()
    depth[row_at(0.0) : row_at(-1.4)] = TEXTURED_MM
    depth[row_at(-1.4) : row_at(-6.0)] = CONTINUED_MM
    assert open_m(model_of(depth, open_share=0.8)) >= 10.0
    assert open_m(model_of(depth, continued_deg=2.0, open_share=0.8)) < 3.0
    depth[depth == CONTINUED_MM] = TEXTURELESS_MM
    assert open_m(model_of(depth, open_share=0.8)) < 3.0


@pytest.mark.parametrize(("width_px", "is_open"), [(1, True), (3, True), (4, False), (12, False)])
def test_columns_that_are_narrower_than_a_hole_are_ground_between_smooth_ground(width_px: int, is_open: bool) -> None:
    """Below them more rows are unmatched than smooth ground is continued over."""
    depth = field()
    depth[row_at(0.0) : row_at(-1.4)] = TEXTURED_MM
    depth[row_at(-1.4) : row_at(-6.0)] = CONTINUED_MM
    depth[row_at(-1.4) : row_at(-6.0), 99 : 99 + width_px] = TEXTURELESS_MM
    assert (open_m(model_of(depth)) >= 10.0) == is_open


@pytest.mark.parametrize(("rows", "filled"), [(4, True), (5, False)])
def test_holes_with_fewer_rows_than_an_edge_in_far_ground_are_filled(rows: int, filled: bool) -> None:
    depth = field()
    depth[row_at(-2.0) : row_at(-2.0) + rows] = TEXTURED_MM
    assert (open_m(model_of(depth)) >= 10.0) == filled


def test_a_tenth_of_unknown_pixels_is_too_much() -> None:
    depth = field()
    v, u = np.mgrid[96:140, : depth.shape[1]]
    depth[96:140][(u + 3 * v) % 10 == 0] = UNKNOWN_MM  # never a whole column
    strict, loose = (model_of(depth, open_share=share).free for share in (0.95, 0.8))
    assert (strict.open_to_m - strict.open_from_m).sum() < (loose.open_to_m - loose.open_from_m).sum()


def test_a_thin_strip_of_sky_is_not_open() -> None:
    low = replace(INFO, intrinsics=Intrinsics(WIDTH, HEIGHT, F_PX, F_PX, 99.5, 7.5))
    rows = np.arange(HEIGHT) - 7.5
    with np.errstate(divide="ignore"):
        mm = np.where(rows > 0, 1000.0 * ABOVE_GROUND_M * F_PX / rows, 0.0)
    column = np.where(rows < 0, TEXTURELESS_MM, np.where(mm < 65_000.0, mm, BEYOND_MM)).astype(np.uint16)
    depth = np.repeat(column[:, None], WIDTH, axis=1)
    assert gain(model_of(depth, info=low)) == 0
    assert gain(model_of(depth, info=low, least_rise_deg=1.0)) > 0


def test_an_edge_off_the_horizon_is_not_taken_for_it() -> None:
    assert open_m(model_of(field(), pitch_deg=-4.0), z_m=-1.0) == 0.0
    assert open_m(model_of(field(), pitch_deg=-4.0, horizon_deg=6.0), z_m=-1.0) >= 10.0


def test_open_ranges_end_at_the_configured_range() -> None:
    for most_m in (6.0, 7.3):
        model = model_of(field(), open_max_range_m=most_m)
        opened = model.free.open_to_dm > 0
        assert model.free.open_to_dm.max() == math.floor(10.0 * most_m)
        assert (model.free.open_to_dm > model.free.open_from_dm)[opened].all()
        assert (model.free.open_to_m > model.free.free_to_m)[opened].all()


def test_the_marks_are_never_a_measurement() -> None:
    near = CameraInfo("front", INFO.intrinsics, min_range_m=0.0001)
    assert pixel_limits(near, 0.002, Params()).least_mm > max(TEXTURELESS_MM, BEYOND_MM, CONTINUED_MM, TEXTURED_MM)


@pytest.mark.parametrize("clear_m", [3.0, 10.4, 18.0])
@pytest.mark.parametrize("ke_per_m", [0.0, 0.0015, 0.0042, 0.02])
def test_a_far_cell_is_open_as_far_as_free_ranges_see_through_it(clear_m: float, ke_per_m: float) -> None:
    """The walk over open cells takes the noise off its distance."""
    p = Params()
    z = far_m(clear_m, ke_per_m, p)
    assert z - min(p.profile_sigmas * ke_per_m * z**2, p.profile_noise_cap * z) == pytest.approx(clear_m)
