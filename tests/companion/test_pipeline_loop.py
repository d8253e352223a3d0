"""What the loop does between two frames."""

from __future__ import annotations

import gc
import threading
import time
import weakref

import numpy as np
import pytest

from companion.blindness import Blindness
from companion.inbox import Inbox
from companion.pipeline import Pipeline, PrismsResult
from companion.pipeline_loop import TIDY_AT, TIDY_OLDER_AT, Clockwork, PipelineLoop, tidy
from core.extractor import Extractor
from core.types import DepthFrame
from drivers.clock import ClockEstimate, ClockSource
from drivers.simulated import camera_info

from .live import until

KEPT_A_FRAME = TIDY_AT // 3


class Node:
    """Garbage that only the collector finds: it refers to itself."""

    def __init__(self) -> None:
        self.me = self


def test_garbage_is_collected_between_frames_and_not_in_one() -> None:
    kept: list[list[int]] = []
    collected: list[bool] = []
    in_frame, said = threading.Event(), threading.Event()
    lost: list[weakref.ref[Node]] = []

    def publish(result: PrismsResult, prisms: bytes) -> None:
        in_frame.set()
        kept.extend([k] for k in range(KEPT_A_FRAME))
        lost.append(weakref.ref(Node()))
        in_frame.clear()
        said.set()

    def seen(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and threading.current_thread().name == "pipeline":
            collected.append(in_frame.is_set())

    inbox = Inbox()
    loop = PipelineLoop(
        Pipeline((), lambda info: Extractor()), inbox, Blindness(("front",), 0.3), publish, None, "off",
        Clockwork(clock=lambda: (ClockEstimate(ClockSource.NONE), 0), armed=lambda: False), lambda: None,
    )  # fmt: skip
    gc.callbacks.append(seen)
    try:
        loop.open()
        inbox.put([camera_info(160, 120)])
        for k in range(120):  # without an attitude each is blind, and published at once
            said.clear()
            now_ns = time.monotonic_ns()
            inbox.put_frame(
                DepthFrame(
                    camera="front", sequence=k, t_exposure_ns=now_ns, t_arrival_ns=now_ns,
                    depth_mm=np.zeros((120, 160), np.uint16),
                )
            )  # fmt: skip
            assert said.wait(10.0)
            assert loop.rest(10.0)
            if k < 3:  # modules are imported in the first
                gc.collect()
                collected.clear()
    finally:
        gc.callbacks.remove(seen)
        loop.close()
    assert len(collected) >= 20
    assert not any(collected)
    assert until(lambda: sum(ref() is None for ref in lost) > 100, 1.0)


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
        for _ in range((TIDY_OLDER_AT + 2) ** (survived + 1)):
            assert lost() is not None
            new = [[k] for k in range(2 * TIDY_AT)]
            tidy()
            del new
            if lost() is None:
                break
        assert lost() is None
    finally:
        gc.enable()
