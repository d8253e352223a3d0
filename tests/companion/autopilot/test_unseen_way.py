"""A plane behind an unmeasured region is never sent as the nearest obstacle: rendered depth with unmeasured regions,
the extractor, sectors, messages, and both autopilots' readers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from companion.autopilot.camera_coverage import Coverage, covered, looked_into, too_near_the_edge
from companion.autopilot.failsafe import AutopilotNow, BlindPolicy, Policy, PolicyInput, braking_reach, policy_of
from companion.autopilot.obstacle_distance import (
    ARDUPILOT,
    PX4,
    UNKNOWN,
    clear_cm,
    encoded,
    for_reader,
    obstacle_distance_message,
)
from companion.autopilot.obstacle_distance_3d import level_points
from companion.autopilot.obstacle_memory import nothing_remembered
from companion.autopilot.polar_histogram import SECTORS, STEP_RAD, SectorScan, SectorState, scan
from companion.autopilot.view_free import View, points_free
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.params import Params
from core.types import CameraInfo, CameraMount, FrameModel, Intrinsics
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import Rendered, camera_info, render
from tests.nightly import examples, nightly

from ..sector_models import model, wall_at

NS = 1_000_000_000
AVOID = AvoidParams()
STOP, NOT_KNOWN = policy_of(AVOID, AutopilotNow(kind="ArduPilot")), Policy("unknown")
INFO = camera_info(320, 240)
SENSOR = SensorModel(ke_per_m=0.0015, sky_is_far=True).scaled_to(INFO.intrinsics.width)
EXTRACTOR = Extractor(Params())
HERE = LevelTransform(0.0, (0.0, 0.0, 0.0))
FRONT = np.arange(-6, 7)
"""Sectors that the camera looks into all of."""


def wall_scene(distance_m: float, height_m: float = 6.0) -> Scene:
    b = SceneBuilder("wall")
    b.ground()
    b.box("wall", distance_m + 0.15, 0.0, 0.3, 60.0, height_m)
    return b.build()


def tangents() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(H, W) each: right and down of each pixel's ray, per metre ahead."""
    k = INFO.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    return np.asarray((u - k.cx) / k.fx, np.float64), np.asarray((v - k.cy) / k.fy, np.float64)


def without_texture(width_m: float, distance_m: float, right_m: float = 0.0) -> NDArray[np.bool_]:
    """(H, W) pixels of a column without texture: nothing is measured there."""
    right, _ = tangents()
    return np.asarray(np.abs(right * distance_m - right_m) < width_m / 2)


def view_of(
    seen: Rendered, unmeasured: NDArray[np.bool_], transform: LevelTransform = HERE, info: CameraInfo = INFO
) -> View:
    depth_mm = seen.depth_mm.copy()
    depth_mm[unmeasured] = 0
    found, _ = EXTRACTOR.extract(depth_mm, info, seen.R_level_optical)
    return View(found, transform, info.intrinsics, np.asarray(seen.R_level_optical).T)


def looked_at(info: CameraInfo = INFO) -> Coverage:
    return looked_into(info, AVOID)


def values_of(
    found: SectorScan, autopilot: str, blind: NDArray[np.bool_] | None = None, avoid: AvoidParams = AVOID
) -> NDArray[np.uint16]:
    seeing, whole = covered([looked_at()])
    nowhere = np.zeros(SECTORS, bool)
    sight = PolicyInput(found, nothing_remembered(), nowhere if blind is None else blind, seeing, whole, 0)
    values = BlindPolicy(avoid).values(sight, policy_of(avoid, AutopilotNow(kind=autopilot)), 0)
    assert values is not None
    return for_reader(values, avoid, autopilot)


@pytest.fixture(scope="module")
def wall_at_10_m() -> Rendered:
    return render(wall_scene(10.0), INFO, position_ned_m=(0.0, 0.0, -2.0), sensor=SENSOR)


# ---- what PX4 brakes for ----------------------------------------------------------------------------------------------

BRAKE = policy_of(AVOID, AutopilotNow(kind=PX4, cp_dist_m=3.0))


def braked_for(
    plane_m: float, velocity_m_s: tuple[float, float] | None, policy: Policy = BRAKE, remembered_m: float = math.inf
) -> int:
    """What is sent for sector 4, 20 degrees to the right, that is unseen and has a plane at this distance from the hull, or an obstacle
    that has left the view and to which the way was not seen."""
    clear = np.full(SECTORS, SectorState.CLEAR, np.uint8)
    distance_m = np.full(SECTORS, np.inf)
    clear[4], distance_m[4] = SectorState.UNSEEN, plane_m
    free_m = np.full(SECTORS, AVOID.max_distance_m)
    lacking = np.zeros((SECTORS, AVOID.slices, AVOID.rays), np.bool_)
    found = SectorScan(clear, distance_m, free_m, np.zeros(SECTORS), lacking)
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    recalled = nothing_remembered()
    recalled.distance_m[4] = remembered_m
    seeing = everywhere if math.isinf(remembered_m) else np.asarray(np.arange(SECTORS) != 4)
    sight = PolicyInput(found, recalled, nowhere, seeing, seeing, 0, nowhere, velocity_m_s=velocity_m_s)
    values = BlindPolicy(AVOID).values(sight, policy, 0)
    assert values is not None
    return int(for_reader(values, AVOID, PX4, braking_reach(sight, AVOID, policy))[4])


def test_px4_is_sent_a_measured_obstacle_in_an_unseen_sector_that_it_must_brake_for() -> None:
    assert braked_for(7.0, (4.0, 0.0)) == 302
    assert braked_for(7.0, (1.0, 0.0)) == UNKNOWN
    assert braked_for(7.0, (0.0, -4.0)) == UNKNOWN  # moves away
    assert braked_for(2.8, None) == 280
    assert braked_for(7.0, None) == 302, "the vehicle may approach it"
    assert braked_for(7.0, None, NOT_KNOWN) == UNKNOWN
    assert braked_for(7.0, (4.0, 0.0), NOT_KNOWN) == UNKNOWN


@pytest.mark.parametrize(
    ("distance_m", "speed_m_s", "sent_cm"), [(8.0, 4.0, 302), (3.6, 4.0, 302), (8.0, 1.0, UNKNOWN)]
)
def test_px4_is_sent_an_obstacle_at_the_edge_beside_an_unseen_sector(
    distance_m: float, speed_m_s: float, sent_cm: int
) -> None:
    seeing, whole = covered([looked_at()])
    edge = too_near_the_edge([looked_at()], AVOID)
    inner = int(np.flatnonzero((seeing & ~edge)[: SECTORS // 2])[-1])
    at = inner + 1
    state = np.where(seeing, SectorState.CLEAR, SectorState.UNSEEN).astype(np.uint8)
    plane_m = np.full(SECTORS, np.inf)
    state[inner], state[at], plane_m[at] = SectorState.UNSEEN, SectorState.OBSTACLE, distance_m
    lacking = np.zeros((SECTORS, AVOID.slices, AVOID.rays), np.bool_)
    found = SectorScan(state, plane_m, np.full(SECTORS, AVOID.max_distance_m), np.zeros(SECTORS), lacking)
    towards = speed_m_s * math.cos(math.radians(5 * at)), speed_m_s * math.sin(math.radians(5 * at))
    blind = np.zeros(SECTORS, np.bool_)
    sight = PolicyInput(found, nothing_remembered(), blind, seeing, whole, 0, edge, velocity_m_s=towards)
    values = BlindPolicy(AVOID).values(sight, BRAKE, 0)
    assert values is not None
    sent = for_reader(values, AVOID, PX4, braking_reach(sight, AVOID, BRAKE))
    assert (int(sent[at]), int(sent[inner])) == (sent_cm, UNKNOWN)


@pytest.mark.parametrize(
    ("distance_m", "speed_m_s", "below_cm"), [(7.0, 1.0, UNKNOWN), (7.0, 4.0, 302), (2.8, 1.0, 280)]
)
def test_px4_may_not_move_by_an_obstacle_into_the_unseen_sector_above_it(
    distance_m: float, speed_m_s: float, below_cm: int
) -> None:
    """PX4 takes the bin below the stick's direction. Obstacles are measured in sectors 3 and 5, and sector 4 is unseen."""
    state, plane_m = np.full(SECTORS, SectorState.CLEAR, np.uint8), np.full(SECTORS, np.inf)
    state[[3, 5]], plane_m[[3, 5]], state[4] = SectorState.OBSTACLE, distance_m, SectorState.UNSEEN
    lacking = np.zeros((SECTORS, AVOID.slices, AVOID.rays), np.bool_)
    found = SectorScan(state, plane_m, np.full(SECTORS, AVOID.max_distance_m), np.zeros(SECTORS), lacking)
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    sight = PolicyInput(
        found, nothing_remembered(), nowhere, everywhere, everywhere, 0, nowhere, velocity_m_s=(speed_m_s, 0.0)
    )
    values = BlindPolicy(AVOID).values(sight, BRAKE, 0)
    assert values is not None
    assert values[3:6].tolist() == [below_cm, UNKNOWN, round(100.0 * distance_m)]


def test_px4_is_sent_an_obstacle_that_has_left_the_view_and_that_it_must_brake_for() -> None:
    """PX4 would pass it nearer than CP_DIST."""

    def sent(remembered_m: float, velocity_m_s: tuple[float, float] | None, policy: Policy = BRAKE) -> int:
        return braked_for(math.inf, velocity_m_s, policy, remembered_m)

    assert sent(2.8, (0.5, 0.0)) == 280
    assert sent(2.8, None) == 280
    assert sent(5.5, (4.0, 0.0)) == 302
    assert sent(5.5, (1.0, 0.0)) == UNKNOWN
    assert sent(5.5, (0.0, -4.0)) == UNKNOWN  # moves away
    assert sent(2.8, (0.5, 0.0), NOT_KNOWN) == UNKNOWN


def test_an_obstacle_counts_without_its_way_only_where_nothing_needs_to_be_seen_free() -> None:
    """Sectors need not be seen free nearer than near_m from the vehicle's middle; distances are from the hull."""
    hull_m = AVOID.near_m - AVOID.radius_m
    assert braked_for(math.inf, None, NOT_KNOWN, hull_m - 0.02) == round(100.0 * (hull_m - 0.02))
    assert braked_for(math.inf, None, NOT_KNOWN, hull_m + 0.02) == UNKNOWN


@pytest.mark.parametrize("free_m", [2.0, 8.0])
def test_the_wall_for_ardupilot_is_not_beyond_what_was_seen_free_from_the_hull(free_m: float) -> None:
    """Free space is measured from the vehicle's middle."""
    state = np.full(SECTORS, SectorState.CLEAR, np.uint8)
    state[4] = SectorState.UNSEEN
    lacking = np.zeros((SECTORS, AVOID.slices, AVOID.rays), np.bool_)
    found = SectorScan(state, np.full(SECTORS, np.inf), np.full(SECTORS, free_m), np.zeros(SECTORS), lacking)
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    sight = PolicyInput(found, nothing_remembered(), nowhere, everywhere, everywhere, 0)
    values = BlindPolicy(AVOID).values(sight, STOP, 0)
    assert values is not None
    assert values[4] == math.floor(100.0 * max(STOP.wall_m, free_m - AVOID.radius_m) + 1e-6)


@given(st.floats(0.0, 30.0), st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(0.0, 6.0))
def test_px4_may_never_move_into_an_unseen_sector(
    plane_m: float, forward_m_s: float, right_m_s: float, remembered_m: float
) -> None:
    for value in (
        braked_for(plane_m, (forward_m_s, right_m_s)),
        braked_for(math.inf, (forward_m_s, right_m_s), remembered_m=remembered_m),
    ):
        assert value == UNKNOWN or value <= 100 * 3.0 + 2


# ---- a column without texture before a wall ---------------------------------------------------------------------------


def test_a_column_that_was_not_measured_hides_the_wall_behind_it(wall_at_10_m: Rendered) -> None:
    """0.6 m wide at 3 m: it spans 5.7 degrees to either side."""
    found = scan([view_of(wall_at_10_m, without_texture(0.6, 3.0))], AVOID)
    assert found.state[[-1, 0, 1]].tolist() == [SectorState.UNSEEN] * 3
    beside = [i for i in FRONT if abs(i) >= 2]
    assert (found.state[beside] == SectorState.OBSTACLE).all()
    nearest_edge = np.radians(5.0 * np.abs(beside) - 2.5)
    assert found.distance_m[beside] == pytest.approx(10.0 / np.cos(nearest_edge) - 0.4, abs=0.6)


@pytest.mark.parametrize("yaw_deg", [0.0, 1.3, -2.1, 8.0])
@pytest.mark.parametrize(("width", "focal_px", "hidden_right"), [(320, 170.0, 0), (336, 175.0, 2), (320, 230.0, 7)])
def test_where_all_is_measured_a_covered_sector_is_clear(
    width: int, focal_px: float, hidden_right: int, yaw_deg: float
) -> None:
    """The outermost direction of the free profile is only partly in the image, and never free. A sector that needs it must
    not count as covered: ArduPilot would be sent the artificial wall there for ever."""
    avoid = replace(AVOID, max_distance_m=6.0)
    intrinsics = Intrinsics(width, 240, focal_px, focal_px, (width - 1) / 2, 119.5)
    info = replace(INFO, intrinsics=intrinsics, mount=CameraMount(yaw_rad=math.radians(yaw_deg)))
    seen = render(wall_scene(10.0), info, position_ned_m=(0.0, 0.0, -2.0), sensor=SENSOR)
    hidden = np.zeros(seen.depth_mm.shape, bool)
    hidden[:, : width // 7] = True
    hidden[:, width - hidden_right :] = True
    view = view_of(seen, hidden, LevelTransform(math.radians(yaw_deg), (0.0, 0.0, 0.0)), info)
    found = scan([replace(view, model=transform_model(view.model, view.transform))], avoid)
    _, whole = covered([looked_into(info, avoid, hidden)])
    assert whole.sum() >= 8
    assert (found.state[whole] == SectorState.CLEAR).all()


def farther_than(found: SectorScan, distance_m: float) -> NDArray[np.bool_]:
    """(72,) sectors that are sent as clear, or as an obstacle farther from the vehicle's middle than this."""
    behind = (found.state == SectorState.OBSTACLE) & (found.distance_m + AVOID.radius_m > distance_m)
    return np.asarray((found.state == SectorState.CLEAR) | behind)


@pytest.mark.parametrize("width_m", [0.08, 0.1, 0.15])
def test_a_column_that_hides_a_quarter_of_a_sector_hides_what_is_behind_it(
    wall_at_10_m: Rendered, width_m: float
) -> None:
    """At 3 m a sector is 0.26 m wide. Least shares that are not detected: docs/reference/limits.md."""
    for right_m in np.linspace(-1.2, 1.2, 37).tolist():
        found = scan([view_of(wall_at_10_m, without_texture(width_m, 3.0, right_m))], AVOID)
        left, right = (math.atan((right_m + side * width_m / 2) / 3.0) for side in (-1, 1))
        middle = np.asarray([math.remainder(i * STEP_RAD, math.tau) for i in range(SECTORS)])
        hidden = np.minimum(middle + STEP_RAD / 2, right) - np.maximum(middle - STEP_RAD / 2, left)
        assert not farther_than(found, 4.0)[hidden >= 0.25 * STEP_RAD].any(), right_m


@pytest.mark.parametrize("up_m", [-0.6, -0.3, 0.0, 0.3, 0.6])
def test_a_bar_that_hides_a_quarter_of_the_band_hides_what_is_behind_it(wall_at_10_m: Rendered, up_m: float) -> None:
    """A bar without texture across the whole view, 0.4 m high at 3 m; the band is 1.6 m high."""
    _, down = tangents()
    bar = np.asarray(np.abs(3.0 * down + up_m) < 0.2)
    assert not farther_than(scan([view_of(wall_at_10_m, bar)], AVOID), 4.0)[FRONT].any()


@pytest.mark.parametrize(("up_m", "high_m"), [(0.0, 0.2), (0.66, 0.3)])
def test_a_bar_that_leaves_four_fifths_of_the_band_hides_what_is_behind_it(
    wall_at_10_m: Rendered, up_m: float, high_m: float
) -> None:
    """At the height of the vehicle, and at the upper edge of the band."""
    _, down = tangents()
    bar = np.asarray(np.abs(3.0 * down + up_m) < 0.5 * high_m)
    assert not farther_than(scan([view_of(wall_at_10_m, bar)], AVOID), 4.0)[FRONT].any()


@pytest.mark.parametrize("bin_deg", [5, 10])
def test_px4_does_not_fly_towards_the_column(wall_at_10_m: Rendered, bin_deg: int) -> None:
    values = values_of(scan([view_of(wall_at_10_m, without_texture(0.6, 3.0))], AVOID), PX4)
    px4 = Px4Reader(bin_deg)
    px4.read(obstacle_distance_message(values, 0, AVOID), NS)
    assert px4.bins_cm(NS)[0] == UNKNOWN
    for degrees in (-5.0, 0.0, 4.0):
        assert px4.room_m(degrees, NS) == 0.0
    assert px4.room_m(20.0, NS) > 5.0  # beside it the wall is sent at its place


@pytest.mark.parametrize("one_pass", [False, True])
def test_ardupilot_is_shown_the_policys_wall_before_the_column(wall_at_10_m: Rendered, one_pass: bool) -> None:
    values = values_of(scan([view_of(wall_at_10_m, without_texture(0.6, 3.0))], AVOID), ARDUPILOT)
    vehicle = ArduPilotReader(one_pass=one_pass, margin_m=AVOID.avoid_margin_m)
    vehicle.read(obstacle_distance_message(values, 0, AVOID), NS)
    assert -0.1 < vehicle.room_m(0.0, NS) < 0.1
    points = level_points(values, AVOID)  # the same sectors as OBSTACLE_DISTANCE_3D
    ahead = np.abs(np.arctan2(points[:, 1], points[:, 0])) < 0.5 * STEP_RAD
    assert np.hypot(*points[ahead, :2].T).max() < 2.2


def test_a_wall_seen_in_full_stays_where_it_stands(wall_at_10_m: Rendered) -> None:
    nothing = np.zeros((INFO.intrinsics.height, INFO.intrinsics.width), bool)
    for distance_m in (2.0, 3.0, 4.0, 5.0, 7.0, 10.0):
        for pitch_deg in (-15.0, 0.0, 15.0):
            seen = render(
                wall_scene(distance_m),
                INFO,
                position_ned_m=(0.0, 0.0, -2.0),
                sensor=SENSOR,
                pitch_rad=math.radians(pitch_deg),
            )
            view = view_of(seen, nothing)
            found = scan([view], AVOID)
            # pitched by 15 degrees, the image shows all but the outermost height of the band near the middle only
            whole = FRONT[4:-4] if pitch_deg else FRONT
            assert (found.state[whole] == SectorState.OBSTACLE).all(), (distance_m, pitch_deg)
            assert (found.state[FRONT] != SectorState.CLEAR).all(), (distance_m, pitch_deg)
            assert found.distance_m[0] <= distance_m - AVOID.radius_m
            assert found.distance_m[0] + view.model.margin_m.max() == pytest.approx(
                distance_m - AVOID.radius_m, abs=0.2
            )


def test_a_near_obstacle_is_sent_whatever_was_not_measured_before_it() -> None:
    seen = render(wall_scene(2.4), INFO, position_ned_m=(0.0, 0.0, -2.0), sensor=SENSOR)
    found = scan([view_of(seen, without_texture(0.3, 1.5))], AVOID)
    assert (found.state[FRONT] == SectorState.OBSTACLE).all()
    for autopilot in (PX4, ARDUPILOT, ""):
        assert (values_of(found, autopilot)[FRONT] <= 300).all()


# ---- one of two cameras is blind --------------------------------------------------------------------------------------


def test_a_plane_seen_from_aside_does_not_vouch_for_the_way_of_a_blind_camera() -> None:
    """The camera in front is blind. The other stands 3 m to the right and looks 5 degrees to the left: it sees the wall
    that stands ahead of the vehicle, and nothing of the first metres on the way there."""
    yaw_rad = math.radians(-5.0)
    aside = render(wall_scene(8.0), INFO, yaw_rad=yaw_rad, position_ned_m=(0.0, 3.0, -2.0), sensor=SENSOR)
    nothing = np.zeros((INFO.intrinsics.height, INFO.intrinsics.width), bool)
    place = LevelTransform(yaw_rad, (0.0, 3.0, 0.0))
    plain = view_of(aside, nothing)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R_level_cam = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    R_optical_level = np.asarray(plain.R_optical_level) @ R_level_cam.T
    view = View(transform_model(plain.model, place), place, INFO.intrinsics, R_optical_level)
    found = scan([view], AVOID)
    ahead = found.distance_m[0]
    assert ahead == pytest.approx(8.0 - AVOID.radius_m, abs=0.6)  # the plane is there
    assert found.state[0] == SectorState.UNSEEN

    front = replace(INFO, camera="front")
    other = replace(INFO, camera="right", mount=CameraMount(yaw_rad=yaw_rad))
    blind, _ = covered([looked_into(front, AVOID)])
    seeing, whole = covered([looked_into(other, AVOID)])
    sight = PolicyInput(found, nothing_remembered(), blind, seeing, whole, 0)
    px4 = BlindPolicy(AVOID).values(sight, NOT_KNOWN, 0)
    stop = BlindPolicy(AVOID).values(sight, STOP, 0)
    assert px4 is not None
    assert stop is not None
    assert px4[0] == UNKNOWN
    assert stop[0] <= 213


# ---- random scenes with random unmeasured regions ---------------------------------------------------------------------


def hidden_share(unmeasured: NDArray[np.bool_], range_m: float) -> NDArray[np.float64]:
    """(72,) which share of the band of height at a range is unmeasured in each sector of FRONT; 0 in the others."""
    right, down = tangents()
    sector = np.round(np.arctan(right) / STEP_RAD).astype(int) % SECTORS
    z_m = down * range_m * np.cos(np.arctan(right))
    inside = (z_m > -AVOID.band_above_m) & (z_m < AVOID.band_below_m)
    out = np.zeros(SECTORS)
    for i in FRONT:
        here = inside & (sector == i % SECTORS)
        out[i] = unmeasured[here].mean()
    return out


@examples(2.5)
@given(st.integers(0, 2**32 - 1))
def test_nothing_is_sent_farther_than_an_unmeasured_obstacle_may_be(seed: int) -> None:
    """Of every sector half of which is hidden by regions without a measurement, which may be things 2.5 m to 8 m away."""
    rng = np.random.default_rng(seed)
    b = SceneBuilder("random")
    b.ground()
    b.box("wall", rng.uniform(5.0, 14.0), rng.uniform(-2.0, 2.0), 0.3, 60.0, 6.0, rng.uniform(-0.6, 0.6))
    for i in range(rng.integers(0, 4)):
        b.pole(f"pole {i}", rng.uniform(2.5, 9.0), rng.uniform(-3.0, 3.0), rng.uniform(0.1, 0.6), 5.0)
    sensor = SensorModel(ke_per_m=rng.choice([0.0015, 0.005]), dropout_share=rng.uniform(0.0, 0.1), sky_is_far=True)
    sensor = sensor.scaled_to(INFO.intrinsics.width)
    tilt_rad = rng.uniform(-0.2, 0.2)
    seen = render(b.build(), INFO, pitch_rad=tilt_rad, position_ned_m=(0.0, 0.0, -2.0), sensor=sensor, seed=seed % 1000)
    nearest_m = rng.uniform(AVOID.near_m, 8.0)
    right, down = tangents()
    unmeasured = np.zeros(right.shape, bool)
    for _ in range(rng.integers(1, 4)):
        half_m, tall_m = rng.uniform(0.15, 0.8), rng.uniform(0.8, 3.0)
        at, up = rng.uniform(-0.6, 0.6), rng.uniform(-0.2, 0.2)
        unmeasured |= (np.abs(right - at) * nearest_m < half_m) & (np.abs(down - up) * nearest_m < tall_m)
    found = scan([view_of(seen, unmeasured)], AVOID)
    # in a tilted image the band lies elsewhere: only what is hidden over all heights counts then
    whole_columns = unmeasured.all(axis=0, keepdims=True).repeat(len(unmeasured), axis=0)
    share = hidden_share(unmeasured if abs(tilt_rad) < 0.01 else whole_columns, nearest_m)
    slack_m = 0.75 + 4.0 * 0.005 * nearest_m**2
    for i in np.flatnonzero(share >= 0.5).tolist():
        assert found.state[i] != SectorState.CLEAR
        if found.state[i] == SectorState.OBSTACLE:
            assert found.distance_m[i] <= nearest_m - AVOID.radius_m + slack_m, (i, nearest_m, share[i])


# ---- low flight -------------------------------------------------------------------------------------------------------


@examples(1.6)
@given(st.floats(0.3, 1.0), st.floats(0.3, 1.2), st.sampled_from([0.0015, 0.005]), st.floats(-0.1, 0.1))
def test_a_surface_within_the_band_is_never_called_clear(
    height_m: float, band_below_m: float, ke_per_m: float, tilt_rad: float
) -> None:
    avoid = replace(AVOID, band_below_m=band_below_m)
    b = SceneBuilder("flat")
    b.ground()
    b.box("wall", 30.0, 0.0, 0.3, 90.0, 6.0)
    info = replace(INFO, ke_per_m=ke_per_m)
    seen = render(
        b.build(),
        info,
        pitch_rad=tilt_rad,
        position_ned_m=(0.0, 0.0, -height_m),
        sensor=SensorModel(ke_per_m=ke_per_m, sky_is_far=True),
    )
    found, _ = EXTRACTOR.extract(seen.depth_mm, info, seen.R_level_optical)
    sectors = scan([View(found, HERE, info.intrinsics, np.asarray(seen.R_level_optical).T)], avoid)
    if height_m < band_below_m - 0.03:
        assert (sectors.state != SectorState.CLEAR).all()
    z = np.linspace(-0.5, 1.2, 35)
    x, y = np.full(1, 4.0), np.zeros(1)
    free = points_free(View(found, HERE), x, y, z)[:, 0]
    assert not free[z > height_m].any()


@pytest.mark.parametrize(("band_below_m", "clear_share"), [(1.2, 0.8), (1.2, 0.5), (0.8, 0.5)])
def test_ground_in_the_lowest_part_of_the_band_leaves_no_sector_clear(band_below_m: float, clear_share: float) -> None:
    """`clear_share` alone lets that part be unseen: PX4 moved over the surface. The wall for ArduPilot is where the free space of
    the rest ends."""
    avoid = replace(AVOID, band_below_m=band_below_m, clear_share=clear_share)
    for height_m, expected in ((band_below_m - 0.02, SectorState.UNSEEN), (band_below_m + 0.05, SectorState.CLEAR)):
        b = SceneBuilder("flat")
        b.ground()
        b.box("wall", 30.0, 0.0, 0.3, 90.0, 6.0)
        seen = render(b.build(), INFO, position_ned_m=(0.0, 0.0, -height_m), sensor=SENSOR)
        sectors = scan([view_of(seen, np.zeros(seen.depth_mm.shape, bool))], avoid)
        assert (sectors.state[FRONT] == expected).all(), height_m
        if expected == SectorState.UNSEEN:
            assert set(values_of(sectors, PX4, avoid=avoid)[FRONT]) == {UNKNOWN}
            free_cm = math.floor(100.0 * (sectors.free_m[0] - avoid.radius_m))
            assert set(values_of(sectors, ARDUPILOT, avoid=avoid)[FRONT]) == {free_cm}


@pytest.mark.parametrize("tolerance_m", [0.1, 0.25, 0.6])
def test_nothing_is_free_where_the_extractor_takes_what_it_measures_for_ground(tolerance_m: float) -> None:
    b = SceneBuilder("flat")
    b.ground()
    b.box("wall", 30.0, 0.0, 0.3, 90.0, 6.0)
    seen = render(b.build(), INFO, position_ned_m=(0.0, 0.0, -1.5), sensor=SENSOR)
    found, _ = Extractor(Params(ground_tolerance_m=tolerance_m)).extract(seen.depth_mm, INFO, seen.R_level_optical)
    z = np.linspace(-0.5, 1.5, 81)
    free = points_free(View(found, HERE), np.full(1, 4.0), np.zeros(1), z)[:, 0]
    assert free[(z > 0.0) & (z < 1.5 - tolerance_m - 0.05)].all()
    assert not free[z > 1.5 - tolerance_m + 0.05].any()


def test_the_way_to_a_plane_may_end_a_ring_and_a_step_before_it() -> None:
    """With the ring that is configured, whatever it is."""
    for ring_m, free_to_m, seen in ((0.2, 3.85, False), (0.5, 3.85, True), (0.5, 3.6, False)):
        view = View(model(wall_at(0.0, 5.0), free_to_m=free_to_m), HERE, ring_m=ring_m)
        avoid = replace(AVOID, step_m=0.2)
        state = scan([view], avoid).state[0]
        assert state == (SectorState.OBSTACLE if seen else SectorState.UNSEEN)


def test_above_the_band_flat_ground_leaves_every_sector_clear() -> None:
    b = SceneBuilder("flat")
    b.ground()
    b.box("wall", 30.0, 0.0, 0.3, 90.0, 6.0)
    for height_m in (0.9, 1.0, 1.3, 2.0, 4.0):
        seen = render(b.build(), INFO, position_ned_m=(0.0, 0.0, -height_m), sensor=SENSOR)
        found, _ = EXTRACTOR.extract(seen.depth_mm, INFO, seen.R_level_optical)
        sectors = scan([View(found, HERE, INFO.intrinsics, np.asarray(seen.R_level_optical).T)], AVOID)
        assert (sectors.state[FRONT] == SectorState.CLEAR).all(), height_m


def test_a_raised_surface_taken_for_the_ground_is_never_called_clear() -> None:
    """A flat roof 0.5 to 0.7 m under the vehicle that fills the view."""
    for height_m in (0.5, 0.55, 0.6, 0.65, 0.7):
        b = SceneBuilder("roof")
        b.ground()
        b.box("roof", 8.0, 0.0, 20.0, 30.0, 4.0)
        seen = render(b.build(), INFO, position_ned_m=(0.0, 0.0, -4.0 - height_m), sensor=SENSOR)
        found: FrameModel = EXTRACTOR.extract(seen.depth_mm, INFO, seen.R_level_optical)[0]
        sectors = scan([View(found, HERE, INFO.intrinsics, np.asarray(seen.R_level_optical).T)], AVOID)
        assert (sectors.state != SectorState.CLEAR).all(), height_m
        assert (encoded(sectors, AVOID) != clear_cm(AVOID)).all()


@pytest.mark.parametrize("height_m", [0.05, 0.12, *nightly(0.06, 0.08, 0.1)])
def test_the_floor_before_take_off_is_no_wall(height_m: float) -> None:
    """ArduCopter arms when nothing is nearer than 0.6 m. A wall ahead keeps its place, and open floor is not clear."""
    ke_per_m = 0.005
    info = camera_info(640, 480, ke_per_m=ke_per_m)
    for wall_m in (4.0, 30.0):
        seen = render(
            wall_scene(wall_m),
            info,
            position_ned_m=(0.0, 0.0, -height_m),
            sensor=SensorModel(ke_per_m=ke_per_m, sky_is_far=True),
        )
        found, _ = EXTRACTOR.extract(seen.depth_mm, info, seen.R_level_optical)
        if height_m <= 0.05 and not found.valid:
            # the steep gradient of the floor is taken for flying pixels: the camera counts as blind, which arms as well
            assert (values_of(scan([], AVOID), ARDUPILOT, blind=np.ones(SECTORS, bool)) > 60).all()
            continue
        assert found.ground.seen
        sectors = scan([View(found, HERE, info.intrinsics, np.asarray(seen.R_level_optical).T)], AVOID)
        if wall_m < AVOID.max_distance_m:
            assert (sectors.state[FRONT] == SectorState.OBSTACLE).all()
            assert sectors.distance_m[0] == pytest.approx(wall_m - AVOID.radius_m, abs=0.4)
        else:
            assert (sectors.state[FRONT] == SectorState.UNSEEN).all()
            assert (values_of(sectors, PX4)[FRONT] == UNKNOWN).all()
        assert (values_of(sectors, ARDUPILOT)[FRONT] > 200).all()
