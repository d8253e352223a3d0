"""What the loop does between two frames."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.live.event_queue import EventQueue
from companion.live.log_feed import ClockCallbacks, LogFeed
from companion.live.motion_checks import MotionChecks
from companion.live.pipeline_thread import COLLECT_AT, COLLECT_OLDER_AT, PipelineThread, Receivers, collect_garbage
from companion.live.staleness import StalenessMonitor
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.types import AttitudeSample, DepthFrame
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.simulation.source import camera_info
from tests.waiting import until

pytestmark = pytest.mark.process

KEPT_A_FRAME = COLLECT_AT // 3


def loop_of(
    pipeline: Pipeline,
    event_queue: EventQueue,
    publish: Callable[[PrismsResult, bytes], None],
    recorder: Recorder | None,
    record: str,
) -> PipelineThread:
    """A loop without an autopilot's clock, of a disarmed vehicle."""
    callbacks = ClockCallbacks(clock=lambda: (ClockEstimate(ClockSource.NONE), 0), armed=lambda: False)
    return PipelineThread(
        pipeline,
        event_queue,
        StalenessMonitor(("front",), 0.3),
        Receivers(result=publish),
        LogFeed(recorder, record, callbacks, pipeline),
        MotionChecks(),
        lambda: None,
    )


class Node:
    """Garbage that only the collector finds: it refers to itself."""

    def __init__(self) -> None:
        self.me = self


def test_garbage_is_collected_between_frames_and_not_in_one() -> None:
    kept: list[list[int]] = []
    collected: list[bool] = []
    in_frame, published = threading.Event(), threading.Event()
    lost: list[weakref.ref[Node]] = []

    def publish(result: PrismsResult, prisms: bytes) -> None:
        in_frame.set()
        kept.extend([k] for k in range(KEPT_A_FRAME))
        lost.append(weakref.ref(Node()))
        in_frame.clear()
        published.set()

    def seen(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and threading.current_thread().name == "pipeline":
            collected.append(in_frame.is_set())

    event_queue = EventQueue()
    loop = loop_of(Pipeline((), lambda info: Extractor()), event_queue, publish, None, "off")
    gc.callbacks.append(seen)
    try:
        loop.open()
        event_queue.put([camera_info(160, 120)])
        for k in range(120):  # without an attitude each is blind, and published at once
            published.clear()
            now_ns = time.monotonic_ns()
            event_queue.put_frame(
                DepthFrame(
                    camera="front",
                    sequence=k,
                    t_exposure_ns=now_ns,
                    t_arrival_ns=now_ns,
                    depth_mm=np.zeros((120, 160), np.uint16),
                )
            )
            assert published.wait(60.0)
            assert loop.wait_idle(60.0)
            if k < 3:  # modules are imported in the first
                gc.collect()
                collected.clear()
    finally:
        gc.callbacks.remove(seen)
        loop.close()
    assert len(collected) >= 20
    assert not any(collected)
    assert until(lambda: sum(ref() is None for ref in lost) > 100)


class CallRecorder(Recorder):
    """Records its calls in the same list as the published results."""

    def __init__(self, folder: Path, calls: list[str]) -> None:
        super().__init__(folder, run_info("live"))
        self._calls = calls

    def begin(self, *of: Any) -> None:
        self._calls.append("begin")
        super().begin(*of)

    def events(self, events: Any) -> None:
        self._calls.append("attitude")

    def event(self, event: Any) -> None:
        self._calls.append(f"frame {event.sequence}")

    def output(self, output: Any, prisms: bytes | None = None) -> None:
        self._calls.append(f"{type(output).__name__} {output.sequence}, {len(prisms or b'') > 0}")


class Breaks(Pipeline):
    """Calls `fault` when it handles the second frame."""

    def __init__(self, fault: Callable[[], None]) -> None:
        super().__init__((), lambda info: Extractor())
        self._fault = fault

    def handle(self, event: Any) -> Any:
        if isinstance(event, DepthFrame) and event.sequence == 1:
            self._fault()
        return super().handle(event)


def two_frames(folder: Path, calls: list[str], fault: Callable[[], None]) -> PipelineThread:
    """A loop that handles two frames; `fault` is called in the second. calls: the results and records, in order."""
    recorder, event_queue = CallRecorder(folder, calls), EventQueue()
    loop = loop_of(
        Breaks(fault), event_queue, lambda result, prisms: calls.append(f"sent {result.sequence}"), recorder, "always"
    )
    event_queue.put([camera_info(160, 120)])
    loop.open()
    for k in range(2):
        event_queue.put([AttitudeSample(1_000 + k, 1_000 + k, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))])
        frame = np.zeros((120, 160), np.uint16)
        event_queue.put_frame(
            DepthFrame(camera="front", sequence=k, t_exposure_ns=1_000 + k, t_arrival_ns=2_000, depth_mm=frame)
        )
        assert k == 1 or until(lambda: "PrismsResult 0, True" in calls)
    return loop


FIRST = ["attitude", "begin", "sent 0", "frame 0", "FrameDecision 0, False", "PrismsResult 0, True"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_prisms_are_sent_before_their_frame_is_recorded_and_the_log_has_a_frame_that_breaks_the_pipeline(
    tmp_path: Path,
) -> None:
    def breaks() -> None:
        raise RuntimeError("as a fault of the pipeline would")

    calls: list[str] = []
    loop = two_frames(tmp_path, calls, breaks)
    assert until(lambda: bool(loop.failure))
    loop.close()
    assert calls == [*FIRST, "attitude", "frame 1"]


def test_the_log_has_the_frame_over_which_the_pipeline_hangs(tmp_path: Path) -> None:
    calls: list[str] = []
    hangs, goes_on = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        goes_on.wait(60.0)

    loop = two_frames(tmp_path, calls, hang)
    try:
        assert hangs.wait(60.0)
        assert calls == FIRST
        loop.close()
        assert calls == [*FIRST, "attitude", "frame 1"]
    finally:
        goes_on.set()
    loop.close()  # waits for its end
    # and once: what comes when it goes on after all is its own
    assert calls == [*FIRST, "attitude", "frame 1", "sent 1", "FrameDecision 1, False", "PrismsResult 1, True"]


@pytest.mark.parametrize("survived", [0, 1])
def test_older_garbage_is_collected_in_its_turn(survived: int) -> None:
    """What was in use when its generation was last looked through, and is in use no more."""
    gc.collect()
    gc.disable()  # nothing but `tidy` collects
    try:
        node = Node()
        gc.collect(survived)
        lost = weakref.ref(node)
        del node
        for _ in range((COLLECT_OLDER_AT + 2) ** (survived + 1)):
            assert lost() is not None
            new = [[k] for k in range(2 * COLLECT_AT)]
            collect_garbage()
            del new
            if lost() is None:
                break
        assert lost() is None
    finally:
        gc.enable()
