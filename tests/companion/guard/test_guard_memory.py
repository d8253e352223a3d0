"""The guard's memory: what a kill, a gap and a suspension of the computer change."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from companion.guard.machine import GAP_NS, GuardMachine
from companion.guard.memory_file import LIFE_NS, GuardMemoryFile
from companion.guard.modes import StopMethod
from companion.guard.states import (
    GuardMemory,
    GuardState,
    SpeedCommand,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_BRAKE, DO_CHANGE_SPEED

from ..guard_machine import (
    AUTO,
    BLOCKED,
    FREE,
    GUARD,
    NARROW,
    NS,
    STEP_NS,
    Flight,
    commands,
    holding,
    stopping,
    texts,
)


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


def test_after_a_long_gap_a_vehicle_that_stands_as_commanded_is_held() -> None:
    """The pilot must be asked to change the mode. One that flies in the stop mode has been commanded by another station."""
    for speed_m_s, state, announced in (
        (0.1, GuardState.HOLDING, ["guard: stopped, change mode to go on"]),
        (2.0, GuardState.INACTIVE, []),
    ):
        f = stopping()
        f.connected = False
        f.step(GAP_NS // STEP_NS + 2)
        f.connected, f.mode, f.verdict = True, COPTER_BRAKE, replace(BLOCKED, speed_m_s=speed_m_s)
        assert texts(f.step()) == announced
        assert f.state is state


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
