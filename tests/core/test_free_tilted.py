"""What a tilted camera calls free lies within what it measured: the range clip is one of optical depth, not of forward
distance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.extractor import Extractor
from core.params import Params
from core.stages.classify import clear_range_m
from core.types import FAR_MM, CameraInfo, ExtractorState, FrameModel, FreeEnd, Intrinsics
from core.world.world import Observation, World
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered, camera_info, render
from osape_client.query.space import Occupancy, PlacedModel, Space
from osape_client.world.space import WorldSpace

from ..nightly import nightly
from .views import CLEAN, VIEW, extract, free_to, level, seen

NS = 1_000_000_000
KE = 0.003
TILTS_DEG = [
    (-20.0, 0.0),
    (-40.0, 0.0),
    (-55.0, 0.0),
    (-20.0, 30.0),
    (-40.0, -25.0),
    (20.0, 0.0),
    (40.0, 10.0),
    (50.0, -30.0),
]
"""(pitch, roll)."""


def claimed_points(model: FrameModel) -> np.ndarray:
    """(P, 3) in level_cam: the corners of every cell that the profile calls free, at its beginning, middle and end."""
    f = model.free
    found = []
    for d, layer in np.argwhere(f.free_to_m > f.free_from_m):
        for share in (0.0, 0.5, 1.0):
            r = f.free_from_m[d, layer] + share * (f.free_to_m[d, layer] - f.free_from_m[d, layer])
            for azimuth in f.azimuth_edges_rad[d : d + 2]:
                for z in f.layer_edges_m[layer : layer + 2]:
                    found.append([r * math.cos(azimuth), r * math.sin(azimuth), z])
    return np.array(found).reshape(-1, 3)


def short_camera(max_range_m: float) -> CameraInfo:
    return camera_info(160, 120, max_range_m=max_range_m, ke_per_m=KE)


@pytest.mark.parametrize("max_range_m", [3.0, *nightly(5.0), 8.0, *nightly(12.0), 20.0])
@pytest.mark.parametrize(("pitch_deg", "roll_deg"), TILTS_DEG)
@pytest.mark.parametrize("far_from", ["sensor", "clip"])
def test_far_is_free_only_as_deep_as_the_camera_measures(
    max_range_m: float, pitch_deg: float, roll_deg: float, far_from: str
) -> None:
    """An image that is far all over, either from the sensor or since all depths lie beyond the range clip."""
    info, R = short_camera(max_range_m), level(math.radians(pitch_deg), math.radians(roll_deg))
    value = FAR_MM if far_from == "sensor" else round(1000.0 * 1.01 * max_range_m)
    model, _ = Extractor(Params()).extract(np.full((120, 160), value, np.uint16), info, R)
    assert model.valid
    depth = claimed_points(model) @ R[:, 2]
    assert (depth <= clear_range_m(info, KE, Params()) + 1e-3).all(), f"free down to {depth.max():.2f} m"


@pytest.mark.parametrize("pitch_deg", [-40.0, -20.0, 0.0, 20.0, 40.0])
def test_a_tilted_camera_that_sees_far_calls_free_what_it_sees(pitch_deg: float) -> None:
    """The bound is kept with no more than a ring and a layer to spare, or the test above would pass by claiming nothing."""
    R = level(math.radians(pitch_deg))
    info = short_camera(20.0)
    model, _ = Extractor(Params()).extract(np.full((120, 160), FAR_MM, np.uint16), info, R)
    depth = claimed_points(model) @ R[:, 2]
    assert depth.max() >= clear_range_m(info, KE, Params()) - 1.0


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), TILTS_DEG)
def test_all_that_is_called_free_lies_in_the_image(pitch_deg: float, roll_deg: float) -> None:
    """Rolled, the border of the image cuts layers; the part that it hides must not pass for a few unknown pixels."""
    info, R = short_camera(20.0), level(math.radians(pitch_deg), math.radians(roll_deg))
    model, _ = Extractor(Params()).extract(np.full((120, 160), FAR_MM, np.uint16), info, R)
    k = info.intrinsics
    right, down, ahead = (claimed_points(model) @ R).T
    u, v = k.fx * right / ahead + k.cx, k.fy * down / ahead + k.cy
    outside = np.max([-0.5 - u, u - k.width + 0.5, -0.5 - v, v - k.height + 0.5], axis=0)
    # half a cell of the view at its edge, and half a pixel: cells are up to 1.4 pixels apart there, in both directions
    assert (outside <= 2.5).all(), f"{outside.max():.1f} px outside"


def test_a_free_range_limited_by_the_maximum_range_is_marked() -> None:
    """Pitched down, low layers end at the clip before the forward distance does."""
    R = level(math.radians(-30.0))
    model, _ = Extractor(Params()).extract(np.full((240, 320), FAR_MM, np.uint16), camera_info(320, 240), R)
    f = model.free
    middle = f.free_to_m.shape[0] // 2
    known = f.free_to_m[middle] > f.free_from_m[middle]
    assert known.sum() >= 3
    assert (f.end[middle][known] == FreeEnd.MAX_RANGE).sum() >= 2
    assert not (f.end[middle] == FreeEnd.OBSTACLE).any()


def camera(name: str, intrinsics: Intrinsics, max_range_m: float, ke_per_m: float) -> CameraInfo:
    return CameraInfo(name, intrinsics, max_range_m=max_range_m, min_range_m=0.4, ke_per_m=ke_per_m)


CAMERAS = {
    "zed": (camera("zed", Intrinsics(336, 188, 175.0, 175.0, 167.5, 93.5), 12.0, 0.003), -20.0, 6.2),
    "oak": (camera("oak", Intrinsics(320, 200, 197.0, 197.0, 159.5, 99.5), 15.0, 0.003), -20.0, 6.2),
    "v4l2": (camera("v4l2", Intrinsics(320, 240, 191.5, 191.5, 159.5, 119.5), 6.0, 0.005), -40.0, 4.2),
    "short": (camera("short", Intrinsics(320, 240, 191.5, 191.5, 159.5, 119.5), 5.0, 0.0015), -40.0, 4.2),
}
"""Cameras of the configurations that are shipped, at half their resolution, and one of 5 m; a pitch, and how far below
the camera the object is."""


def beyond_the_clip(
    info: CameraInfo, pitch_deg: float, down_m: float, reach_m: float = 30.0
) -> tuple[Rendered, np.ndarray]:
    """(frame, points (81, 3) of the object): a box of 2 x 1.2 m whose nearest point lies just beyond the camera's clip.

    The frame is what a sensor delivers that measures to reach_m."""
    p = math.radians(pitch_deg)
    nearest_m = 1.01 * clear_range_m(info, info.ke_per_m, Params())
    x = (nearest_m + (down_m - 0.6) * math.sin(p)) / math.cos(p)
    s = SceneBuilder("object")
    s.box("object", x + 0.3, 0.0, 0.6, 2.0, 1.2, base=-down_m - 0.6)
    s.wall("behind", (25.0, -60.0), (25.0, 60.0), 80.0, base=-40.0)
    sensor_info = camera(info.camera, info.intrinsics, reach_m, info.ke_per_m)
    frame = render(s.build(), sensor_info, pitch_rad=p, position_ned_m=(0.0, 0.0, 0.0), sensor=CLEAN)
    y, z = np.meshgrid(np.linspace(-0.95, 0.95, 9), down_m + np.linspace(-0.55, 0.55, 9))
    return frame, np.stack([np.full(y.size, x + 0.05), y.ravel(), z.ravel()], axis=1)


@pytest.mark.parametrize("name", CAMERAS)
def test_an_object_that_was_measured_beyond_the_clip_is_not_free(name: str) -> None:
    info, pitch_deg, down_m = CAMERAS[name]
    frame, points = beyond_the_clip(info, pitch_deg, down_m)
    model, _ = Extractor(Params()).extract(frame.depth_mm, info, frame.R_level_optical)
    assert model.valid
    answers = Space([PlacedModel(model, (0.0, 0.0, 0.0))]).points(points)
    assert (answers == Occupancy.FREE).sum() == 0


@pytest.mark.parametrize("name", ["zed", "v4l2", *nightly("oak", "short")])
def test_frames_that_measured_an_object_beyond_their_clip_do_not_clear_it(name: str) -> None:
    """A camera of long range puts it into the world; 60 frames of the one that cuts it off must leave it there."""
    info, pitch_deg, down_m = CAMERAS[name]
    frame, points = beyond_the_clip(info, pitch_deg, down_m)
    world, state = World(), ExtractorState()
    extractor = Extractor(Params())
    for i in range(30):
        model, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state)
        world.add(Observation(model=model, place_m=(0.0, 0.0, 0.0), t_ns=(1 + i) * NS // 10))
    before = WorldSpace(world.picture(3 * NS)).points(points, 0.1)
    assert (before == Occupancy.OCCUPIED).mean() > 0.5
    state = ExtractorState()
    for i in range(60):
        model, state = extractor.extract(frame.depth_mm, info, frame.R_level_optical, state)
        world.add(Observation(model=model, place_m=(0.0, 0.0, 0.0), t_ns=(31 + i) * NS // 10))
    after = WorldSpace(world.picture(9 * NS)).points(points, 0.1)
    assert (after == Occupancy.FREE).sum() == 0
    assert (after == Occupancy.OCCUPIED).sum() == (before == Occupancy.OCCUPIED).sum()


def test_a_wall_that_a_near_box_hides_is_not_free() -> None:
    """The box, all below the layer, hides the wall's top in it: less than a fifth of the rows that look at the layer there."""
    s = SceneBuilder("box before a wall")
    s.box("box", 3.1, 0.0, 1.0, 12.0, 8.57, base=-8.0)
    s.wall("wall", (5.1, -9.0), (5.1, 9.0), 9.1, base=-8.0)
    r = seen(s, position_ned_m=(0.0, 0.0, 0.0), pitch_rad=0.25)
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    assert free_to(model, 0.0, -1.0) < 5.1
    thick = {"profile_layers": 7, "profile_layer_m": 2.0, "profile_outer_layers": 0}
    assert 3.5 < free_to(extract(r.depth_mm, VIEW, r.R_level_optical, **thick), 0.0, -2.0) < 5.1
