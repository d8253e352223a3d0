"""The place of a neighbour's frame: by position, and by planes of both vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.sharing.alignment import FitResult, fit
from core.sharing.placement import placement_by_position
from core.sharing.records import LocalFrame

from .shared_maps import one_way, other_of, placed, refused, street

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
    projected_m = 0.0035 * math.hypot(120.0, 45.0, 6.0) + 0.0007 * 10.0
    assert placed.sigma_m == pytest.approx(math.hypot(3.0, 3.0, projected_m), abs=1e-4)


def test_an_own_frame_that_is_turned() -> None:
    own = LocalFrame(latitude_deg=47.3977, longitude_deg=8.5456, altitude_m=488.0, yaw_rad=math.pi / 2)
    other = moved_north_east(ZURICH, 50.0, 20.0, 0.0, 0.0)
    got = placement_by_position(own, other, (0.0, 0.0, 0.0)).points(np.zeros((1, 3)))[0]
    assert got[:2] == pytest.approx([20.0, -50.0], abs=0.02)


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
    assert refused(own, own, placed(20.0, 0.0, -3.0, 0.0, m=6.1)) is FitResult.TOO_UNCERTAIN
    assert refused(own, own, placed(20.0, 0.0, -3.0, 0.0, yaw=1.0)) is FitResult.TOO_UNCERTAIN
    assert refused(own, own, placed(20.0, 0.0, -3.0, 0.0, yaw=math.radians(10.1))) is FitResult.TOO_UNCERTAIN
    long = np.vstack([other_of(true, own), [[-400.0, 0.0, 500.0, 0.0, -5.0, 0.0]] * 50])
    fit(long, own, true)


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
