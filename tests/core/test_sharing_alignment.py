"""The place of a neighbour's frame: by position, and by planes of both vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.sharing.alignment import FitResult, fit
from core.sharing.placement import Placement, placement_by_position
from core.sharing.records import LocalFrame

Floats = NDArray[np.float64]
ZURICH = LocalFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_m=488.0)


def moved_north_east(frame: LocalFrame, north_m: float, east_m: float, up_m: float, yaw_rad: float) -> LocalFrame:
    """By radii of curvature, another formula than the code's."""
    lat = math.radians(frame.latitude_deg)
    e2 = 0.00669437999014
    meridian = 6_378_137.0 * (1 - e2) / (1 - e2 * math.sin(lat) ** 2) ** 1.5
    normal = 6_378_137.0 / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    return LocalFrame(
        latitude_deg=frame.latitude_deg + math.degrees(north_m / (meridian + frame.altitude_m)),
        longitude_deg=frame.longitude_deg + math.degrees(east_m / ((normal + frame.altitude_m) * math.cos(lat))),
        altitude_m=frame.altitude_m + up_m,
        yaw_rad=yaw_rad,
    )


def test_frames_by_their_origins() -> None:
    other = moved_north_east(ZURICH, 120.0, -45.0, 6.0, 0.3)
    placed = placement_by_position(ZURICH, other, (10.0, 0.0, -5.0))
    got = placed.points(np.array([[0.0, 0.0, 0.0], [10.0, 0.0, -5.0]]))
    assert got[0] == pytest.approx([120.0, -45.0, -6.0], abs=0.02)
    assert got[1] == pytest.approx([120.0 + 10 * math.cos(0.3), -45.0 + 10 * math.sin(0.3), -11.0], abs=0.02)
    assert placed.sigma_m == pytest.approx(math.hypot(3.0, 3.0))


def test_an_own_frame_that_is_turned() -> None:
    own = LocalFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_m=488.0, yaw_rad=math.pi / 2)
    other = moved_north_east(ZURICH, 50.0, 20.0, 0.0, 0.0)
    got = placement_by_position(own, other, (0.0, 0.0, 0.0)).points(np.zeros((1, 3)))[0]
    assert got[:2] == pytest.approx([20.0, -50.0], abs=0.02)


def street(rng: np.random.Generator, begin_m: float, end_m: float) -> Floats:
    """Planes (N, 6) of facades on both sides with gaps, house corners and masts, cut to a part of the street."""
    world = np.random.Generator(np.random.PCG64(5))
    rows = []
    for side in (-1.0, 1.0):
        x = -20.0
        while x < 80.0:
            length, depth, y = world.uniform(5.0, 13.0), world.uniform(3.0, 8.0), side * world.uniform(6.0, 8.0)
            top = -world.uniform(5.0, 12.0)
            ends = [(x, y), (x + length, y)] if side > 0 else [(x + length, y), (x, y)]
            rows.append((*ends[0], *ends[1], top, 0.0))
            rows.append((x, y + side * depth, x, y, top, 0.0) if side > 0 else (x, y, x, y + side * depth, top, 0.0))
            x += length + world.uniform(1.5, 4.0)
    box = np.array(rows)
    middle = 0.5 * (box[:, 0] + box[:, 2])
    box = box[(middle > begin_m) & (middle < end_m)]
    noise = rng.normal(0.0, 0.05, (len(box), 6))
    return np.asarray(box + noise)


def other_of(true: Placement, box: Floats) -> Floats:
    """Planes of the own frame as the other vehicle has them."""
    back = Placement(
        yaw_rad=-true.yaw_rad, pivot_m=true.at_m, at_m=true.pivot_m, sigma_m=0.0, sigma_z_m=0.0, sigma_yaw_rad=0.0
    )
    return back.boxes(box)


def placed(x: float, y: float, z: float, yaw_rad: float, **sigma: float) -> Placement:
    return Placement(
        yaw_rad=yaw_rad,
        pivot_m=(30.0, 5.0, -3.0),
        at_m=(x, y, z),
        sigma_m=sigma.get("m", 2.1),
        sigma_z_m=sigma.get("z", 2.8),
        sigma_yaw_rad=sigma.get("yaw", 0.05),
    )


@pytest.mark.parametrize("seed", range(6))
def test_three_metres_of_error_are_found_within_a_third(seed: int) -> None:
    rng = np.random.Generator(np.random.PCG64(seed))
    true = placed(40.0, 0.0, -3.0, 0.4)
    off = 3.0 * np.array([math.cos(seed), math.sin(seed)])
    prior = placed(40.0 + off[0], off[1], -3.0 + rng.normal(0, 1.5), 0.4 + rng.normal(0, 0.03))
    found = fit(other_of(true, street(rng, 15.0, 80.0)), street(rng, -20.0, 55.0), prior)
    assert found.result is FitResult.ACCEPTED
    gap = found.placement.points(np.array([true.pivot_m]))[0] - np.array(true.at_m)
    assert math.hypot(*gap[:2]) < 0.3
    assert abs(gap[2]) < 0.3
    assert abs(found.placement.yaw_rad - 0.4) < math.radians(1.0)
    assert found.placement.sigma_m <= 0.5


def refused(other: Floats, own: Floats, prior: Placement) -> FitResult:
    found = fit(other, own, prior)
    assert found.placement == prior
    return found.result


def test_another_street_is_refused() -> None:
    rng = np.random.Generator(np.random.PCG64(1))
    own, true = street(rng, -20.0, 60.0), placed(20.0, 0.0, -3.0, 0.0)
    wrong = own.copy()
    for k in range(0, len(own), 2):  # other houses: each facade and each side moved by metres of its own
        wrong[k : k + 2, :4] += np.tile(rng.uniform(-4.0, 4.0, 2), 2)
    assert refused(other_of(true, wrong), own, true) is not FitResult.ACCEPTED


def test_two_bare_walls_do_not_fix_the_place_along_them() -> None:
    rows = []
    for y in (6.0, 9.0, 12.0, 15.0):
        rows += [[0, y, 40, y, -6, 0], [40, -y, 0, -y, -6, 0]]
    walls = np.array(rows, np.float64)
    true = placed(20.0, 0.0, -3.0, 0.0)
    assert refused(other_of(true, walls), walls, true) in (FitResult.UNOBSERVABLE, FitResult.AMBIGUOUS)


def test_a_row_of_equal_pillars_is_ambiguous() -> None:
    rows = []
    for k in range(24):
        x = 3.0 * k
        rows += [(x, 0, x + 1, 0, -4, 0), (x + 1, 0, x + 1, 1, -4, 0), (x + 1, 1, x, 1, -4, 0), (x, 1, x, 0, -4, 0)]
    box = np.array(rows, np.float64)
    true = placed(18.0, 0.0, -3.0, 0.0)
    prior = placed(19.4, 0.0, -3.0, 0.0)
    assert refused(other_of(true, box), box, prior) is FitResult.AMBIGUOUS


def test_nothing_in_common_is_too_little() -> None:
    rng = np.random.Generator(np.random.PCG64(2))
    true = placed(500.0, 0.0, -3.0, 0.0)
    own = street(rng, -20.0, 60.0)
    assert refused(own, own, true) is FitResult.TOO_LITTLE
    assert refused(np.zeros((0, 6)), own, true) is FitResult.TOO_LITTLE
    assert refused(own, np.zeros((0, 6)), true) is FitResult.TOO_LITTLE


def test_equal_input_gives_equal_fits() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    own, true = street(rng, -20.0, 55.0), placed(40.0, 0.0, -3.0, 0.4)
    other = other_of(true, street(rng, 10.0, 80.0))
    prior = placed(41.0, 1.0, -2.0, 0.42)
    assert fit(other, own, prior) == fit(other, own, prior)


@pytest.mark.parametrize("count", [1, 8])
def test_exactly_parallel_walls_are_refused_without_an_error(count: int) -> None:
    rows = [[0.0, 3.0 * k, 40.0, 3.0 * k, -6.0, 0.0] for k in range(count)]
    walls = np.array(rows)
    assert refused(other_of(placed(20.0, 0.0, -3.0, 0.0), walls), walls, placed(20.0, 0.0, -3.0, 0.0)) is not None


def test_a_claimed_uncertainty_does_not_widen_the_search() -> None:
    rng = np.random.Generator(np.random.PCG64(2))
    own, true = street(rng, -20.0, 60.0), placed(20.0, 0.0, -3.0, 0.0)
    assert refused(own, own, placed(20.0, 0.0, -3.0, 0.0, m=600.0)) is FitResult.TOO_UNCERTAIN
    assert refused(own, own, placed(20.0, 0.0, -3.0, 0.0, yaw=1.0)) is FitResult.TOO_UNCERTAIN
    long = np.vstack([other_of(true, own), [[-400.0, 0.0, 500.0, 0.0, -5.0, 0.0]] * 50])
    fit(long, own, true)


@pytest.mark.parametrize("shift_m", [0.0, 8.0, 15.0])
def test_walls_that_end_where_the_views_end_do_not_fix_the_place_along_them(shift_m: float) -> None:
    """Each vehicle has observed another part of the same walls: their ends must not be fitted to each other."""
    rows = [[0, 6, 40, 6, -6, 0], [40, -6, 0, -6, -6, 0], [0, 8, 40, 8, -9, 0], [40, -9, 0, -9, -9, 0]]
    own = np.array(rows * 2, np.float64)
    own[4:, [1, 3]] *= 1.7
    other = own + shift_m * np.array([1.0, 0, 1, 0, 0, 0])
    true = placed(20.0 + shift_m / 2, 0.0, -3.0, 0.0)
    prior = placed(22.0 + shift_m / 2, 1.0, -3.0, 0.02)
    assert refused(other_of(true, other), own, prior) in (FitResult.UNOBSERVABLE, FitResult.AMBIGUOUS)


def one_way(seed: int, ahead: float) -> Floats:
    """Planes (N, 6) of a street with cars, flown along x (ahead = 1) or against it (-1): facades that end where the
    view ends, the sides of cars towards the street, and of their ends those that face the vehicle."""
    world = np.random.Generator(np.random.PCG64([seed, 1]))
    rng = np.random.Generator(np.random.PCG64([seed, 2 + int(ahead)]))
    rows: list[tuple[float, ...]] = []
    for side in (-1.0, 1.0):
        for k in range(5):
            begin, length, y = 10.0 * k - 5.0, world.uniform(6.0, 9.5), side * world.uniform(6.5, 8.0)
            cut = rng.uniform(0.0, 2.0, 2)
            rows.append((begin + cut[0], y, begin + length - cut[1], y, -8.0, 0.0))
    for _ in range(6):
        x, y = world.uniform(0.0, 40.0), world.choice([-1.0, 1.0]) * world.uniform(3.5, 4.8)
        street = y - math.copysign(0.9, y)
        end = x - 2.1 * ahead
        rows += [(x - 2.1, street, x + 2.1, street, -1.5, 0.0), (end, y - 0.9, end, y + 0.9, -1.5, 0.0)]
    box = np.array(rows)
    return np.asarray(box + rng.normal(0.0, 0.05, box.shape))


def test_fits_from_opposite_directions_are_right_within_their_margins() -> None:
    """Both see other ends of each car: they must not be fitted to each other."""
    errors = []
    for seed in range(12):
        true = placed(40.0, 0.0, -3.0, 0.4)
        off = 3.0 * np.array([math.cos(seed), math.sin(seed)])
        found = fit(other_of(true, one_way(seed, -1.0)), one_way(seed, 1.0), placed(40.0 + off[0], off[1], -3.0, 0.42))
        if found.result is FitResult.ACCEPTED:
            middle = np.array([found.placement.pivot_m])
            error_m = math.hypot(*(found.placement.points(middle) - true.points(middle))[0, :2])
            assert error_m < 2.0 * found.placement.sigma_m
            errors.append(error_m)
    assert len(errors) >= 6
    assert np.median(errors) < 0.3


def trees(rng: np.random.Generator, first: int, last: int) -> Floats:
    """Planes (N, 6) of crowns in a row, alternately on both sides, 3.2 m apart: what one vehicle has observed of each."""
    world = np.random.Generator(np.random.PCG64(9))
    rows = []
    for k in range(16):
        y, radius = (-1.0 if k % 2 else 1.0) * world.uniform(4.0, 6.0), world.uniform(1.2, 1.6)
        for _ in range(14):
            angle, size = rng.uniform(0.0, math.pi), radius * rng.uniform(0.5, 1.0)
            x, off = 3.2 * k + rng.normal(0.0, 0.2), rng.normal(0.0, 0.3)
            dx, dy = size * math.cos(angle), size * math.sin(angle)
            if first <= k <= last:
                rows.append((x - dx, y + off - dy, x + dx, y + off + dy, -5.0, -1.0))
    return np.array(rows)


@pytest.mark.parametrize("seed", range(8))
def test_a_row_of_trees_is_not_shifted_by_a_period(seed: int) -> None:
    """Five trees are common. One or two periods aside seven or more fit less well, but to a greater length."""
    rng = np.random.Generator(np.random.PCG64(seed))
    true = placed(40.0, 0.0, -3.0, 0.4)
    off = 3.0 * np.array([-1.0, 0.2])
    found = fit(other_of(true, trees(rng, 6, 15)), trees(rng, 0, 10), placed(40.0 + off[0], off[1], -3.0, 0.42))
    if found.result is FitResult.ACCEPTED:
        middle = np.array([found.placement.pivot_m])
        error_m = math.hypot(*(found.placement.points(middle) - true.points(middle))[0, :2])
        assert error_m < 2.0 * found.placement.sigma_m
