"""The guard's state machine: limits of the speed, and speed items of the mission."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.config.guard import GuardParams
from companion.guard.machine import GuardMachine
from companion.guard.modes import StopMethod
from companion.guard.speed_limit import ACCEPTED, RAISE_AFTER_NS, TEMPORARILY_REJECTED
from companion.guard.states import (
    GuardState,
    Output,
    SpeedCommand,
    StopCommand,
)
from drivers.mavlink.commands import DO_CHANGE_SPEED

from ..guard_machine import (
    BLOCKED,
    FREE,
    NARROW,
    OFFBOARD,
    STEP_NS,
    Flight,
    commands,
    texts,
)


def test_limits_the_speed_before_it_stops() -> None:
    f = Flight()
    f.step()
    f.verdict = NARROW
    out = f.step()
    assert commands(out) == [SpeedCommand(7, 2.0)]
    assert texts(out) == ["guard: speed limit 2.0 m/s"]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(NARROW, speed_m_s=2.0)
    assert f.step(20) == []
    assert f.state is GuardState.LIMITED
    f.verdict = BLOCKED
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_repeats_a_limit_three_times() -> None:
    f = Flight(verdict=NARROW)
    out = f.step()
    f.verdict = replace(NARROW, speed_m_s=2.0)
    out += f.step(100)
    assert commands(out) == [SpeedCommand(7, 2.0)] * 3


@pytest.mark.parametrize(("result", "times"), [(TEMPORARILY_REJECTED, 3), (ACCEPTED, 1)])
def test_a_limit_that_is_rejected_for_a_moment_is_repeated(result: int, times: int) -> None:
    f = Flight(verdict=NARROW)
    out: list[Output] = []
    for _ in range(100):
        step = f.step()
        out += step
        f.verdict = replace(NARROW, speed_m_s=2.0)
        if commands(step):
            f.machine.acknowledged(DO_CHANGE_SPEED, result)
    assert commands(out) == [SpeedCommand(7, 2.0)] * times


def test_lowers_at_once_and_raises_late() -> None:
    f = Flight()
    f.step()
    f.verdict = NARROW
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.step(5)
    f.verdict = replace(NARROW, allowed_m_s=1.2)
    assert commands(f.step()) == [SpeedCommand(7, 1.0)]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=1.0)
    raise_steps = RAISE_AFTER_NS // STEP_NS
    assert commands(f.step(raise_steps)) == []
    out = f.step(10)
    assert commands(out) == [SpeedCommand(7, 3.0)]
    assert texts(out) == ["guard: speed limit ended"]
    assert f.state is GuardState.WATCHING


def test_no_limit_above_the_speed_before() -> None:
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, allowed_m_s=15.0, speed_m_s=2.0)
    assert all(c.speed_m_s <= 3.0 for c in commands(f.step(200)) if isinstance(c, SpeedCommand))


def test_a_limit_is_never_above_the_speed_of_the_vehicle() -> None:
    """The command sets the speed: 4.5 m/s would make a mission at 3 m/s faster."""
    accelerating = replace(NARROW, predicted_m_s=5.0, allowed_m_s=4.6)
    f = Flight(verdict=accelerating)
    assert commands(f.step()) == [SpeedCommand(7, 3.0)]
    f = Flight(verdict=replace(accelerating, speed_m_s=0.9))
    assert f.step(20) == []
    f = Flight(machine=GuardMachine(GuardParams(enabled=True, cruise_m_s=6.0)), verdict=accelerating)
    assert commands(f.step()) == [SpeedCommand(7, 3.0)]
    f = Flight(machine=GuardMachine(GuardParams(enabled=True, cruise_m_s=2.0)), verdict=accelerating)
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]


@pytest.mark.parametrize("cruise_m_s", [0.0, 10.0])
def test_the_end_of_a_limit_is_not_faster_than_the_leg(cruise_m_s: float) -> None:
    """The first leg is flown at 10 m/s, the second at 3 m/s."""
    f = Flight(
        machine=GuardMachine(GuardParams(enabled=True, cruise_m_s=cruise_m_s)), verdict=replace(FREE, speed_m_s=10.0)
    )
    assert f.step(20) == []
    f.verdict = FREE
    f.step(100)
    f.verdict = replace(NARROW, allowed_m_s=1.5)
    sent = commands(f.step())
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=1.5, allowed_m_s=15.0)
    sent += commands(f.step(200))
    assert sent == [SpeedCommand(7, 1.5), SpeedCommand(7, 3.0)]


def test_a_limit_that_the_vehicle_does_not_follow_is_not_in_force() -> None:
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=2.6)
    out = f.step(25)
    assert commands(out) == []
    assert texts(out) == ["guard: speed limit has no effect"]
    assert f.state is GuardState.WATCHING
    assert f.step(100) == []


def test_a_vehicle_that_is_still_braking_follows_its_limit() -> None:
    f = Flight(verdict=replace(NARROW, speed_m_s=10.0))
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    for k in range(80):
        f.verdict = replace(NARROW, speed_m_s=10.0 - 0.1 * k)
        assert f.step() == []
    assert f.state is GuardState.LIMITED


def test_a_limit_is_raised_to_the_speed_just_before_it() -> None:
    accelerating = replace(NARROW, predicted_m_s=5.0, allowed_m_s=4.6)
    f = Flight(verdict=accelerating)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=4.2)
    f.step(5)
    f.verdict = replace(FREE, speed_m_s=3.0)
    assert commands(f.step(60)) == []
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=2.0)
    assert commands(f.step(60)) == [SpeedCommand(7, 3.0)]


def test_a_vehicle_that_stands_is_not_limited() -> None:
    """Its speed would become the highest to which the limit is raised."""
    f = Flight(verdict=replace(NARROW, speed_m_s=0.2, allowed_m_s=0.0))
    assert f.step(20) == []


def test_no_limit_in_offboard_nor_when_refused() -> None:
    f = Flight("PX4", OFFBOARD, verdict=NARROW)
    assert f.step(30) == []
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 4)
    assert commands(f.step(50)) == []
    assert f.state is GuardState.WATCHING


def test_a_mission_that_raises_the_speed_during_a_limit_is_asked_again_and_then_stopped() -> None:
    f = Flight(verdict=NARROW)
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(NARROW, speed_m_s=6.0, predicted_m_s=6.0)
    out = f.step(25)
    assert "guard: speed limit has no effect" in texts(out)
    assert commands(out) == [SpeedCommand(7, 2.0)]
    f.verdict = replace(BLOCKED, speed_m_s=6.0)
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_a_speed_item_of_the_mission_is_answered_at_once_and_once() -> None:
    """The vehicle followed the limit, and then gets faster."""
    f = Flight(verdict=NARROW)
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(NARROW, speed_m_s=2.0)
    assert commands(f.step(20)) == []
    f.verdict = replace(NARROW, speed_m_s=2.6)
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(NARROW, speed_m_s=6.0)
    out = f.step(19)
    assert commands(out) == []
    assert "guard: speed limit has no effect" in texts(f.step(10))


def test_a_speed_item_where_the_path_is_free_is_not_answered() -> None:
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(NARROW, speed_m_s=2.0)
    f.step(20)
    f.verdict = replace(FREE, speed_m_s=2.8)
    assert commands(f.step(10)) == []


def test_a_vehicle_that_first_ends_its_acceleration_follows_its_limit() -> None:
    """A limited jerk: it gets faster for a second, and is as fast as before after two."""
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    out: list[Output] = []
    for speed_m_s in (2.4, 3.0, 3.6, 4.0, 4.1, 4.0, 3.8, 3.5, 3.2, 2.8, 2.4, 2.1):
        f.verdict = replace(NARROW, speed_m_s=speed_m_s)
        out += f.step(3)
    assert out == []
    assert f.state is GuardState.LIMITED


def test_a_vehicle_that_others_keep_slower_than_its_limit_is_not_made_faster() -> None:
    """A ground station has set 0.8 m/s while the limit was 2 m/s; the guard would set the 3 m/s from before the limit."""
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    f.verdict = replace(FREE, speed_m_s=0.8)
    assert commands(f.step(100)) == []
    f.verdict = replace(FREE, speed_m_s=2.0)
    assert commands(f.step(60)) == [SpeedCommand(7, 3.0)]


def test_a_vehicle_that_others_keep_a_little_slower_than_its_limit_is_not_made_faster() -> None:
    """A ground station has set 1.7 m/s while the limit was 2 m/s. The measured speed has noise, and peaks above 1.8."""
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    out: list[Output] = []
    for k in range(200):
        f.verdict = replace(FREE, speed_m_s=1.7 + 0.15 * math.sin(k))
        out += f.step()
    assert commands(out) == []


def test_a_limit_is_raised_although_the_measured_speed_has_noise() -> None:
    f = Flight(verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    out: list[Output] = []
    for k in range(60):
        f.verdict = replace(FREE, speed_m_s=1.95 + 0.4 * math.sin(k))
        out += f.step()
    assert commands(out) == [SpeedCommand(7, 3.0)]


def test_a_vehicle_that_does_not_answer_is_stopped_all_the_same_and_not_limited() -> None:
    f = Flight(verdict=NARROW, silent=True)
    out = f.step(10)
    assert commands(out) == []
    assert texts(out) == ["guard: vehicle does not answer, stop may fail"]
    f.verdict = BLOCKED
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_a_vehicle_that_answers_again_is_announced() -> None:
    f = Flight(silent=True)
    f.step()
    f.silent = False
    assert texts(f.step()) == ["guard: vehicle answers again"]
