"""The marks of unmeasured pixels, 1 to 4 mm, are no distances: nothing but open space, where it is presumed, tells them from 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.self_check.depth_registration import depth_pyramid
from core.self_check.surfaces import find_surfaces
from core.types import (
    BEYOND_MM,
    CONTINUED_MM,
    FAR_MM,
    GREATEST_MARK_MM,
    SATURATED_MM,
    TEXTURED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    CameraInfo,
    ExtractorState,
    Intrinsics,
    is_measured,
)

from .test_open_space import INFO, field

Depth = NDArray[np.uint16]
LEVEL = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
SMEARS = ExtractorState(edge_ramps=0.95, edge_steps=0.05)
"""Of a camera whose edges are ramps."""


def unmarked(depth: Depth) -> Depth:
    """The image with 0 for each mark."""
    return np.where(depth <= GREATEST_MARK_MM, np.uint16(UNKNOWN_MM), depth)


def assert_equal(one: object, other: object, where: str = "") -> None:
    """Bit for bit, through all fields."""
    assert type(one) is type(other), where
    if isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        assert one.dtype == other.dtype, where
        assert one.shape == other.shape, where
        assert one.tobytes() == other.tobytes(), where
    elif is_dataclass(one):
        for f in fields(one):
            assert_equal(getattr(one, f.name), getattr(other, f.name), f"{where}.{f.name}")
    elif isinstance(one, Sequence) and not isinstance(one, str | bytes):
        assert isinstance(other, Sequence)
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_equal(a, b, f"{where}[{i}]")
    else:
        assert one == other or (one != one and other != other), f"{where}: {one} {other}"


def camera(width: int) -> CameraInfo:
    """Of this image size, with the field of view of a common depth camera."""
    focal, height = 450.0 * width / 640, width * 3 // 4
    return replace(INFO, intrinsics=Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2))


def hidden_beam(info: CameraInfo, beam_px: int) -> Depth:
    """A horizontal beam at 5 m across the view under a smooth sky, before a hedge at 14 m."""
    k = info.intrinsics
    top = k.height // 2 - 10
    depth = np.full((k.height, k.width), TEXTURELESS_MM, np.uint16)
    depth[top + beam_px :] = 14_000
    depth[top : top + beam_px] = 5_000
    return depth


def scene(rng: np.random.Generator) -> Depth:
    """Boxes and beams at random distances, smeared or not, with unmeasured parts that bear random marks."""
    k = INFO.intrinsics
    depth_m = np.full((k.height, k.width), rng.uniform(6.0, 30.0))
    for _ in range(rng.integers(2, 12)):
        u, v = rng.integers(0, k.width), rng.integers(0, k.height)
        wide, high = (int(n) for n in rng.choice([1, 2, 3, 4, 8, 30, 200], 2))
        depth_m[v : v + high, u : u + wide] = rng.uniform(1.0, 25.0)
    if rng.random() < 0.5:
        kernel = np.ones(7) / 7.0
        depth_m = 1.0 / np.apply_along_axis(lambda row: np.convolve(row, kernel, "same"), 1, 1.0 / depth_m)
    depth = np.clip(1000.0 * depth_m * (1.0 + rng.normal(0.0, 0.002, depth_m.shape)), 300.0, FAR_MM).astype(np.uint16)
    marks = rng.choice(np.array([TEXTURELESS_MM, BEYOND_MM, CONTINUED_MM, TEXTURED_MM], np.uint16), depth.shape)
    for _ in range(rng.integers(1, 6)):
        u, v = rng.integers(0, k.width), rng.integers(0, k.height)
        among = np.s_[v : v + rng.integers(1, 60), u : u + rng.integers(1, 120)]
        depth[among] = marks[among] if rng.random() < 0.5 else rng.integers(1, GREATEST_MARK_MM + 1)
    depth[: rng.integers(0, 80)] = TEXTURELESS_MM
    holes = rng.random(depth.shape) < 0.03
    depth[holes] = marks[holes]
    return depth


@pytest.mark.parametrize(("width", "beam_px"), [(640, 1), (640, 3), (640, 4), (320, 2), (160, 1)])
def test_a_beam_below_marks_stays_with_a_camera_that_smears(width: int, beam_px: int) -> None:
    info = camera(width)
    depth = hidden_beam(info, beam_px)
    model, _ = Extractor().extract(depth, info, LEVEL, SMEARS)
    plain, _ = Extractor().extract(unmarked(depth), info, LEVEL, SMEARS)
    nearest = [float(m.planes[:, [0, 2]].min()) for m in (model, plain)]
    assert nearest == pytest.approx([5.0, 5.0], abs=0.2)


def test_marks_change_nothing_with_a_camera_that_smears() -> None:
    smeared = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        depth = scene(rng)
        share = rng.uniform(0.8, 1.0)
        state = ExtractorState(edge_ramps=share, edge_steps=1.0 - share)
        marked = Extractor().extract(depth, INFO, LEVEL, state)
        plain = Extractor().extract(unmarked(depth), INFO, LEVEL, state)
        assert_equal(marked, plain, f"seed {seed}")
        smeared += plain[0].stats.smeared_px > 0
    assert smeared >= 20, "ramps are dropped in many of these scenes"


def test_marks_are_no_measurement() -> None:
    values = np.array([UNKNOWN_MM, 1, 2, 3, 4, 5, 5000, FAR_MM - 1, FAR_MM, SATURATED_MM], np.uint16)
    assert is_measured(values).tolist() == [False, False, False, False, False, True, True, True, False, False]


def test_the_self_checks_take_no_mark_for_a_distance() -> None:
    info = replace(INFO, min_range_m=0.001)
    rng = np.random.default_rng(3)
    depth = field()
    depth[40:80] = rng.integers(1, GREATEST_MARK_MM + 1, depth[40:80].shape)
    assert_equal(find_surfaces(depth, info, LEVEL, 0.002), find_surfaces(unmarked(depth), info, LEVEL, 0.002))
    assert_equal(depth_pyramid(depth, info), depth_pyramid(unmarked(depth), info))


def presuming(depth: NDArray[np.uint16] | NDArray[np.float32], info: CameraInfo) -> bool:
    """Whether the model with open space presumed holds open ranges."""
    model, _ = Extractor(Params(), OpenSkyParams(mode="presume")).extract(depth, info, LEVEL)
    assert model.valid
    return model.free.has_open


def test_nothing_is_open_by_marks_of_a_camera_that_writes_none() -> None:
    assert presuming(field(), INFO)
    assert not presuming(field(), replace(INFO, marks_smooth=False))
    assert not CameraInfo("front", Intrinsics(200, 160, 120.0, 120.0, 99.5, 79.5)).marks_smooth


def test_metres_hold_no_marks() -> None:
    assert not presuming((field() / np.float32(1000.0)).astype(np.float32), INFO)
