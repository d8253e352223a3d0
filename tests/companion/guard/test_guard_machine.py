"""The guard's state machine: which command stops the vehicle, when it is repeated, and when a stop ends."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from companion.autopilot.status_text import MOST_CHARACTERS
from companion.config.guard import GuardParams
from companion.guard.attempt import FAILED_AFTER, MODE_NS
from companion.guard.machine import GuardMachine
from companion.guard.modes import StopMethod
from companion.guard.speed_limit import IN_PROGRESS
from companion.guard.states import (
    Announcement,
    GuardState,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER, DO_SET_MODE, px4_mode_number

from ..guard_machine import (
    ALT_HOLD,
    AUTO,
    BLOCKED,
    FREE,
    GUIDED,
    HOLD,
    MANUAL,
    MISSION,
    OFFBOARD,
    POSITION,
    RETURN,
    RTL,
    STABILIZE,
    STEP_NS,
    Flight,
    commands,
    holding,
    stopping,
    texts,
)


@pytest.mark.parametrize(
    ("kind", "mode"), [("ArduPilot", AUTO), ("ArduPilot", RTL), ("ArduPilot", 21), ("ArduPilot", GUIDED)]
)
def test_stops_copter_by_brake(kind: str, mode: int) -> None:
    f = Flight(kind, mode)
    assert f.step() == []
    assert f.state is GuardState.WATCHING
    f.verdict = BLOCKED
    out = f.step()
    assert commands(out) == [StopCommand(7, StopMethod.COPTER_BRAKE)]
    assert texts(out) == ["guard: stop, obstacle 3.0 m ahead"]


@pytest.mark.parametrize("mode", [MISSION, RETURN, OFFBOARD])
def test_stops_px4_by_hold(mode: int) -> None:
    f = Flight("PX4", mode)
    f.step()
    f.verdict = BLOCKED
    assert commands(f.step()) == [StopCommand(7, StopMethod.PX4_HOLD)]


@pytest.mark.parametrize(
    ("kind", "mode"), [("ArduPilot", STABILIZE), ("ArduPilot", ALT_HOLD), ("ArduPilot", COPTER_LOITER), ("ArduPilot", 9),
                   ("PX4", POSITION), ("PX4", MANUAL), ("PX4", HOLD), ("PX4", px4_mode_number(4, 6)), ("PX4", AUTO),
                   ("autopilot 4", AUTO)],
)  # fmt: skip
def test_sends_nothing_in_other_modes(kind: str, mode: int) -> None:
    f = Flight(kind, mode, verdict=BLOCKED)
    assert f.step(50) == []
    assert f.state is GuardState.INACTIVE


def test_modes_can_be_switched_off() -> None:
    for kind, mode, guard in (
        ("ArduPilot", AUTO, GuardParams(enabled=True, mission=False)),
        ("ArduPilot", RTL, GuardParams(enabled=True, return_home=False)),
        ("PX4", OFFBOARD, GuardParams(enabled=True, guided=False)),
    ):
        f = Flight(kind, mode, GuardMachine(guard), verdict=BLOCKED)
        assert f.step(20) == []


def test_holds_until_the_mode_changes() -> None:
    f = holding()
    f.verdict = replace(FREE, speed_m_s=0.1)
    assert f.step(100) == []
    f.mode = COPTER_LOITER
    assert texts(f.step()) == ["guard: released, mode changed"]
    assert f.state is GuardState.INACTIVE
    f.verdict = BLOCKED
    assert f.step(50) == []


@pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, COPTER_LOITER, 9])
def test_a_pilot_ends_a_stop_that_is_not_confirmed(mode: int) -> None:
    f = stopping()
    f.mode = mode
    assert commands(f.step(100)) == []
    assert f.state is GuardState.INACTIVE


def test_a_mission_continued_by_the_pilot_is_not_stopped_again() -> None:
    """BRAKE was taken, and the mission was resumed before the vehicle stood."""
    f = stopping()
    f.mode, f.verdict = COPTER_BRAKE, BLOCKED
    assert commands(f.step(2)) == []
    f.mode, f.verdict = AUTO, FREE
    out = f.step()
    assert commands(out) == []
    assert texts(out) == ["guard: released, mode changed"]
    assert f.state is GuardState.WATCHING


def test_repeats_without_acknowledgement_and_takes_the_next_command_when_refused() -> None:
    f = stopping("PX4", MISSION)
    assert commands(f.step(3)) == []
    assert commands(f.step(2)) == [StopCommand(7, StopMethod.PX4_REPOSITION)]
    f = stopping("PX4", MISSION)
    f.machine.acknowledged(DO_SET_MODE, 4)
    assert commands(f.step()) == [StopCommand(7, StopMethod.PX4_REPOSITION)]


def test_an_acknowledged_attempt_is_repeated_when_a_heartbeat_shows_the_old_mode() -> None:
    f = stopping()
    f.machine.acknowledged(DO_SET_MODE, 0)
    assert commands(f.step(4)) == []
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_an_acknowledged_attempt_is_repeated_late_without_heartbeats() -> None:
    f = stopping()
    f.machine.acknowledged(DO_SET_MODE, 0)
    f.heartbeat_ns = f.now_ns
    assert commands(f.step(MODE_NS // STEP_NS - 1)) == []
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_loiter_needs_evidence_that_brake_had_no_effect() -> None:
    """LOITER reads the throttle stick. Acknowledgements and heartbeats may be lost while BRAKE works."""
    f = stopping()
    f.heartbeat_ns = f.now_ns
    out = commands(f.step(15))
    assert len(out) >= 2
    assert set(out) == {StopCommand(7, StopMethod.COPTER_BRAKE)}
    f.heartbeat_ns = None  # heartbeats are received again and show the old mode
    assert StopCommand(7, StopMethod.COPTER_LOITER) in f.step(30)


def test_an_attempt_in_progress_is_no_refusal() -> None:
    f = stopping()
    f.heartbeat_ns = f.now_ns
    out = []
    for _ in range(40):
        f.machine.acknowledged(DO_SET_MODE, IN_PROGRESS)
        out += commands(f.step())
    assert set(out) == {StopCommand(7, StopMethod.COPTER_BRAKE)}


def test_no_loiter_while_the_autopilot_is_in_brake() -> None:
    f = stopping()
    f.mode = COPTER_BRAKE
    out = commands(f.step(200))
    assert len(out) > 5
    assert set(out) == {StopCommand(7, StopMethod.COPTER_BRAKE)}


def test_a_stop_without_effect_is_not_repeated_where_the_path_is_free() -> None:
    f = stopping()
    f.step(20)
    f.verdict = FREE
    out = f.step(40)
    assert commands(out) == []
    assert texts(out) == ["guard: stop ended, not needed now"]
    assert f.state is GuardState.WATCHING
    f.verdict = BLOCKED
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_a_stop_without_effect_ends_only_where_the_path_is_free_without_interruption() -> None:
    f = stopping()
    f.step(20)
    f.verdict = FREE
    f.step(15)
    f.verdict = BLOCKED
    f.step(20)
    f.verdict = FREE
    assert f.step(15) == []
    assert f.state is GuardState.STOPPING


def test_a_stop_without_effect_does_not_end_before_a_heartbeat_shows_it() -> None:
    """A command that was sent may still take effect. Its mode would count as the pilot's."""
    f = stopping()
    f.heartbeat_ns, f.verdict = f.now_ns, FREE
    assert f.step(30) == []
    assert f.state is GuardState.STOPPING


def test_a_late_effect_of_an_earlier_command_is_a_stop_of_the_guard() -> None:
    f = stopping()
    assert StopCommand(7, StopMethod.COPTER_LOITER) in f.step(30)
    f.mode = COPTER_BRAKE
    assert texts(f.step()) == []
    assert f.state is GuardState.STOPPING


def test_announces_a_stop_without_effect_once_and_goes_on() -> None:
    """With the command that is the last of FAILED_AFTER; `stopping` has sent the first one."""
    f = stopping()
    out = f.step(150)
    assert texts(out) == ["guard: STOP NOT CONFIRMED, take over"]
    assert len(commands(out[: out.index(Announcement(texts(out)[0], critical=True))])) == FAILED_AFTER - 1
    methods = [c.method for c in commands(out) if isinstance(c, StopCommand)]
    assert len(methods) > FAILED_AFTER
    assert methods.count(StopMethod.COPTER_LOITER) > 1
    assert (StopMethod.COPTER_LOITER,) * 2 not in pairwise(methods)


def test_next_command_when_the_vehicle_does_not_brake_in_the_stop_mode() -> None:
    f = stopping("PX4", MISSION)
    f.mode = HOLD
    out = f.step(80)
    assert commands(out)[0] == StopCommand(7, StopMethod.PX4_REPOSITION)
    assert f.state is GuardState.STOPPING


def test_a_go_to_before_the_vehicle_stood_ends_the_stop() -> None:
    """PX4 flies a Go-to in Hold, the mode that the guard has set."""
    f = stopping("PX4", MISSION)
    f.mode = HOLD
    for speed_m_s in (3.0, 2.0, 1.0):
        f.verdict = replace(BLOCKED, speed_m_s=speed_m_s)
        assert f.step(3) == []
    f.verdict = replace(BLOCKED, speed_m_s=2.5)
    out = f.step(12)
    assert commands(out) == []
    assert texts(out) == ["guard: released, flies in the stop mode"]
    assert len(f"OA: {texts(out)[0]}") <= MOST_CHARACTERS, "the pilot must get all of it"
    assert f.state is GuardState.INACTIVE
    assert f.step(100) == []


def test_a_slow_vehicle_that_still_gets_faster_does_not_count_as_stopped() -> None:
    """At the beginning of a leg PX4 is stopped at 0.3 m/s, and reaches 1.7 m/s before it brakes."""
    f = stopping("PX4", MISSION)
    f.mode = HOLD
    for speed_m_s in (0.3, 0.38, 0.8, 1.3, 1.6, 1.7, 1.7, 1.6, 1.5, 1.4, 1.3, 1.2, 1.0, 0.8, 0.6):
        f.verdict = replace(BLOCKED, speed_m_s=speed_m_s)
        assert texts(f.step()) == []
        assert f.state is GuardState.STOPPING
    f.verdict = replace(BLOCKED, speed_m_s=0.3)
    assert texts(f.step()) == ["guard: stopped, change mode to go on"]


def test_a_vehicle_that_returns_to_the_place_to_hold_is_still_stopped() -> None:
    """PX4 computes this place from the speed at the command. A vehicle that was getting faster passes it, comes to rest,
    and flies back by some metres at up to 1.5 m/s."""
    f = Flight("PX4", MISSION)
    f.step()
    f.verdict = replace(BLOCKED, course_rad=0.1)
    f.step()
    f.mode = HOLD
    f.verdict = replace(BLOCKED, speed_m_s=0.2, course_rad=0.1)
    f.step(12)
    assert f.state is GuardState.HOLDING
    f.verdict = replace(BLOCKED, speed_m_s=1.5, course_rad=3.0)
    assert f.step(40) == []
    assert f.state is GuardState.HOLDING
    f.verdict = replace(BLOCKED, speed_m_s=1.5, course_rad=0.3)
    assert texts(f.step(12)) == ["guard: released, flies in the stop mode"]


def test_a_go_to_after_the_stop_ends_it() -> None:
    f = holding("PX4", MISSION, HOLD)
    f.verdict = replace(BLOCKED, speed_m_s=1.1)
    assert f.step(9) == []
    f.verdict = replace(BLOCKED, speed_m_s=0.9)  # a gust
    assert f.step(20) == []
    f.verdict = replace(BLOCKED, speed_m_s=1.1)
    assert texts(f.step(12)) == ["guard: released, flies in the stop mode"]
    assert f.state is GuardState.INACTIVE
    f.mode = MISSION
    assert commands(f.step()) == [StopCommand(7, StopMethod.PX4_HOLD)]


def test_a_copter_that_gets_faster_in_brake_is_not_released() -> None:
    """BRAKE is no mode of a Go-to."""
    f = stopping()
    f.mode = COPTER_BRAKE
    for speed_m_s in (3.0, 2.0, 3.5):
        f.verdict = replace(BLOCKED, speed_m_s=speed_m_s)
        f.step(12)
    assert f.state is GuardState.STOPPING
    assert commands(f.step(60)) != []


def test_a_vehicle_that_still_accelerates_in_the_stop_mode_is_not_released() -> None:
    f = stopping("PX4", MISSION)
    f.mode = HOLD
    for tenths in range(30, 70):
        f.verdict = replace(BLOCKED, speed_m_s=0.1 * tenths)
        f.step()
    assert f.state is GuardState.STOPPING


def test_in_loiter_the_pilot_has_the_sticks() -> None:
    f = stopping()
    f.machine.acknowledged(DO_SET_MODE, 4)
    f.step()
    f.machine.acknowledged(DO_SET_MODE, 4)
    assert StopCommand(7, StopMethod.COPTER_LOITER) in f.step()
    f.mode = COPTER_LOITER
    assert commands(f.step(100)) == []
    assert f.state is GuardState.HOLDING


def test_nothing_is_sent_to_an_ambiguous_target_and_it_is_reported() -> None:
    f = Flight(doubt="two autopilots", verdict=BLOCKED)
    out = f.step(50)
    assert commands(out) == []
    assert texts(out) == ["guard: off, two autopilots"]
    f.doubt = ""
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_doubt_suspends_the_attempts() -> None:
    f = stopping()
    f.doubt = "no heartbeat"
    assert commands(f.step(50)) == []
    f.doubt = ""
    assert commands(f.step()) != []


def test_doubt_suspends_the_attempts_in_the_stop_mode() -> None:
    f = stopping()
    f.mode, f.doubt = COPTER_BRAKE, "two autopilots"
    assert commands(f.step(200)) == []
    f.doubt = ""
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_a_lost_link_keeps_the_state() -> None:
    f = holding()
    f.connected = False
    f.step(200)
    f.connected = True
    assert f.step(3) == []
    assert f.state is GuardState.HOLDING
    f = stopping()
    f.connected = False
    f.step(10)
    f.connected = True
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_another_vehicle_begins_anew() -> None:
    f = stopping()
    f.system_id, f.verdict = 9, FREE
    assert commands(f.step(5)) == []
    assert f.machine.memory.system_id == 9


def test_contradicting_heartbeats_keep_the_state() -> None:
    f = holding()
    f.kind = "ArduPilot or PX4"
    assert f.step(10) == []
    f.kind = "ArduPilot"
    assert f.step() == []
    assert f.state is GuardState.HOLDING


def test_disarming_ends_all() -> None:
    f = stopping()
    f.armed = False
    assert texts(f.step()) == ["guard: ended, not flying"]
    assert f.state is GuardState.INACTIVE
