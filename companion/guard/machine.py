"""The state machine of the guard: from the verdict on the path and the autopilot's state to commands and
announcements.

It has no clock, thread or link: each step gets a `GuardInput` and returns the outputs to send. States and transitions
are drawn in docs/explanation/guard.md. These rules hold in all states:

- A command is sent only to the vehicle of the input, only if it is certain who receives it (`GuardInput.doubt` is
  empty), and only in a watched mode or in a stop mode that the guard itself has set and in which the vehicle has not
  come to rest.
- A mode that the guard did not set ends the intervention. It counts as the pilot's, also if another ground station
  has set it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from drivers.mavlink.commands import COPTER_LOITER, DO_CHANGE_SPEED, DO_REPOSITION, DO_SET_MODE
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from ..config.guard import GuardParams
from .assessment import Action, Verdict
from .attempt import FAILED_AFTER, Attempt, next_method
from .availability import Availability
from .hold_motion import STANDS_M_S, HoldMotion
from .modes import STOP_MODES, STOP_ORDER, StopMethod, Watched, returns_by_failsafe, takes_speed, watched_mode
from .seen_path import SeenPath, turned_rad
from .speed_limit import IN_PROGRESS, LimitState, SpeedLimiter
from .states import (
    INTERVENES,
    Announcement,
    GuardInput,
    GuardMemory,
    GuardState,
    Output,
    SpeedCommand,
    StopCommand,
)

NS = 1_000_000_000
REARM_NS = 5 * NS
"""After a stop for unseen space, the path must be seen for this time without interruption before unseen space stops
the vehicle again."""
FREE_NS = 2 * NS
"""A stop without effect ends if the path is free for this time."""
GAINS_NS = NS
"""Time after a stop command in which the vehicle may still get faster: PX4 does for up to 1 s."""
SPARE_STOP_NS = 2 * NS
"""Time added to the computed braking time before the next command is sent to a vehicle that does not brake."""
GAP_NS = 5 * NS
"""If the vehicle was not received for longer, an unconfirmed stop is decided again: another station may have had
control."""


@dataclass(slots=True)
class GuardMachine:
    """The state machine of the guard.

    `step` is called ten times per second or more, `acknowledged` for each COMMAND_ACK that answers the guard."""

    guard: GuardParams
    memory: GuardMemory = field(default_factory=GuardMemory)  # the state, which outlives the process
    # instant at which the vehicle was last received, also in an earlier run; None: never
    received_ns: int | None = None
    _limiter: SpeedLimiter = field(init=False)
    _attempt: Attempt | None = None
    _brakes_until_ns: int | None = None
    _failure_announced: bool = False
    _free_since_ns: int | None = None
    _reason: Verdict | None = None
    _seen_path: SeenPath = field(default_factory=SeenPath)
    _motion: HoldMotion = field(default_factory=HoldMotion)
    _availability: Availability = field(default_factory=Availability)

    def __post_init__(self) -> None:
        memory = self.memory
        self._limiter = SpeedLimiter(self.guard, memory.limit_m_s, memory.fastest_m_s)

    # ---- input ------------------------------------------------------------------------------------------------------

    def acknowledged(self, command: int, result: int) -> None:
        """Handles a COMMAND_ACK of the vehicle for a command of the guard."""
        attempt = self._attempt
        if attempt is not None and command == attempt.command and attempt.result in (None, IN_PROGRESS):
            attempt.result = result
        if command == DO_CHANGE_SPEED:
            self._limiter.acknowledged(result)

    def step(self, now: GuardInput) -> list[Output]:
        """Returns what to send now, in order."""
        vehicle = now.vehicle
        if vehicle is None or vehicle.heartbeat_ns <= 0:
            return []  # the state is kept: the link may recover
        gap_ns = 0 if self.received_ns is None else now.now_ns - self.received_ns
        self.received_ns = now.now_ns
        if (vehicle.autopilot, vehicle.system_id) != (self.memory.kind, self.memory.system_id):
            if vehicle.autopilot not in STOP_ORDER and vehicle.system_id == self.memory.system_id:
                return []  # heartbeats contradict each other: wait until they name one kind of autopilot
            self._begin(GuardState.INACTIVE, now, kind=vehicle.autopilot, system_id=vehicle.system_id, seen=False)
        if not vehicle.armed or not now.in_air:
            return self._rest(now)
        if self.memory.state is GuardState.STOPPING and gap_ns > GAP_NS and not self._stands_as_asked(now):
            self._begin(GuardState.INACTIVE, now)
        if self.memory.state in INTERVENES:
            return self._intervene(vehicle, now)
        return self._watch(vehicle, now)

    def _stands_as_asked(self, now: GuardInput) -> bool:
        """True if the vehicle is in a stop mode of the guard and its measured speed is that of a standing vehicle."""
        speed_m_s = None if now.verdict is None else now.verdict.speed_m_s
        in_stop_mode = now.vehicle is not None and now.vehicle.custom_mode in self.memory.stop_modes
        return in_stop_mode and speed_m_s is not None and speed_m_s < STANDS_M_S

    # ---- not intervening --------------------------------------------------------------------------------------------

    def _rest(self, now: GuardInput) -> list[Output]:
        """Ends an intervention because the vehicle is on the ground or disarmed."""
        intervened = self.memory.state in INTERVENES
        if self.memory.state is not GuardState.INACTIVE or self.memory.seen:
            self._begin(GuardState.INACTIVE, now, seen=False, blind_stop=False)
        return [Announcement("guard: ended, not flying")] if intervened else []

    def _watch(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Handles a step without an intervention: begins one, adjusts the speed limit, or reports why nothing is
        sent."""
        group = watched_mode(vehicle.autopilot, vehicle.custom_mode, self.guard)
        if group is None:
            if self.memory.state is not GuardState.INACTIVE:
                self._begin(GuardState.INACTIVE, now)
            self._record_seen(self._seen_path.in_flight(now.verdict, now.now_ns), now)
            return []
        if self.memory.state is GuardState.INACTIVE or vehicle.custom_mode != self.memory.mode:
            self._begin(GuardState.WATCHING, now)
        self._record_seen(self._seen_path.in_flight(now.verdict, now.now_ns), now)
        doubt = now.doubt or self._no_sight(now)
        if doubt:
            return self._doubts(doubt, now)
        out = self._availability.restored()
        if self.memory.state is GuardState.UNAVAILABLE:
            limited = self.memory.limit_m_s > 0.0
            self._change(now, state=GuardState.LIMITED if limited else GuardState.WATCHING, cause="")
        verdict = now.verdict
        assert verdict is not None
        out += self._availability.vehicle_answers(not now.silent)
        if self._wants_stop(now):  # also if the vehicle does not acknowledge commands: they may still arrive
            return out + self._stop(vehicle, verdict, now)
        return out if now.silent else out + self._adjust_speed(vehicle, group, verdict, now)

    def _record_seen(self, seen_ns: int | None, now: GuardInput) -> None:
        """Records that the path is seen.

        Unseen space stops the vehicle only after the path was seen once, and after a stop for unseen space only after
        it was seen for REARM_NS. seen_ns: for how long it is; None: it is not."""
        if seen_ns is None:
            return
        armed_again = self.memory.blind_stop and seen_ns >= REARM_NS
        if not self.memory.seen or armed_again:
            self._change(now, seen=True, blind_stop=self.memory.blind_stop and not armed_again)

    def _no_sight(self, now: GuardInput) -> str:
        """Returns why the path cannot be judged, as text; empty: it can."""
        if now.verdict is None:
            return "vehicle's velocity unknown"
        if not self.memory.seen and not now.verdict.obstacle_stop:
            return "nothing seen since take-off"
        unseen = not now.verdict.sees and not now.verdict.obstacle_stop
        return "path still not seen" if self.memory.blind_stop and unseen else ""

    def _wants_stop(self, now: GuardInput) -> bool:
        """True if the vehicle must be stopped.

        A stop ends a return that a failsafe has commanded, and the autopilot does not command it again. There only an
        obstacle counts that two frames show with many pixels. During take-off and landing only obstacles count,
        because the path leads to where no camera looks."""
        verdict = now.verdict
        if verdict is None or verdict.action is not Action.STOP:
            return False
        if returns_by_failsafe(now.vehicle, self.guard):
            return verdict.firm_stop
        return verdict.obstacle_stop if now.near_ground else True

    def _doubts(self, doubt: str, now: GuardInput) -> list[Output]:
        """Handles a step in which no command may be sent. doubt: why, as text."""
        if self.memory.state is not GuardState.UNAVAILABLE or self.memory.cause != doubt:
            self._change(now, state=GuardState.UNAVAILABLE, cause=doubt)
        return self._availability.lost(doubt, now.now_ns)

    # ---- speed ------------------------------------------------------------------------------------------------------

    def _adjust_speed(self, vehicle: Vehicle, group: Watched, verdict: Verdict, now: GuardInput) -> list[Output]:
        """Sends, changes or ends the speed limit."""
        limiter = self._limiter
        if not self.guard.limit_speed or not takes_speed(vehicle.autopilot, group):
            return []
        if limiter.state is LimitState.REFUSED:
            if self.memory.state is not GuardState.LIMITED:
                return []
            self._change(now, state=GuardState.WATCHING, limit_m_s=0.0)
            return [Announcement("guard: no speed limit in this mode")]
        wanted_m_s = limiter.wanted(verdict, now.now_ns)
        if limiter.state is LimitState.INEFFECTIVE:
            self._begin(GuardState.WATCHING, now)
            return [Announcement("guard: speed limit has no effect")]
        if wanted_m_s is None:
            return []
        out: list[Output] = [SpeedCommand(vehicle.system_id, wanted_m_s)]
        if limiter.state is LimitState.ENDED:
            out.append(Announcement("guard: speed limit ended"))
            self._begin(GuardState.WATCHING, now)
            return out
        if self.memory.state is not GuardState.LIMITED:
            out.append(Announcement(f"guard: speed limit {wanted_m_s:.1f} m/s"))
        self._change(
            now, state=GuardState.LIMITED, limit_m_s=wanted_m_s, fastest_m_s=limiter.fastest_m_s, cause=verdict.cause
        )
        return out

    # ---- stop -------------------------------------------------------------------------------------------------------

    def _stop(self, vehicle: Vehicle, verdict: Verdict, now: GuardInput) -> list[Output]:
        """Begins an intervention: sends the first stop command."""
        self._seen_path.stopped(verdict, repeated=self.memory.blind_stop)
        self._begin(
            GuardState.STOPPING, now, blind_stop=self.memory.blind_stop or not verdict.sees, cause=verdict.cause
        )
        self._reason = verdict
        return [*self._try_to_stop(vehicle, now), Announcement(f"guard: stop, {verdict.cause}", critical=True)]

    def _try_to_stop(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Sends a stop command and counts the attempt."""
        method = next_method(vehicle, self._attempt, self.memory.attempts)
        command = DO_REPOSITION if method is StopMethod.PX4_REPOSITION else DO_SET_MODE
        self._attempt = Attempt(method, command, now.now_ns)
        modes = tuple(sorted({*self.memory.stop_modes, STOP_MODES[method]}))
        self._change(now, attempts=self.memory.attempts + 1, stop_modes=modes)
        return [StopCommand(vehicle.system_id, method)]

    def _intervene(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Handles a step of an intervention, by the mode of the vehicle."""
        memory, mode = self.memory, vehicle.custom_mode
        if mode in memory.stop_modes:
            return self._in_stop_mode(vehicle, now)
        if memory.state is GuardState.STOPPING and mode == memory.mode and not memory.taken:
            return self._not_taken_yet(vehicle, now)
        # the sender of this mode has control now
        self._begin(GuardState.INACTIVE, now)
        return [Announcement("guard: released, mode changed"), *self._watch(vehicle, now)]

    def _not_taken_yet(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Handles a step in which the vehicle is still in the watched mode: repeats the command or ends the stop."""
        if watched_mode(vehicle.autopilot, vehicle.custom_mode, self.guard) is None:
            return []
        if now.doubt:
            return self._availability.lost(now.doubt, now.now_ns)
        out = self._availability.restored()
        if not self._still_needed(now):
            return out + self._leave_when_free(vehicle, now)
        self._free_since_ns = None
        if self._attempt is not None and not self._attempt.is_over(vehicle, now.now_ns, self.memory.attempts):
            return out
        return [*out, *self._try_to_stop(vehicle, now), *self._failure("guard: STOP NOT CONFIRMED, take over")]

    def _still_needed(self, now: GuardInput) -> bool:
        """True if a stop without effect is repeated: unless the path is seen and the braking distance fits. Where unseen
        space does not stop the vehicle, the reason for the stop counts until the path is seen. After a restart the
        reason is known only as an obstacle or unseen space."""
        if self._wants_stop(now):
            return True
        if now.verdict is not None and now.verdict.sees:
            return False
        failsafe = returns_by_failsafe(now.vehicle, self.guard)
        if not failsafe and not now.near_ground:
            return True
        if self._reason is None:
            return not failsafe and not self.memory.blind_stop
        return self._wants_stop(replace(now, verdict=self._reason))

    def _leave_when_free(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Ends a stop without effect that is not needed any more, unless a command that was sent may still take
        effect."""
        if self._free_since_ns is None:
            self._free_since_ns = now.now_ns
        under_way = self._attempt is not None and not self._attempt.shown_without_effect(vehicle)
        if under_way or now.now_ns - self._free_since_ns < FREE_NS:
            return []
        self._begin(GuardState.WATCHING, now)
        return [Announcement("guard: stop ended, not needed now")]

    def _in_stop_mode(self, vehicle: Vehicle, now: GuardInput) -> list[Output]:
        """Handles a step in a stop mode: waits until the vehicle rests, and repeats the command if it does not brake.

        In LOITER the pilot has the sticks, and nothing more is commanded."""
        speed_m_s = now.verdict.speed_m_s if now.verdict is not None else None
        sticks = vehicle.autopilot == ARDUPILOT and vehicle.custom_mode == COPTER_LOITER
        holds = self.memory.state is GuardState.HOLDING
        if holds:
            self._record_seen(self._seen_path.at_rest(now.verdict, self._reason, now.now_ns), now)
        if holds and not sticks:
            self._motion.stands()
        # PX4 flies a Go-to in Hold. A copter that gets faster in BRAKE before it rested does not brake.
        may_be_go_to = holds or vehicle.autopilot == PX4
        onward_m_s = None if holds and self._flies_back(now) else speed_m_s
        if self._motion.flies_again(onward_m_s, now.now_ns) and may_be_go_to:
            self._begin(GuardState.INACTIVE, now)
            return [Announcement("guard: released, flies in the stop mode", critical=True)]
        if holds:
            return []
        if not self.memory.taken:
            self._change(now, taken=True)
        if sticks or (speed_m_s is not None and speed_m_s < STANDS_M_S and not self._may_get_faster(now)):
            self._change(now, state=GuardState.HOLDING)
            return [Announcement("guard: stopped, change mode to go on", critical=True)]
        if speed_m_s is None:
            return []
        if self._brakes_until_ns is None:
            brakes_s = speed_m_s / self.guard.deceleration_m_s2 + self.guard.reaction_s
            self._brakes_until_ns = now.now_ns + round(brakes_s * NS) + SPARE_STOP_NS
        if now.now_ns < self._brakes_until_ns or not self._still_needed(now):
            return []
        if now.doubt:
            return self._availability.lost(now.doubt, now.now_ns)
        out = self._availability.restored()
        self._brakes_until_ns = now.now_ns + SPARE_STOP_NS
        return [*out, *self._try_to_stop(vehicle, now), *self._failure("guard: DOES NOT STOP, take over")]

    def _may_get_faster(self, now: GuardInput) -> bool:
        """True for a moment after a stop command: a vehicle at the beginning of a leg is slow, and still gets faster."""
        return self._attempt is not None and now.now_ns - self._attempt.t_ns < GAINS_NS

    def _flies_back(self, now: GuardInput) -> bool:
        """True if the vehicle flies against the course on which it was stopped.

        PX4 computes the place to hold from the speed at the command. A vehicle that was getting faster comes to rest
        beyond it, and returns."""
        turned = turned_rad(now.verdict, self._reason)
        return turned is not None and math.cos(turned) < 0.0

    def _failure(self, text: str) -> list[Output]:
        """Returns the announcement that the attempts have no effect, once per intervention."""
        if self.memory.attempts < FAILED_AFTER or self._failure_announced:
            return []
        self._failure_announced = True
        return [Announcement(text, critical=True)]

    # ---- state ------------------------------------------------------------------------------------------------------

    def _change(self, now: GuardInput, **changes: Any) -> None:
        """Changes fields of the memory."""
        self.memory = replace(self.memory, t_ns=now.now_ns, **changes)

    def _begin(self, state: GuardState, now: GuardInput, **changes: Any) -> None:
        """Begins a state. Fields not named in `changes` get their defaults, except the vehicle and what was seen."""
        old, vehicle = self.memory, now.vehicle
        fresh = GuardMemory(
            state=state,
            kind=old.kind,
            system_id=old.system_id,
            mode=old.mode if vehicle is None else vehicle.custom_mode,
            t_ns=now.now_ns,
            seen=old.seen,
            blind_stop=old.blind_stop,
        )
        self.memory = replace(fresh, **changes)
        if state is GuardState.INACTIVE:
            self._availability.ended()
        self._limiter = SpeedLimiter(self.guard)
        self._attempt, self._brakes_until_ns, self._failure_announced = None, None, False
        self._free_since_ns, self._reason, self._motion = None, None, HoldMotion()
