"""The truth check of claimed free space: planted wrong cells are found, and what may be claimed is not reported."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.free_space import campaign as free_campaign
from benchmarks.free_space import worlds as free_worlds
from benchmarks.free_space.biased_frames import biased_frame
from benchmarks.free_space.blank_frames import blank_frame
from benchmarks.free_space.hard_frames import hard_frames, hard_views
from benchmarks.free_space.near_frames import near_frame
from benchmarks.free_space.random_frames import ROOM_M, has_room, random_frame
from benchmarks.free_space.readers import ReaderCounts, deep_in_solid, judge_readers
from benchmarks.free_space.volume import SLACK_M, above_ground, first_solids, wrong_cells
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.free_geometry import lowest_clear, walk_settings
from core.stages.ground import NO_GROUND
from core.stages.model import blind_model
from core.stages.view_geometry import source_of, view_geometry
from core.types import (
    FAR_MM,
    UNKNOWN_MM,
    ExtractorState,
    FrameModel,
    FreeEnd,
    FreeProfile,
    Ground,
    InvalidCause,
    is_measured,
)
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import Rendered, camera_info, render

INFO = camera_info(160, 120, max_range_m=12.0)
KE = 0.0015
EDGES = np.linspace(-0.6, 0.6, 25).astype(np.float32)
LAYERS = np.array([-3.0, -1.0, 1.0, 3.0], np.float32)


def claiming(
    free_to_m: float, layers: tuple[int, ...] = (1,), ground: Ground = NO_GROUND, edges_m: np.ndarray = LAYERS
) -> FrameModel:
    """A model that calls some layers free to a range in all directions, from 1 m on."""
    start, to = np.zeros((24, 3), np.float32), np.zeros((24, 3), np.float32)
    start[:, layers], to[:, layers] = 1.0, free_to_m
    free = FreeProfile(
        azimuth_edges_rad=EDGES,
        layer_edges_m=edges_m,
        free_from_m=start,
        free_to_m=to,
        end=np.full((24, 3), int(FreeEnd.MAX_RANGE), np.uint8),
    )
    return replace(blind_model(INFO, InvalidCause.NONE, Params()), valid=True, free=free, ground=ground, ke_per_m=KE)


def view(s: SceneBuilder, *, height_m: float = 2.0, yaw_rad: float = 0.4, pitch_rad: float = 0.0) -> Rendered:
    return render(s.build(), INFO, yaw_rad=yaw_rad, pitch_rad=pitch_rad, position_ned_m=(3.0, -2.0, -height_m))


def ahead(distance_m: float, right_m: float = 0.0, yaw_rad: float = 0.4) -> tuple[float, float]:
    """x, y in ned of a place before the camera of `view`."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return 3.0 + distance_m * c - right_m * s, -2.0 + distance_m * s + right_m * c


def box(low_m: float, high_m: float, *, ground: bool = False) -> SceneBuilder:
    """A box of 2 x 2 m whose face is 5 m ahead, between two heights."""
    s = SceneBuilder("box")
    if ground:
        s.ground()
    s.box("box", *ahead(6.0), 2.0, 2.0, high_m - low_m, 0.4, low_m)
    return s


def test_a_claim_that_ends_before_a_solid_is_right_and_one_that_enters_it_is_wrong() -> None:
    frame = view(box(0.0, 4.0))
    assert wrong_cells(frame, claiming(4.9), KE, Params()) == ([], 24)
    assert wrong_cells(frame, claiming(5.28), KE, Params())[0] == []  # within the slack
    wrong, claimed = wrong_cells(frame, claiming(5.45), KE, Params())
    assert claimed == 24
    # the face spans 1 m to either side: 11.3 degrees, hence the directions from -0.2 to 0.2 rad
    assert {w.direction for w in wrong} == {8, 9, 10, 11, 12, 13, 14, 15}
    for w in wrong:
        assert w.layer == 1
        assert w.solid == 0
        assert w.range_m * math.cos(w.azimuth_rad) == pytest.approx(5.0, abs=1e-6)
        assert w.deep_m == pytest.approx(5.45 - w.range_m, abs=1e-5)


def test_noise_allows_three_sigma() -> None:
    frame = view(box(0.0, 4.0))
    assert wrong_cells(frame, claiming(5.45), KE, Params())[0]
    assert wrong_cells(frame, claiming(5.45), 0.008, Params())[0] == []  # 3 * 0.008 * 25 = 0.6 m
    assert wrong_cells(frame, claiming(5.65), 0.008, Params())[0]


def test_space_that_no_pixel_observes_is_evaluated_too() -> None:
    """A claim that begins in a solid, and one that goes on behind what is seen."""
    s = box(0.0, 4.0)
    s.wall("wall", ahead(0.8, -9.0), ahead(0.8, 9.0), 5.0)
    assert wrong_cells(view(s), claiming(5.8), KE, Params())[0]
    inside = SceneBuilder("inside")
    inside.box("hall", *ahead(5.0), 30.0, 30.0, 9.0)
    wrong, claimed = wrong_cells(view(inside), claiming(4.0), KE, Params())
    assert len(wrong) == claimed == 24


def test_only_layers_that_a_solid_reaches_into_are_wrong() -> None:
    frame = view(box(3.2, 4.2))  # z = -2.2..-1.2: the layer above the camera's own
    assert wrong_cells(frame, claiming(6.0, (1, 2)), KE, Params())[0] == []
    assert {w.layer for w in wrong_cells(frame, claiming(6.0, (0, 1, 2)), KE, Params())[0]} == {0}


def test_less_than_a_pixel_of_a_layer_is_not_evaluated() -> None:
    """At 5 m a pixel is 4.4 cm high; two boxes that reach 3.5 and 10 cm into a layer, from below and from above."""
    edges_m = np.array([-0.75, -0.25, 0.25, 0.75], np.float32)
    for inside_m, wrong in ((0.035, False), (0.1, True)):
        for low, high in ((0.0, 1.75 + inside_m), (2.25 - inside_m, 4.0)):
            found, _ = wrong_cells(view(box(low, high)), claiming(6.0, (1,), edges_m=edges_m), KE, Params())
            assert bool(found) == wrong


@pytest.mark.parametrize("pitch_rad", [0.0, -0.5, 0.4])
def test_the_tilt_of_the_camera_does_not_turn_the_cells(pitch_rad: float) -> None:
    frame = view(box(0.0, 4.0), pitch_rad=pitch_rad)
    assert {w.direction for w in wrong_cells(frame, claiming(6.0), KE, Params())[0]} == set(range(8, 16))


def test_below_the_ground_of_the_model_nothing_is_claimed() -> None:
    low, tall = view(box(0.0, 0.9)), view(box(0.0, 1.6))  # z = 1.1..2 and 0.4..2
    layer = (2,)  # z = 1..3
    assert wrong_cells(low, claiming(6.0, layer), KE, Params())[0]
    assert wrong_cells(low, claiming(6.0, layer, Ground(seen=True, height_m=1.3)), KE, Params())[0] == []
    assert wrong_cells(low, claiming(6.0, layer, Ground(seen=True, height_m=1.3)), KE, Params(), below_ground=True)[0]
    assert wrong_cells(low, claiming(6.0, layer, Ground(seen=True, height_m=2.0)), KE, Params())[0]
    # a roof that was taken for ground hides what is below it, not what stands on it
    assert wrong_cells(tall, claiming(6.0, (1, 2), Ground(seen=True, height_m=1.3)), KE, Params())[0]


def test_what_is_lower_than_an_obstacle_above_the_true_ground_is_not_evaluated() -> None:
    layer = (2,)
    assert wrong_cells(view(box(0.0, 0.5, ground=True), height_m=2.5), claiming(6.0, layer), KE, Params())[0] == []
    assert wrong_cells(view(box(0.0, 0.9, ground=True), height_m=2.5), claiming(6.0, layer), KE, Params())[0]


def test_ground_that_is_called_free_deeper_than_an_obstacle_is_wrong() -> None:
    s = SceneBuilder("ground")
    s.ground()
    assert {w.solid for w in wrong_cells(view(s), claiming(6.0, (2,)), KE, Params())[0]} == {-1}  # z = 1..3, ground 2
    assert wrong_cells(view(s, height_m=2.5), claiming(6.0, (2,)), KE, Params())[0] == []
    assert wrong_cells(view(s), claiming(6.0, (2,), Ground(seen=True, height_m=2.0)), KE, Params())[0] == []


def test_the_model_s_ground_bounds_a_ray_as_the_profile_does() -> None:
    rng, p = np.random.default_rng(3), Params()
    R = view(SceneBuilder("none")).R_level_optical
    g, source = view_geometry(INFO, R, p), source_of(INFO, R, 12.0)[0]
    for _ in range(200):
        slopes = rng.uniform(-0.2, 0.2, 2)
        height_m = rng.uniform(0.5, 4.0)
        noise_per_m = p.ground_sigmas * KE * height_m
        ground = Ground(seen=True, height_m=height_m, slope_x=slopes[0], slope_y=slopes[1], noise_per_m=noise_per_m)
        azimuth, z = rng.uniform(-0.8, 0.8), rng.uniform(-3.0, 5.0)
        (lo,), (hi,) = above_ground(
            ground, np.array([azimuth]), np.array([z]), np.array([1.0]), np.array([12.0]), KE, p
        )
        w = walk_settings(g, source, ground, KE, p)[0]
        for r in rng.uniform(1.0, 12.0, 20):
            above = z < lowest_clear(math.tan(azimuth), r * math.cos(azimuth), w)
            assert above == (lo <= r <= hi)


def test_rays_enter_each_kind_of_solid_where_it_begins() -> None:
    s = SceneBuilder("all")
    s.box("box", 5.0, 0.0, 2.0, 2.0, 2.0)
    s.sphere("sphere", 5.0, 10.0, 1.0, 1.5)
    s.pole("pole", 5.0, 20.0, 0.4, 3.0)
    s.disc("disc", (5.0, 30.0, -1.0), (1.0, 0.0, 0.0), 0.5)
    y = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    origins = np.stack([np.zeros(5), y, np.full(5, -1.0)], axis=1)
    directions = np.tile([1.0, 0.0, 0.0], (5, 1))
    at, which = first_solids(s.build(), False, origins, directions, np.zeros(5), np.full(5, 9.0), 0.6)
    np.testing.assert_allclose(at, [4.0, 3.5, 4.8, 5.0, np.inf])
    np.testing.assert_array_equal(which, [0, 1, 2, 3, -2])
    at, _ = first_solids(s.build(), False, origins, directions, np.full(5, 4.9), np.full(5, 9.0), 0.6)
    np.testing.assert_allclose(at, [4.9, 4.9, 4.9, 5.0, np.inf])  # it starts inside
    at, _ = first_solids(s.build(), False, origins, directions, np.full(5, 6.6), np.full(5, 9.0), 0.6)
    assert not np.isfinite(at).any()


def test_a_random_frame_is_the_same_again_and_has_room_for_its_camera() -> None:
    for number in range(8):
        a, b = random_frame(5, number), random_frame(5, number)
        np.testing.assert_array_equal(a.frame.depth_mm, b.frame.depth_mm)
        assert a.frame.info == b.frame.info
        assert has_room(a.frame.scene, -float(a.frame.position_ned_m[2]))
    near = SceneBuilder("near")
    near.box("box", ROOM_M + 0.4, 0.0, 1.0, 1.0, 4.0)
    assert not has_room(near.build(), 2.0)


def test_a_near_frame_is_the_same_again_and_holds_a_thing_that_is_too_near() -> None:
    unmeasured = 0
    for number in range(8):
        one, other = near_frame(1, number), near_frame(1, number)
        np.testing.assert_array_equal(one.frame.depth_mm, other.frame.depth_mm)
        least_m = one.frame.info.min_range_m
        assert not ((one.frame.depth_mm > 0) & (one.frame.depth_mm < 1000 * least_m)).any()
        # in a tenth of this range the same camera would measure what is missing
        near = replace(one.camera.measures, min_range_m=0.05)
        camera = replace(one.camera, measures=near, info=near)
        place = (0.0, 0.0, float(one.frame.position_ned_m[2]))
        again = camera.image(one.frame.scene, place, 0.0, one.pitch_deg, one.roll_deg, number)
        unmeasured += bool(((again.depth_mm > 0) & (again.depth_mm < 1000 * least_m)).any())
    assert unmeasured >= 6


@pytest.mark.parametrize("number", [31, 45, 83, 89, 114, 119, 735, 938, 1488])
def test_no_free_cell_holds_a_thing_that_is_too_near(number: int) -> None:
    """Cells that held up to 8 m of what lies behind the edge of such a thing; the last five by less than a pixel, by a thing
    between two rings, or by one that reaches beyond the minimum range."""
    r = near_frame(1, number)
    wrong, cells, valid, _ = free_campaign.judge(r, Extractor(Params()), False)
    assert valid
    assert cells > 0
    assert wrong == []


def test_a_blank_frame_is_a_random_frame_without_the_pixels_of_some_things() -> None:
    hidden = 0
    for number in range(8):
        blank, again, measured = blank_frame(5, number), blank_frame(5, number), random_frame(5, number)
        np.testing.assert_array_equal(blank.frame.depth_mm, again.frame.depth_mm)
        missing = blank.frame.depth_mm != measured.frame.depth_mm
        label = measured.frame.truth.label(measured.frame.scene)
        assert (blank.frame.depth_mm[missing] == UNKNOWN_MM).all()
        assert (label[missing] >= 0).all()
        for thing in np.unique(label[missing]):
            assert (blank.frame.depth_mm[label == thing] == UNKNOWN_MM).all()
        hidden += bool(missing.any())
    assert hidden >= 3


def test_biased_depths_are_too_great_by_the_stated_bias() -> None:
    measured, biased = random_frame(7, 2).frame, biased_frame(7, 2).frame
    both = is_measured(measured.depth_mm) & is_measured(biased.depth_mm)
    true_m, told_m = measured.depth_mm[both] / 1000.0, biased.depth_mm[both] / 1000.0
    assert both.sum() > 1000
    assert biased.info.bias_per_m == 0.01
    np.testing.assert_allclose(told_m / (1.0 + 0.01 * told_m), true_m, atol=1e-3)
    np.testing.assert_array_equal(
        biased.depth_mm[~is_measured(measured.depth_mm)], measured.depth_mm[~is_measured(measured.depth_mm)]
    )


@pytest.mark.parametrize("number", [19, 62])
def test_no_free_cell_holds_what_is_measured_too_far(number: int) -> None:
    """Without the bias in the description of the camera, up to 16 cells do."""
    r = biased_frame(7, number)
    wrong, cells, valid, _ = free_campaign.judge(r, Extractor(Params()), False)
    assert valid
    assert cells > 0
    assert wrong == []
    unaware = replace(r, frame=replace(r.frame, info=replace(r.frame.info, bias_per_m=0.0)))
    assert free_campaign.judge(unaware, Extractor(Params()), False)[0]


def test_free_cells_of_a_world_in_a_solid_are_wrong_and_those_beside_it_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = np.array([[6.0, 0.0, -1.0], [4.8, 0.0, -1.0], [5.1, 0.0, -1.0], [6.0, 0.0, -3.5]])
    s = SceneBuilder("box")
    s.box("box", 6.0, 0.0, 2.0, 2.0, 3.0)
    first = random_frame(3, 0)
    frame = render(s.build(), INFO, position_ned_m=(0.0, 0.0, -2.0))
    flown = [free_worlds.Flown(frame, claiming(4.0))]
    monkeypatch.setattr(free_worlds, "flight", lambda *_: (flown, first.ke_per_m))
    monkeypatch.setattr(free_worlds, "_free_cells", lambda *_: points)
    wrong, cells, valid = free_worlds.judge_world(3, 0, Extractor(Params()))
    np.testing.assert_array_equal(wrong, points[:1])  # the third lies within the slack of its side
    assert (cells, valid) == (4, 1)
    # behind the box nothing was seen, above it all
    beyond = np.array([[7.5, 0.0, -1.0], [7.5, 0.0, -3.5]])
    monkeypatch.setattr(free_worlds, "_free_cells", lambda *_: beyond)
    np.testing.assert_array_equal(free_worlds.judge_world(3, 0, Extractor(Params()))[0], beyond[:1])
    monkeypatch.setattr(free_worlds, "_free_cells", lambda *_: points)
    # what the world answers counts, also below what a frame took for ground
    flown[0] = free_worlds.Flown(frame, claiming(4.0, ground=Ground(seen=True, height_m=0.8)))
    np.testing.assert_array_equal(free_worlds.judge_world(3, 0, Extractor(Params()))[0], points[:1])


def test_free_cells_that_no_frame_can_have_seen_are_wrong() -> None:
    """A wall of 0.25 m is thinner than the slack: nothing is deep in it. With left and right exchanged in all models, no cell of
    25 random worlds was found."""
    points = np.array([[4.9, 0.0, -1.0], [5.2, 0.0, -1.0], [6.0, 0.0, -1.0], [6.0, 3.5, -1.0], [6.0, 0.0, -4.5]])
    s = SceneBuilder("wall")
    s.wall("wall", (5.0, -2.0), (5.0, 2.0), 3.0)
    scene, slack = s.build(), np.full(len(points), SLACK_M)
    first = render(scene, INFO, position_ned_m=(0.0, 0.0, -2.0))
    assert not deep_in_solid(first, points, slack, 0.6).any()
    flown = [free_worlds.Flown(first, claiming(4.0))]
    assert free_worlds.out_of_sight(flown, points, slack, 0.6).tolist() == [False, False, True, False, False]
    beside = render(scene, INFO, position_ned_m=(5.5, 6.0, -2.0), yaw_rad=-1.5)
    assert not free_worlds.out_of_sight([*flown, free_worlds.Flown(beside, claiming(4.0))], points, slack, 0.6).any()
    # an invalid frame has seen nothing
    blind = free_worlds.Flown(beside, replace(claiming(4.0), valid=False))
    assert free_worlds.out_of_sight([*flown, blind], points, slack, 0.6).sum() == 1


def test_readers_are_not_judged_by_what_is_lower_than_a_pixel() -> None:
    """A box that enters a layer by 3 to 6 cm at 8.9 m, where a pixel is 7.9 cm high."""
    counts = judge_readers(random_frame(23, 16702), Extractor(Params()))
    assert counts.cells > 100
    assert counts.wrong_cells == 0


def answers(frame: Rendered, model: FrameModel, monkeypatch: pytest.MonkeyPatch) -> ReaderCounts:
    """Errors that the check of readers finds for this model of a frame."""
    with monkeypatch.context() as patch:
        patch.setattr(Extractor, "extract", lambda *_: (model, None))
        return judge_readers(replace(random_frame(3, 0), frame=frame), Extractor(Params()))


def test_readers_that_answer_free_in_a_solid_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    low, layer = view(box(0.0, 0.9)), (2,)  # z = 1.1..2 in z = 1..3
    found = answers(low, claiming(4.9, layer), monkeypatch)
    assert (found.cells, found.wrong_cells, found.wrong_points) == (24, 0, 0)
    assert found.points > 5
    found = answers(low, claiming(6.0, layer), monkeypatch)
    assert found.wrong_cells == 8
    assert found.deepest_m == pytest.approx(1.0, abs=0.1)
    # what a reader cuts at the ground is not answered free, and what it does not cut is
    assert (
        answers(low, claiming(6.0, layer, Ground(seen=True, height_m=1.3, tolerance_m=0.25)), monkeypatch).wrong_cells
        == 0
    )
    assert (
        answers(low, claiming(6.0, layer, Ground(seen=True, height_m=2.0, tolerance_m=0.25)), monkeypatch).wrong_cells
        == 8
    )
    far = claiming(8.0, (0, 1, 2))
    wide = SceneBuilder("wide")
    wide.box("wide", *ahead(8.0), 8.0, 40.0, 30.0, 0.4, -15.0)
    assert answers(view(wide), far, monkeypatch).wrong_points > 0


@pytest.mark.parametrize("number", [63, 240, 1256, 1325])
def test_no_free_cell_holds_the_edge_of_a_blank_thing_in_a_column_beside_it(number: int) -> None:
    """A roof, a pole and two boxes that cover a column of the view of which less than half lies in the cell."""
    wrong, cells, valid, _ = free_campaign.judge(blank_frame(43, number), Extractor(Params()), False)
    assert valid
    assert cells > 50
    assert wrong == []


@pytest.mark.parametrize(("seed", "number"), [(2811, 7), (2701, 597), (3306, 129)])
def test_no_free_cell_holds_the_edge_of_a_blank_thing_in_a_block_in_part(seed: int, number: int) -> None:
    """A box and a sphere of which three or four rows lie in the uppermost rows of a layer, and a wall of which one or two lie in the
    lowest rows, not in a whole block of columns."""
    wrong, cells, valid, _ = free_campaign.judge(blank_frame(seed, number), Extractor(Params()), False)
    assert valid
    assert cells > 50
    assert wrong == []


def test_no_free_cell_holds_the_side_of_a_blank_sphere() -> None:
    """A column of 20 unknown rows beside columns that hold a square of 32: it reaches 1.2 pixels into the cell."""
    wrong, cells, valid, _ = free_campaign.judge(blank_frame(3301, 104), Extractor(Params()), False)
    assert valid
    assert cells > 50
    assert wrong == []


def test_no_free_cell_holds_the_end_of_a_roof_that_is_seen_edge_on() -> None:
    """Its pixels were removed as flying ones: its last column is unknown but for near pixels without a plane."""
    r = random_frame(23, 7389)
    wrong, cells, valid, _ = free_campaign.judge(r, Extractor(Params()), False)
    assert valid
    assert cells > 100
    assert wrong == []
    assert judge_readers(r, Extractor(Params())).wrong_cells == 0


@pytest.mark.parametrize("number", [2655, 2800])
def test_no_sector_is_clear_with_a_box_beyond_the_border_of_the_image(number: int) -> None:
    """A box reaches 0.2 m into the height band where the camera, pitched by 11 and -16 degrees, does not see it."""
    assert free_worlds.judge_sectors(random_frame(23, number), Extractor(Params()))[0] == []


def test_a_solid_in_a_clear_sector_is_wrong() -> None:
    s = SceneBuilder("post")
    s.box("post", 5.0, 0.0, 0.4, 0.4, 6.0, base=-3.0)
    r = random_frame(3, 0)
    camera = replace(r.camera, info=INFO, measures=INFO)
    frame = camera.image(SceneBuilder("empty").build(), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0)
    far = replace(frame, depth_mm=np.full((120, 160), FAR_MM, np.uint16))

    class Staged:
        """A camera that delivers an empty sky, whatever stands before it."""

        info, sensor = INFO, r.camera.sensor

        def __init__(self, scene: Scene) -> None:
            self.scene = scene

        def image(self, *_: object) -> Rendered:
            return replace(far, scene=self.scene)

    for scene, wrong in ((SceneBuilder("empty").build(), []), (s.build(), [0])):
        staged = replace(r, frame=replace(far, scene=scene), camera=Staged(scene))  # type: ignore[arg-type]
        found, clear = free_worlds.judge_sectors(staged, Extractor(Params()))
        assert found == wrong
        assert clear >= 5


@pytest.mark.slow
def test_hard_views_show_their_things_and_no_free_or_open_cell_holds_one() -> None:
    """Each seventh frame; all of them: `campaign --hard`. What shows less than a pixel of itself is no case."""
    extractor, claimed, opened = Extractor(Params(), OpenSkyParams(mode="presume")), 0, 0
    assert len(list(hard_views())) >= 50
    for r in list(hard_frames(1))[::7]:
        label = r.frame.truth.label(r.frame.scene)
        assert {n for n in r.frame.scene.names if n != "wall"} <= {
            r.frame.scene.names[i] for i in np.unique(label) if i >= 0
        }
        wrong, cells, valid, _ = free_campaign.judge(r, extractor, False)
        assert valid
        assert wrong == []
        claimed += cells
        opened += bool(extractor.extract(r.frame.depth_mm, r.frame.info, r.frame.R_level_optical)[0].free.has_open)
    assert claimed > 1000
    assert opened > 3


@pytest.mark.soak
def test_twenty_thousand_random_frames_and_the_matrix_call_nothing_solid_free() -> None:
    assert (
        free_campaign.main(
            [
                "--frames",
                "20000",
                "--matrix",
                "--worlds",
                "500",
                "--sectors",
                "5000",
                "--readers",
                "20000",
                "--seed",
                "23",
            ]
        )
        == 0
    )


def test_a_short_campaign_finds_nothing_and_a_planted_claim_fails_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert free_campaign.main(["--frames", "60", "--seed", "7"]) == 0
    counts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert counts["frames"] == 60
    assert counts["cells"] > 1000
    whole = free_campaign.Extractor.extract

    def reaching_too_far(self, *arguments, **more):  # type: ignore[no-untyped-def]
        model, state = whole(self, *arguments, **more)
        return replace(model, free=replace(model.free, free_to_m=model.free.free_to_m * np.float32(1.5))), state

    monkeypatch.setattr(free_campaign.Extractor, "extract", reaching_too_far)
    assert free_campaign.main(["--frames", "20", "--seed", "7"]) == 1
    out = capsys.readouterr().out.splitlines()
    assert json.loads(out[-1])["wrong"] > 0
    assert out[0].startswith("random ")

    def claiming_nothing(self: Extractor, *arguments: Any, **more: Any) -> tuple[FrameModel, ExtractorState]:
        model, state = whole(self, *arguments, **more)
        return replace(model, free=replace(model.free, free_to_m=0.0 * model.free.free_to_m)), state

    monkeypatch.setattr(free_campaign.Extractor, "extract", claiming_nothing)
    assert free_campaign.main(["--frames", "20", "--seed", "7"]) == 1
    assert "frames: nothing was called free" in capsys.readouterr().out
