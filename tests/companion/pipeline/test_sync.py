"""Attitude and position at mid-exposure: compared with analytic motion, and irregular timestamps."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.sync import SyncParams
from companion.pipeline.quaternion import (
    conjugate,
    from_rotation_vector,
    normalised,
    product,
    rates_between,
    rotate_by_rates,
    slerp,
    to_rotation_vector,
)
from companion.pipeline.sample_buffer import HELD
from companion.pipeline.sync import MAX_DISTANCE_M, NS, AttitudeAt, DropCause, PoseAt, Source, Synchroniser
from core.frames import quaternion_from_euler, rotation_from_quaternion
from core.types import AttitudeSample, PoseSample

MS = 1_000_000
angles = st.floats(-3.0, 3.0)
vectors = st.tuples(angles, angles, angles)


def angle_between(a, b) -> float:
    v = to_rotation_vector(product(conjugate(normalised(a)), normalised(b)))
    return math.sqrt(sum(c * c for c in v))


def turning(t_ns: int, start, rates, with_rates: bool = True) -> AttitudeSample:
    """Constant body rates from `start` at t = 0: what slerp and the rates must reproduce exactly."""
    q = product(normalised(start), from_rotation_vector(tuple(r * t_ns / NS for r in rates)))
    return AttitudeSample(t_ns, t_ns + 5 * MS, q, tuple(rates) if with_rates else None)


def synchroniser(*samples: AttitudeSample | PoseSample, **params) -> Synchroniser:
    sync = Synchroniser(SyncParams(**params))
    for sample in samples:
        (sync.poses if isinstance(sample, PoseSample) else sync.attitudes).add(sample)
    return sync


@given(vectors, vectors)
def test_the_product_of_quaternions_is_that_of_rotations(a, b):
    p, q = from_rotation_vector(a), from_rotation_vector(b)
    expected = rotation_from_quaternion(p) @ rotation_from_quaternion(q)
    np.testing.assert_allclose(rotation_from_quaternion(product(p, q)), expected, atol=1e-12)


@given(vectors, vectors, st.floats(0.0, 1.0))
def test_slerp_turns_at_constant_rate_the_short_way(a, b, share):
    p, q = from_rotation_vector(a), from_rotation_vector(b)
    whole = angle_between(p, q)
    middle = slerp(p, q, share)
    assert math.isclose(angle_between(p, middle), share * whole, abs_tol=1e-7)
    assert math.isclose(angle_between(middle, q), (1 - share) * whole, abs_tol=1e-7)
    negative = (-q[0], -q[1], -q[2], -q[3])  # the same attitude
    assert angle_between(slerp(p, negative, share), middle) < 1e-6


@given(vectors, st.tuples(*[st.floats(-1.05, 1.05)] * 3), st.integers(1, 59 * MS))
def test_a_turn_of_60_degrees_a_second_is_met_exactly_between_samples(start, rates, t_ns):
    q0 = from_rotation_vector(start)
    sync = synchroniser(turning(0, q0, rates, False), turning(60 * MS, q0, rates, False))
    at = sync.attitude_at(t_ns)
    assert at.source is Source.INTERPOLATED
    assert angle_between(at.q_ned_frd_wxyz, turning(t_ns, q0, rates).q_ned_frd_wxyz) < 1e-6
    assert at.distance_ns == min(t_ns, 60 * MS - t_ns)


@given(vectors, st.tuples(*[st.floats(-1.05, 1.05)] * 3), st.integers(1, 50 * MS), st.booleans())
def test_a_turn_is_carried_forward_by_rates_or_by_differences(start, rates, ahead_ns, recorded):
    q0 = from_rotation_vector(start)
    sync = synchroniser(turning(0, q0, rates, recorded), turning(20 * MS, q0, rates, recorded))
    at = sync.attitude_at(20 * MS + ahead_ns)
    assert at.source is Source.EXTRAPOLATED
    truth = turning(20 * MS + ahead_ns, q0, rates).q_ned_frd_wxyz
    assert angle_between(at.q_ned_frd_wxyz, truth) < 1e-6


@given(st.floats(0.0, 2.0), st.integers(0, 20 * MS))
def test_the_error_between_samples_of_an_accelerated_turn_is_the_analytic_one(acceleration, t_ns):
    """A yaw of 1/2 a t^2: the chord is off by a/2 t (T - t), at most a T^2 / 8."""

    def yaw(t: int) -> AttitudeSample:
        angle = 0.5 * acceleration * (t / NS) ** 2
        return AttitudeSample(t, t, from_rotation_vector((0.0, 0.0, angle)))

    at = synchroniser(yaw(0), yaw(20 * MS)).attitude_at(t_ns)
    expected = 0.5 * acceleration * (t_ns / NS) * (0.02 - t_ns / NS)
    assert math.isclose(angle_between(at.q_ned_frd_wxyz, yaw(t_ns).q_ned_frd_wxyz), expected, abs_tol=1e-7)


@given(vectors, st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.floats(0.01, 0.5))
def test_body_rates_undo_the_turn_they_are_taken_from(start, rates, dt_s):
    q = from_rotation_vector(start)
    found = rates_between(q, rotate_by_rates(q, rates, dt_s), dt_s)
    np.testing.assert_allclose(found, rates, atol=1e-6)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.3, -0.4), (-0.5, 1.2)])
def test_the_rate_of_tilting_is_that_of_down_and_not_the_turn_about_it(roll, pitch):
    q = quaternion_from_euler(roll, pitch, 1.0)
    down = rotation_from_quaternion(q)[2]
    level = np.cross(down, [0.3, -0.7, 0.2])
    level *= 0.25 / np.linalg.norm(level)
    for turn in (0.0, 1.5, -3.0):
        rates = tuple(float(v) for v in turn * down + level)
        s = synchroniser(AttitudeSample(0, 0, q, (0.0, 0.0, 0.0)), AttitudeSample(10_000_000, 10_000_000, q, rates))
        assert s.attitude_at(5_000_000).tilt_rad_s == pytest.approx(0.25), "the greater of both samples"
        assert s.attitude_at(0).tilt_rad_s == 0.0


def test_the_rate_of_tilting_follows_from_two_attitudes_without_rates():
    first, second = (quaternion_from_euler(0.0, pitch, 0.0) for pitch in (0.0, 0.01))
    s = synchroniser(AttitudeSample(0, 0, first, None), AttitudeSample(20_000_000, 20_000_000, second, None))
    assert s.attitude_at(10_000_000).tilt_rad_s == pytest.approx(0.5)
    assert synchroniser(AttitudeSample(0, 0, first, None)).attitude_at(0).tilt_rad_s == 0.0


def test_an_exact_stamp_is_taken_as_it_is():
    q = (0.6, 0.8, 0.0, 0.0)
    at = synchroniser(AttitudeSample(7, 9, q)).attitude_at(7)
    assert (at.q_ned_frd_wxyz, at.source, at.distance_ns) == (q, Source.EXACT, 0)


LEVEL = (1.0, 0.0, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)


def still(t_ms: float, rates=STILL) -> AttitudeSample:
    return AttitudeSample(round(t_ms * MS), round(t_ms * MS), LEVEL, rates)


@pytest.mark.parametrize(
    ("error_ms", "rate_deg_s", "sharp"),
    [(0, 500.0, True), (2, 500.0, True), (30, 99.0, True), (30, 101.0, False), (55, 60.0, False), (30, None, False)],
)
@pytest.mark.parametrize("t_ms", [100, 110, 130])
def test_in_a_fast_turn_no_attitude_is_used_whose_instant_is_uncertain(error_ms, rate_deg_s, sharp, t_ms):
    """With a bound of 55 ms a pole stood 5 degrees beside its place at 100 degrees a second, and its place was free."""
    rates = None if rate_deg_s is None else (0.0, 0.0, math.radians(rate_deg_s))
    found = [turning(at * MS, LEVEL, rates) for at in (100, 120)] if rates else [still(100, None)]
    samples = [replace(sample, stamp_error_ns=error_ms * MS) for sample in found]
    answer = synchroniser(*samples).attitude_at(t_ms * MS)
    if sharp:
        assert isinstance(answer, AttitudeAt)
    elif rates is None and t_ms > 100:
        assert answer is DropCause.NO_RATES
    else:
        assert answer is DropCause.CLOCK_UNCERTAIN


@pytest.mark.parametrize("uncertain_first", [True, False])
@pytest.mark.parametrize("t_ms", [105, 115])
def test_between_two_samples_one_uncertain_instant_is_enough(uncertain_first, t_ms):
    """The bound falls when the clock becomes known: a sample before it may still be of another instant."""
    fast = (0.0, 0.0, math.radians(200.0))
    errors_ms = (30, 1) if uncertain_first else (1, 30)
    found = [turning(at * MS, LEVEL, fast) for at in (100, 120)]
    samples = [replace(s, stamp_error_ns=error_ms * MS) for s, error_ms in zip(found, errors_ms, strict=True)]
    assert synchroniser(*samples).attitude_at(t_ms * MS) is DropCause.CLOCK_UNCERTAIN


@given(vectors, vectors)
def test_a_turn_is_carried_back_before_the_first_sample(start, rates):
    first = turning(100 * MS, from_rotation_vector(start), rates)
    at = synchroniser(first).attitude_at(60 * MS)
    assert at.source is Source.EXTRAPOLATED
    assert angle_between(at.q_ned_frd_wxyz, turning(60 * MS, from_rotation_vector(start), rates).q_ned_frd_wxyz) < 1e-6


def test_an_attitude_after_a_gap_has_the_gap_and_one_before_it_has_not():
    sync = Synchroniser(SyncParams())
    for sample in (still(0), still(100), still(400), still(420)):
        sync.add(sample)
    gaps_ms = [sync.attitude_at(t_ms * MS).gap_ns // MS for t_ms in (100, 400, 410)]
    assert gaps_ms == [0, 400, 400]


@pytest.mark.parametrize(
    ("samples", "t_ms", "expected"),
    [
        ((), 0, DropCause.NO_ATTITUDE),
        ((still(0),), 51, DropCause.ATTITUDE_STALE),
        ((still(0),), 50, Source.EXTRAPOLATED),
        ((still(0, None),), 10, DropCause.NO_RATES),
        ((still(100), still(120)), 49, DropCause.FRAME_TOO_OLD),
        ((still(100), still(120)), 50, Source.EXTRAPOLATED),
        ((still(0), still(150)), 75, Source.INTERPOLATED),
        ((still(0), still(151)), 75, DropCause.GAP_TOO_WIDE),
        ((still(0), still(151)), 30, Source.EXTRAPOLATED),
        ((still(0), still(151)), 120, Source.EXTRAPOLATED),
        ((still(0, None), still(151, None)), 30, DropCause.NO_RATES),
        ((still(0, None), still(140, None)), 160, Source.EXTRAPOLATED),
    ],
)
@pytest.mark.parametrize("begin_ns", [0, 3600 * NS])
def test_what_is_bounded_is_dropped_with_its_cause(samples, t_ms, expected, begin_ns):
    answer = synchroniser(*(replace(s, t_ns=s.t_ns + begin_ns) for s in samples)).attitude_at(t_ms * MS + begin_ns)
    assert (answer if isinstance(answer, DropCause) else answer.source) is expected


@given(st.permutations(range(8)))
def test_the_order_of_arrival_does_not_change_what_is_held(order):
    samples = [turning(i * 20 * MS, LEVEL, (0.3, -0.2, 0.9)) for i in range(8)]
    shuffled = synchroniser(*(samples[i] for i in order))
    assert shuffled.attitudes.samples == tuple(samples)
    in_order = synchroniser(*samples)
    assert shuffled.attitude_at(31 * MS) == in_order.attitude_at(31 * MS)
    late = sum(any(earlier > i for earlier in order[:k]) for k, i in enumerate(order))
    assert shuffled.attitudes.counts["out_of_order"] == late


def test_of_two_samples_with_one_stamp_the_first_stays():
    first, second = still(10), AttitudeSample(10 * MS, 0, (0.0, 1.0, 0.0, 0.0))
    sync = synchroniser(first, second, still(20))
    assert sync.attitudes.samples == (first, still(20))
    assert sync.attitudes.counts["duplicates"] == 1


def test_stamps_that_step_back_far_reset_the_state():
    sync = synchroniser(still(5000), still(5020), still(3900))
    assert sync.attitudes.samples == (still(3900),)
    assert sync.attitudes.counts["restarts"] == 1
    assert sync.attitude_at(5010 * MS) is DropCause.ATTITUDE_STALE


def test_a_stamp_from_the_far_future_does_not_blind_for_long():
    sync = synchroniser(still(0), still(3_600_000), still(20), still(40))
    assert sync.attitude_at(30 * MS).source is Source.INTERPOLATED


@pytest.mark.parametrize("axis", ["heading", "roll"])
def test_nothing_is_interpolated_between_samples_that_contradict_each_other(axis):
    """The stamps step back by less than a restart: samples of two times lie between each other."""
    sync, arrivals = Synchroniser(SyncParams()), itertools.count(step=10 * MS)

    def add(t_ms: int, deg: float, north_m: float) -> None:
        angles = (0.0, 0.0, math.radians(deg)) if axis == "heading" else (math.radians(deg), 0.0, 0.0)
        sync.add(AttitudeSample(t_ms * MS, next(arrivals), quaternion_from_euler(*angles), (0.0, 0.0, 0.0)))
        sync.add(PoseSample(t_ms * MS, next(arrivals), (north_m, 0.0, -2.0), (0.0, 0.0, 0.0)))

    for t_ms in range(10_000, 13_000, 10):
        add(t_ms, 0.0, 0.0)
    begin_ms = 13_005 - 500
    for t_ms in range(begin_ms, begin_ms + 200, 10):
        add(t_ms, 40.0, 50.0)
    between_ns = (begin_ms + 107) * MS
    assert sync.attitude_at(between_ns) is DropCause.GAP_TOO_WIDE
    assert sync.pose_at(between_ns) == "the positions before and after the exposure contradict each other"


def test_the_number_held_is_bounded():
    sync = synchroniser(*(still(i) for i in range(300)))
    assert [s.t_ns for s in sync.attitudes.samples] == [i * MS for i in range(300 - HELD, 300)]


def position(t_ms: float, x_m: float, velocity=(2.0, 0.0, 0.0), reset: int = 0) -> PoseSample:
    return PoseSample(round(t_ms * MS), 0, (x_m, 1.0, -2.0), velocity, reset)


def test_positions_are_interpolated_and_carried():
    sync = synchroniser(position(0, 0.0), position(100, 0.4))
    assert sync.pose_at(25 * MS) == PoseAt((0.1, 1.0, -2.0), Source.INTERPOLATED, 25 * MS, 0)
    carried = sync.pose_at(150 * MS)
    assert carried.source is Source.EXTRAPOLATED
    assert carried.position_ned_m == pytest.approx((0.5, 1.0, -2.0))
    assert sync.pose_at(100 * MS).source is Source.EXACT


@pytest.mark.parametrize("begin_ns", [0, 3600 * NS])
def test_each_axis_of_a_position_is_interpolated_and_carried(begin_ns):
    first = PoseSample(begin_ns, 0, (1.0, 5.0, -2.0), (4.0, -2.0, 1.0), 0)
    second = PoseSample(begin_ns + 100 * MS, 0, (1.4, 4.0, -1.8), (4.0, -2.0, 1.0), 0)
    sync = synchroniser(first, second)
    between, after, before = (sync.pose_at(begin_ns + t_ms * MS) for t_ms in (25, 150, -50))
    assert (between.source, between.distance_ns) == (Source.INTERPOLATED, 25 * MS)
    assert between.position_ned_m == pytest.approx((1.1, 4.75, -1.95))
    assert (after.source, after.distance_ns) == (Source.EXTRAPOLATED, 50 * MS)
    assert after.position_ned_m == pytest.approx((1.6, 3.9, -1.75))
    assert (before.source, before.distance_ns) == (Source.EXTRAPOLATED, 50 * MS)
    assert before.position_ned_m == pytest.approx((0.8, 5.1, -2.05))


@pytest.mark.parametrize(
    ("error_ms", "speed_m_s", "used"), [(0, 40.0, True), (30, 8.0, True), (30, 9.0, False), (55, 5.0, False)]
)
@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("t_ms", [100, 150, 250])
def test_in_fast_flight_no_position_is_used_whose_instant_is_uncertain(error_ms, speed_m_s, used, stated, t_ms):
    """With an error of 55 ms the merged world put a wall 0.5 m beside its place at 10 m/s, and its place was free."""
    velocity = (speed_m_s, 0.0, 0.0) if stated else None
    samples = [
        PoseSample(at * MS, at * MS, (speed_m_s * at / 1000.0, 0.0, -5.0), velocity, stamp_error_ns=error_ms * MS)
        for at in (100, 200)
    ]
    answer = synchroniser(*samples).pose_at(t_ms * MS)
    if used and (stated or t_ms < 200):
        assert isinstance(answer, PoseAt)
    elif used:
        assert "no velocity" in answer
    else:
        assert isinstance(answer, str)


@pytest.mark.parametrize(("down_m_s", "reset", "used"), [(8.0, 0, True), (9.0, 0, False), (0.0, 1, False)])
def test_the_velocity_between_two_positions_is_vertical_too_and_not_that_of_a_jump(down_m_s, reset, used):
    sync = Synchroniser(SyncParams())
    for t_ms, counter in ((0, 0), (40, reset)):
        place_m = (0.0, 0.0, down_m_s * t_ms / 1000.0)
        sync.add(PoseSample(t_ms * MS, t_ms * MS, place_m, reset_counter=counter, stamp_error_ns=30 * MS))
    assert isinstance(sync.pose_at(40 * MS), PoseAt) == used


def test_a_single_position_without_velocity_and_with_an_uncertain_instant_is_not_used() -> None:
    sample = PoseSample(0, 0, (0.0, 0.0, 0.0), stamp_error_ns=MS)
    assert isinstance(synchroniser(sample).pose_at(0), str)
    assert isinstance(synchroniser(replace(sample, stamp_error_ns=0)).pose_at(0), PoseAt)


def test_no_position_where_none_is_known():
    assert isinstance(synchroniser().pose_at(0), str)
    assert isinstance(synchroniser(position(0, 0.0)).pose_at(201 * MS), str)
    assert isinstance(synchroniser(position(0, 0.0, None)).pose_at(1), str)


def test_a_jump_of_the_estimate_is_never_interpolated_across():
    sync = synchroniser(position(0, 0.0, reset=0), position(100, 50.0, reset=1))
    before, after = sync.pose_at(20 * MS), sync.pose_at(80 * MS)
    assert (before.source, after.source) == (Source.EXTRAPOLATED, Source.EXTRAPOLATED)
    assert before.position_ned_m[0] == pytest.approx(0.04)
    assert after.position_ned_m[0] == pytest.approx(49.96)
    assert (before.reset_counter, after.reset_counter) == (0, 1)


def test_positions_are_not_interpolated_across_a_wide_gap():
    """Nor is their velocity: the vehicle may have flown elsewhere between them."""
    sync = synchroniser(position(0, 0.0), position(510, 1.02))
    assert isinstance(sync.pose_at(255 * MS), str)
    uncertain = [PoseSample(t_ms * MS, t_ms * MS, (0.0, 0.0, -5.0), stamp_error_ns=MS) for t_ms in (0, 510)]
    assert isinstance(synchroniser(*uncertain).pose_at(0), str)
    near = replace(uncertain[1], t_ns=400 * MS)
    assert isinstance(synchroniser(uncertain[0], near).pose_at(0), PoseAt)


def test_bounds_are_checked():
    with pytest.raises(ValueError, match=r"sync: max_gap_s = 3\.0: expected 0\.005\.\.1\.0 s"):
        SyncParams(max_gap_s=3.0)
    with pytest.raises(ValueError, match="max_gap_s"):
        SyncParams(max_gap_s=math.nan)


@pytest.mark.parametrize("rate", [71.0, 1e4, 1e200])
def test_rates_that_nothing_flies_with_carry_no_attitude(rate):
    """By such rates a frame would be levelled anyhow, or not at all."""
    q = (1.0, 0.0, 0.0, 0.0)
    alone = synchroniser(AttitudeSample(0, 0, q, (rate, 0.0, 0.0)))
    assert alone.attitude_at(10 * MS) is DropCause.NO_RATES
    two = synchroniser(AttitudeSample(0, 0, q, None), AttitudeSample(20 * MS, 20 * MS, q, (0.0, -rate, 0.0)))
    at = two.attitude_at(30 * MS)  # the turn between the two is none
    assert at.source is Source.EXTRAPOLATED
    assert angle_between(at.q_ned_frd_wxyz, q) < 1e-9


def test_a_turn_between_two_attitudes_that_nothing_flies_carries_no_attitude():
    roll = from_rotation_vector((1.0, 0.0, 0.0))
    sync = synchroniser(still(100, None), replace(still(110, None), q_ned_frd_wxyz=roll))
    assert sync.attitude_at(115 * MS) is DropCause.NO_RATES


def test_rates_across_a_jump_of_the_heading_carry_no_attitude():
    sync = Synchroniser(SyncParams())
    for sample in (still(100, None), replace(still(150, None), q_ned_frd_wxyz=from_rotation_vector((0.0, 0.0, 0.7)))):
        sync.add(sample)
    assert sync.headings.number == 1
    for t_ms in (95, 155):  # beside each of the two
        assert sync.attitude_at(t_ms * MS) is DropCause.NO_RATES


@pytest.mark.parametrize("far_m", [1.01 * MAX_DISTANCE_M, -1e8, 1e39, 1e300])
def test_a_position_beyond_every_local_frame_is_none(far_m):
    exact = synchroniser(PoseSample(0, 0, (0.0, far_m, 0.0)))
    assert "km from the origin" in exact.pose_at(0)
    carried = synchroniser(PoseSample(0, 0, (0.0, 0.0, 0.0), (far_m * 100, 0.0, 0.0)))
    assert "km from the origin" in carried.pose_at(100 * MS)
    assert isinstance(synchroniser(PoseSample(0, 0, (0.0, 0.0, -MAX_DISTANCE_M))).pose_at(0), PoseAt)
