"""Whatever happens, the guard commands in no manual mode and no other vehicle."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from companion.guard.machine import GuardMachine
from companion.guard.modes import STOP_MODES, watched_mode
from companion.guard.states import (
    GuardState,
    Output,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_LOITER, DO_CHANGE_SPEED, DO_SET_MODE
from tests.nightly import examples

from ..guard_machine import (
    ALT_HOLD,
    BLIND,
    BLOCKED,
    FREE,
    GUARD,
    MANUAL,
    MODES,
    NARROW,
    POSITION,
    STABILIZE,
    Flight,
    commands,
)

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


@examples(10)
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
