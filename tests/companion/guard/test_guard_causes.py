"""The guard's state machine: unseen space, failsafes, take-off and landing."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.guard.assessment import Verdict
from companion.guard.machine import REARM_NS, GuardMachine
from companion.guard.modes import StopMethod
from companion.guard.states import (
    GuardState,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER

from ..guard_machine import (
    AUTO,
    BLIND,
    BLOCKED,
    FREE,
    GUARD,
    RETURN,
    RTL,
    STEP_NS,
    UNSEEN,
    WEAK,
    Flight,
    commands,
    stopping,
    texts,
)


def test_a_stop_is_repeated_where_the_path_is_not_seen() -> None:
    f = stopping()
    f.verdict = replace(FREE, sees=False)
    assert commands(f.step(30)) != []
    f = stopping()
    f.verdict = None
    assert commands(f.step(30)) != []


@pytest.mark.parametrize("unseen", [BLIND, replace(FREE, sees=False), None])
def test_a_stop_before_an_obstacle_is_repeated_in_take_off_landing_and_failsafe_where_the_path_is_lost(
    unseen: Verdict | None,
) -> None:
    """Unseen space alone does not stop the vehicle there. It does not show that the obstacle is gone, either."""
    f = Flight(near_ground=True)
    f.step()
    f.verdict = BLOCKED
    assert len(commands(f.step())) == 1
    f.verdict = unseen
    assert len(commands(f.step(100))) > 3
    f.verdict = FREE
    assert texts(f.step(40)) == ["guard: stop ended, not needed now"]
    f = Flight("PX4", RETURN, system_status=5)
    f.step()
    f.verdict = BLOCKED
    assert len(commands(f.step())) == 1
    f.verdict = unseen
    assert len(commands(f.step(100))) > 3


@pytest.mark.parametrize(("reason", "repeated"), [(BLOCKED, True), (BLIND, False)])
def test_a_restart_in_landing_repeats_a_stop_before_an_obstacle(reason: Verdict, repeated: bool) -> None:
    f = Flight()
    f.step()
    f.verdict = reason
    assert len(commands(f.step())) == 1
    f.machine = GuardMachine(GUARD, f.machine.memory, f.machine.received_ns)
    f.near_ground, f.verdict = True, BLIND
    assert (len(commands(f.step(100))) > 3) is repeated


def test_a_failsafe_that_begins_during_a_stop_needs_a_firm_obstacle() -> None:
    f = Flight("PX4", RETURN)
    f.step()
    f.verdict = WEAK
    assert len(commands(f.step())) == 1
    f.verdict, f.system_status = BLIND, 5
    assert commands(f.step(50)) == []


def test_blindness_stops_once() -> None:
    """Otherwise a vehicle with a broken camera could not return."""
    f = Flight()
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]
    f.mode, f.verdict = COPTER_BRAKE, replace(BLIND, speed_m_s=0.0)
    f.step(12)
    assert f.state is GuardState.HOLDING
    f.mode, f.verdict = RTL, BLIND
    out = f.step(50)
    assert commands(out) == []
    assert texts(out) == ["guard: released, mode changed", "guard: off, path still not seen"]
    f.verdict = FREE
    f.step(REARM_NS // STEP_NS + 1)
    f.verdict = BLIND
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


@pytest.mark.parametrize(
    ("seen", "heading_deg", "stopped_again"),
    [(True, 5.0, True), (True, -5.0, True), (True, 60.0, False), (True, None, False), (False, 0.0, False)],
)
def test_a_camera_that_sees_the_course_again_at_rest_stops_a_second_time(
    seen: bool, heading_deg: float | None, stopped_again: bool
) -> None:
    """A mission that was resumed flew 34 m without a camera. The time at rest counts only where the vehicle looks along the course
    on which it was stopped: a mission that flies sideways can still be resumed."""
    f = Flight()
    f.verdict = replace(FREE, course_rad=math.pi)
    f.step()
    f.verdict = replace(BLIND, course_rad=math.pi)
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]
    course_rad = None if heading_deg is None else math.remainder(math.pi + math.radians(heading_deg), math.tau)
    at_rest = replace(FREE if seen else BLIND, speed_m_s=0.0, course_rad=course_rad)
    f.mode, f.verdict = COPTER_BRAKE, at_rest
    assert commands(f.step(12 + REARM_NS // STEP_NS)) == []
    assert f.state is GuardState.HOLDING
    f.mode, f.verdict = AUTO, replace(FREE, course_rad=math.pi)
    assert commands(f.step(20)) == []
    f.verdict = replace(BLIND, course_rad=math.pi)
    assert bool(commands(f.step())) is stopped_again


@pytest.mark.parametrize("course_rad", [0.0, math.radians(60.0)])
@pytest.mark.parametrize("other_camera_fails", [False, True])
def test_a_path_that_no_camera_shows_in_flight_stops_once_although_it_is_seen_at_rest(
    course_rad: float, other_camera_fails: bool
) -> None:
    """In a descent, with a strong lean or under an open sky each resumed mission would be stopped."""
    f = Flight()
    f.verdict = replace(FREE, course_rad=course_rad, camera_fails=other_camera_fails)
    f.step()
    f.verdict = replace(UNSEEN, course_rad=course_rad, camera_fails=other_camera_fails)
    assert len(commands(f.step())) == 1
    f.mode, f.verdict = COPTER_BRAKE, replace(FREE, speed_m_s=0.0, course_rad=0.0, camera_fails=other_camera_fails)
    f.step(12 + 2 * REARM_NS // STEP_NS)
    assert f.state is GuardState.HOLDING
    f.mode, f.verdict = AUTO, replace(FREE, course_rad=course_rad, camera_fails=other_camera_fails)
    assert commands(f.step(20)) == []
    f.verdict = replace(UNSEEN, course_rad=course_rad, camera_fails=other_camera_fails)
    assert commands(f.step(50)) == []


@pytest.mark.parametrize(
    ("speed_m_s", "camera_fails", "stopped_again"), [(0.3, False, True), (0.3, True, False), (0.1, False, False)]
)
def test_noise_of_the_velocity_at_rest_is_no_other_course(
    speed_m_s: float, camera_fails: bool, stopped_again: bool
) -> None:
    """From 0.2 m/s on the path is along the velocity. At 0.1 m/s the heading has changed."""
    f = Flight()
    f.verdict = replace(FREE, course_rad=0.0)
    f.step()
    f.verdict = replace(BLIND, course_rad=0.0)
    f.step()
    f.mode = COPTER_BRAKE
    noise = replace(UNSEEN, speed_m_s=speed_m_s, course_rad=2.0, camera_fails=camera_fails)
    for _ in range(9):
        f.verdict = replace(FREE, speed_m_s=0.1, course_rad=0.0)
        f.step(10)
        f.verdict = noise
        f.step(2)
    f.mode, f.verdict = AUTO, replace(BLIND, course_rad=0.0)
    assert bool(commands(f.step())) is stopped_again


def test_a_stop_before_an_obstacle_between_keeps_that_a_camera_had_failed() -> None:
    f = Flight()
    f.verdict = replace(FREE, course_rad=0.0)
    f.step()
    f.verdict = replace(BLIND, course_rad=0.0)
    f.step()
    f.mode, f.verdict = COPTER_BRAKE, replace(BLIND, speed_m_s=0.0, course_rad=0.0)
    f.step(12)
    f.mode, f.verdict = AUTO, replace(BLOCKED, course_rad=0.0)
    assert len(commands(f.step())) == 1
    f.mode, f.verdict = COPTER_BRAKE, replace(FREE, speed_m_s=0.0, course_rad=0.0)
    f.step(12 + REARM_NS // STEP_NS)
    f.mode, f.verdict = AUTO, replace(BLIND, course_rad=0.0)
    assert len(commands(f.step())) == 1


def test_a_camera_that_fails_at_rest_must_see_anew() -> None:
    f = Flight()
    f.verdict = replace(FREE, course_rad=0.0)
    f.step()
    f.verdict = replace(BLIND, course_rad=0.0)
    f.step()
    f.mode = COPTER_BRAKE
    for verdict in (FREE, BLIND, FREE):
        f.verdict = replace(verdict, speed_m_s=0.0, course_rad=0.0)
        f.step(REARM_NS // STEP_NS - 12)
    f.mode, f.verdict = AUTO, replace(BLIND, course_rad=0.0)
    assert commands(f.step(5)) == []


def test_a_blind_stop_counts_for_one_flight_only() -> None:
    f = Flight()
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) != []
    f.armed = False
    f.step()
    f.armed = True
    assert commands(f.step(10)) == []  # nothing was seen in this flight
    f.verdict = FREE
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_an_intermittent_camera_stops_the_vehicle_once() -> None:
    f = Flight()
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) != []
    f.mode, f.verdict = COPTER_BRAKE, replace(BLIND, speed_m_s=0.0)
    f.step()
    f.mode = AUTO
    for _ in range(10):
        f.verdict = FREE
        assert commands(f.step(10)) == []
        f.verdict = BLIND
        assert commands(f.step(5)) == []
    f.verdict = BLOCKED
    assert commands(f.step()) != []


def test_a_remembered_obstacle_stops_after_a_stop_for_unseen_space() -> None:
    f = Flight()
    f.step()
    f.verdict = BLIND
    f.step()
    f.mode, f.verdict = COPTER_BRAKE, replace(BLIND, speed_m_s=0.0)
    f.step()
    f.mode = AUTO
    assert commands(f.step(20)) == []
    f.verdict = replace(BLIND, obstacle_stop=True)
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


@pytest.mark.parametrize("system_status", [5, 6])
@pytest.mark.parametrize(("kind", "mode"), [("PX4", RETURN), ("ArduPilot", RTL), ("ArduPilot", 21)])
def test_a_return_of_a_failsafe_is_stopped_before_firm_obstacles_only(kind: str, mode: int, system_status: int) -> None:
    f = Flight(kind, mode, system_status=system_status)
    f.step()
    for verdict in (BLIND, WEAK):
        f.verdict = verdict
        assert commands(f.step(30)) == []
    f.verdict = BLOCKED
    assert len(commands(f.step())) == 1


def test_a_blind_stop_is_not_repeated_when_a_failsafe_begins() -> None:
    f = Flight("ArduPilot", RTL)
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) != []
    f.system_status = 5
    assert commands(f.step(50)) == []


def test_a_failsafe_in_a_mission_changes_nothing() -> None:
    f = Flight(system_status=5)
    f.step()
    f.verdict = BLIND
    assert commands(f.step()) != []


def test_no_stop_for_unseen_space_in_take_off_and_landing() -> None:
    f = Flight(near_ground=True)
    f.step()
    f.verdict = BLIND
    assert commands(f.step(30)) == []
    f.verdict = WEAK
    assert commands(f.step()) != []


def test_an_obstacle_stops_the_vehicle_although_its_path_was_never_seen() -> None:
    f = Flight(verdict=BLIND)
    f.step(30)
    f.verdict = replace(WEAK, sees=False)
    assert commands(f.step()) != []


def test_nothing_is_stopped_before_anything_was_seen() -> None:
    f = Flight(verdict=BLIND)
    out = f.step(30)
    assert commands(out) == []
    assert texts(out) == ["guard: off, nothing seen since take-off"]


def test_that_no_command_is_sent_is_announced_although_the_cause_changes() -> None:
    f = Flight()
    f.step()
    out = []
    for cause in ("no heartbeat", "two clocks") * 3:
        f.doubt = cause
        out += f.step(10)
    assert texts(out)[:1] == ["guard: off, no heartbeat"]
    assert len(texts(out)) == 1


def test_the_same_cause_is_announced_again_in_the_next_watched_mode() -> None:
    """Else a pilot who comes back to AUTO gets no word of it, also hours later."""
    f = Flight(doubt="commands are not acknowledged")
    assert texts(f.step(30)) == ["guard: off, commands are not acknowledged"]
    f.mode = COPTER_LOITER
    assert texts(f.step(30)) == []
    f.mode = AUTO
    assert texts(f.step(30)) == ["guard: off, commands are not acknowledged"]
    f.mode = COPTER_LOITER
    f.step()
    f.mode, f.doubt = AUTO, ""
    assert texts(f.step(30)) == ["guard: active"]


def test_a_vehicle_that_does_not_brake_and_gets_no_command_is_announced() -> None:
    f = stopping()
    f.mode, f.doubt = COPTER_BRAKE, "two autopilots"
    assert texts(f.step(30)) == []  # it brakes for now
    out = f.step(100)
    assert commands(out) == []
    assert texts(out) == ["guard: off, two autopilots"]


def test_a_stop_that_cannot_be_repeated_is_announced() -> None:
    f = stopping()
    f.doubt = "no heartbeat"
    out = f.step(50)
    assert commands(out) == []
    assert texts(out) == ["guard: off, no heartbeat"]
    f.doubt = ""
    out = f.step()
    assert texts(out)[:1] == ["guard: active"]
    assert commands(out) != []
