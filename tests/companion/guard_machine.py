"""A guard's state machine without a link, and verdicts for it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from companion.config.guard import GuardParams
from companion.guard.assessment import Action, Verdict
from companion.guard.machine import GuardMachine
from companion.guard.states import (
    Announcement,
    GuardInput,
    GuardState,
    Output,
    SpeedCommand,
    StopCommand,
)
from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER, px4_mode_number
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
UNSEEN = replace(WEAK, room_m=0.0, obstacle=False, obstacle_stop=False, sees=False, cause="seen free for 0.0 m only")
BLIND = replace(UNSEEN, cause="front: no frame", camera_fails=True)


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


MODES = {
    "ArduPilot": [AUTO, RTL, 21, 27, GUIDED, STABILIZE, ALT_HOLD, COPTER_LOITER, COPTER_BRAKE, 9, 16],
    "PX4": [MISSION, RETURN, OFFBOARD, HOLD, POSITION, MANUAL, px4_mode_number(4, 6), px4_mode_number(2, 0)],
    "ArduPilot or PX4": [AUTO, MISSION],
    "autopilot 4": [AUTO],
}
