"""What holds the merged world against the truth: its own geometry, its flights, its tables."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper.cases import EXACT
from benchmarks.world.cost import AREA_M2, SIZES, Cost, saved
from benchmarks.world.flights import (
    CONDITION,
    DRIFTING,
    ESTIMATES,
    NOISY,
    TRUE,
    Flight,
    flights,
    flown,
    frame,
    judged,
    renderings,
)
from benchmarks.world.message_bytes import Bytes, grid_bytes
from benchmarks.world.section import bytes_table, cost_table, truth_table
from benchmarks.world.truth import Verdict, could_see, in_level, merged, seen_by, to_ned, verdict
from drivers.simulation.scenes import SceneBuilder

WALL = SceneBuilder("wall")
WALL.ground()
WALL.box("wall", 6.0, 0.0, 0.5, 6.0, 4.0, 0.0)
SCENE = WALL.build()
AHEAD = frame(SCENE, (0.0, 0.0, -2.0, 0.0, 0.0), EXACT, 0, 0)
ASIDE = frame(SCENE, (6.0, -9.0, -2.0, math.pi / 2, 0.1), EXACT, 0, 0)


def test_there_and_back_between_the_frames() -> None:
    for view in (AHEAD, ASIDE):
        rng = np.random.default_rng(1)
        planes = np.column_stack([rng.normal(size=(5, 4)) * 5.0, np.full(5, -4.0), np.zeros(5)])
        level = in_level(planes, view)
        for side in (slice(0, 2), slice(2, 4)):
            back = to_ned(view, np.column_stack([level[:, side], level[:, 4]]))
            assert np.allclose(back, np.column_stack([planes[:, side], planes[:, 4]]))


def test_true_points_in_ned_lie_on_the_wall() -> None:
    hit = AHEAD.truth.obstacle(0.6)
    points = to_ned(AHEAD, AHEAD.truth.points_level_cam_m[hit])
    assert np.allclose(points[:, 0], 5.75, atol=1e-6)


def test_seen_is_what_stood_in_sight() -> None:
    points = np.array([[5.75, 0.0, -2.0], [6.25, 0.0, -2.0], [6.0, -3.0, -2.0], [40.0, 0.0, -5.0]])
    assert seen_by(points, [AHEAD], least=1).tolist() == [True, False, False, False]  # the back, the edge, beyond
    assert seen_by(points, [ASIDE], least=1).tolist() == [False, False, True, False]
    assert not seen_by(points, [AHEAD, ASIDE], least=2).any()
    assert seen_by(points, [AHEAD, AHEAD], least=2)[0]


def test_a_place_is_unseen_where_no_frame_can_have_seen_it() -> None:
    points = np.array([[5.0, 0.0, -2.0], [6.0, 0.0, -2.0], [7.0, 0.0, -2.0], [7.0, 0.0, -5.0], [-1.0, 0.0, -2.0]])
    assert could_see(points, [AHEAD]).tolist() == [True, True, False, True, False]
    beyond = frame(SCENE, (12.0, 0.0, -2.0, math.pi, 0.0), EXACT, 0, 0)
    assert could_see(points, [AHEAD, beyond]).tolist() == [True, True, True, True, False]


def test_a_world_that_calls_everything_free_is_found() -> None:
    """Its free cells behind a wall, which nothing has seen, are counted: points on the wall are occupied by its planes."""
    flight = Flight(
        name="wall",
        scene=SCENE,
        way=tuple((0.2 * k, 0.0, -2.0, 0.0, 0.0) for k in range(6)),
        judged=((0.5, 0.4, -2.2, 0.0, 0.0),),
    )
    rendered, views = renderings(flight, EXACT, 0), judged(flight, 0)
    m = merged(flight, TRUE, 0, rendered)
    assert verdict(flight, TRUE, m, rendered, views).unseen_free == 0.0
    with pytest.MonkeyPatch.context() as patch:
        picture = m.world.picture(m.newest_ns)
        everywhere = np.full_like(picture.masks, np.iinfo(np.uint64).max)
        patch.setattr(m.world, "picture", lambda _: replace(picture, masks=everywhere))
        found = verdict(flight, TRUE, m, rendered, views)
    assert found.false_free == 0.0
    assert found.unseen_free > 0.5


def test_every_flight_is_evaluated_from_new_places_and_has_obstacles_in_view() -> None:
    found = flights(0)
    assert [f.name for f in found] == ["block", "alley", "trees", "cylinder", "trapezoidal prism", "sphere"]
    for f in found:
        way = np.array(f.way)[:, :3]
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        assert np.median(steps) < 0.7
        for pose in f.judged:
            assert np.linalg.norm(way - np.array(pose[:3]), axis=1).min() > 0.2
        if f.inside is not None:
            x, y, _ = f.around
            assert f.inside(np.array([[x, y, -1.5]])).tolist() == [True]
            assert not f.inside(np.array([[x + 9.0, y, -1.5], [x, y + 6.5, -1.5], [x, y, -9.0]])).any()


def test_errors_of_estimates_match_their_sigmas() -> None:
    flight = flights(0)[3]
    rendered = [AHEAD, AHEAD, ASIDE]
    true, noisy, drifting = (list(flown(flight, e, 3, rendered)) for e in (TRUE, NOISY, DRIFTING))
    assert all(np.array_equal(s.place_m, s.rendered.position_ned_m) and not s.drift_m.any() for s in true)
    off = [np.linalg.norm(s.place_m - s.rendered.position_ned_m) for s in noisy]
    assert 0.0 < max(off) < 0.3
    assert not any(s.drift_m.any() for s in noisy)
    jump = np.linalg.norm(AHEAD.position_ned_m - ASIDE.position_ned_m)
    assert np.linalg.norm(drifting[2].drift_m - drifting[1].drift_m) == pytest.approx(0.01 * jump)
    again = list(flown(flight, NOISY, 3, rendered))
    assert all(np.array_equal(a.place_m, b.place_m) for a, b in zip(noisy, again, strict=True))


def test_worlds_of_any_size_are_alike_nearby() -> None:
    small, large = saved(SIZES[0], 1), saved(5000, 1)
    middle = 0.5 * (large.box[:, :2] + large.box[:, 2:4])
    assert np.allclose(middle[:1000], 0.5 * (small.box[:, :2] + small.box[:, 2:4]))
    inner = 0.5 * math.sqrt(SIZES[0] * AREA_M2)
    assert len(middle) == 5000
    assert (np.abs(middle[1000:]).max(axis=1) > inner).all()


def test_a_box_of_cells_is_four_corners_and_one_polygon_a_layer() -> None:
    x, y, z = np.meshgrid(np.arange(4.05, 5.0, 0.1), np.arange(0.05, 1.0, 0.1), [-0.5, -1.0, -1.5])
    points = np.repeat(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), 400, axis=0)
    assert grid_bytes([points, points], [AHEAD, AHEAD], 0.2) == 4 * 8 + 8
    assert grid_bytes([points], [AHEAD], 0.2) == 0  # one frame alone is noise
    assert grid_bytes([np.zeros((0, 3))], [AHEAD], 0.2) == 0


@pytest.mark.parametrize("name", [pytest.param("block", marks=pytest.mark.slow), "cylinder"])
def test_what_is_flown_around_becomes_solid_and_nothing_of_it_is_missed(name: str) -> None:
    """A sixth of a flight's frames, with noise, a camera's faults and an error of the pose."""
    flight = next(f for f in flights(0) if f.name == name)
    flight = replace(flight, way=flight.way[:: 6 if name == "block" else 2][:60], judged=flight.judged[:2])
    rendered = renderings(flight, CONDITION, 0)
    found = verdict(flight, NOISY, merged(flight, NOISY, 0, rendered), rendered, judged(flight, 0))
    assert found.closed > 0.95
    assert found.missed < 0.01
    assert found.phantom < 0.02
    assert found.false_free == 0.0
    assert found.unseen_free == 0.0
    assert found.mean_m < 0.12
    assert found.planes < 20 < found.frame_planes


def test_tables_show_the_worst_value_and_missing_ones() -> None:
    one = {
        "flight": "alley", "frames": 9, "closed": math.nan, "missed": 0.01, "missed_all": 0.02, "phantom": 0.0, "mean_m": 0.1,
        "p95_m": 0.2, "false_free": 0.0, "unseen_free": math.nan, "air": 0.5, "planes": 7, "frame_planes": 30, "sections": 1,
    }  # fmt: skip
    rows = [Verdict(**one, estimate=e.name) for e in ESTIMATES] + [
        Verdict(**(one | {"missed": 0.5, "unseen_free": 0.25}), estimate=e.name) for e in ESTIMATES
    ]
    table = truth_table(rows)
    assert len(table.strip().splitlines()) == 2 + len(ESTIMATES)
    assert "| alley | true pose | - | 50.0 % | 2.0 % |" in table
    assert "| 0.00 % | 25.00 % | 50 % |" in table  # a figure that one seed does not have
    cost = [
        Cost(planes=n, add_ms=0.2 * k, p99_ms=1.0, changes_ms=0.1, memory_bytes=160.0)
        for k, n in ((1, 1000), (2, 10000))
    ]
    assert "| 10,000 | 0.400 | 1.00 | 2.00 | 0.100 | 160 |" in cost_table(cost)
    size = Bytes(
        flight="alley",
        frames=10,
        planes=7,
        disk=400,
        stream=9000,
        stream_planes=3000,
        grids={0.1: 4, 0.2: 3, 0.4: 2, 0.8: 1},
        octomap=None,
        octomap_free=None,
    )
    assert "| 900 | 4 | 3 | 2 | 1 | not installed | not installed |" in bytes_table([size])
