"""The second thread: it works beside whoever asks, not in his place, and is never waited for before it has begun."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from companion.config import config_of
from companion.messages import prisms_bytes
from companion.pipeline import Pipeline, PrismsResult
from companion.second_thread import SecondThread
from core.extractor import Extractor
from core.params import Params
from drivers.proto import osape_v1_pb2 as pb
from drivers.simulated_flight import Rates, SimulatedFlight

from .live import Live, flown

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 30.0

[autopilot]
address = "udpin:127.0.0.1:{port}"

[service]
second_thread_from_hz = 30.0
"""
TWO = len(os.sched_getaffinity(0)) > 1
needs_two = pytest.mark.skipif(not TWO, reason="one processor")


def opened() -> SecondThread:
    second = SecondThread(("front",))
    assert second.open() == ""
    return second


def allowed(process: int) -> dict[str, str]:
    """Of each thread of a process the processors that it may run on, as the kernel writes them."""
    found = {}
    for task in Path(f"/proc/{process}/task").iterdir():
        lines = (task / "status").read_text().splitlines()
        found[task.name] = next(line.split()[1] for line in lines if line.startswith("Cpus_allowed_list"))
    return found


class Part:
    """A piece of work that says when it began, and ends when it is let."""

    def __init__(self, hold: bool = False) -> None:
        self.began, self.let = threading.Event(), threading.Event()
        if not hold:
            self.let.set()
        self.thread, self.processors = 0, set[int]()

    def __call__(self) -> str:
        self.thread, self.processors = threading.get_ident(), os.sched_getaffinity(0)
        self.began.set()
        assert self.let.wait(10.0)
        return "done"


@needs_two
def test_work_is_done_by_another_thread_kept_off_one_processor() -> None:
    second, part = opened(), Part()
    try:
        job = second.start(part)
        assert part.began.wait(5.0)
        assert job.result() == "done"
        assert part.thread != threading.get_ident()
        assert part.processors < os.sched_getaffinity(0)
    finally:
        second.close()


@needs_two
def test_it_is_kept_off_the_processor_of_whoever_asks_wherever_that_is_moved_to() -> None:
    second, mine = opened(), os.sched_getaffinity(0)
    try:
        for processor in (*sorted(mine)[:2], *sorted(mine)[:1]):
            os.sched_setaffinity(0, {processor})  # of this thread
            part = Part()
            job = second.start(part)
            assert part.began.wait(5.0)
            assert job.result() == "done"
            assert part.processors == mine - {processor}
    finally:
        os.sched_setaffinity(0, mine)
        second.close()


@needs_two
def test_a_new_piece_waits_for_what_a_frame_that_was_given_up_left() -> None:
    """The memory that it writes to is the next frame's."""
    second, held, after = opened(), Part(hold=True), Part()
    try:
        second.start(held)
        assert held.began.wait(5.0)
        threading.Timer(0.3, held.let.set).start()
        begun_s = time.monotonic()
        second.start(after)
        assert time.monotonic() - begun_s > 0.2
    finally:
        second.close()


@needs_two
def test_what_has_not_begun_when_it_is_asked_for_is_never_done() -> None:
    """Whoever asked does it himself."""
    second, held, late = opened(), Part(hold=True), Part()
    try:
        second.start(held)
        assert held.began.wait(5.0)
        second._last = None  # else it would wait for the thread to be free
        begun_s = time.monotonic()
        assert second.start(late).result() is None
        assert time.monotonic() - begun_s < 5.0
        held.let.set()
        assert not late.began.wait(0.3)
        then = Part()
        job = second.start(then)
        assert then.began.wait(5.0)
        assert job.result() == "done"
    finally:
        held.let.set()
        second.close()
    never = Part()
    assert second.start(never).result() is None
    assert not never.began.wait(0.2)


@needs_two
def test_asked_for_at_once_it_is_either_done_or_never_begun() -> None:
    second = opened()
    try:
        for _ in range(2000):
            part = Part()
            result = second.start(part).result()
            assert part.began.is_set() == (result == "done")
    finally:
        second.close()


@needs_two
def test_an_error_is_raised_where_the_result_is_asked_for_and_nothing_is_done_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = list[BaseException | None]()
    monkeypatch.setattr(threading, "excepthook", lambda args: told.append(args.exc_value))
    second, began = opened(), threading.Event()

    def broken() -> str:
        began.set()
        raise ValueError("broken")

    try:
        job = second.start(broken)
        assert began.wait(5.0)
        with pytest.raises(RuntimeError, match="second thread ended with an error"):
            job.result()
        assert second.start(Part()).result() is None
        assert [str(error) for error in told] == ["broken"]
    finally:
        second.close()


def test_without_a_quick_camera_there_is_no_thread() -> None:
    before = threading.active_count()
    second = SecondThread(())
    assert second.open() == ""
    assert threading.active_count() == before
    assert second.helper_of("front") is None
    second.close()
    second.close()


@pytest.mark.parametrize(("from_hz", "helped"), [(0.0, ()), (10.0, ("a", "b")), (10.5, ("b",)), (31.0, ())])
def test_cameras_that_are_quick_enough_are_helped(from_hz: float, helped: tuple[str, ...]) -> None:
    cameras = [{"name": name, "kind": "simulated", "fps": fps} for name, fps in (("a", 10.0), ("b", 30.0))]
    config = config_of({"camera": cameras, "service": {"second_thread_from_hz": from_hz}}, "test")
    assert config.helped_cameras == helped


@needs_two
def test_a_flight_gives_the_same_bytes_with_it_and_without() -> None:
    flight = SimulatedFlight("street", width=320, height=240, duration_s=2.0, rates=Rates(depth_hz=20.0))
    second = opened()

    def flown_through(helped: bool) -> list[bytes]:
        pipeline = Pipeline(
            flight.cameras, lambda info: Extractor(Params(), second.helper_of(info.camera) if helped else None)
        )
        results = [out for event in flight.events() for out in pipeline.handle(event)]
        return [prisms_bytes(out) for out in results if isinstance(out, PrismsResult)]

    try:
        alone = flown_through(False)
        assert len(alone) > 30
        assert flown_through(True) == alone
    finally:
        second.close()


@needs_two
def test_the_live_service_has_it_and_its_log_replays_bit_for_bit_without(tmp_path: Path, renders: Path) -> None:
    live = Live(tmp_path, CONFIG, renders)
    prisms = live.ear("prisms", pb.PrismsFrame)
    try:
        with flown(live):
            live.start()
            prisms.wait(lambda m: m.valid and m.sequence > 40, 60.0)
            assert live.process is not None
            places = allowed(live.process.pid)
            whole = places.pop(str(live.process.pid))
            assert [place != whole for place in places.values()].count(True) == 1
            assert live.stop() == 0
    finally:
        live.close()
    done = live.command("replay", str(live.logs[0]), "--check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_with_one_processor_the_service_says_that_it_cannot_and_flies(tmp_path: Path, renders: Path) -> None:
    live = Live(tmp_path, CONFIG, renders)
    health = live.ear("health", pb.Health)
    mine = os.sched_getaffinity(0)
    try:
        with flown(live):
            os.sched_setaffinity(0, {min(mine)})
            live.start()
            os.sched_setaffinity(0, mine)
            report = health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE, 60.0)
        assert [note.split(":")[0] for note in report.notes] == ["second_thread_from_hz is not heeded"]
        assert not any("second_thread" in trouble for trouble in report.troubles)
        assert "second_thread_from_hz is not heeded" in live.said()
    finally:
        live.close()
