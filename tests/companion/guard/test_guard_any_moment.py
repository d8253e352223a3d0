"""One flight to a stop, disturbed at each of its steps: kill -9, lost link, another ground station, the pilot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from companion.guard.machine import GAP_NS, GuardMachine
from companion.guard.memory_file import GuardMemoryFile
from companion.guard.modes import STOP_MODES
from companion.guard.states import GuardMemory, GuardState, Output, SpeedCommand, StopCommand
from drivers.mavlink.commands import COPTER_BRAKE, DO_CHANGE_SPEED, DO_SET_MODE

from ..guard_machine import (
    AUTO,
    BLOCKED,
    FREE,
    GUARD,
    HOLD,
    MISSION,
    NARROW,
    POSITION,
    RETURN,
    RTL,
    STABILIZE,
    STEP_NS,
    Flight,
    commands,
)

STEPS = 50
"""Of the flight without a disturbance: it stands from step 35 on."""
MOMENTS = range(40)
KINDS = ["ArduPilot", "PX4"]
CRUISE = {"ArduPilot": AUTO, "PX4": MISSION}
MANUAL = {"ArduPilot": STABILIZE, "PX4": POSITION}
GO_HOME = {"ArduPilot": RTL, "PX4": RETURN}
STOP = {"ArduPilot": COPTER_BRAKE, "PX4": HOLD}


@dataclass
class Approach:
    """A vehicle that flies to a wall and obeys stop commands three steps later."""

    kind: str
    folder: Path
    flight: Flight = field(init=False)
    speed_m_s: float = 3.0
    sent: list[tuple[int, Output]] = field(default_factory=list)
    _obeys: list[tuple[int, Output]] = field(default_factory=list)
    _step: int = 0

    def __post_init__(self) -> None:
        self.flight = Flight(self.kind, CRUISE[self.kind])

    def step(self) -> None:
        f = self.flight
        for due in [command for at, command in self._obeys if at <= self._step]:
            self._obey(due)
        self._obeys = [(at, command) for at, command in self._obeys if at > self._step]
        if f.mode == STOP[self.kind]:
            self.speed_m_s = max(0.0, self.speed_m_s - 0.4)
        verdict = FREE if self._step < 10 else NARROW if self._step < 20 else BLOCKED
        f.verdict = replace(verdict, speed_m_s=self.speed_m_s, predicted_m_s=self.speed_m_s)
        for command in commands(f.step()):
            self.sent.append((self._step, command))
            self._obeys.append((self._step + 3, command))
        self._step += 1

    def _obey(self, command: Output) -> None:
        if isinstance(command, StopCommand):
            self.flight.machine.acknowledged(DO_SET_MODE, 0)
            self.flight.mode = STOP_MODES[command.method]
        elif isinstance(command, SpeedCommand):
            self.flight.machine.acknowledged(DO_CHANGE_SPEED, 0)
            self.speed_m_s = min(self.speed_m_s, command.speed_m_s)

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.step()

    def kill(self, away_ns: int) -> None:
        """The service is killed and starts again so much later. The vehicle goes on."""
        file = GuardMemoryFile(self.folder)
        file.keep(self.flight.machine.memory, self.flight.now_ns)
        file.close()
        self.flight.now_ns += away_ns
        if away_ns > GAP_NS:  # the vehicle has done meanwhile what it was asked for
            for _, command in self._obeys:
                self._obey(command)
            self._obeys.clear()
            self.speed_m_s = 0.0 if self.flight.mode == STOP[self.kind] else self.speed_m_s
        file = GuardMemoryFile(self.folder)
        memory = file.load(self.flight.now_ns)
        self.flight.machine = GuardMachine(GUARD, memory or GuardMemory(), file.loaded_ns)

    @property
    def state(self) -> GuardState:
        return self.flight.state

    def sent_from(self, step: int) -> list[Output]:
        return [command for at, command in self.sent if at >= step]


@pytest.fixture(params=KINDS)
def approach(request: pytest.FixtureRequest, tmp_path: Path) -> Approach:
    return Approach(str(request.param), tmp_path)


def again(approach: Approach) -> Approach:
    return Approach(approach.kind, approach.folder)


def stands(a: Approach) -> bool:
    return a.state is GuardState.HOLDING and a.flight.mode == STOP[a.kind] and a.speed_m_s < 0.4


def test_without_a_disturbance_it_stands(approach: Approach) -> None:
    states = []
    for _ in MOMENTS:
        approach.step()
        states.append(approach.state)
    order = [GuardState.WATCHING, GuardState.LIMITED, GuardState.STOPPING, GuardState.HOLDING]
    assert sorted(set(states), key=states.index) == order
    assert stands(approach)
    assert len([c for c in approach.sent_from(0) if isinstance(c, StopCommand)]) == 1


@pytest.mark.parametrize("away_ns", [STEP_NS, 20 * STEP_NS, GAP_NS + STEP_NS])
def test_killed_at_any_moment(approach: Approach, away_ns: int) -> None:
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        before = a.state
        a.kill(away_ns)
        assert a.flight.machine.memory.state is before
        a.run(STEPS)
        assert stands(a), moment


@pytest.mark.parametrize("away_ns", [STEP_NS, GAP_NS + STEP_NS])
def test_killed_at_any_moment_while_the_pilot_takes_over(approach: Approach, away_ns: int) -> None:
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        a._obeys.clear()
        a.kill(away_ns)
        a.flight.mode = MANUAL[a.kind]
        a.run(STEPS)
        assert a.sent_from(moment) == [], moment
        assert a.state is GuardState.INACTIVE


@pytest.mark.parametrize("steps", [3, GAP_NS // STEP_NS + 5])
def test_a_link_that_is_lost_at_any_moment(approach: Approach, steps: int) -> None:
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        before, a.flight.connected = a.state, False
        a._obeys.clear()
        a.run(steps)
        assert a.sent_from(moment) == [], moment
        assert a.state is before, moment
        a.flight.connected = True
        a.run(STEPS)
        assert stands(a), moment


def test_the_pilot_at_any_moment(approach: Approach) -> None:
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        a._obeys.clear()
        a.flight.mode = MANUAL[a.kind]
        a.run(STEPS)
        assert a.sent_from(moment) == [], moment
        assert a.state is GuardState.INACTIVE, moment


def test_another_ground_station_that_sends_the_vehicle_home_at_any_moment(approach: Approach) -> None:
    """The way home is blocked, too: it is stopped anew, in the mode that was commanded."""
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        a._obeys.clear()
        a.flight.mode, a.speed_m_s = GO_HOME[a.kind], 3.0
        a.run(STEPS + 20)
        assert stands(a), moment
        assert {command.system_id for command in a.sent_from(0) if isinstance(command, StopCommand | SpeedCommand)} == {
            7
        }


def test_doubt_at_any_moment(approach: Approach) -> None:
    """A second autopilot, for example: nothing is sent until it is over."""
    for moment in MOMENTS:
        a = again(approach)
        a.run(moment)
        a._obeys.clear()
        a.flight.doubt = "two autopilots"
        a.run(30)
        assert a.sent_from(moment) == [], moment
        a.flight.doubt = ""
        a.run(STEPS)
        assert stands(a), moment
