"""A near thin cable is what a vehicle flies into: it is kept whole, horizontal or slanted, before the sky or a house."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.extractor import Extractor
from core.types import FrameModel
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import Rendered, camera_info, render

from ..nightly import nightly

CAMERA_M = 2.0
MEAN_HEIGHT_M = 2.2
NEAR_M = 0.5
"""How far before or behind the cable a plane may stop its rays."""


def scene(x_m: float, slant_deg: float, house: bool, cable: bool = True) -> SceneBuilder:
    """A cable of 2 cm across the view."""
    s = SceneBuilder("cable")
    s.ground()
    if house:
        s.box("house", 12.0, -6.0, 4.0, 14.0, 8.0, 0.0)
    rise = 2.0 * math.tan(math.radians(slant_deg))
    if cable:
        s.cylinder("cable", (x_m, -2.0, -MEAN_HEIGHT_M - rise), (x_m, 2.0, -MEAN_HEIGHT_M + rise), 0.01)
    return s


def render_sequence(s: SceneBuilder, ke: float) -> tuple[Rendered, FrameModel]:
    """640 pixels wide, with the noise, holes and mismatches of a good stereo camera."""
    info = camera_info(640, 480, ke_per_m=ke)
    position = (0.0, 0.0, -CAMERA_M)
    r = render(s.build(), info, sensor=replace(TYPICAL, ke_per_m=ke), seed=1, position_ned_m=position)
    model, _ = Extractor().extract(r.depth_mm, info, r.R_level_optical)
    return r, model


def points_on_cable(r: Rendered) -> NDArray[np.float64]:
    """(N, 3) points, level_cam, of the pixels that see the cable higher than an obstacle's least height above the ground."""
    on = r.truth.label(r.scene) == r.scene.names.index("cable")
    on[:, : TYPICAL.blind_left_px] = False  # where one of the two eyes sees nothing
    points = r.truth.points_level_cam_m[on]
    return points[points[:, 2] < CAMERA_M - 0.6]


def stopped(points: NDArray[np.float64], model: FrameModel) -> NDArray[np.bool_]:
    """(N,) bool: a plane stops the ray to this point within NEAR_M of it."""
    x, y, z = points.T
    hit = np.zeros(len(points), bool)
    for ax, ay, bx, by, top, bottom in model.planes.astype(float):
        dx, dy = bx - ax, by - ay
        with np.errstate(divide="ignore", invalid="ignore"):
            k = (ay * dx - ax * dy) / (y * dx - x * dy)
        along = ((k * x - ax) * dx + (k * y - ay) * dy) / (dx * dx + dy * dy)
        near = np.abs(k - 1.0) * np.hypot(x, y) < NEAR_M
        hit |= near & (along >= 0.0) & (along <= 1.0) & (k * z >= top) & (k * z <= bottom)
    return hit


@pytest.mark.parametrize("ke", [0.0015, 0.005])
@pytest.mark.parametrize("house", [False, True], ids=["sky", "house"])
@pytest.mark.parametrize(
    ("x_m", "slant_deg"),
    [(2.0, 0.0), *nightly((2.0, 30.0)), (3.0, 10.0), *nightly((3.0, 60.0), (4.0, 0.0)), (4.0, 60.0)],
)
def test_a_near_thin_cable_is_kept(x_m: float, slant_deg: float, house: bool, ke: float) -> None:
    r, model = render_sequence(scene(x_m, slant_deg, house), ke)
    points = points_on_cable(r)
    assert len(points) > 500
    hit = stopped(points, model)
    assert hit.mean() > 0.99
    piece = np.floor(points[:, 1] / 0.2)
    assert all(hit[piece == k].mean() > 0.9 for k in np.unique(piece)), "a stretch of 20 cm is missing"


def test_without_the_cable_nothing_stops_those_rays() -> None:
    r, _ = render_sequence(scene(3.0, 10.0, True), 0.0015)
    _, without = render_sequence(scene(3.0, 10.0, True, cable=False), 0.0015)
    assert not stopped(points_on_cable(r), without).any()
