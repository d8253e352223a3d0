"""Turns: the rate of the course, by the velocity and the lean of the vehicle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.surroundings import Surroundings
from companion.autopilot.vehicle_motion import GRAVITY_M_S2, VehicleMotion
from companion.guard.lean import LeanAcceleration
from companion.guard.turn import WIDEST_RAD, CourseRate, fan, turns
from core.frames import quaternion_from_euler
from core.types import AttitudeSample

from ..guard_sight import HERE, NS, T_NS, nothing_remembered

HZ = 15


def decision(t_s: float, velocity_m_s: tuple[float, float], lean_m_s2: tuple[float, float] | None) -> Surroundings:
    """A decision with this velocity and lean, north and east."""
    return Surroundings(
        t_ns=T_NS + round(t_s * NS),
        views=(),
        weak_px=(),
        exposed_ns=None,
        recall=None,
        recalled=nothing_remembered(),
        blind={},
        here=replace(HERE, lean_m_s2=lean_m_s2),
        velocity_ned_m_s=(*velocity_m_s, 0.0),
    )


def turned(course_rad: float, forward: float, right: float) -> tuple[float, float]:
    """North and east of a vector that is given along a course."""
    c, s = math.cos(course_rad), math.sin(course_rad)
    return c * forward - s * right, s * forward + c * right


def turning(rate_deg_s: float, speed_m_s: float = 3.0, hz: float = 15.0, frames: int = 12) -> float:
    """Rate in degrees per second after so many decisions on a turning course that passes south."""
    course_rate, out = CourseRate(), 0.0
    for n in range(frames):
        course = math.radians(175.0 + rate_deg_s * n / hz)
        out = course_rate.take(decision(n / hz, turned(course, speed_m_s, 0.0), None))
    return math.degrees(out)


@pytest.mark.parametrize("rate_deg_s", [-45.0, -10.0, 10.0, 60.0])
def test_the_rate_of_the_course(rate_deg_s: float) -> None:
    assert turning(rate_deg_s) == pytest.approx(rate_deg_s, abs=0.1)
    assert turning(rate_deg_s, speed_m_s=0.2) == 0.0, "it stands"
    assert turning(rate_deg_s, frames=4) == 0.0, "too short a time"
    assert turning(rate_deg_s, hz=1.0) == 0.0, "too long ago"


def starting(course_deg: float, drift_m_s: float, accelerates_m_s2: float, until_s: float) -> tuple[float, float]:
    """(rate in degrees per second, course in degrees) of a vehicle that begins a leg while it drifts to the right of it."""
    course_rate, out, course = CourseRate(), 0.0, math.radians(course_deg)
    for n in range(round(until_s * 15) + 1):
        t = n / 15
        along, drift = max(0.0, 0.5 + accelerates_m_s2 * t), drift_m_s * (1.0 - t / 2.0)
        north, east = turned(course, along, drift)
        out = course_rate.take(decision(t, (north, east), None))
    return math.degrees(out), math.degrees(math.atan2(east, north))


def test_a_vehicle_that_begins_a_leg_turns_to_where_it_accelerates() -> None:
    rate, course = starting(67.0, 0.4, 2.5, until_s=0.4)
    assert course - 67.0 > 10.0
    assert 67.0 - 2.0 < course + rate < course - 5.0, "towards the leg"
    assert starting(67.0, 0.0, 2.5, until_s=0.4)[0] == 0.0, "straight"
    rate, course = starting(67.0, 0.12, 2.5, until_s=0.4)
    assert course - 67.0 > 3.0
    assert 67.0 - 2.0 < course + rate < course - 1.0, "a drift of 0.1 m/s, too"
    assert starting(67.0, 0.4, -0.6, until_s=0.4)[0] == 0.0, "it gets slower"


def test_a_rate_counts_where_the_arc_leaves_the_corridor_within_the_braking_distance() -> None:
    assert turning(5.0) == pytest.approx(5.0, abs=0.1)
    assert turns(math.radians(5.9), 10.0, 20.0, 0.3), "2.1 m aside"
    assert not turns(math.radians(0.5), 10.0, 20.0, 0.3)
    assert not turns(math.radians(4.0), 1.0, 2.9, 0.3)
    assert turns(math.radians(10.0), 1.0, 2.9, 0.3)


@pytest.mark.parametrize(("turn_deg_s", "speed_m_s"), [(5.9, 10.0), (30.0, 3.0), (60.0, 2.0)])
def test_the_corridors_of_the_fan_leave_no_gap(turn_deg_s: float, speed_m_s: float) -> None:
    directions = fan(math.radians(turn_deg_s), speed_m_s, 20.0, 0.7)
    steps = np.diff([0.0, *(angle for angle, _ in directions)])
    assert (steps * 20.0 <= 2.0 * 0.7 + 1e-9).all()
    widest = min(WIDEST_RAD, 0.5 * math.radians(turn_deg_s) / speed_m_s * 20.0)
    assert directions[-1][0] * 20.0 + 0.7 >= widest * 20.0


def test_a_missing_or_frozen_velocity_holds_the_last_rate() -> None:
    course_rate = CourseRate()

    def take(t: float, stamp: float | None) -> float:
        angle = math.radians(30.0) * (0.0 if stamp is None else stamp)
        s = decision(t, turned(angle, 3.0, 0.0), None)
        velocity = None if stamp is None else s.velocity_ned_m_s
        stamp_ns = None if stamp is None else T_NS + round(stamp * NS)
        return math.degrees(course_rate.take(replace(s, velocity_ned_m_s=velocity, velocity_ns=stamp_ns)))

    for n in range(11):
        rate = take(n * 0.05, n * 0.05)
    assert rate == pytest.approx(30.0, abs=0.1)
    assert take(0.55, None) == pytest.approx(30.0, abs=0.1)
    assert take(0.6, 0.6) == pytest.approx(30.0, abs=0.1), "the samples before the gap still count"
    assert take(1.1, 0.6) == pytest.approx(30.0, abs=0.1), "frozen"
    assert take(1.3, 0.6) == 0.0


@pytest.mark.parametrize("speed_m_s", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("wind_m_s2", [0.0, 2.0])
def test_the_noise_of_the_velocity_of_a_straight_flight_is_no_turn(speed_m_s: float, wind_m_s2: float) -> None:
    """Noise of PX4: 0.05 m/s in each component, with a time constant of 0.5 s. A turn would widen the corridor."""
    rng, noise, course_rate, found = np.random.default_rng(1), np.zeros(2), CourseRate(), 0
    kept = math.exp(-1.0 / HZ / 0.5)
    for n in range(3000):
        noise = kept * noise + math.sqrt(1.0 - kept * kept) * rng.normal(0.0, 0.05, 2)
        velocity = speed_m_s + float(noise[0]), float(noise[1])
        rate = course_rate.take(decision(n / HZ, velocity, (0.0, wind_m_s2)))
        found += rate != 0.0 and n >= 5 * HZ
    assert found <= 15


@pytest.mark.parametrize("rate_deg_s", [-45.0, 8.0, 60.0])
@pytest.mark.parametrize("wind_m_s2", [0.0, 2.0])
def test_a_vehicle_that_leans_into_a_turn_turns(rate_deg_s: float, wind_m_s2: float) -> None:
    """After 3 s of straight flight at 3 m/s, and as long as the turn goes on."""
    course_rate, rates, rate_rad_s = CourseRate(), [], math.radians(rate_deg_s)
    for n in range(-3 * HZ, 20 * HZ):
        course = rate_rad_s * max(0, n) / HZ
        north, east = turned(course, 0.0, 3.0 * rate_rad_s if n >= 0 else 0.0)
        lean = north, east + wind_m_s2
        rates.append(course_rate.take(decision(3.0 + n / HZ, turned(course, 3.0, 0.0), lean)))
    assert rates[: 3 * HZ] == [0.0] * 3 * HZ
    assert rates[3 * HZ + 1] != 0.0, "one decision after its beginning"
    assert np.degrees(rates[3 * HZ + 6 :]) == pytest.approx(rate_deg_s, rel=0.01)


@pytest.mark.parametrize("rate_deg_s", [-30.0, 20.0])
def test_a_vehicle_that_turns_without_a_lean_is_noticed_by_its_velocity(rate_deg_s: float) -> None:
    """It is noticed when the velocity has changed by 0.4 m/s: 2 m/s2 at 4 m/s and 30 degrees per second."""
    course_rate, rates, rate_rad_s = CourseRate(), [], math.radians(rate_deg_s)
    for n in range(-HZ, 5 * HZ):
        course = rate_rad_s * max(0, n) / HZ
        rates.append(course_rate.take(decision(1.0 + n / HZ, turned(course, 4.0, 0.0), (0.0, 0.0))))
    first = next(n for n, rate in enumerate(rates) if rate != 0.0) - HZ
    assert first / HZ == pytest.approx(0.4 / (4.0 * abs(rate_rad_s)), abs=0.1)
    assert np.degrees(rates[HZ + 8 :]) == pytest.approx(rate_deg_s, rel=0.01)


def test_a_gust_that_pushes_the_vehicle_aside_is_no_turn() -> None:
    """It drifts to the right with the gust and leans to the left against it."""
    course_rate, rates = CourseRate(), []
    for n in range(6 * HZ):
        t = n / HZ - 3.0
        drift, against = (0.3 * (1.0 - math.exp(-t)), -1.0) if t >= 0.0 else (0.0, 0.0)
        rates.append(course_rate.take(decision(n / HZ, (3.0, drift), (0.4, against))))
    assert rates == [0.0] * len(rates)


def test_a_fast_change_of_the_course_is_a_turn_whatever_the_lean_is() -> None:
    """It is pushed to the right at 1 m/s2 and leans to the left."""
    course_rate, rates = CourseRate(), []
    for n in range(4 * HZ):
        t = n / HZ - 3.0
        drift, against = (t, -1.0) if t >= 0.0 else (0.0, 0.0)
        rates.append(course_rate.take(decision(n / HZ, (3.0, drift), (0.0, against))))
    assert rates[: 3 * HZ] == [0.0] * 3 * HZ
    assert min(rates[3 * HZ + 7 :]) > 0.0


def test_without_a_lean_each_change_of_the_course_counts() -> None:
    course_rate, rate = CourseRate(), 0.0
    for n in range(2 * HZ):
        rate = course_rate.take(decision(n / HZ, turned(math.radians(2.0) * n / HZ, 3.0, 0.0), None))
    assert math.degrees(rate) == pytest.approx(2.0, abs=0.01)


def test_the_lean_of_steady_flight_is_subtracted() -> None:
    """Wind from the left and drag: the vehicle leans by 1.0 and 0.5 m/s2 and does not accelerate; then it accelerates."""
    lean, end_ns = LeanAcceleration(), T_NS + NS
    assert lean.newest_m_s2(end_ns) is None
    lean.settle(T_NS, T_NS + NS, (0.0, 0.0))
    assert lean.newest_m_s2(end_ns) is None, "no lean is known"
    for n in range(10):
        lean.take(T_NS + n * NS // 10, (0.5, -1.0))
        lean.settle(T_NS + n * NS // 10 - 3 * NS // 10, T_NS + n * NS // 10, (0.0, 0.0))
    assert lean.newest_m_s2(end_ns) == pytest.approx((0.0, 0.0), abs=1e-9)
    lean.take(T_NS + NS, (2.5, -1.0))
    assert lean.newest_m_s2(end_ns) == pytest.approx((2.0, 0.0), abs=1e-9)
    assert lean.newest_m_s2(end_ns + 3 * NS // 10) is not None
    assert lean.newest_m_s2(end_ns + 4 * NS // 10) is None, "the lean is too old"


def test_a_lean_from_before_a_gap_of_the_attitude_does_not_make_a_turn_noise() -> None:
    """Straight flight with a lean; then the attitude has no lean any more, and the course turns slowly."""
    course_rate, rate = CourseRate(), 0.0
    for n in range(3 * HZ):
        course = math.radians(2.0) * max(0, n - 2 * HZ) / HZ
        rate = course_rate.take(decision(n / HZ, turned(course, 3.0, 0.0), (0.0, 0.0) if n < 2 * HZ else None))
    assert math.degrees(rate) == pytest.approx(2.0, abs=0.01)


def test_the_steady_lean_follows_the_wind() -> None:
    """The wind ends: three time constants later nothing of its lean is left but a twentieth."""
    lean = LeanAcceleration()
    for n in range(200):
        t_ns = T_NS + n * NS // 10
        lean.take(t_ns, (0.0, 2.0 if n < 140 else 0.0))
        lean.settle(t_ns - 3 * NS // 10, t_ns, (0.0, 0.0))
    newest = lean.newest_m_s2(T_NS + 199 * NS // 10)
    assert newest is not None
    assert -0.15 < newest[1] < -0.05


@pytest.mark.parametrize("heading_deg", [0.0, 120.0])
def test_the_lean_of_an_attitude(heading_deg: float) -> None:
    """Nose down by 10 degrees accelerates forward, the right side down by 5 degrees to the right."""
    for roll_deg, pitch_deg, forward, right in (
        (0.0, -10.0, math.tan(math.radians(10.0)), 0.0),
        (5.0, 0.0, 0.0, math.tan(math.radians(5.0))),
    ):
        found = lean_of(roll_deg, pitch_deg, heading_deg)
        assert found == pytest.approx(turned(math.radians(heading_deg), GRAVITY_M_S2 * forward, GRAVITY_M_S2 * right))
    assert lean_of(80.0, 0.0, heading_deg) is None


def lean_of(roll_deg: float, pitch_deg: float, heading_deg: float) -> tuple[float, float] | None:
    """The lean of a vehicle with this attitude."""
    motion, q = VehicleMotion(), quaternion_from_euler(*map(math.radians, (roll_deg, pitch_deg, heading_deg)))
    motion.samples([AttitudeSample(T_NS + n * NS // 50, T_NS + n * NS // 50, q, (0.0, 0.0, 0.0)) for n in range(5)])
    here = motion.catch_up(T_NS + 2 * NS // 50)
    assert here is not None
    return here.lean_m_s2
