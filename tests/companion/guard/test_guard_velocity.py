"""A velocity that is late or lost: the vehicle may be faster than it was, and is not taken to stand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.guard.assessment import (
    GAIN_M_S2,
    LATE_NS,
    LONGEST_UNMEASURED_NS,
    PREDICT_S,
    Action,
    PathAssessor,
    Verdict,
)
from companion.guard.machine import GuardMachine
from companion.guard.states import GuardState, SpeedCommand
from companion.guard.velocity_hold import HOLD_NS
from drivers.mavlink.commands import COPTER_BRAKE, DO_CHANGE_SPEED

from ..guard_machine import BLOCKED, GUARD, NARROW, Flight, commands, stopping, texts
from ..guard_sight import AVOID, BRAKING, MS, NS, SIGHT, T_NS
from .test_guard_thread import STEP_NS
from .test_guard_thread import Flight as GuardFlight

STANDING = replace(SIGHT, speed_m_s=0.0, velocity_ns=T_NS)


def verdict(age_ns: int, speed_m_s: float, **changes: Any) -> Verdict | None:
    """With a velocity of this age; everything else is new."""
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    sight = replace(SIGHT, speed_m_s=speed_m_s, velocity_ns=T_NS - age_ns)
    assessor.take(replace(sight, **changes))
    return assessor.verdict(T_NS)


@pytest.mark.parametrize("age_ns", [0, LATE_NS])
def test_a_velocity_of_now_is_the_speed(age_ns: int) -> None:
    now = verdict(age_ns, 0.0, obstacle_m=2.0)
    assert now is not None
    assert (now.speed_m_s, now.action) == (0.0, Action.PASS)


def test_a_vehicle_with_a_late_velocity_may_have_accelerated() -> None:
    """It stood, and its velocity was lost: 1 s later it may fly at 2 m/s."""
    late = verdict(LATE_NS + 1000 * MS, 0.0, obstacle_m=BRAKING.needed_m(GAIN_M_S2) - 0.2)
    assert late is not None
    assert late.action is Action.STOP
    assert late.speed_m_s is None, "not measured"
    unseen = verdict(LATE_NS + 1000 * MS, 0.0, free_m=0.0)
    assert unseen is not None
    assert unseen.action is Action.STOP
    far = verdict(LATE_NS + 200 * MS, 1.0)
    assert far is not None
    assert far.action is Action.PASS


def test_a_late_velocity_is_a_speed_until_it_is_too_old() -> None:
    known = verdict(LONGEST_UNMEASURED_NS, 2.0)
    assert known is not None
    assert known.speed_m_s == 2.0
    unknown = verdict(LONGEST_UNMEASURED_NS + 1, 2.0)
    assert unknown is not None
    assert unknown.speed_m_s is None
    assert verdict(HOLD_NS + 1, 2.0) is None


@pytest.mark.parametrize("every_ms", [20, 67, 200, 333])
def test_a_velocity_that_comes_seldom_shows_the_same_acceleration(every_ms: int) -> None:
    """A vehicle that gains 3 m/s2, decisions at 15 Hz, velocities at 3 to 50 Hz."""
    assessor, gained = PathAssessor(GUARD, BRAKING, AVOID), []
    for n in range(30):
        t_ns = T_NS + n * 67 * MS
        stamp_ns = t_ns - (n * 67 * MS) % (every_ms * MS)
        speed_m_s = 1.0 + 3.0 * (stamp_ns - T_NS) / NS
        assessor.take(replace(SIGHT, t_ns=t_ns, exposed_ns=t_ns, speed_m_s=speed_m_s, velocity_ns=stamp_ns))
        found = assessor.verdict(t_ns)
        assert found is not None
        if n >= 15:
            gained.append(found.predicted_m_s - speed_m_s)
    assert min(gained) == pytest.approx(3.0 * PREDICT_S)
    assert max(gained) == pytest.approx(3.0 * PREDICT_S)


def test_an_obstacle_output_that_hangs_before_the_vehicle_moves_is_not_a_vehicle_that_stands() -> None:
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assessor.take(STANDING)
    later = assessor.verdict(T_NS + 1000 * MS)
    assert later is not None
    assert (later.action, later.speed_m_s, later.sees) == (Action.STOP, None, False)
    assert assessor.verdict(T_NS + HOLD_NS + 1) is None


def test_a_vehicle_whose_velocity_is_not_measured_is_not_stopped_yet() -> None:
    f = stopping()
    f.mode, f.verdict = COPTER_BRAKE, replace(BLOCKED, speed_m_s=None)
    f.step(30)
    assert f.state is GuardState.STOPPING
    f.verdict = replace(BLOCKED, speed_m_s=0.1)
    f.step()
    assert f.state is GuardState.HOLDING


def test_no_limit_is_begun_without_a_measured_velocity() -> None:
    """Its first value is bounded by the speed of the vehicle, which is not known."""
    f = Flight(machine=GuardMachine(GUARD), verdict=replace(NARROW, speed_m_s=None))
    assert commands(f.step(10)) == []
    f.verdict = NARROW
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]


def test_a_velocity_that_is_lost_just_before_the_stop_is_due_does_not_prevent_it() -> None:
    flight = GuardFlight()
    flight.step(5)
    flight.velocity = None
    flight.step(500 * MS // STEP_NS)
    assert flight.state is GuardState.WATCHING
    flight.wall_m = 5.0
    flight.step()
    assert len(flight.stops()) == 1


def test_a_flying_vehicle_whose_velocity_is_lost_is_stopped_when_it_may_be_too_fast() -> None:
    flight = GuardFlight()
    flight.step(5)
    flight.velocity = None
    flight.step(LATE_NS // STEP_NS)
    assert flight.state is GuardState.WATCHING
    flight.step((HOLD_NS - LATE_NS) // STEP_NS)
    assert flight.state is GuardState.STOPPING
    assert flight.stops()


def test_a_guard_that_never_received_a_velocity_is_in_doubt() -> None:
    flight = GuardFlight()
    flight.velocity = None
    flight.step(10)
    assert flight.state is GuardState.UNAVAILABLE
    assert flight.guard.memory.cause == "vehicle's velocity unknown"
    assert flight.stops() == []


def test_where_a_vehicle_flies_that_stood_when_its_velocity_was_lost_is_not_known() -> None:
    """Its path is that of no direction: it may fly to where no camera looks."""
    known = verdict(LONGEST_UNMEASURED_NS, 0.0)
    assert known is not None
    assert known.action is Action.PASS
    unknown = verdict(LATE_NS + 400 * MS, 0.0)
    assert unknown is not None
    assert unknown.room_m == 0.0
    assert unknown.action is Action.STOP


def test_the_way_since_a_late_velocity_is_that_of_the_speed_it_may_have() -> None:
    """The decision is 0.3 s old, and its velocity 1.3 s."""
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assessor.take(replace(SIGHT, speed_m_s=2.0, velocity_ns=T_NS - 1000 * MS))
    late = assessor.verdict(T_NS + 300 * MS)
    assert late is not None
    assert late.room_m == pytest.approx(SIGHT.free_m - 0.3 * (2.0 + GAIN_M_S2 * 1.0))


def test_the_way_between_two_sights_with_a_late_velocity_is_that_of_the_speed_it_may_have() -> None:
    """The position is as late as the velocity."""
    assessor, late_ns = PathAssessor(GUARD, BRAKING, AVOID), LATE_NS + 400 * MS
    fastest_m_s = 1.0 + GAIN_M_S2 * 0.4
    free_m = BRAKING.needed_m(fastest_m_s) + 0.7 * 0.25 * fastest_m_s
    before = replace(SIGHT, speed_m_s=1.0, velocity_ns=T_NS + 250 * MS - late_ns, free_m=free_m)
    assessor.take(before)
    assessor.take(replace(before, t_ns=T_NS + 250 * MS, exposed_ns=T_NS + 200 * MS, free_m=0.0))
    found = assessor.verdict(T_NS + 250 * MS)
    assert found is not None
    assert found.room_m == pytest.approx(free_m - 0.25 * fastest_m_s)
    assert found.action is Action.STOP


def test_a_velocity_gap_is_no_evidence_about_a_limit() -> None:
    """The vehicle does not follow its limit, and half of its velocities are missing."""
    f = Flight(machine=GuardMachine(GUARD), verdict=NARROW)
    f.step()
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    out = []
    for k in range(40):
        f.verdict = replace(NARROW, speed_m_s=None if k % 2 else 4.0)
        out += f.step()
    assert "guard: speed limit has no effect" in texts(out)


def test_a_vehicle_that_brakes_is_given_its_time_once_its_speed_is_known() -> None:
    f = stopping()
    f.mode, f.verdict = COPTER_BRAKE, replace(BLOCKED, speed_m_s=None)
    f.step(15)
    f.verdict = replace(BLOCKED, speed_m_s=3.0)
    assert commands(f.step(15)) == []
