"""Each rule that refuses a fit: a scene that the other rules accept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.sharing.alignment import FitResult, agree, fit
from core.sharing.placement import Placement
from core.sharing.samples import (
    AROUND_M,
    LONG_M,
    MOST_LENGTH_M,
    MOST_PLANES,
    PRIOR_SIGMAS,
    common_samples,
    sample_pairs,
    samples_of,
)

from ..nightly import nightly
from .shared_maps import Floats, one_way, other_of, placed, refused, street

TRUE = placed(40.0, 0.0, -3.0, 0.4)


def prior(x_m: float = 1.0, y_m: float = 0.7, yaw_rad: float = 0.02, **sigma: float) -> Placement:
    """A place by position that is wrong by this."""
    return placed(40.0 + x_m, y_m, -3.0, 0.4 + yaw_rad, **sigma)


def scattered(seed: int, count: int, length_m: float, apart_m: float) -> Floats:
    """Walls (N, 6) of one length in all directions, each near a point of a grid of its own."""
    rng = np.random.Generator(np.random.PCG64([seed, 1]))
    side = math.ceil(math.sqrt(count))
    k = np.arange(count)
    middle = apart_m * np.column_stack([k % side, k // side]) + rng.uniform(-1.0, 1.0, (count, 2))
    angle = rng.uniform(0.0, math.pi, count)
    half = 0.5 * length_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([middle - half, middle + half, np.full(count, -6.0), np.zeros(count)])


def error_m(found: Placement) -> float:
    """Horizontal error at the middle of the planes."""
    middle = np.array([found.pivot_m])
    return math.hypot(*(found.points(middle) - TRUE.points(middle))[0, :2])


@pytest.mark.parametrize("seed", range(3))
def test_walls_in_all_directions_are_aligned(seed: int) -> None:
    """The scene of the following tests, when all of it is common."""
    walls = scattered(seed, 30, 4.0, 8.0)
    found = fit(other_of(TRUE, walls), walls, prior())
    assert found.result is FitResult.ACCEPTED
    assert error_m(found.placement) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_less_than_seventy_metres_in_common_are_too_little(seed: int) -> None:
    walls = scattered(seed, 30, 4.0, 8.0)
    assert refused(other_of(TRUE, walls[8:]), walls[:24], prior()) is FitResult.TOO_LITTLE


@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
def test_five_planes_in_common_are_too_little(seed: int) -> None:
    walls = scattered(seed, 9, 18.0, 22.0)
    order = np.random.Generator(np.random.PCG64(seed)).permutation(9)
    assert fit(other_of(TRUE, walls), walls, prior()).result is FitResult.ACCEPTED
    assert refused(other_of(TRUE, walls[order[2:]]), walls[order[:7]], prior()) is FitResult.TOO_LITTLE


@pytest.mark.parametrize("swapped", [False, True])
def test_five_planes_that_the_other_vehicle_has_in_parts_are_too_little(swapped: bool) -> None:
    walls = scattered(1, 9, 18.0, 22.0)
    order = np.random.Generator(np.random.PCG64(1)).permutation(9)
    whole, rest = walls[order[:7]], walls[order[2:]]
    halves = np.concatenate([rest, rest])
    halves[: len(rest), 2:4] = halves[len(rest) :, 0:2] = 0.5 * (rest[:, 0:2] + rest[:, 2:4])
    own, other = (halves, whole) if swapped else (whole, halves)
    assert refused(other_of(TRUE, other), own, prior()) is FitResult.TOO_LITTLE


@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
def test_walls_of_which_a_third_stands_elsewhere_are_inconsistent(seed: int) -> None:
    walls = scattered(seed, 42, 4.0, 8.0)
    rng = np.random.Generator(np.random.PCG64(seed))
    moved, some = walls.copy(), rng.permutation(42)[:16]
    along = (walls[some, 2:4] - walls[some, 0:2]) / 4.0
    moved[some, :4] += 0.9 * np.tile(np.column_stack([-along[:, 1], along[:, 0]]), 2)
    assert refused(other_of(TRUE, moved), walls, prior()) is FitResult.INCONSISTENT


def test_parallel_walls_do_not_fix_the_place_along_them() -> None:
    """With positions so certain that few other places are probable, too."""
    rows = [(0.0, y, 40.0, y, -6.0, 0.0) for y in (5.0, 8.0, 12.0, -6.0, -9.0, -13.0)]
    walls = np.array(rows)
    assert refused(other_of(TRUE, walls), walls, prior(0.2, 0.1, 0.0, m=0.68)) is FitResult.AMBIGUOUS


def test_ribs_closer_than_other_places_are_compared_leave_the_place_uncertain() -> None:
    """A fit one rib of 1.1 m off is no other place, but a part of the uncertainty."""
    rows = [(0.0, y, 40.0, y, -6.0, 0.0) for y in (5.0, 8.0, 12.0, -6.0, -9.0, -13.0)]
    for x in 1.1 * np.arange(36):
        rows += [(x, 5.0, x, 3.5, -6.0, 0.0), (x, -6.0, x, -4.5, -6.0, 0.0)]
    walls = np.array(rows)
    assert refused(other_of(TRUE, walls), walls, prior(0.1, 0.1, 0.0, m=1.3)) is FitResult.UNOBSERVABLE


def test_round_walls_do_not_fix_the_yaw() -> None:
    angle = np.linspace(0.0, math.tau, 41)
    rows = []
    for radius_m in (5.0, 9.0):
        x, y = 30.0 + radius_m * np.cos(angle), radius_m * np.sin(angle)
        rows.append(np.column_stack([x[:-1], y[:-1], x[1:], y[1:], 0 * x[1:] - 6.0, 0 * x[1:]]))
    walls = np.concatenate(rows)
    assert refused(other_of(TRUE, walls), walls, prior(0.3, 0.2, 0.02)) is FitResult.UNOBSERVABLE


@pytest.mark.parametrize("shift_m", [3.0, 4.0])
def test_walls_that_are_cut_at_the_border_of_each_view_are_not_fitted_by_their_ends(shift_m: float) -> None:
    """Both have observed 30 m of the same walls, from other places: the ends fit where both views would be the same."""
    rows = [(0.0, y, 30.0, y, -6.0, 0.0) for y in (5.0, 8.0, 12.0, -6.0, -9.0, -13.0)]
    own = np.array(rows)
    other = own + shift_m * np.array([1.0, 0, 1, 0, 0, 0])
    assert refused(other_of(TRUE, other), own, prior(0.0, 0.0, 0.0)) is not FitResult.ACCEPTED


@pytest.mark.parametrize("seed", range(2))
def test_a_place_that_the_positions_exclude_is_refused(seed: int) -> None:
    walls = scattered(seed, 30, 4.0, 8.0)
    assert fit(other_of(TRUE, walls), walls, prior(0.7, 0.0, 0.0, m=0.3)).result is FitResult.ACCEPTED
    assert refused(other_of(TRUE, walls), walls, prior(1.5, 0.0, 0.0, m=0.3)) is FitResult.AGAINST_POSITION


@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
@pytest.mark.parametrize("off_deg", [9.5, 10.0])
def test_a_heading_beyond_the_search_is_not_found_at_its_edge(off_deg: float, seed: int) -> None:
    """The search extends to 9 degrees. A fit at its edge would be half a degree wrong or more, and certain of 0.15."""
    rng = np.random.Generator(np.random.PCG64(seed))
    other, own = street(rng, 15.0, 80.0), street(rng, -20.0, 55.0)
    assert refused(other_of(TRUE, other), own, prior(yaw_rad=-math.radians(off_deg))) is FitResult.AGAINST_POSITION


def similar_trees(rng: np.random.Generator, seed: int, first: int, last: int, sigma_m: float = 0.2) -> Floats:
    """Planes (N, 6) of crowns in a row, alternately on both sides, 3.2 m apart, each with planes of its own that both
    vehicles observe with this error."""
    world = np.random.Generator(np.random.PCG64([seed, 4]))
    rows = []
    for k in range(18):
        y_m = (-1.0 if k % 2 else 1.0) * world.uniform(4.0, 6.0)
        for _ in range(12):
            angle, size_m = world.uniform(0.0, math.pi), world.uniform(1.2, 1.6) * world.uniform(0.5, 1.0)
            x, y = 3.2 * k + world.normal(0.0, 0.2), y_m + world.normal(0.0, 0.3)
            dx, dy = size_m * math.cos(angle), size_m * math.sin(angle)
            if first <= k <= last:
                ex, ey = rng.normal(0.0, sigma_m, 2)
                rows.append((x - dx + ex, y - dy + ey, x + dx + ex, y + dy + ey, -5.0, -1.0))
    return np.array(rows)


@pytest.mark.parametrize("seed", [0, 1, *nightly(*range(2, 6))])
@pytest.mark.parametrize("first", [6, 7])
def test_a_row_of_similar_trees_is_not_shifted_by_a_period(first: int, seed: int) -> None:
    """Four or five trees are common, and the positions are wrong by one period: there more trees stand together, and
    fit less well."""
    rng = np.random.Generator(np.random.PCG64(seed))
    other, own = similar_trees(rng, seed, first, 17), similar_trees(rng, seed, 0, 10)
    assert refused(other_of(TRUE, other), own, prior(-3.2, 0.2, 0.02)) in (FitResult.AMBIGUOUS, FitResult.TOO_LITTLE)


FARTHER = [(0, 9), (1, 4), (2, 6)]
FARTHER_TOO = [(5, 8), (7, 8), (11, 8), (19, 6), (19, 9), (22, 8), (25, 8)]


@pytest.mark.parametrize(("seed", "first"), [*FARTHER, *nightly(*FARTHER_TOO)])
def test_a_row_is_not_shifted_further_where_more_of_it_would_be_common(seed: int, first: int) -> None:
    """The positions are wrong by two trees, one period since they stand alternately on both sides. Two trees further, away
    from the true place, more of the row is common. A smaller share of it matches there than at other places, which are as
    probable by position."""
    rng = np.random.Generator(np.random.PCG64([seed, first, 7]))
    other, own = similar_trees(rng, seed, first, 17), similar_trees(rng, seed, 0, 10)
    wrong = prior(-6.4, rng.normal(0.0, 0.5), rng.normal(0.0, 0.02))
    assert refused(other_of(TRUE, other), own, wrong) is FitResult.AMBIGUOUS


def test_a_place_where_a_smaller_share_matches_than_at_another_one_is_ambiguous() -> None:
    """The positions are wrong by two trees. There the fit is the most probable one, also if as much were common elsewhere,
    and 74 percent agree: only the share that matches at another place, 11 percent greater, refuses a place 6.4 m wrong."""
    rng = np.random.Generator(np.random.PCG64([11, 6, 11]))
    other, own = similar_trees(rng, 11, 6, 17), similar_trees(rng, 11, 0, 10)
    wrong = prior(-6.4, rng.normal(0.0, 0.5), rng.normal(0.0, 0.02))
    assert refused(other_of(TRUE, other), own, wrong) is FitResult.AMBIGUOUS


@pytest.mark.parametrize("seed", [0, 1, *nightly(2, 3)])
@pytest.mark.parametrize("off_m", [1.6, 3.2])
def test_a_row_of_similar_trees_is_aligned_where_enough_of_it_is_common(off_m: float, seed: int) -> None:
    """By trees that differ, although the positions are wrong by a tree."""
    rng = np.random.Generator(np.random.PCG64([seed, 9]))
    other, own = similar_trees(rng, seed, 3, 17), similar_trees(rng, seed, 0, 10)
    found = fit(other_of(TRUE, other), own, prior(off_m, 0.2, 0.02))
    assert found.result is FitResult.ACCEPTED
    assert error_m(found.placement) < 0.3


def test_a_row_that_agrees_by_less_than_seventy_percent_is_inconsistent() -> None:
    """At the true place, too, few samples agree, so that no other rule refuses the place one period off. 69.5 percent agree
    there: with a limit of 67 percent the frame is 6.4 m wrong and counts as aligned."""
    rng = np.random.Generator(np.random.PCG64(3))
    other, own = similar_trees(rng, 3, 7, 17, 0.6), similar_trees(rng, 3, 0, 10, 0.6)
    found = fit(other_of(TRUE, other), own, prior(-3.2, 0.2, 0.02))
    assert 0.68 < found.agreeing < 0.7
    assert found.result is FitResult.INCONSISTENT


@pytest.mark.parametrize("period_m", [1.5, 2.6, 3.0, 3.4])
@pytest.mark.parametrize("seed", [0, 1, *nightly(*range(2, 12))])
def test_a_facade_that_repeats_is_ambiguous_whatever_its_period(period_m: float, seed: int) -> None:
    """Both vehicles have observed bays of the same facades, and one has observed those beyond, too. The periods are no
    multiples of the cells of the coarse grid."""
    rng = np.random.Generator(np.random.PCG64([seed, 5]))
    x = period_m * np.arange(int(48.0 / period_m))
    rows = []
    for side in (-7.0, 7.0):
        y, zero = np.full(len(x), side), np.zeros(len(x))
        rows.append(np.column_stack([x, y, x + 0.7 * period_m, y, zero - 8.0, zero]))
        rows.append(np.column_stack([x, y + math.copysign(3.0, side), x, y, zero - 8.0, zero]))
    own = np.concatenate(rows)
    other = own[(own[:, 0] >= 12.0) & (own[:, 0] < 36.0)]
    own, other = (box + rng.normal(0.0, 0.1, box.shape) for box in (own, other))
    wrong = prior(*rng.uniform(-3.0, 3.0, 2), 0.0)
    assert refused(other_of(TRUE, other), own, wrong) in (FitResult.AMBIGUOUS, FitResult.TOO_LITTLE)


@pytest.mark.parametrize(
    ("moved_m", "turned_rad", "expected"),
    [(0.0, 0.0, True), (0.55, 0.0, True), (0.65, 0.0, False), (0.0, 0.019, True), (0.0, 0.021, False)],
)
def test_two_fits_agree_to_the_sum_of_their_sigmas(moved_m: float, turned_rad: float, expected: bool) -> None:
    one = placed(40.0, 0.0, -3.0, 0.4, m=0.3, yaw=0.01)
    two = placed(40.0 + 0.8 * moved_m, 0.6 * moved_m, -3.0, 0.4 + turned_rad, m=0.3, yaw=0.01)
    assert agree(one, two) is expected


# ---- height ----------------------------------------------------------------------------------------------------------------


def with_heights(walls: Floats, up_m: Floats) -> Placement:
    """The fit where tops and bottoms of the neighbour's walls are higher by up_m, (N,)."""
    other = walls.copy()
    other[:, 4:6] -= up_m[:, None]
    found = fit(other_of(TRUE, other), walls, replace(placed(41.0, 0.7, -2.0, 0.42), sigma_z_m=1.0))
    assert found.result is FitResult.ACCEPTED
    return found.placement


def test_the_height_is_that_on_which_most_planes_agree() -> None:
    walls = scattered(0, 30, 4.0, 8.0)
    up_m = np.zeros(30)
    up_m[:17] = np.linspace(1.0, 4.5, 17)
    placement = with_heights(walls, up_m)
    assert placement.at_m[2] == pytest.approx(-3.0, abs=0.05)
    assert placement.sigma_z_m == pytest.approx(0.15)


def test_heights_that_differ_leave_the_height_to_the_positions() -> None:
    placement = with_heights(scattered(0, 30, 4.0, 8.0), np.linspace(-4.0, 4.0, 30))
    assert (placement.at_m[2], placement.sigma_z_m) == (-2.0, 1.0)


def test_heights_that_the_positions_exclude_do_not_count() -> None:
    placement = with_heights(scattered(0, 30, 4.0, 8.0), np.full(30, 8.0))
    assert (placement.at_m[2], placement.sigma_z_m) == (-2.0, 1.0)


# ---- samples ---------------------------------------------------------------------------------------------------------------


def test_planes_without_a_usable_size_do_not_count() -> None:
    walls = other_of(TRUE, scattered(0, 30, 4.0, 8.0))
    odd = np.array(
        [
            (0.0, 0.0, math.nan, 0.0, -3.0, 0.0),
            (0.0, 0.0, 1.0, 0.0, -math.inf, 0.0),
            (5.0, 5.0, 5.1, 5.0, -3.0, 0.0),
            (-150.0, 3.0, 150.0, 3.0, -3.0, 0.0),
        ]
    )
    own = scattered(0, 30, 4.0, 8.0)
    assert fit(np.concatenate([odd, walls]), own, prior()) == fit(walls, own, prior())
    assert len(samples_of(odd, 1000).points) == 0
    assert len(samples_of(np.array([(0.0, 0.0, MOST_LENGTH_M - 1.0, 0.0, -3.0, 0.0)]), 10_000).points) > 900


def test_the_number_of_samples_is_bounded_and_the_longest_planes_count() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    count = 2 * MOST_PLANES
    begin, angle = rng.uniform(-200.0, 200.0, (count, 2)), rng.uniform(0.0, math.tau, count)
    length_m = np.where(np.arange(count) % 2, 30.0, 20.0)
    end = begin + length_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    found = samples_of(np.column_stack([begin, end, np.full(count, -3.0), np.zeros(count)]), 2000)
    assert 1000 < len(found.points) <= 2000
    assert (found.plane % 2 == 1).all()


def test_samples_far_from_the_common_area_are_left_out() -> None:
    """They would make the grid of the search large."""
    near, far = scattered(0, 30, 4.0, 8.0), scattered(1, 9, 4.0, 8.0) + np.array([90.0, 0, 90.0, 0, 0, 0])
    walls = np.concatenate([near, far])
    other, own = samples_of(walls, 3000), samples_of(walls, 6000)
    place = replace(placed(0.0, 0.0, 0.0, 0.0, m=1.0), pivot_m=(0.0, 0.0, 0.0))
    there, here = common_samples(other, own, place)
    for some, more_m in ((there, 0.0), (here, PRIOR_SIGMAS + 1.0)):
        middle = np.median(other.points, axis=0)
        assert np.hypot(*(some.points - middle).T).max() <= AROUND_M + more_m
        assert len(some.points) >= 0.6 * len(near) * 4.0 / 0.3


def test_only_long_planes_are_compared_with_extended_ones() -> None:
    box = np.array([(0.0, 0.0, LONG_M + 1.0, 0.0, -3.0, 0.0), (0.0, 9.0, LONG_M - 1.0, 9.0, -3.0, 0.0)])
    samples = samples_of(box, 1000)
    long, short = sample_pairs(samples, samples, box)
    assert long.points[:, 1].tolist() == [0.0] * len(long.points)
    assert (short.points[:, 1] == 9.0).all()
    assert long.own[:, 0].min() == pytest.approx(-3.0, abs=0.2)
    assert long.own[:, 0].max() == pytest.approx(LONG_M + 4.0, abs=0.2)
    assert short.own[:, 0].min() > 0.0
    assert (long.own[long.own[:, 1] == 9.0, 0].min(), long.own[long.own[:, 1] == 9.0, 0].max()) == (
        pytest.approx(0.1, abs=0.1),
        pytest.approx(LONG_M - 1.1, abs=0.1),
    )


# ---- uncertainty -----------------------------------------------------------------------------------------------------------


def test_the_stated_uncertainty_covers_the_errors_and_is_not_much_larger() -> None:
    """Opposite flights of streets: consumers enlarge each plane by 2 sigma of the place where it stands."""
    place, yaw = [], []
    for seed in range(20):
        rng = np.random.Generator(np.random.PCG64([seed, 8]))
        x_m, y_m = rng.normal(0.0, 1.5, 2)
        wrong = prior(x_m, y_m, rng.normal(0.0, 0.035))
        other = other_of(TRUE, one_way(seed, -1.0))
        found = fit(other, one_way(seed, 1.0), wrong)
        if found.result is not FitResult.ACCEPTED:
            continue
        placement = found.placement
        ends = np.concatenate([other[:, 0:2], other[:, 2:4]])
        points = np.column_stack([ends, np.zeros(len(ends))])
        moved_m = np.hypot(*(placement.points(points) - TRUE.points(points))[:, :2].T)
        assert (moved_m <= 2.0 * placement.sigma_at_m(ends)).all()
        place.append(error_m(placement) / placement.sigma_m)
        yaw.append((placement.yaw_rad - TRUE.yaw_rad) / placement.sigma_yaw_rad)
    assert len(place) >= 14
    for ratio in (np.array(place), np.array(yaw)):
        assert 0.15 <= math.sqrt(float((ratio**2).mean())) <= 0.8
