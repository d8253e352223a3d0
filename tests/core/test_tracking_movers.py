"""Moving obstacles: declared with support only, with a velocity near the truth; static scenes have none."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from core.free_view import FreeView, free_view
from core.tracking.groups import GROUP, find_groups
from core.tracking.objects import OBJECT, assign_groups, turn_covariance
from core.tracking.observed import measured_limits
from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tables import detections_of
from core.tracking.tracker import Tracker

from .tracked import SMALL, STEP, distance, frame, without_position
from .worlds import NS, blind, wall

BACK = wall(14.0, -14.0, 14.0, 14.0)


def face(x: float, y: float, width: float = 0.5, top: float = -1.0, bottom: float = 1.0) -> list[float]:
    """The face of a person or a car towards a camera that looks along x."""
    return wall(x, y - width / 2, x, y + width / 2, top, bottom)


def follow(place: Callable[[float], list[list[float]]], frames: int, **how: object) -> tuple[Tracker, TrackSnapshot]:
    """A tracker after frames of obstacles that `place` gives for each time, before a wall."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(4)
    for k in range(frames):
        s = tracker.observe(frame([*place(0.1 * k), BACK], k, rng=rng, **how))  # type: ignore[arg-type]
    return tracker, s


@pytest.mark.parametrize(
    ("x", "y", "vx", "vy"), [(5.0, -1.0, 0.0, 1.5), (9.0, 2.0, 0.0, -1.5), (8.5, 0.0, -1.5, 0.0), (3.5, 0.3, 1.5, 0.3)]
)
def test_a_person_is_moving_within_a_second(x: float, y: float, vx: float, vy: float) -> None:
    _, s = follow(lambda t: [face(x + vx * t, y + vy * t)], 11)
    assert len(s.objects) == 1
    o = s.objects[0]
    assert math.hypot(o.velocity_m_s[0] - vx, o.velocity_m_s[1] - vy) < 0.3
    assert math.hypot(o.centre_m[0] - (x + vx), o.centre_m[1] - (y + vy)) < 0.15
    assert o.velocity_sigma_m_s < 0.4
    assert (s.object_id == o.id).sum() >= 1
    wall_rows = s.planes[:, [0, 2]].min(axis=1) > 13.0
    assert (s.object_id[wall_rows] == 0).all()


@pytest.mark.nojit
def test_a_car_at_eight_metres_a_second() -> None:
    _, s = follow(lambda t: [face(10.0, -5.0 + 8.0 * t, width=1.8)], 11)
    assert len(s.objects) == 1
    assert math.hypot(s.objects[0].velocity_m_s[0], s.objects[0].velocity_m_s[1] - 8.0) < 0.8


def test_a_mover_leaves_no_trail_for_longer_than_half_a_second() -> None:
    _, s = follow(lambda t: [face(6.0, -2.5 + 1.5 * t)], 31)
    here = -2.5 + 1.5 * 3.0
    assert distance(s, 6.0, here) < 0.2
    assert distance(s, 6.0, here - 0.5 - 1.5 * 0.5 - 0.3) > 0.2
    assert len(s.ids) <= 4


@pytest.mark.nojit
def test_a_mover_that_stops_is_static_again() -> None:
    _, s = follow(lambda t: [face(6.0, -1.5 + 1.5 * min(t, 1.2))], 40)
    assert s.objects == ()


@pytest.mark.parametrize("seed", [1, 2])
def test_static_obstacles_do_not_move_under_pose_errors(seed: int) -> None:
    """Drift of 1 % of the way, a yaw error that swings by 1 degree, vibration of 0.03 m."""
    rng = np.random.default_rng(seed)
    posts = [face(4.0 + 2.0 * i, -3.0 + 1.7 * i, 0.4) for i in range(4)] + [BACK]
    tracker, movers = Tracker(SMALL), 0
    for k in range(60):
        t = 0.1 * k
        shake = rng.normal(0.0, 0.03, 2)
        yaw = math.radians(1.0) * math.sin(math.tau * 0.7 * t)
        at = (0.8 * t, 0.2 * math.sin(t))
        f = frame(posts, k, at=at, rng=rng)
        c, s = math.cos(yaw), math.sin(yaw)
        rotated = f.model.planes.copy()
        for i in (0, 2):
            x, y = f.model.planes[:, i] - at[0], f.model.planes[:, i + 1] - at[1]
            rotated[:, i] = at[0] + c * x - s * y + shake[0] + 0.008 * t
            rotated[:, i + 1] = at[1] + s * x + c * y + shake[1]
        snapshot = tracker.observe(with_planes(f, rotated))
        movers += len(snapshot.objects)
    assert movers == 0


def with_planes(f: TrackingFrame, planes: np.ndarray) -> TrackingFrame:
    return dataclasses.replace(f, model=dataclasses.replace(f.model, planes=planes.astype(np.float32)))


@pytest.mark.nojit
def test_flicker_is_no_motion() -> None:
    """Pieces of a bush that come and go at random."""
    rng = np.random.default_rng(9)
    tracker = Tracker(SMALL)
    for k in range(60):
        pieces = [face(*(np.array([6.0, 0.0]) + rng.normal(0.0, 0.4, 2)), 0.3) for _ in range(3)]
        assert tracker.observe(frame([*pieces, BACK], k)).objects == ()


def test_a_gap_in_time_ends_objects() -> None:
    tracker, s = follow(lambda t: [face(6.0, -1.5 + 1.5 * t)], 12)
    assert len(s.objects) == 1
    late = frame([face(6.0, 2.0), BACK], 12)
    s = tracker.observe(
        TrackingFrame(
            model=late.model, camera_m=late.camera_m, t_ns=12 * STEP + NS, positioned=True, origin_m=late.origin_m
        )
    )
    assert s.objects == ()


def noisy(f: TrackingFrame, ke_per_m: float) -> TrackingFrame:
    """The frame of a camera with this range noise: the free-space comparison demands more."""
    return dataclasses.replace(f, model=dataclasses.replace(f.model, ke_per_m=ke_per_m))


@pytest.mark.nojit
@pytest.mark.parametrize(("x", "vx"), [(9.0, -1.5), (4.0, 1.5)])
def test_a_person_on_the_viewing_ray_is_moving_in_a_noisy_camera(x: float, vx: float) -> None:
    """The place of 0.35 s ago is within the noise of the present one; that of 1 to 2 s ago is not."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(4)
    for k in range(21):
        f = frame([face(x + 0.1 * k * vx, 0.0), BACK], k, rng=rng, sigma_m=0.05)
        s = tracker.observe(noisy(f, 0.005))
    assert len(s.objects) == 1
    assert abs(s.objects[0].velocity_m_s[0] - vx) < 0.3
    assert abs(s.objects[0].velocity_m_s[1]) < 0.3


@pytest.mark.nojit
def test_fragments_that_flash_beside_a_person_do_not_end_its_motion() -> None:
    """A fragment seen once has no velocity, so that its place is uncertain: it must not take the person's detections."""
    rng = np.random.default_rng(8)
    found = []
    tracker = Tracker(SMALL)
    for k in range(40):
        x, y = 6.0, -3.0 + 0.15 * k
        flash = [face(x + 0.7, y + rng.uniform(-0.9, 0.9), 0.2)] if k % 3 == 0 else []
        found.append(tracker.observe(frame([face(x, y), *flash, BACK], k, rng=rng)).objects)
    assert all(len(objects) == 1 for objects in found[12:])
    assert len({objects[0].id for objects in found[12:]}) == 1


def rows_of(walls: list[list[float]], flags: list[int]) -> np.ndarray:
    """(N,) DETECTION."""
    n = len(walls)
    planes = np.array(walls, np.float32)
    return detections_of(planes, np.full(n, 0.1, np.float32), np.array(flags, np.uint8), np.zeros(n, np.int32))


def groups_of(detections: np.ndarray, view_rad: float = 0.7) -> np.ndarray:
    """The groups that a camera at the origin sees, whose measured directions reach to both sides by view_rad."""
    near, far, end = np.zeros((1, 1), np.float32), np.ones((1, 1), np.float32), np.zeros((1, 1), np.uint8)
    edges, layers = np.array([-view_rad, view_rad]), np.array([-9.0, 9.0])
    view = FreeView(0.0, 0.0, 0.001, edges, layers, near, far, end, math.inf, 0.0, 0.0, 0.0, 0.0)
    groups = np.zeros(8, GROUP)
    return groups[: find_groups(detections, view, groups)]


def test_a_group_takes_the_object_whose_place_is_known_best() -> None:
    """An object seen once, nearer as a share of its own wide gate, does not take the group of one that is followed."""
    objects = np.zeros(2, OBJECT)
    for o, y, variance in zip(objects, (0.12, 0.3), (0.01, 1.0), strict=True):
        o["hits"], o["x_m"], o["y_m"], o["size_m"], o["top_m"], o["bottom_m"] = 5, 6.0, y, 0.5, -1.0, 1.0
        o["r00"] = o["t00"] = variance
    groups = groups_of(rows_of([face(6.0, 0.0)], [2]))
    assign_groups(groups, objects)
    assert groups[0].object == 0


@pytest.mark.nojit
def test_a_filled_gap_does_not_join_a_car_and_a_pole() -> None:
    car, gap, pole = face(8.0, 0.0, 1.8), wall(8.0, 0.9, 8.0, 2.2, -1.0, 1.0), face(8.0, 2.3, 0.2)
    assert len(groups_of(rows_of([car, pole], [2, 2]))) == 2
    assert len(groups_of(rows_of([car, gap, pole], [2, 1, 2]))) == 2
    assert len(groups_of(rows_of([car, gap, pole], [2, 3, 2]))) == 1, "a gap that hides what is behind it is a surface"


def test_what_follows_a_car_is_the_middle_of_the_face_towards_the_camera() -> None:
    """Neither its roof behind the face, nor its side that is seen edge-on, moves the place."""
    front = face(8.0, 0.0, 1.8, -1.4, 0.0)
    alone = groups_of(rows_of([front], [2]))[0]
    roof = wall(8.2, -0.7, 10.0, 0.9, -1.45, -1.3)
    side = wall(11.9, -0.9, 8.0, -0.9, -1.4, 0.0)
    whole = groups_of(rows_of([front, roof, side], [2, 2, 2]))
    assert len(whole) == 1
    assert (whole[0].x_m, whole[0].y_m) == pytest.approx((alone.x_m, alone.y_m), abs=0.02)
    assert alone.x_m == pytest.approx(8.0)


@pytest.mark.parametrize(("y", "moves"), [(0.0, True), (4.6, False), (-4.6, False)])
def test_a_group_at_the_border_of_the_measured_directions_is_cut(y: float, moves: bool) -> None:
    """The left border of a stereo image is not measured: planes end there without a flag."""
    group = groups_of(rows_of([face(8.0, y, 2.0)], [2]), view_rad=math.atan2(5.6, 8.0))[0]
    assert bool(group.plane_flags & 12) != moves


@pytest.mark.nojit
def test_views_without_a_free_range_limit_everything() -> None:
    tracker = Tracker(SMALL)
    f = frame([face(6.0, 0.0)], 0)
    far = np.zeros_like(f.model.free.free_to_m)
    model = dataclasses.replace(f.model, free=dataclasses.replace(f.model.free, free_to_m=far))
    assert measured_limits(free_view(model, f.camera_m)) == (0.0, 0.0)
    assert tracker.observe(dataclasses.replace(f, model=model)).objects == ()
    first, last = measured_limits(free_view(f.model, f.camera_m))
    assert first == pytest.approx(math.radians(-40.0))
    assert last == pytest.approx(math.radians(40.0))


@pytest.mark.nojit
@pytest.mark.parametrize("name", ["height_m", "slope_x", "noise_per_m"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_ground_that_is_not_finite_leaves_no_free_range(name: str, bad: float) -> None:
    f = frame([face(6.0, 0.0)], 0)
    seen = dataclasses.replace(f.model.ground, seen=True, height_m=2.0)
    assert free_view(dataclasses.replace(f.model, ground=seen), f.camera_m).far_m.size > 0
    ground = dataclasses.replace(seen, **{name: bad})
    assert free_view(dataclasses.replace(f.model, ground=ground), f.camera_m).far_m.size == 0


def test_the_range_of_a_person_is_less_exact_than_the_direction() -> None:
    """The published error is that of the range; across the view the velocity is exact within half a second."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(4)
    for k in range(14):
        f = frame([face(10.0, -3.0 + 0.15 * k), BACK], k, rng=rng, sigma_m=0.05)
        s = tracker.observe(noisy(f, 0.005))
    assert len(s.objects) == 1
    assert abs(s.objects[0].velocity_m_s[1] - 1.5) < 0.2
    objects = tracker.state().objects
    o = np.frombuffer(objects, OBJECT)
    o = o[(o["hits"] > 0) & (o["moving_ns"] > 0)][0]
    assert o["t11"] < 0.7 * o["r11"]
    assert s.objects[0].velocity_sigma_m_s == pytest.approx(math.sqrt(o["r11"]))


def test_the_box_of_a_mover_contains_its_planes_at_once() -> None:
    """It comes out behind a corner and lifts its arms."""
    tracker = Tracker(SMALL)
    for k in range(16):
        y = -2.5 + 0.15 * k
        whole = face(6.0, y, 1.2, -1.9) if k == 15 else face(6.0, y)
        s = tracker.observe(frame([whole, BACK], k))
    assert len(s.objects) == 1
    (x, y, z), (hx, hy, hz) = s.objects[0].centre_m, s.objects[0].half_size_m
    assert x - hx <= 6.0 <= x + hx
    assert y - hy <= -0.25 - 0.6 + 0.06
    assert y + hy >= -0.25 + 0.6 - 0.06
    assert z - hz <= -1.9 + 1e-6
    assert z + hz >= 1.0 - 1e-6


@pytest.mark.parametrize(("vx", "vy"), [(0.0, 4.0), (-2.0, 0.0), (0.0, 1.5)])
def test_a_mover_that_stops_suddenly_is_not_published_beside_its_place(vx: float, vy: float) -> None:
    tracker, stop = Tracker(SMALL), 1.5
    for k in range(32):
        t = min(0.1 * k, stop)
        x, y = 8.0 + vx * t, (-3.0 if vy else 0.0) + vy * t
        s = tracker.observe(frame([face(x, y), BACK], k))
        if k == 14:
            assert len(s.objects) == 1
        if k >= 15:
            for o in s.objects:
                assert math.hypot(o.centre_m[0] - x, o.centre_m[1] - y) < 0.4 + 0.1 * math.hypot(vx, vy), k
    assert s.objects == ()


@pytest.mark.nojit
def test_an_object_that_stops_keeps_its_id_with_an_uncertain_velocity() -> None:
    tracker = Tracker(SMALL)
    for k in range(18):
        s = tracker.observe(frame([face(8.0, -3.0 + 0.4 * min(k, 14)), BACK], k))
        if k == 14:
            before = s.objects[0]
    assert [o.id for o in s.objects] in ([], [before.id])
    assert all(o.velocity_sigma_m_s > 2.0 * before.velocity_sigma_m_s for o in s.objects)


@pytest.mark.parametrize("steps", [1, 9, 90])
def test_the_error_along_the_ray_is_kept_when_the_ray_turns(steps: int) -> None:
    """After a turn by 60 degrees 75 % of the large variance lie across the new ray."""
    objects = np.zeros(1, OBJECT)
    o = objects[0]
    o["r00"], o["r11"], o["t00"], o["t11"] = 1.0, 4.0, 0.01, 0.04
    for k in range(steps):
        turn_covariance(o, math.radians(60.0) * (k + 1) / steps)
    exact = math.sin(math.radians(60.0)) ** 2 * 0.99 + 0.01
    assert o["r00"] == 1.0
    assert 0.85 * exact <= o["t00"] <= 1.0
    assert o["t11"] == pytest.approx(4.0 * o["t00"])


def walking(tracker: Tracker, frames: range) -> TrackSnapshot:
    """The tracks after these frames of a person who walks across the view."""
    for k in frames:
        s = tracker.observe(frame([face(6.0, -3.0 + 0.15 * k), BACK], k))
    return s


def invalid(k: int) -> TrackingFrame:
    return TrackingFrame(model=blind(k * STEP).model, camera_m=(0.0, 0.0, 0.0), t_ns=k * STEP, positioned=True)


def test_a_moving_obstacle_is_at_its_predicted_place_after_invalid_frames() -> None:
    tracker = Tracker(SMALL)
    before = walking(tracker, range(14)).objects[0]
    for k in range(14, 18):
        s = tracker.observe(invalid(k))
    assert s.objects[0].centre_m[1] == pytest.approx(before.centre_m[1] + 0.6, abs=0.05)
    mine = s.planes[s.object_id == before.id]
    assert mine[:, [1, 3]].mean() == pytest.approx(before.centre_m[1] + 0.6, abs=0.1)
    s = walking(tracker, range(18, 19))
    assert [o.id for o in s.objects] == [before.id], "invalid frames do not count as frames without an observation"


def test_a_moving_obstacle_ends_in_invalid_frames_too() -> None:
    tracker = Tracker(SMALL)
    assert len(walking(tracker, range(14)).objects) == 1
    for k in range(14, 24):
        s = tracker.observe(invalid(k))
    assert s.objects == ()
    assert (s.object_id == 0).all()


def test_tracks_belong_to_no_object_once_the_position_is_lost() -> None:
    tracker = Tracker(SMALL)
    s = walking(tracker, range(14))
    assert s.object_id.max() > 0
    s = tracker.observe(without_position(frame([face(6.0, -3.0 + 0.15 * 14), BACK], 14)))
    assert (s.object_id == 0).all()


@pytest.mark.nojit
def test_ids_of_moving_obstacles_are_not_given_again_after_a_restart_of_the_camera() -> None:
    tracker = Tracker(SMALL)
    first = walking(tracker, range(20, 34)).objects[0]
    again = walking(tracker, range(14)).objects[0]
    assert again.id > first.id
