"""Free, occupied, unknown: exact queries compared with dense sampling; unobserved space is never free."""

from __future__ import annotations

import math
import textwrap
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.params import Params
from core.stages.model import blind_model
from core.types import CameraInfo, FrameModel, FreeEnd, FreeProfile, Intrinsics, InvalidCause
from osape_client.query.rectangles import Rectangles, between_segments, rectangles
from osape_client.query.space import Occupancy, PlacedModel, Space, balls_free
from osape_client.world.snapshot import WorldSnapshot
from osape_client.world.space import WorldSpace

from ..conftest import CHECKOUT

SEED = st.integers(0, 2**32 - 1)
INFO = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5))
HERE = (0.0, 0.0, 0.0)


def profile(free_from: float, free_to: float, view_deg: float = 80.0, around_deg: float = 0.0) -> FreeProfile:
    edges = np.radians(np.linspace(around_deg - view_deg / 2, around_deg + view_deg / 2, 17)).astype(np.float32)
    return FreeProfile(
        azimuth_edges_rad=edges,
        layer_edges_m=np.array([-3.0, -1.0, 1.0, 3.0], np.float32),
        free_from_m=np.full((16, 3), free_from, np.float32),
        free_to_m=np.full((16, 3), free_to, np.float32),
        end=np.full((16, 3), FreeEnd.MAX_RANGE, np.uint8),
    )


def model(*planes: tuple[float, ...], margin: float = 0.0, free: FreeProfile | None = None) -> FrameModel:
    n = len(planes)
    return replace(
        blind_model(INFO, InvalidCause.NONE, Params()),
        valid=True,
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.ones(n, np.int32),
        margin_m=np.full(n, margin, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
        free=profile(0.0, 0.0) if free is None else free,
    )


def some_planes(rng: np.random.Generator, n: int) -> np.ndarray:
    xy = rng.uniform(-6.0, 6.0, (n, 4))
    top = rng.uniform(-4.0, 2.0, n)
    return np.column_stack([xy, top, top + rng.uniform(0.1, 4.0, n)])


def sampled_distance(plane: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """From a way to a rectangle, by points all along the way: too great by no more than half of their step.

    A rectangle stands upright: the nearest of it to a point is found along its foot and along its height apart.
    """
    way = a + np.linspace(0, 1, 401)[:, None] * (b - a)
    foot, along = plane[:2], plane[2:4] - plane[:2]
    share = np.clip((way[:, :2] - foot) @ along / (along @ along), 0, 1)
    aside = way[:, :2] - (foot + share[:, None] * along)
    above = way[:, 2] - np.clip(way[:, 2], plane[4], plane[5])
    return float(np.sqrt((aside**2).sum(axis=1) + above**2).min())


# ---- distances --------------------------------------------------------------------------------------------------------


@given(SEED)
def test_distances_against_points_all_over_both(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plane, a, b = some_planes(rng, 1), rng.uniform(-6, 6, (1, 3)), rng.uniform(-6, 6, (1, 3))
    found = rectangles(plane, np.zeros(1))._distance(a, b, np.zeros(1, np.intp))[0]
    sampled = sampled_distance(plane[0], a[0], b[0])
    assert found <= sampled + 1e-9
    assert sampled - found < 0.04


@given(SEED)
def test_segments_that_are_parallel_short_or_crossing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, u = rng.normal(size=(1, 3)), rng.normal(size=(1, 3))
    beside = np.cross(u, rng.normal(size=(1, 3)))
    beside /= np.linalg.norm(beside)
    assert between_segments(a, a + u, a + beside, a + u + beside)[0] == pytest.approx(1.0)
    assert between_segments(a, a, a + beside, a + beside)[0] == pytest.approx(1.0)
    middle = a + 0.3 * u
    assert between_segments(a, a + u, middle - beside, middle + beside)[0] == pytest.approx(0.0, abs=1e-7)


# ---- occupied ---------------------------------------------------------------------------------------------------------


@given(SEED, st.sampled_from([0.0, 0.3, 1.0]))
def test_many_ways_among_many_planes_against_each_alone(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    planes = some_planes(rng, 12)
    space = Space([PlacedModel(model(*planes, margin=0.1), HERE)])
    a, b = rng.uniform(-8, 8, (40, 3)), rng.uniform(-8, 8, (40, 3))
    answers = space.segments(a, b, radius)
    for i in range(40):
        sampled = min(sampled_distance(plane, a[i], b[i]) for plane in planes)
        if sampled <= radius + 0.1:
            assert answers[i] == Occupancy.OCCUPIED
        elif sampled > radius + 0.1 + 0.04:
            assert answers[i] == Occupancy.UNKNOWN


@given(SEED)
def test_the_nearest_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    planes, p = some_planes(rng, 6), rng.uniform(-8, 8, (5, 3))
    distance, towards, number = Space([PlacedModel(model(*planes), HERE)]).nearest(p)
    for i in range(5):
        each = [sampled_distance(plane, p[i], p[i]) for plane in planes]
        assert distance[i] <= min(each) + 1e-6
        assert distance[i] == pytest.approx(min(each), abs=1e-6)
        foot = p[i] + distance[i] * towards[i]
        assert sampled_distance(planes[number[i]], foot, foot) < 1e-6


def test_nothing_there() -> None:
    distance, towards, number = Space([]).nearest([1.0, 2.0, 3.0])
    assert (distance[0], number[0], towards.tolist()) == (math.inf, -1, [[0.0, 0.0, 0.0]])
    assert not Space([]).knows
    assert Space([]).points(np.zeros((0, 3))).shape == (0,)
    assert Space([]).segments([0, 0, 0], [9, 0, 0]).tolist() == [Occupancy.UNKNOWN]


# ---- free and unknown -------------------------------------------------------------------------------------------------


def test_a_wall_the_free_space_before_it_and_the_unknown_behind() -> None:
    wall = (8.0, -6.0, 8.0, 6.0, -3.0, 3.0)
    space = Space([PlacedModel(model(wall, margin=0.2, free=profile(1.0, 7.5)), HERE)])
    assert space.points([[5, 0, 0], [7.9, 0, 0], [9, 0, 0], [0.5, 0, 0], [0, 5, 0]]).tolist() == [
        Occupancy.FREE,
        Occupancy.OCCUPIED,
        Occupancy.UNKNOWN,
        Occupancy.UNKNOWN,
        Occupancy.UNKNOWN,
    ]
    assert space.points([[7.0, 0, 0]], 0.4).tolist() == [Occupancy.FREE]
    assert space.points([[7.0, 0, 0]], 0.6).tolist() == [Occupancy.UNKNOWN]
    assert space.points([[7.0, 0, 0]], 0.8).tolist() == [Occupancy.OCCUPIED]
    ways = space.segments([[2, 0, 0]] * 4, [[6, 1, 0], [9, 0, 0], [2, 9, 0], [6, 1, -3.5]], 0.3)
    assert ways.tolist() == [Occupancy.FREE, Occupancy.OCCUPIED, Occupancy.UNKNOWN, Occupancy.UNKNOWN]


def printed_by_the_guide(space: Space, capsys: pytest.CaptureFixture[str]) -> str:
    """The output of the code in the guide for planners that asks how far it is free ahead."""
    guide = CHECKOUT / "docs" / "how-to" / "write-a-planner-client.md"
    section = guide.read_text(encoding="utf-8").split("### How far is it free ahead?")[1].split("###")[0]
    code = "\n".join(line for line in section.splitlines() if line.startswith("    "))
    content = SimpleNamespace(transform=SimpleNamespace(yaw_rad=0.0))
    exec(textwrap.dedent(code), {"message": SimpleNamespace(content=content, space=space), "at_m": HERE})
    return capsys.readouterr().out


def test_the_guide_finds_how_far_it_is_free_ahead(capsys: pytest.CaptureFixture[str]) -> None:
    wall, pole = (8.0, -6.0, 8.0, 6.0, -3.0, 3.0), (4.0, -0.1, 4.0, 0.1, -3.0, 3.0)
    free = profile(1.0, 7.5)
    before_a_wall = Space([PlacedModel(model(wall, margin=0.2, free=free), HERE)])
    before_a_pole = Space([PlacedModel(model(wall, pole, margin=0.2, free=free), HERE)])
    assert printed_by_the_guide(before_a_wall, capsys) == "free from 1.6 to 6.9 m\n"
    assert printed_by_the_guide(before_a_pole, capsys) == "free from 1.6 to 3.2 m\n"
    assert printed_by_the_guide(Space([PlacedModel(model(wall), HERE)]), capsys) == ""
    assert printed_by_the_guide(Space([]), capsys) == ""


@given(SEED)
def test_a_free_ball_has_free_points_only(seed: int) -> None:
    """Every point of a ball that is called free is free by itself, wherever the camera stands and looks."""
    rng = np.random.default_rng(seed)
    free = profile(0.5, 6.0, 80.0, float(rng.uniform(-360, 360)))
    holes = rng.random((16, 3)) < 0.1
    free = replace(free, free_to_m=np.where(holes, 0.0, free.free_to_m).astype(np.float32))
    place = tuple(rng.uniform(-2, 2, 3))
    p, radius = rng.uniform(-6, 6, (60, 3)), rng.uniform(0.05, 0.8, 60)
    called = balls_free(free, place, p, radius)
    inside = rng.normal(size=(200, 3))
    inside *= (rng.random(200) ** (1 / 3) / np.linalg.norm(inside, axis=1))[:, None]
    for i in np.flatnonzero(called):
        assert balls_free(free, place, p[i] + 0.999 * radius[i] * inside, np.zeros(200)).all()


def test_blind_parts_free_nothing_and_keep_no_planes() -> None:
    blind = replace(model((8.0, -6.0, 8.0, 6.0, -3.0, 3.0), free=profile(1.0, 7.5)), valid=False)
    space = Space([PlacedModel(blind, HERE)])
    assert not space.knows
    assert space.points([[5, 0, 0], [8, 0, 0]]).tolist() == [Occupancy.UNKNOWN] * 2


def test_an_obstacle_of_one_camera_outranks_what_another_calls_free() -> None:
    seen = PlacedModel(model(free=profile(1.0, 7.5)), HERE)
    other = PlacedModel(model((5.0, -1.0, 5.0, 1.0, -1.0, 1.0)), (0.0, 1.0, 0.0))
    assert Space([seen]).points([[5, 0, 0]]).tolist() == [Occupancy.FREE]
    assert Space([seen, other]).points([[5, 0, 0]]).tolist() == [Occupancy.OCCUPIED]


def test_what_is_no_number_may_not_be_passed() -> None:
    space = Space([PlacedModel(model(free=profile(1.0, 7.5)), HERE)])
    assert space.points([[math.nan, 0, 0], [5, 0, 0]]).tolist() == [Occupancy.OCCUPIED, Occupancy.FREE]
    assert space.segments([[5, 0, 0]], [[math.inf, 0, 0]]).tolist() == [Occupancy.OCCUPIED]


def test_from_what_is_no_position_nothing_is_far() -> None:
    """Without planes the distance was infinite."""
    points = [[math.nan, 0.0, 0.0], [0.0, math.inf, 0.0], [0.0, 0.0, 1e10], [0.0, 0.0, 0.0]]
    for space in (Space([]), WorldSpace(WorldSnapshot.empty())):
        assert space.nearest(points)[0].tolist() == [0.0, 0.0, 0.0, math.inf]


def test_many_planes_are_looked_at_with_few_ways_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """2048 ways were compared with all planes: with those of the largest message in 8 GB."""
    rng, pairs = np.random.default_rng(2), []
    boxes = rng.uniform(-9, 9, (40, 6))
    boxes[:, 5] = boxes[:, 4] + 1.0
    several, a = rectangles(boxes, np.full(40, 0.1)), rng.uniform(-9, 9, (300, 3))
    expected, near = several.touch(a, a + 1.0, 0.3), Rectangles._near

    def counted(self: Rectangles, a: NDArray[np.float64], b: NDArray[np.float64], radius_m: float) -> object:
        pairs.append(len(a) * len(self.corner))
        return near(self, a, b, radius_m)

    monkeypatch.setattr(Rectangles, "_near", counted)
    for most in (1, 200, 1 << 20):
        monkeypatch.setattr("osape_client.query.rectangles._MOST_PAIRS", most)
        pairs.clear()
        assert several.touch(a, a + 1.0, 0.3).tolist() == expected.tolist()
        assert max(pairs) <= max(most, 40)


def test_wrong_shapes() -> None:
    with pytest.raises(ValueError, match=r"expected \(M, 3\)"):
        Space([]).points(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="as many of each"):
        Space([]).segments(np.zeros((4, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize("radius", [-1.0, -1e-9, math.nan, math.inf])
def test_a_radius_that_is_none_is_refused(radius: float) -> None:
    for space in (Space([PlacedModel(model(free=profile(1.0, 7.5)), HERE)]), Space([])):
        with pytest.raises(ValueError, match="radius_m = "):
            space.points([[5, 0, 0]], radius)
        with pytest.raises(ValueError, match="radius_m = "):
            space.segments([[5, 0, 0]], [[6, 0, 0]], radius)


@pytest.mark.parametrize("radius", [1e20, 1e39, 1e300])
@pytest.mark.filterwarnings("error")
def test_a_ball_of_any_size_touches_without_a_warning(radius: float) -> None:
    space = Space([PlacedModel(model((5.0, -1.0, 5.0, 1.0, -1.0, 1.0)), HERE)])
    assert space.points([[0, 0, 0]], radius).tolist() == [Occupancy.OCCUPIED]
    assert space.segments([[0, 0, 0]], [[1e9, 0, 0]], radius).tolist() == [Occupancy.OCCUPIED]


@pytest.mark.parametrize("far", [2e5, 1e9, 1e300])
def test_a_way_far_beyond_what_is_known_is_not_free(far: float) -> None:
    """Its chain of balls is never made: 1e9 m would take 10,000,000,000 of them."""
    for reach in (7.5, math.inf):
        space = Space([PlacedModel(model(free=profile(1.0, reach)), HERE)])
        assert Occupancy.FREE not in space.segments([[5, 0, 0]], [[far, 0, 0]], 0.2)


def test_many_ways_are_looked_at_a_part_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    space = Space([PlacedModel(model(free=profile(1.0, 7.5)), HERE)])
    rng = np.random.default_rng(1)
    a, b = rng.uniform(-8, 8, (200, 3)), rng.uniform(-8, 8, (200, 3))
    a[:, 2], b[:, 2] = 0.0, 0.0
    together = space.segments(a, b, 0.1)
    assert set(together.tolist()) == {Occupancy.FREE, Occupancy.UNKNOWN}
    monkeypatch.setattr("osape_client.query.ways.MOST_BALLS", 7)
    assert space.segments(a, b, 0.1).tolist() == together.tolist()
