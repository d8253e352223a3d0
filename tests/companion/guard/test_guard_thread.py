"""The guard's thread: what a slow disk delays and what the service sees of a thread that has ended."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_memory import nothing_remembered
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.guard import REPEAT_NS, Guard
from companion.guard.memory_file import GuardMemoryFile
from companion.guard.states import Announcement, GuardMemory, GuardState
from companion.live.parts import Parts
from companion.pipeline.transform import LevelTransform
from companion.state_file import StateFile
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle
from drivers.watched_thread import WatchedThread
from tests.waiting import until

from ..guard_sight import HERE, plane
from ..sector_models import model
from .test_guard_certainty import COPTER, LINK

NS = 1_000_000_000
START_NS = 100 * NS
STEP_NS = NS // 20
PIPELINE_THREAD: Any = SimpleNamespace(failure="", started=threading.Event(), alive_ns=0)


class Flight:
    """A guard of a copter in AUTO at 3 m/s north, before a wall at a distance."""

    def __init__(self, folder: Any = None) -> None:
        self.now_ns = START_NS
        self.sent: list[Any] = []
        self.decided_by: list[Vehicle] = []
        self.link = LINK
        self.wall_m = 19.0
        self.velocity: tuple[float, float, float] | None = (3.0, 0.0, 0.0)
        self.guard = Guard(
            GuardParams(enabled=True, limit_speed=False),
            AvoidParams(radius_m=0.4),
            AutopilotLine(self._vehicle, self.sent.append, command=self._command),
            lambda: self.link,
            folder,
        )

    def _command(self, message: Any, decided_by: Vehicle) -> None:
        self.sent.append(message)
        self.decided_by.append(decided_by)

    def _vehicle(self) -> Vehicle:
        return replace(COPTER, heartbeat_ns=self.now_ns)

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.now_ns += STEP_NS
            view = View(
                model(plane(self.wall_m, -2.0, 2.0), free_to_m=self.wall_m), LevelTransform(0.0, (0.0, 0.0, 0.0))
            )
            self.guard.observe(
                Surroundings(
                    t_ns=self.now_ns,
                    views=(view,),
                    weak_px=(0.0,),
                    exposed_ns=self.now_ns,
                    recall=None,
                    recalled=nothing_remembered(),
                    blind={},
                    here=HERE,
                    velocity_ned_m_s=self.velocity,
                )
            )
            self.guard.step(self.now_ns)
            if self.now_ns == START_NS + STEP_NS:
                self.guard.message(dialect.MAVLink_command_ack_message(511, 0, 0, 0, 7, 196), self.now_ns)

    @property
    def state(self) -> GuardState:
        return self.guard.memory.state

    def stops(self) -> list[Any]:
        return [m for m in self.sent if m.get_type() == "COMMAND_LONG" and m.command == 176]


@pytest.mark.parametrize("signed", [True, False])
def test_a_fault_of_signing_that_does_not_concern_the_vehicle_takes_no_stop_away(signed: bool) -> None:
    """Timestamps that cannot be stored, or forged messages that are dropped, while the vehicle's signatures are right."""
    flight = Flight()
    flight.link = replace(LINK, signed=signed, signing_fault="another sender uses the autopilot's ids")
    flight.step(5)
    flight.wall_m = 5.0
    flight.step()
    assert len(flight.stops()) == signed
    assert (flight.state is GuardState.UNAVAILABLE) == (not signed)


def test_a_command_is_sent_with_the_heartbeat_by_which_it_was_decided() -> None:
    """Another one may arrive while the guard decides. The session drops a command that it contradicts."""
    flight = Flight()
    flight.step(5)
    flight.wall_m = 5.0
    asked: list[Vehicle] = []

    def vehicle() -> Vehicle:
        asked.append(replace(COPTER, heartbeat_ns=flight.now_ns, custom_mode=COPTER.custom_mode + 2 * bool(asked)))
        return asked[-1]

    flight.guard._line = replace(flight.guard._line, vehicle=vehicle)
    flight.step()
    assert len(flight.stops()) == 1
    assert flight.decided_by == asked[:1]


def test_a_slow_disk_does_not_delay_the_stop(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight(tmp_path)
    at_write: list[int] = []

    def keep(file: GuardMemoryFile, memory: GuardMemory, now_ns: int) -> None:
        if memory.state is GuardState.STOPPING:
            at_write.append(len(flight.stops()))

    monkeypatch.setattr(GuardMemoryFile, "keep", keep)
    flight.step(5)
    assert flight.stops() == []
    flight.wall_m = 5.0
    flight.step()
    assert at_write == [1]


def test_a_journal_that_is_not_read_does_not_delay_the_stop() -> None:
    """A write to a full pipe blocks until its reader goes on, as a terminal after Ctrl-S."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    flight = Flight()
    flight.step(5)
    flight.wall_m = 5.0
    log, thread = logging.getLogger("companion"), threading.Thread(target=flight.step, daemon=True)
    with os.fdopen(writer, "w") as stream:
        handler = logging.StreamHandler(stream)
        log.addHandler(handler)
        try:
            thread.start()
            assert until(lambda: len(flight.stops()) == 1)
            assert until(lambda: any(m.get_type() == "STATUSTEXT" for m in flight.sent))
            assert thread.is_alive(), "it waits for the reader of the journal"
        finally:
            log.removeHandler(handler)
            os.set_blocking(reader, False)  # the thread may end between the question and the read
            while thread.is_alive():
                with contextlib.suppress(BlockingIOError):
                    os.read(reader, 65536)
                thread.join(0.01)
    os.close(reader)


def test_a_disk_that_hangs_holds_up_no_step_and_the_newest_state_is_written_after_it(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight, disk, write = Flight(tmp_path), threading.Event(), StateFile._write

    def slow(file: StateFile, *args: Any) -> None:
        assert disk.wait(60.0)
        write(file, *args)

    monkeypatch.setattr(StateFile, "_write", slow)
    flight.step(5)
    flight.wall_m = 5.0
    flight.step()
    assert flight.state is GuardState.STOPPING
    assert len(flight.stops()) == 1
    assert not (tmp_path / "guard.json").exists()
    disk.set()
    flight.guard._file.close()
    flight.step()
    flight.guard._file.close()
    kept = GuardMemoryFile(tmp_path).load(flight.now_ns)
    assert kept is not None
    assert kept.state is GuardState.STOPPING


def test_a_file_that_no_thread_can_write_ends_no_step(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Where memory or threads are short. The thread of the guard would end, and with it the service, in flight."""

    def none_left(thread: WatchedThread) -> None:
        raise RuntimeError("can't start new thread")

    flight = Flight(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(WatchedThread, "start", none_left)
        flight.step(5)
        flight.wall_m = 5.0
        flight.step()
        assert len(flight.stops()) == 1
        assert "guard.json cannot be written (can't start new thread)" in caplog.text
        flight.guard._file.close()
    flight.step(60)
    flight.guard._file.close()
    assert (tmp_path / "guard.json").exists()


def test_texts_that_were_announced_are_forgotten_when_they_may_be_repeated() -> None:
    """Most texts contain a distance, so that each one differs from those before."""
    sent: list[Any] = []
    guard = Guard(
        GuardParams(enabled=True), AvoidParams(), AutopilotLine(lambda: None, sent.append), lambda: LINK, None
    )
    for k in range(1000):
        guard._announce(Announcement(f"guard: stop, obstacle {k} m ahead"), START_NS + k * NS)
        guard._announce(Announcement(f"guard: stop, obstacle {k} m ahead"), START_NS + k * NS)
    assert len(sent) == 1000
    assert len(guard._announced) <= REPEAT_NS // NS
    guard._announce(Announcement("guard: stop, obstacle 995 m ahead"), START_NS + 1000 * NS)
    assert len(sent) == 1001


@pytest.mark.parametrize(("speed_m_s", "protected"), [(3.0, True), (1.0, False)])
def test_a_fast_vehicle_does_not_stand_on_the_ground(speed_m_s: float, protected: bool) -> None:
    """A land detector that is wrong in flight."""
    flight = Flight()
    flight.velocity = (speed_m_s, 0.0, 0.0)
    flight.guard.message(dialect.MAVLink_extended_sys_state_message(0, 1), START_NS)
    flight.step(5)
    assert (flight.state is not GuardState.INACTIVE) == protected


def parts_of(guard: Guard) -> Parts:
    """The parts of a service whose guard alone can fail."""
    unused: Any = None
    return Parts(
        cameras={}, pipeline_thread=PIPELINE_THREAD, event_queue=unused, previews=unused, signing=unused, guard=guard
    )


def guard_with(vehicle: Callable[[], Vehicle | None]) -> Guard:
    return Guard(GuardParams(enabled=True), AvoidParams(), AutopilotLine(vehicle, lambda _: None), lambda: LINK, None)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_guard_that_has_ended_ends_the_service() -> None:
    reached = threading.Event()

    def vehicle() -> Vehicle | None:
        reached.set()
        raise ValueError("test")

    guard = guard_with(vehicle)
    assert parts_of(guard).stalled(START_NS, NS) == "", "not started"
    guard.open()
    assert reached.wait(60.0)
    guard.close()
    assert parts_of(guard).failures() == "the guard has ended: ValueError: test"
    assert parts_of(guard).stalled(guard.alive_ns, NS) == "", "it has ended"


def test_a_guard_that_does_not_respond_is_a_stalled_part() -> None:
    reached, release = threading.Event(), threading.Event()

    def vehicle() -> Vehicle | None:
        reached.set()
        release.wait(60.0)
        return None

    guard = guard_with(vehicle)
    guard.open()
    try:
        assert reached.wait(60.0)
        assert parts_of(guard).stalled(guard.alive_ns + NS, NS) == ""
        assert parts_of(guard).stalled(guard.alive_ns + NS + 1, NS) == "the guard does not respond"
        assert parts_of(guard).failures() == ""
    finally:
        release.set()
        guard.close()
