"""What differs between the paper's printed form and the corrected one, on the scenes where it matters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.types import FrameModel, PlaneFlags
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import TYPICAL, SensorModel
from drivers.simulation.source import Rendered, camera_info, render

from .views import VIEW, extract, first_hit, free_to, seen


def both(r: Rendered, **params: float) -> dict[str, FrameModel]:
    """The models of one frame in both modes."""
    return {m: extract(r.depth_mm, r.info, r.R_level_optical, mode=m, **params) for m in ("safe", "paper")}


@pytest.mark.parametrize("scene", ["street", "trees", "window", "corner"])
@pytest.mark.parametrize("mode", ["safe", "paper"])
def test_both_modes_find_the_obstacles_of_a_scene(scene: str, mode: str) -> None:
    r = render(make_scene(scene, 1), VIEW, sensor=TYPICAL, seed=1)
    model = extract(r.depth_mm, VIEW, r.R_level_optical, mode=mode)
    assert model.valid
    assert len(model.planes) >= 2
    assert len(model.prisms) >= 2
    points = r.truth.points_level_cam_m
    with np.errstate(invalid="ignore"):
        truth = points[r.truth.obstacle() & (r.depth_mm > 0) & (points[..., 0] < 15.0)]
    rng = np.random.default_rng(1)
    stopped = 0
    sample = truth[rng.choice(len(truth), 60, replace=False)]
    for x, y, z in sample:
        stopped += first_hit_3d(model, x, y, z) < math.hypot(x, y) + 1.0
    assert stopped >= (55 if mode == "safe" else 30)


def first_hit_3d(model: FrameModel, x: float, y: float, z: float) -> float:
    """Horizontal range at which the ray to (x, y, z) meets the first plane."""
    best = math.inf
    for ax, ay, bx, by, top, bottom in model.planes.astype(float):
        det = (bx - ax) * y - (by - ay) * x
        if abs(det) < 1e-12:
            continue
        share = (ay * x - ax * y) / det
        along = math.hypot(ax + share * (bx - ax), ay + share * (by - ay)) / math.hypot(x, y)
        ahead = (ax + share * (bx - ax)) * x + (ay + share * (by - ay)) * y > 0
        if 0 <= share <= 1 and ahead and top <= z * along <= bottom:
            best = min(best, along * math.hypot(x, y))
    return best


@pytest.mark.parametrize("pitch", [0.0, -0.15])
def test_tilted_ground(pitch: float) -> None:
    """Flat ground fills as many pixels a kernel at any range while the printed threshold falls with range: far ground is
    an obstacle in print. Found first and taken out, it is none."""
    s = SceneBuilder("field")
    s.ground(slope_x=0.02)
    r = seen(s, position_ned_m=(0.0, 0.0, -3.0), pitch_rad=pitch, roll_rad=0.1)
    model = both(r)
    assert len(model["safe"].planes) == 0
    assert model["safe"].ground.seen
    assert not model["paper"].ground.seen
    assert len(model["paper"].planes) > 0


def test_pole() -> None:
    """Three columns make a group of three strips, for which the printed Algorithm 2 has no plane."""
    s = SceneBuilder("pole")
    s.pole("pole", 8.0, 0.5, 0.05, 5.0)
    info = camera_info(640, 480)
    model = both(seen(s, info, sensor=SensorModel(ke_per_m=0.0015, sky_is_far=True), seed=1))
    at = math.atan2(0.5, 8.0)
    assert first_hit(model["safe"], at, 0.0) == pytest.approx(8.0, abs=0.4)
    assert first_hit(model["paper"], at, 0.0) > 8.5


def niche(width: float) -> Rendered:
    s = SceneBuilder("niche 1.4 m deep")
    s.wall("left", (6.0, -20.0), (6.0, -width / 2), 20.0, base=-10.0)
    s.wall("right", (6.0, width / 2), (6.0, 20.0), 20.0, base=-10.0)
    s.wall("back", (7.4, -width / 2), (7.4, width / 2), 20.0, base=-10.0)
    return seen(s)


def test_notch() -> None:
    """A notch too narrow for the vehicle is spanned by either form; only the corrected one says that nothing was seen
    there. A niche that it could fly into stays open; the printed merge closes it a metre and a half before its back."""
    narrow, wide = both(niche(1.2)), both(niche(3.0))
    assert first_hit(narrow["safe"], 0.0, 0.0) == pytest.approx(6.0, abs=0.3)
    assert first_hit(narrow["paper"], 0.0, 0.0) == pytest.approx(6.0, abs=0.3)
    assert any(PlaneFlags(int(f)) & PlaneFlags.INFERRED for f in narrow["safe"].flags)
    assert not any(PlaneFlags(int(f)) & PlaneFlags.INFERRED for f in narrow["paper"].flags)
    assert first_hit(wide["safe"], 0.0, 0.0) == pytest.approx(7.4, abs=0.3)
    assert first_hit(wide["paper"], 0.0, 0.0) == pytest.approx(6.0, abs=0.3)


def spike(out_m: float, y_m: float) -> SceneBuilder:
    """A wedge 10 cm wide at its foot that stands out of a wall at 8 m."""
    s = SceneBuilder("spike")
    s.wall("wall", (8.0, -30.0), (8.0, 30.0), 20.0, base=-10.0)
    outline = ((8.0 - out_m, y_m), (8.0, y_m - 0.05), (8.0, y_m + 0.05))
    s.convex("spike", np.array([[x, y, z] for z in (-8.0, 4.0) for x, y in outline]))
    return s


def test_spike() -> None:
    """A thing three columns wide that stands out towards the camera: the listing's dot product deletes it (real
    obstacle), the corrected form never deletes what is nearer than the chord."""
    s = spike(1.0, 0.3)
    info = camera_info(640, 480)
    model = both(seen(s, info))
    at = math.atan2(0.3, 7.0)
    assert first_hit(model["safe"], at, 0.0) * math.cos(at) <= 7.0 + 0.28
    assert first_hit(model["paper"], at, 0.0) * math.cos(at) > 7.5


@pytest.mark.parametrize("out_m", [0.6, 1.0, 1.5])
def test_a_spike_is_stopped_wherever_its_tip_falls_between_two_columns(out_m: float) -> None:
    for y in (-1.3, -0.4, 0.1, 0.29, 0.3, 0.302, 0.31):
        r = seen(spike(out_m, y), camera_info(640, 480))
        at = math.atan2(y, 8.0 - out_m)
        x = first_hit(extract(r.depth_mm, r.info, r.R_level_optical), at, 0.0) * math.cos(at)
        assert 8.0 - out_m - 0.1 <= x <= 8.0 - out_m + 0.28, y


def test_two_sided_occlusion() -> None:
    """A pillar before a wall: behind it lies unknown. Nothing there is free, and no plane is drawn through it."""
    s = SceneBuilder("pillar before a wall")
    s.wall("wall", (12.0, -30.0), (12.0, 30.0), 20.0, base=-10.0)
    s.box("pillar", 4.25, 0.0, 0.5, 0.8, 12.0, base=-4.0)
    r = seen(s)
    model = both(r)["safe"]
    assert first_hit(model, 0.0, 0.0) == pytest.approx(4.0, abs=0.3)
    assert free_to(model, 0.0, 0.0) <= 4.0
    beside = math.atan2(0.8, 4.0)
    assert free_to(model, beside, 0.0) > 10.0
    # the pillar and both halves of the wall, which it hides over more than a vehicle's width
    assert len(np.unique(model.cluster)) == 3
    inside = [p for p in model.planes if 4.6 < min(p[0], p[2]) < 11.0]
    assert inside == []
    # the printed form draws planes only and says nothing of what is free behind them
    paper = both(r)["paper"]
    assert first_hit(paper, beside, 0.0) > 10.0
