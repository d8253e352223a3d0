"""The guard as a part of the service: its thread, its inputs from the obstacle output and the link, and its outputs."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from drivers.mavlink import commands
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import LinkStatus, Vehicle
from drivers.watched_thread import WatchedThread

from ..autopilot.landed import LandedState
from ..autopilot.line import AutopilotLine
from ..autopilot.status_text import text_message
from ..autopilot.surroundings import Surroundings
from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams
from ..diagnostic import Diagnostic, DiagnosticCode
from .assessment import PathAssessor, Verdict
from .braking import braking_of
from .certainty import Certainty
from .kept_views import KeptViews
from .machine import GuardMachine
from .memory_file import GuardMemoryFile
from .modes import StopMethod
from .path_sight import PathSight, path_sight
from .states import (
    Announcement,
    GuardInput,
    GuardMemory,
    GuardState,
    Output,
    SpeedCommand,
    StopCommand,
)
from .turn import CourseRate
from .velocity_hold import VelocityHold

log = logging.getLogger("companion")

NS = 1_000_000_000
STEP_S: Final = 0.05
"""Longest time between two steps; a new sight of the path causes one at once."""
LINK_NS: Final = NS // 5
FLIES_M_S: Final = 2.0
"""A faster vehicle does not stand on the ground."""
REPEAT_NS: Final = 5 * NS
"""The same text is not announced again within this time."""
READS: Final = frozenset({dialect.MAVLINK_MSG_ID_COMMAND_ACK, dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE})
"""Ids of the autopilot's messages that `message` handles."""


class Guard:
    """The guard. `observe` is called by the obstacle output, `message` by the link; the guard decides in a thread of
    its own."""

    def __init__(
        self,
        guard: GuardParams,
        avoid: AvoidParams,
        line: AutopilotLine,
        link_status: Callable[[], LinkStatus],
        folder: Path | None,
    ) -> None:
        """Creates a guard whose thread is not started.

        Args:
            guard: parameters of the guard.
            avoid: parameters of the obstacle output.
            line: the autopilot.
            link_status: returns conflicts and signing of the link.
            folder: folder of the state; None: nothing is kept."""
        self._guard, self._avoid, self._line, self._link_status = guard, avoid, line, link_status
        self._certainty = Certainty()
        self._landed = LandedState()
        self._assessor = PathAssessor(guard, braking_of(guard, avoid), avoid)
        self._velocity = VelocityHold()
        self._course_rate = CourseRate()
        self._kept_views = KeptViews()
        self._file = GuardMemoryFile(folder)
        memory = self._file.load(time.monotonic_ns())
        self._machine = GuardMachine(guard, memory or GuardMemory(), self._file.loaded_ns)
        self._messages: deque[Any] = deque(maxlen=64)
        self._lock = threading.Lock()
        self._sight: PathSight | None = None
        self._verdict: Verdict | None = None
        self._link: LinkStatus | None = None
        self._link_ns = 0
        self._announced: dict[str, int] = {}
        self._stop, self._wake = threading.Event(), threading.Event()
        self._thread = WatchedThread(self._run, "guard")
        self.alive_ns = time.monotonic_ns()
        """Instant at which the newest step of the thread began."""

    # ---- in ---------------------------------------------------------------------------------------------------------

    def observe(self, surroundings: Surroundings) -> None:
        """Takes the surroundings of a decision of the obstacle output."""
        turn_rad_s = self._course_rate.take(surroundings)
        held = self._velocity.held(surroundings)
        sight = path_sight(held, self._avoid, self._guard, turn_rad_s, self._kept_views.before(surroundings))
        self._kept_views.take(surroundings)
        with self._lock:
            self._sight = sight
            self._assessor.take(sight)
        self._wake.set()

    def message(self, message: Any, arrival_ns: int) -> None:
        """Takes a message of the autopilot, of those in READS."""
        if message.get_type() == "COMMAND_ACK":
            self._messages.append(message)
            self._wake.set()
        self._landed.take(message, arrival_ns)

    # ---- thread -----------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Starts the thread."""
        self.alive_ns = time.monotonic_ns()
        self._thread.start()

    def close(self) -> None:
        """Ends the thread, and announces in a watched mode that the guard has ended. May be called twice."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._wake.set()
        if self._thread.ident is not None:
            self._thread.join(2.0)
        self._file.close()
        if self.memory.state is not GuardState.INACTIVE:
            end = Announcement("guard: off, the service stops", critical=True)
            self._announce(end, time.monotonic_ns())
            log.warning("%s", end.text)

    def _run(self) -> None:
        while not self._stop.is_set():
            self._wake.wait(STEP_S)
            self._wake.clear()
            self.alive_ns = time.monotonic_ns()
            if not self._stop.is_set():
                self.step(time.monotonic_ns())

    @property
    def failure(self) -> str:
        """The exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    def step(self, now_ns: int) -> None:
        """Does one step: reads messages, decides and sends."""
        vehicle = self._line.vehicle()
        if vehicle is not None:
            self._acknowledgements(now_ns)
            for request in self._certainty.requests(vehicle, now_ns):
                self._line.post(request)
        with self._lock:
            self._verdict = self._assessor.verdict(now_ns)
        outputs = self._machine.step(self._input(vehicle, now_ns))
        for output in outputs:  # before the file is written, so that a slow disk does not delay a command
            self._send(output, now_ns, vehicle)
        self._file.keep(self.memory, now_ns)
        for output in outputs:  # last, so that a handler that blocks does not delay a command or the file
            log.warning(
                "%s", output.text if isinstance(output, Announcement) else f"guard: {output}, {self.memory.cause}"
            )

    def _acknowledgements(self, now_ns: int) -> None:
        while self._messages:
            ack = self._messages.popleft()
            self._certainty.acknowledged(int(ack.command), int(ack.result), now_ns)
            self._machine.acknowledged(int(ack.command), int(ack.result))

    def _input(self, vehicle: Vehicle | None, now_ns: int) -> GuardInput:
        doubt, in_air = "", False
        if vehicle is not None:
            if self._link is None or now_ns - self._link_ns >= LINK_NS:
                self._link, self._link_ns = self._link_status(), now_ns
            # while the vehicle's signatures are right, a fault concerns the disk, or other senders that are not accepted
            signing_fault = "" if self._link.signed else self._link.signing_fault
            doubt = self._certainty.doubt(vehicle, self._link.conflicts, signing_fault, now_ns)
            in_air = not self._landed.on_ground(vehicle, now_ns) or self._flies()
        return GuardInput(
            now_ns=now_ns,
            vehicle=vehicle,
            doubt=doubt,
            in_air=in_air,
            verdict=self._verdict,
            near_ground=self._landed.takes_off_or_lands(now_ns),
            silent=self._certainty.silent(now_ns),
        )

    def _flies(self) -> bool:
        """True if the measured speed is that of a flying vehicle, whatever the autopilot reports."""
        speed_m_s = None if self._verdict is None else self._verdict.speed_m_s
        return speed_m_s is not None and speed_m_s > FLIES_M_S

    # ---- out --------------------------------------------------------------------------------------------------------

    def _send(self, output: Output, now_ns: int, decided_by: Vehicle | None) -> None:
        """Sends an output. decided_by: the vehicle by which it was decided. A heartbeat may have arrived since: a command that
        it contradicts is not sent, and the next step decides by it."""
        if isinstance(output, Announcement):
            self._announce(output, now_ns)
        elif decided_by is not None:
            self._line.command(message_of(output), decided_by)

    def _announce(self, text: Announcement, now_ns: int) -> None:
        self._announced = {old: t_ns for old, t_ns in self._announced.items() if now_ns - t_ns < REPEAT_NS}
        if text.text in self._announced:
            return
        self._announced[text.text] = now_ns
        severity = dialect.MAV_SEVERITY_CRITICAL if text.critical else dialect.MAV_SEVERITY_WARNING
        self._line.post(text_message(severity, f"OA: {text.text}"))

    @property
    def memory(self) -> GuardMemory:
        """State and its data."""
        return self._machine.memory

    @property
    def sight(self) -> PathSight | None:
        """The newest sight of the path."""
        return self._sight

    @property
    def verdict(self) -> Verdict | None:
        """The newest verdict on the path."""
        return self._verdict

    def diagnostics(self) -> list[Diagnostic]:
        """Returns the diagnostics of the guard."""
        memory, out = self.memory, []
        if self._thread.failure:
            text = f"the guard has ended: {self._thread.failure}; the vehicle is not stopped in automatic modes"
            out.append(Diagnostic(DiagnosticCode.GUARD_FAULT, "", text))
        if memory.state is GuardState.UNAVAILABLE:
            text = f"the guard sends no commands: {memory.cause}; the vehicle is not stopped in this mode"
            out.append(Diagnostic(DiagnosticCode.GUARD_UNAVAILABLE, "", text))
        if memory.state is not GuardState.INACTIVE and self._certainty.silent(time.monotonic_ns()):
            text = "the vehicle does not acknowledge the guard's commands any more: a stop may not arrive"
            out.append(Diagnostic(DiagnosticCode.GUARD_UNAVAILABLE, "", text))
        if memory.state is GuardState.STOPPING:
            text = f"the guard stops the vehicle, attempt {memory.attempts}: {memory.cause}"
            out.append(Diagnostic(DiagnosticCode.GUARD_INTERVENES, "", text))
        if memory.state is GuardState.HOLDING:
            text = f"the guard has stopped the vehicle: {memory.cause}; change the flight mode to go on"
            out.append(Diagnostic(DiagnosticCode.GUARD_INTERVENES, "", text))
        if memory.state is GuardState.LIMITED:
            text = f"the guard limits the speed to {memory.limit_m_s:g} m/s: {memory.cause}"
            out.append(Diagnostic(DiagnosticCode.GUARD_INTERVENES, "", text))
        return out


def message_of(output: StopCommand | SpeedCommand) -> Any:
    """Returns the MAVLink message of a command."""
    if isinstance(output, SpeedCommand):
        return commands.change_speed(output.system_id, output.speed_m_s)
    if output.method is StopMethod.PX4_HOLD:
        return commands.set_px4_hold(output.system_id)
    if output.method is StopMethod.PX4_REPOSITION:
        return commands.px4_reposition_here(output.system_id)
    if output.method is StopMethod.COPTER_BRAKE:
        return commands.set_copter_mode(output.system_id, commands.COPTER_BRAKE)
    return commands.set_copter_mode(output.system_id, commands.COPTER_LOITER)
