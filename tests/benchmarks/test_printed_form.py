"""What differs between the paper's printed form and the corrected one, on the scenes where it matters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.paper.forms import MODES, extractor_of, params_of
from benchmarks.paper.printed.clusters import cluster_paper, fill_paper
from benchmarks.paper.printed.density import bin_table_paper
from benchmarks.paper.printed.level import level_paper, view_geometry_paper
from benchmarks.paper.printed.params import PaperParams
from benchmarks.paper.printed.strips import STRIP
from core.stages.density import ONE_PX
from core.types import CameraInfo, FrameModel, Intrinsics, InvalidCause, PlaneFlags
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import TYPICAL, SensorModel
from drivers.simulation.source import Rendered, camera_info, render
from tests.core import naive
from tests.core.views import INFO, SMALL, VIEW, anything_free, first_hit, flat_wall, free_to, level, seen


def both(r: Rendered, **params: float) -> dict[str, FrameModel]:
    """The models of one frame by both forms."""
    return {m: extract(r.depth_mm, r.info, r.R_level_optical, mode=m, **params) for m in MODES}


def extract(
    depth: np.ndarray, info: CameraInfo, R: np.ndarray | None = None, mode: str = "safe", **params: float
) -> FrameModel:
    """The model of one image by a new extractor of a form."""
    model, _ = extractor_of(params_of(mode, **params)).extract(depth, info, level() if R is None else R)
    return model


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
    """A notch too narrow for the vehicle is spanned by either form; only the corrected one reports that nothing was seen
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
    # the printed form has planes only and no free space behind them
    paper = both(r)["paper"]
    assert first_hit(paper, beside, 0.0) > 10.0


@pytest.mark.parametrize("pitch", [-0.4, 0.0, 0.4])
def test_lemma_1_levels_the_distances_of_a_wall(pitch: float) -> None:
    """The paper's form, without roll: same rows, disparity over (cos theta - (v - v0)/f sin theta), theta nose down."""
    depth = flat_wall(INFO, 6.0, pitch)
    g = view_geometry_paper(INFO, level(pitch), PaperParams())
    out = np.empty((g.cols, g.rows), np.uint16)
    level_paper(depth, g.H, g.lateral, g.f_px * g.lsb_per_px, out)
    np.testing.assert_allclose(g.f_px * g.lsb_per_px / out, 6.0, atol=0.03)
    for v in (0, 14, 29):
        up = -pitch + math.atan((v - 14.5) / 30.0)  # angle below the horizon of the row's middle
        assert 0.5 * (g.tan_edge[v] + g.tan_edge[v + 1]) == pytest.approx(math.tan(up), abs=6e-3)


@pytest.mark.parametrize("roll", [-0.3, 0.3])
def test_the_paper_rotates_the_image_back_by_the_roll(roll: float) -> None:
    g = view_geometry_paper(INFO, level(0.0, roll), PaperParams())
    R = level(0.0, roll)
    for u, v in ((5, 6), (30, 20)):
        got = g.H @ [u, v, 1.0]
        want = naive.source_pixel(u, v, R, SMALL, 30.0, 19.5, 14.5)
        np.testing.assert_allclose(got[:2], want[:2], atol=1e-9)
    assert np.array_equal(
        view_geometry_paper(INFO, level(0.0, 0.03), PaperParams()).H, np.eye(3)
    )  # below two degrees: left alone
    assert not np.array_equal(view_geometry_paper(INFO, level(0.0, 0.03), PaperParams(paper_roll_deg=1.0)).H, np.eye(3))


@pytest.mark.parametrize("half", [1, 3, 5])
def test_the_paper_kernel_has_unit_area_and_its_threshold_counts_in_it(half: int) -> None:
    """Eq. 4-6: n h F = sum K against Hm x / C; in soft counts (the peak of the kernel is one pixel) that is over K(0)."""
    p = PaperParams(kernel_half_bins=half)
    t = bin_table_paper(450.0, 20.0, 0.675, p)
    s = p.kernel_sigma_bins / (2 * half + 1)
    x = np.linspace(-0.5, 0.5, 20001)
    shape = np.exp(-0.5 * (x / s) ** 2)
    peak = 1.0 / (np.mean(shape) * 1.0)
    assert t.threshold[100] == pytest.approx(ONE_PX * p.min_obstacle_height_m * t.disparity_px[100] / peak, rel=1e-3)
    assert (t.width_px[1:] == t.width_px[1]).all()


def strips_at(*places: tuple[float, float, float, float]) -> np.ndarray:
    """Strips at (x, y, top, bottom), m."""
    strips = np.zeros(len(places), STRIP)
    for name, column in zip(("x_m", "y_m", "top_m", "bottom_m"), np.array(places).T, strict=True):
        strips[name] = column
    return strips


def test_the_printed_algorithm_takes_the_nearest_last_strip_and_never_joins_clusters() -> None:
    wall = [(8.0, 0.08 * (u - 30), -1.0, 1.0) for u in (*range(20), *range(40, 60))]
    hiding = [(3.0, 0.03 * (u - 30), -1.0, 1.0) for u in range(25, 35)]  # hides the wall for a while
    strips = strips_at(*wall[:20], *hiding, *wall[20:])
    assert cluster_paper(strips, 2.0) == 2
    last: dict[int, int] = {}
    for i, s in enumerate(strips):
        gaps = {c: math.hypot(s["x_m"] - strips["x_m"][j], s["y_m"] - strips["y_m"][j]) for c, j in last.items()}
        near = {c: gap for c, gap in gaps.items() if gap < 2.0}
        assert s["cluster"] == (min(near, key=lambda c: near[c]) if near else len(last))
        last[int(s["cluster"])] = i


def test_the_printed_filling_takes_both_complements_of_the_whole_cluster() -> None:
    # both complements of the second are half a metre, two metres are missing below the third
    strips = strips_at((5.0, 0.0, -2.0, 2.0), (5.0, 0.1, -1.5, 1.5), (5.0, 0.2, -2.0, 0.0))
    fill_paper(strips, 1.0, 1)
    assert (strips["top_m"][1], strips["bottom_m"][1]) == (-2.0, 2.0)
    assert strips["bottom_m"][2] == 0.0


def test_the_printed_form_reports_nothing_without_a_measurement_and_calls_nothing_free() -> None:
    nothing = extract(np.zeros((30, 40), np.uint16), INFO, mode="paper")
    assert (nothing.valid, nothing.cause) == (False, InvalidCause.NO_MEASUREMENT)
    wall = extract(flat_wall(INFO, 6.0), INFO, mode="paper")
    assert wall.valid
    assert not anything_free(wall)
    steep = Intrinsics(17, 160, 41.3, 3.291, 20.65, 178.89)
    info = CameraInfo("front", steep, max_range_m=10.0)
    model = extract(np.full((160, 17), 1000, np.uint16), info, level(0.0, 1.1022), mode="paper")
    assert (model.valid, model.cause) == (False, InvalidCause.TOO_STEEP)
