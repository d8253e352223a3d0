"""Types reject values that they cannot represent, with a message."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from core.params import Params
from core.types import (
    AttitudeSample,
    CameraInfo,
    CameraMount,
    DepthFrame,
    FrameModel,
    FrameStats,
    FreeProfile,
    Ground,
    Intrinsics,
    InvalidCause,
    PoseSample,
    Prism,
    readonly,
)

K = Intrinsics(640, 480, 450.0, 450.0, 319.5, 239.5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"width": 8}, "16..4096"),
        ({"height": 5000}, "16..4096"),
        ({"fx": math.nan}, "fx is not finite"),
        ({"cy": math.inf}, "cy is not finite"),
        ({"fx": 45.0}, "another resolution"),
        ({"fy": -450.0}, "another resolution"),
        ({"cx": 2000.0}, "principal point"),
        ({"cy": -300.0}, "principal point"),
    ],
)
def test_intrinsics_that_do_not_fit_are_refused(change: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        replace(K, **change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"camera": ""}, "printable name"),
        ({"camera": "a\nb"}, "printable name"),
        ({"min_range_m": 0.0}, "0 < min < max"),
        ({"min_range_m": 30.0}, "0 < min < max"),
        ({"max_range_m": 70.0}, "0 < min < max"),
        ({"ke_per_m": 0.0}, "ke_per_m"),
        ({"ke_per_m": math.nan}, "ke_per_m"),
    ],
)
def test_a_camera_with_impossible_numbers_is_refused(change: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        replace(CameraInfo("front", K), **change)


def test_a_mount_needs_finite_numbers() -> None:
    for name in (f.name for f in fields(CameraMount)):
        with pytest.raises(ValueError, match=name):
            CameraMount(**{name: math.nan})


def test_attitude_and_pose_refuse_what_is_no_attitude_and_no_pose() -> None:
    good = (1.0, 0.0, 0.0, 0.0)
    assert AttitudeSample(1, 2, good).rates_frd_rad_s is None
    for bad in ((0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)):
        with pytest.raises(ValueError, match="quaternion norm"):
            AttitudeSample(1, 2, bad)
    with pytest.raises(ValueError, match="rates"):
        AttitudeSample(1, 2, good, (0.0, math.inf, 0.0))
    with pytest.raises(ValueError, match="position"):
        PoseSample(1, 2, (0.0, math.nan, 0.0))
    with pytest.raises(ValueError, match="velocity"):
        PoseSample(1, 2, (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0))


def test_depth_frames_hold_read_only_uint16_images() -> None:
    def frame(image: np.ndarray) -> DepthFrame:
        return DepthFrame(camera="a", sequence=0, t_exposure_ns=0, t_arrival_ns=1, depth_mm=image)

    held = frame(np.ones((30, 40), np.uint16)[:, ::2]).depth_mm
    assert held.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        held[0, 0] = 2
    with pytest.raises(ValueError, match="dtype float32"):
        frame(np.ones((30, 40), np.float32))
    with pytest.raises(ValueError, match="shape"):
        frame(np.ones((30, 40, 3), np.uint16))


def test_readonly_leaves_the_given_array_writeable() -> None:
    a = np.zeros((2, 3), np.float32)
    view = readonly(a, np.float32, (2, None), "a")
    a[0, 0] = 1.0
    assert view[0, 0] == 1.0
    assert not view.flags.writeable
    with pytest.raises(ValueError, match="a: shape"):
        readonly(a, np.float32, (3, None), "a")


def profile(**change: np.ndarray) -> FreeProfile:
    given = {
        "azimuth_edges_rad": np.array([-0.1, 0.0, 0.1], np.float32),
        "layer_edges_m": np.array([-1.0, 1.0], np.float32),
        "free_from_m": np.zeros((2, 1), np.float32),
        "free_to_m": np.zeros((2, 1), np.float32),
        "end": np.zeros((2, 1), np.uint8),
    }
    return FreeProfile(**(given | change))


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("free_to_m", np.zeros((1, 2), np.float32)),
        ("end", np.zeros((2, 1), np.int64)),
        ("azimuth_edges_rad", np.zeros((2, 2), np.float32)),
    ],
)
def test_a_free_profile_needs_arrays_that_fit_each_other(name: str, bad: np.ndarray) -> None:
    assert profile().free_to_m.shape == (2, 1)
    with pytest.raises(ValueError, match=name):
        profile(**{name: bad})


def prism(**change: object) -> Prism:
    given = {
        "cluster": 0,
        "top_m": -1.0,
        "bottom_m": 1.0,
        "closed": False,
        "margin_m": 0.1,
        "vertices_m": np.zeros((3, 2), np.float32),
        "plane": np.zeros(2, np.int32),
    }
    return Prism(**(given | change))


def test_a_prism_has_an_edge_less_than_vertices_unless_it_is_closed() -> None:
    assert not prism().closed
    assert prism(closed=True, plane=np.zeros(3, np.int32)).closed
    with pytest.raises(ValueError, match="plane"):
        prism(closed=True)
    with pytest.raises(ValueError, match="z is down"):
        prism(top_m=1.0, bottom_m=1.0)


def model(planes: np.ndarray, margin: np.ndarray) -> FrameModel:
    n = len(planes)
    return FrameModel(
        valid=True,
        cause=InvalidCause.NONE,
        planes=planes,
        support_px=np.ones(n, np.int32),
        margin_m=margin,
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
        prisms=(),
        free=profile(),
        ground=Ground(seen=False),
        stats=FrameStats(),
        ke_per_m=0.001,
    )


def test_a_model_refuses_planes_upside_down_and_fields_of_other_lengths() -> None:
    up = np.array([[1, 0, 1, 1, -1, 1]], np.float32)
    assert len(model(up, np.zeros(1, np.float32)).planes) == 1
    with pytest.raises(ValueError, match="z is down"):
        model(up[:, [0, 1, 2, 3, 5, 4]], np.zeros(1, np.float32))
    with pytest.raises(ValueError, match="margin_m"):
        model(up, np.zeros(2, np.float32))


def test_every_parameter_has_a_range_that_holds_its_default_and_is_enforced() -> None:
    p = Params()
    for f in fields(Params):
        assert f.metadata["doc"]
        if "min" not in f.metadata:
            continue
        low, high = f.metadata["min"], f.metadata["max"]
        assert low <= getattr(p, f.name) <= high
        step = 1 if f.type == "int" else 0.001
        for value in (low - step, high + step):
            with pytest.raises(ValueError, match=f.name):
                Params(**{f.name: value})
        assert getattr(Params(**{f.name: low}), f.name) == low
        assert getattr(Params(**{f.name: high}), f.name) == high


def test_parameters_of_the_wrong_kind_are_refused() -> None:
    for bad in (
        {"estimate_noise": 1},
        {"window_members": 2.5},
        {"window_members": True},
        {"peak_alpha": math.nan},
    ):
        with pytest.raises(ValueError, match=next(iter(bad))):
            Params(**bad)
