"""The guard's state machine: what it sends in which state, and what it must never send."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.guard import GuardParams
from companion.guard.assessment import Action, Verdict
from companion.guard.attempt import FAILED_AFTER, MODE_NS
from companion.guard.machine import GAP_NS, REARM_NS, GuardMachine
from companion.guard.memory_file import LIFE_NS, GuardMemoryFile
from companion.guard.modes import STOP_MODES, StopMethod, watched_mode
from companion.guard.speed_limit import IN_PROGRESS, RAISE_AFTER_NS
from companion.guard.states import (
    Announcement,
    GuardInput,
    GuardMemory,
    GuardState,
    Output,
    SpeedCommand,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER, DO_CHANGE_SPEED, DO_SET_MODE, px4_mode_number
from drivers.mavlink.session_types import Vehicle

NS = 1_000_000_000
STEP_NS = NS // 10
AUTO, RTL, GUIDED, STABILIZE, ALT_HOLD = 3, 6, 4, 0, 2
MISSION, RETURN, OFFBOARD = px4_mode_number(4, 4), px4_mode_number(4, 5), px4_mode_number(6, 0)
HOLD, POSITION, MANUAL = px4_mode_number(4, 3), px4_mode_number(3, 0), px4_mode_number(1, 0)
GUARD = GuardParams(enabled=True)
FREE = Verdict(
    action=Action.PASS,
    speed_m_s=3.0,
    predicted_m_s=3.0,
    allowed_m_s=8.0,
    room_m=20.0,
    obstacle=False,
    sees=True,
    cause="",
)
BLOCKED = replace(
    FREE,
    action=Action.STOP,
    allowed_m_s=0.0,
    room_m=3.0,
    obstacle=True,
    cause="obstacle 3.0 m ahead",
    obstacle_stop=True,
    firm_stop=True,
)
WEAK = replace(BLOCKED, firm_stop=False)
NARROW = replace(FREE, action=Action.SLOW, allowed_m_s=2.2, room_m=8.0, cause="obstacle 8.0 m ahead", obstacle=True)
BLIND = replace(WEAK, room_m=0.0, obstacle=False, obstacle_stop=False, sees=False, cause="front: no frame")


@dataclass
class Flight:
    """A machine and the vehicle that its commands do not reach by themselves."""

    kind: str = "ArduPilot"
    mode: int = AUTO
    machine: GuardMachine = field(default_factory=lambda: GuardMachine(GUARD))
    now_ns: int = 100 * NS
    system_id: int = 7
    armed: bool = True
    in_air: bool = True
    doubt: str = ""
    verdict: Verdict | None = FREE
    connected: bool = True
    heartbeat_ns: int | None = None
    system_status: int = 4
    near_ground: bool = False
    silent: bool = False

    def step(self, times: int = 1) -> list[Output]:
        out: list[Output] = []
        for _ in range(times):
            self.now_ns += STEP_NS
            beat_ns = self.now_ns if self.heartbeat_ns is None else self.heartbeat_ns
            vehicle = Vehicle(
                self.system_id, self.kind, 2, self.armed, self.mode, beat_ns, system_status=self.system_status
            )
            out += self.machine.step(
                GuardInput(
                    now_ns=self.now_ns,
                    vehicle=vehicle if self.connected else None,
                    doubt=self.doubt,
                    in_air=self.in_air,
                    verdict=self.verdict,
                    near_ground=self.near_ground,
                    silent=self.silent,
                )
            )
        return out

    @property
    def state(self) -> GuardState:
        return self.machine.memory.state


def commands(out: list[Output]) -> list[StopCommand | SpeedCommand]:
    return [o for o in out if not isinstance(o, Announcement)]


def texts(out: list[Output]) -> list[str]:
    return [o.text for o in out if isinstance(o, Announcement)]


def stopping(kind: str = "ArduPilot", mode: int = AUTO) -> Flight:
    f = Flight(kind, mode)
    f.step()
    f.verdict = BLOCKED
    f.step()
    assert f.state is GuardState.STOPPING
    return f


def holding(kind: str = "ArduPilot", mode: int = AUTO, stop_mode: int = COPTER_BRAKE) -> Flight:
    f = stopping(kind, mode)
    f.mode, f.verdict = stop_mode, replace(BLOCKED, speed_m_s=0.1)
    f.step(12)
    assert f.state is GuardState.HOLDING
    return f


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


def test_announces_a_stop_without_effect_once_and_goes_on() -> None:
    f = stopping()
    out = f.step(150)
    assert texts(out) == ["guard: STOP NOT CONFIRMED, take over"]
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
    assert texts(out) == ["guard: released, vehicle flies in the stop mode"]
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
    assert texts(f.step(12)) == ["guard: released, vehicle flies in the stop mode"]


def test_a_go_to_after_the_stop_ends_it() -> None:
    f = holding("PX4", MISSION, HOLD)
    f.verdict = replace(BLOCKED, speed_m_s=1.1)
    assert f.step(9) == []
    f.verdict = replace(BLOCKED, speed_m_s=0.9)  # a gust
    assert f.step(20) == []
    f.verdict = replace(BLOCKED, speed_m_s=1.1)
    assert texts(f.step(12)) == ["guard: released, vehicle flies in the stop mode"]
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


def test_a_vehicle_known_from_the_last_run_keeps_the_state_until_its_heartbeat() -> None:
    """Its mode is not known before: it is not one that the pilot has chosen."""
    f = stopping()
    f.mode, f.heartbeat_ns = 0, 0
    assert f.step(10) == []
    assert f.state is GuardState.STOPPING
    f.mode, f.heartbeat_ns = AUTO, None
    assert commands(f.step()) == [StopCommand(7, StopMethod.COPTER_BRAKE)]


def test_after_a_long_gap_an_unconfirmed_stop_is_assessed_again() -> None:
    f = stopping()
    f.connected = False
    f.step(GAP_NS // STEP_NS + 2)
    f.connected, f.verdict = True, FREE
    assert commands(f.step(20)) == []
    assert f.state is GuardState.WATCHING


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


# ---- speed ----------------------------------------------------------------------------------------------------------


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


# ---- properties -----------------------------------------------------------------------------------------------------

MODES = {
    "ArduPilot": [AUTO, RTL, 21, 27, GUIDED, STABILIZE, ALT_HOLD, COPTER_LOITER, COPTER_BRAKE, 9, 16],
    "PX4": [MISSION, RETURN, OFFBOARD, HOLD, POSITION, MANUAL, px4_mode_number(4, 6), px4_mode_number(2, 0)],
    "ArduPilot or PX4": [AUTO, MISSION],
    "autopilot 4": [AUTO],
}
EVENTS = st.one_of(
    st.tuples(st.just("mode"), st.integers(0, 10)),
    st.tuples(st.just("kind"), st.sampled_from(sorted(MODES))),
    st.tuples(
        st.just("verdict"), st.sampled_from([None, FREE, BLOCKED, NARROW, BLIND, replace(BLOCKED, speed_m_s=0.1)])
    ),
    st.tuples(st.just("doubt"), st.sampled_from(["", "", "two autopilots"])),
    st.tuples(st.just("connected"), st.booleans()),
    st.tuples(st.just("armed"), st.sampled_from([True, True, True, False])),
    st.tuples(st.just("in_air"), st.sampled_from([True, True, True, False])),
    st.tuples(st.just("system"), st.sampled_from([7, 7, 7, 9])),
    st.tuples(st.just("ack"), st.tuples(st.sampled_from([DO_SET_MODE, 192, DO_CHANGE_SPEED, 511]), st.integers(0, 6))),
    st.tuples(st.just("obey"), st.none()),
    st.tuples(st.just("kill"), st.none()),
    st.tuples(st.just("wait"), st.integers(1, 80)),
)


def apply(f: Flight, event: str, value: object, asked: list[Output]) -> None:
    """Changes the world around the machine."""
    if event == "mode":
        modes = MODES[f.kind]
        f.mode = modes[int(str(value)) % len(modes)]
    elif event == "kind":
        f.kind = str(value)
        f.mode = MODES[f.kind][0]
    elif event == "ack":
        assert isinstance(value, tuple)
        f.machine.acknowledged(*value)
    elif event == "obey":
        stops = [o for o in asked if isinstance(o, StopCommand)]
        if stops:
            f.mode = STOP_MODES[stops[-1].method]
    elif event == "kill":
        f.machine = GuardMachine(GUARD, f.machine.memory)
    elif event != "wait":
        setattr(f, {"system": "system_id"}.get(event, event), value)


@settings(max_examples=300, deadline=None)
@given(st.lists(EVENTS, min_size=1, max_size=40), st.sampled_from(["ArduPilot", "PX4"]))
def test_never_commands_in_a_manual_mode_nor_another_vehicle(events: list[tuple[str, object]], kind: str) -> None:
    f = Flight(kind, MODES[kind][0])
    asked: list[Output] = []
    for event, value in events:
        apply(f, event, value, asked)
        for _ in range(int(str(value)) if event == "wait" else 2):
            own_stop = f.machine.memory.stop_modes if f.state is GuardState.STOPPING else ()
            out = f.step()
            asked += out
            for command in commands(out):
                assert command.system_id == f.system_id
                assert f.connected
                assert f.armed
                assert f.in_air
                assert not f.doubt
                watched = watched_mode(f.kind, f.mode, GUARD) is not None
                assert watched or (f.mode in own_stop and isinstance(command, StopCommand))
                assert f.mode not in (STABILIZE, ALT_HOLD, COPTER_LOITER, 9, 16) or f.kind != "ArduPilot"
                assert f.mode not in (POSITION, MANUAL) or f.kind != "PX4"


# ---- memory ---------------------------------------------------------------------------------------------------------


def keep(file: GuardMemoryFile, memory: GuardMemory, now_ns: int) -> None:
    """Keeps the memory, and waits for its write."""
    file.keep(memory, now_ns)
    file.close()


@pytest.mark.parametrize("begin", [stopping, holding])
def test_a_kill_changes_nothing(begin: object, tmp_path: Path) -> None:
    assert callable(begin)
    f = begin()
    keep(GuardMemoryFile(tmp_path), f.machine.memory, f.now_ns)
    loaded = GuardMemoryFile(tmp_path).load(f.now_ns + 3 * NS)
    assert loaded == f.machine.memory
    f.machine = GuardMachine(GUARD, loaded)
    out = f.step()
    assert f.state is (GuardState.STOPPING if begin is stopping else GuardState.HOLDING)
    assert bool(commands(out)) == (begin is stopping)


def test_after_a_long_restart_an_unconfirmed_stop_is_assessed_again(tmp_path: Path) -> None:
    f = stopping()
    keep(GuardMemoryFile(tmp_path), f.machine.memory, f.now_ns)
    f.now_ns += 20 * NS
    file = GuardMemoryFile(tmp_path)
    loaded = file.load(f.now_ns)
    assert loaded is not None
    f.machine, f.verdict = GuardMachine(GUARD, loaded, file.loaded_ns), FREE
    assert commands(f.step(30)) == []
    assert f.state is GuardState.WATCHING


def test_a_limit_survives_a_kill(tmp_path: Path) -> None:
    f = Flight(verdict=NARROW)
    f.step()
    file = GuardMemoryFile(tmp_path)
    keep(file, f.machine.memory, f.now_ns)
    f.machine = GuardMachine(GUARD, file.load(f.now_ns) or GuardMemory())
    f.verdict = replace(FREE, speed_m_s=2.0)
    assert f.state is GuardState.LIMITED
    assert commands(f.step()) == [SpeedCommand(7, 2.0)]
    f.machine.acknowledged(DO_CHANGE_SPEED, 0)
    assert SpeedCommand(7, 3.0) in f.step(60)


def test_an_old_or_damaged_memory_is_not_used(tmp_path: Path) -> None:
    file = GuardMemoryFile(tmp_path)
    memory = stopping().machine.memory
    keep(file, memory, 100 * NS)
    assert GuardMemoryFile(tmp_path).load(101 * NS + LIFE_NS) is None
    assert GuardMemoryFile(tmp_path).load(99 * NS) is None
    path = tmp_path / "guard.json"
    good = path.read_text()
    limits = [good.replace('"limit_m_s": 0.0', f'"limit_m_s": {wrong}') for wrong in ("NaN", "Infinity", "-1.0")]
    assert good not in limits
    for damaged in (
        "",
        "{",
        good.replace("stopping", "flying"),
        good.replace('"seen": true', '"seen": 1'),
        "[]",
        *limits,
    ):
        path.write_text(damaged)
        assert GuardMemoryFile(tmp_path).load(101 * NS) is None


def test_a_suspension_of_the_computer_makes_the_memory_older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CLOCK_MONOTONIC stands still meanwhile; another station may have flown the vehicle."""
    clock, suspended_ns = time.clock_gettime_ns, [0]
    monkeypatch.setattr(
        time,
        "clock_gettime_ns",
        lambda which: clock(which) + (suspended_ns[0] if which == time.CLOCK_BOOTTIME else 0),
    )
    keep(GuardMemoryFile(tmp_path), stopping().machine.memory, 100 * NS)
    suspended_ns[0] = 10 * NS
    file = GuardMemoryFile(tmp_path)
    assert file.load(101 * NS) is not None
    assert file.loaded_ns == pytest.approx(90 * NS, abs=NS // 10), "11 s before the loading"
    suspended_ns[0] = LIFE_NS
    assert GuardMemoryFile(tmp_path).load(101 * NS) is None


def test_the_memory_stays_young_while_the_guard_holds(tmp_path: Path) -> None:
    f = holding()
    file = GuardMemoryFile(tmp_path)
    for _ in range(600):
        f.step()
        keep(file, f.machine.memory, f.now_ns)
    assert GuardMemoryFile(tmp_path).load(f.now_ns + NS) == f.machine.memory


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
