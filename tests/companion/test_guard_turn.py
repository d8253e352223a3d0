"""Turns: the rate of the course, by the velocity and the lean of the vehicle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.surroundings import Surroundings
from companion.autopilot.vehicle_motion import GRAVITY_M_S2, VehicleMotion
from companion.guard.lean import LeanAcceleration
from companion.guard.turn import CourseRate
from core.frames import quaternion_from_euler
from core.types import AttitudeSample

from .test_guard_path import HERE, NS, T_NS, nothing_remembered

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


@pytest.mark.parametrize("speed_m_s", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("wind_m_s2", [0.0, 2.0])
def test_the_noise_of_the_velocity_of_a_straight_flight_is_no_turn(speed_m_s: float, wind_m_s2: float) -> None:
    """Noise of PX4: 0.05 m/s in each component, with a time constant of 0.5 s. A turn would widen the corridor."""
    rng, noise, course_rate, turns = np.random.default_rng(1), np.zeros(2), CourseRate(), 0
    kept = math.exp(-1.0 / HZ / 0.5)
    for n in range(3000):
        noise = kept * noise + math.sqrt(1.0 - kept * kept) * rng.normal(0.0, 0.05, 2)
        velocity = speed_m_s + float(noise[0]), float(noise[1])
        rate = course_rate.take(decision(n / HZ, velocity, (0.0, wind_m_s2)))
        turns += rate != 0.0 and n >= 5 * HZ
    assert turns <= 15


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


def test_a_gust_that_pushes_the_vehicle_aside_is_no_turn() -> None:
    """It drifts to the right with the gust and leans to the left against it."""
    course_rate, rates = CourseRate(), []
    for n in range(6 * HZ):
        t = n / HZ - 3.0
        drift, against = (0.3 * (1.0 - math.exp(-t)), -1.0) if t >= 0.0 else (0.0, 0.0)
        rates.append(course_rate.take(decision(n / HZ, (3.0, drift), (0.4, against))))
    assert rates == [0.0] * len(rates)


def test_without_a_lean_each_change_of_the_course_counts() -> None:
    course_rate, rate = CourseRate(), 0.0
    for n in range(2 * HZ):
        rate = course_rate.take(decision(n / HZ, turned(math.radians(2.0) * n / HZ, 3.0, 0.0), None))
    assert math.degrees(rate) == pytest.approx(2.0, abs=0.01)


def test_the_lean_of_steady_flight_is_subtracted() -> None:
    """Wind from the left and drag: the vehicle leans by 1.0 and 0.5 m/s2 and does not accelerate; then it accelerates."""
    lean = LeanAcceleration()
    assert lean.newest_m_s2() is None
    lean.settle(T_NS, T_NS + NS, (0.0, 0.0))
    assert lean.newest_m_s2() is None, "no lean is known"
    for n in range(10):
        lean.take(T_NS + n * NS // 10, (0.5, -1.0))
        lean.settle(T_NS + n * NS // 10 - 3 * NS // 10, T_NS + n * NS // 10, (0.0, 0.0))
    assert lean.newest_m_s2() == pytest.approx((0.0, 0.0), abs=1e-9)
    lean.take(T_NS + NS, (2.5, -1.0))
    assert lean.newest_m_s2() == pytest.approx((2.0, 0.0), abs=1e-9)


def test_the_steady_lean_follows_the_wind() -> None:
    """The wind ends: three time constants later nothing of its lean is left but a twentieth."""
    lean = LeanAcceleration()
    for n in range(200):
        t_ns = T_NS + n * NS // 10
        lean.take(t_ns, (0.0, 2.0 if n < 140 else 0.0))
        lean.settle(t_ns - 3 * NS // 10, t_ns, (0.0, 0.0))
    newest = lean.newest_m_s2()
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
