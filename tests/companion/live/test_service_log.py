"""The log of a live run: after any fault, each of its files replays to the same prisms, bit for bit."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.live.event_queue import EventQueue
from companion.live.log_feed import ClockCallbacks, LogFeed
from companion.live.motion_checks import MotionChecks
from companion.live.pipeline_thread import PipelineThread, Receivers
from companion.live.staleness import StalenessMonitor
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.replay.replay import Options, replay
from core.extractor import Extractor
from core.types import DepthFrame
from drivers.logs.reader import McapRecording
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.simulation.flight import Rates, SimulatedFlight
from drivers.simulation.source import camera_info
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import Live, flown

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160

[[camera]]
name = "right"
kind = "simulated"
flight = "street"
width_px = 160
fps = 10.0
yaw_deg = 90.0
required = false

[autopilot]
address = "udpin:127.0.0.1:{port}"

[record]
file_mb = 2.0

[supervision]
restart_s = 1.5
first_backoff_s = 0.1
"""


def kinds(path: Path) -> Counter[str]:
    """What a log holds, by the schema's short names and by cause of decisions."""
    found: Counter[str] = Counter()
    with McapRecording(path) as source:
        for key in ("state", "clock", "mavlink", "decision", "health"):
            for item in source.messages(key):
                found[key] += 1
                if isinstance(item.message, pb.FrameDecision) and not item.message.used:
                    found[pb.Cause.Name(item.message.cause)] += 1
    return found


def compared(path: Path) -> int:
    """Replays a log with `--check`: how many frames it compared, all of them equal. A file that began in the moment of the
    stop has none."""
    check = replay(path, Options(check=True)).comparison
    assert check is not None
    assert check.different == 0, check
    assert check.only_computed == ()
    assert check.only_logged == ()
    return check.compared


def test_every_file_of_an_eventful_flight_replays_bit_for_bit(tmp_path: Path, renders: Path) -> None:
    """Two cameras; one is killed, the autopilot falls silent and reboots, files rotate meanwhile."""
    live = Live(tmp_path, CONFIG, renders)
    prisms = live.subscribe("prisms", pb.PrismsFrame)
    try:
        with flown(live) as line:
            live.start()
            prisms.wait(lambda m: m.valid and m.camera == "right", PATIENCE_S)
            os.kill(live.camera_pids()["front"], signal.SIGKILL)
            prisms.wait(lambda m: not m.valid and m.camera == "front", PATIENCE_S)
            prisms.wait(lambda m: m.valid and m.camera == "front", PATIENCE_S)
            line.change(lambda a: setattr(a, "silent", True))
            prisms.wait(
                lambda m: not m.valid and m.camera == "right" and m.cause == pb.CAUSE_ATTITUDE_STALE, PATIENCE_S
            )
            line.change(lambda a: setattr(a, "silent", False))
            prisms.wait(lambda m: m.valid, PATIENCE_S)
            line.change(lambda a: a.reboot(time.monotonic_ns()))
            assert until(lambda: len(live.logs) >= 3), live.logs
            begun_ns = time.monotonic_ns()
            assert until(lambda: len([m for m in prisms.since(begun_ns) if m.valid]) > 10)
            assert live.stop() == 0
    finally:
        live.close()
    assert not [p for p in live.logs if p.suffix != ".mcap"]
    frames = [compared(path) for path in live.logs]
    assert all(count > 0 for count in frames[:-1])
    held = [kinds(path) for path in live.logs]
    assert all(k["state"] == 1 for k in held)
    assert all(k["clock"] >= 1 for k in held)
    whole = sum(held, Counter())
    assert whole["mavlink"] > 500
    assert whole["health"] >= 5
    assert whole["CAUSE_ATTITUDE_STALE"] >= 1


def recorder_in(folder: Path, params: RecordParams | None = None) -> Recorder:
    """One that writes into this folder."""
    config = Config(record=params or RecordParams())
    return Recorder(folder, run_info("live", config), config.record)


def loop_of(
    event_queue: EventQueue,
    recorder: Recorder,
    publish: Callable[[PrismsResult, bytes], None],
    warm_up: Callable[[], None] = lambda: None,
    armed: Callable[[], bool | None] = lambda: None,
) -> PipelineThread:
    """A pipeline of its own, without an autopilot's clock, recorded always."""
    config = Config()
    pipeline = Pipeline((), lambda info: Extractor(config.extractor), config.sync)
    callbacks = ClockCallbacks(clock=lambda: (ClockEstimate(ClockSource.NONE), 0), armed=armed)
    return PipelineThread(
        pipeline,
        event_queue,
        StalenessMonitor(("front", "right"), 0.3),
        Receivers(result=publish),
        LogFeed(recorder, "always", callbacks, pipeline),
        MotionChecks(),
        warm_up,
    )


def test_frames_passed_over_by_a_busy_pipeline_are_in_the_log_and_passed_over_again(tmp_path: Path) -> None:
    flight = SimulatedFlight("trees", width=160, height=120, duration_s=1.0, rates=Rates(depth_hz=20.0))
    recorder = recorder_in(tmp_path / "logs")
    event_queue, held = EventQueue(), threading.Event()
    published: list[int] = []
    rested: list[bool] = []

    def publish(result: PrismsResult, prisms: bytes) -> None:
        published.append(result.sequence)
        rested.append(loop.wait_idle(0.0))
        if len(published) == 3:
            assert held.wait(60.0)

    def published_up_to(frames: int) -> bool:
        return until(lambda: len(published) >= frames)

    loop = loop_of(event_queue, recorder, publish)
    recorder.open()
    loop.open()
    event_queue.put([camera_info(160, 120, ke_per_m=flight.cameras[0].ke_per_m)])
    for event in flight.events():
        if not isinstance(event, DepthFrame):
            event_queue.put([event])
            continue
        assert published_up_to(min(event.sequence, 3))
        event_queue.put_frame(event)
    held.set()
    assert until(lambda: published[-1] == 20)
    assert loop.wait_idle(60.0)
    assert rested == 4 * [False]  # reports of the service wait for the frame at hand
    loop.close()
    recorder.close()
    (log,) = (tmp_path / "logs").iterdir()
    assert kinds(log)["CAUSE_BUSY"] == 17
    result = replay(log, Options(check=True))
    assert result.comparison is not None
    assert result.comparison.passed
    assert result.comparison.compared == len(published) == 4
    assert published == [0, 1, 2, 20]


def _has(published: list[int], frames: int) -> bool:
    return len(published) == frames


def recorded(folder: Path, params: RecordParams) -> Path:
    """The log of 21 frames in one second, whose estimate of the noise depends on the frames before."""
    flight = SimulatedFlight("street", width=320, height=240, duration_s=1.0, rates=Rates(depth_hz=20.0))
    recorder, event_queue, published = recorder_in(folder, params), EventQueue(), list[int]()
    loop = loop_of(event_queue, recorder, lambda result, prisms: published.append(result.sequence))
    recorder.open()
    loop.open()
    event_queue.put([camera_info(320, 240, ke_per_m=flight.cameras[0].ke_per_m)])
    for event in flight.events():
        if isinstance(event, DepthFrame):
            event_queue.put_frame(event)
            assert until(partial(_has, published, event.sequence + 1))
        else:
            event_queue.put([event])
    loop.close()
    recorder.close()
    (log,) = folder.iterdir()
    return log


def test_a_new_file_begins_when_the_vehicle_is_armed(tmp_path: Path) -> None:
    """The file before is marked, so that it is deleted before any flight. One that began without an autopilot is not."""
    flight = SimulatedFlight("street", width=160, height=120, duration_s=1.5, rates=Rates(depth_hz=20.0))
    recorder, event_queue, published = recorder_in(tmp_path), EventQueue(), list[int]()
    armed: list[bool | None] = [False]
    loop = loop_of(event_queue, recorder, lambda r, prisms: published.append(r.sequence), armed=lambda: armed[0])
    recorder.open()
    loop.open()
    event_queue.put([camera_info(160, 120, ke_per_m=flight.cameras[0].ke_per_m)])
    for event in flight.events():
        if isinstance(event, DepthFrame):
            event_queue.put_frame(event)
            assert until(partial(_has, published, event.sequence + 1))
            armed[0] = {10: True, 20: False}.get(event.sequence, armed[0])
        else:
            event_queue.put([event])
    loop.close()
    recorder.close()
    before, after = sorted(tmp_path.iterdir())
    assert before.name.endswith(".000.idle.mcap")
    assert after.name.endswith(".001.mcap")
    for log, frames in ((before, 11), (after, 20)):
        result = replay(log, Options(check=True))
        assert result.comparison is not None
        assert result.comparison.passed
        assert result.comparison.compared == frames


def test_of_a_log_with_fewer_images_those_replay_bit_for_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = recorded(tmp_path / "logs", RecordParams(depth_hz=5.0))
    assert kinds(log)["state"] == 1 + 6
    assert main(["replay", str(log), "--check"]) == 0
    published = capsys.readouterr().out
    assert "check: 6 frames compared bit by bit: equal" in published
    assert "check: 15 frames not comparable, without depth" in published
    assert "depth_hz = 5: frames between the recorded images cannot be computed again" in published


def test_a_log_without_images_reports_that_nothing_can_be_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = recorded(tmp_path / "logs", RecordParams(depth=False))
    assert main(["replay", str(log), "--check"]) == 1
    assert "[record] depth = false: no frame can be computed again" in capsys.readouterr().out


def test_no_frame_is_handled_if_the_service_stops_while_the_kernels_are_loaded(tmp_path: Path) -> None:
    """Without them a frame would compile them in this thread, which no signal ends."""
    event_queue, published, recorder = EventQueue(), list[int](), recorder_in(tmp_path / "logs")
    loop = loop_of(event_queue, recorder, lambda result, prisms: published.append(result.sequence), lambda: loop.stop())
    event_queue.put([camera_info(160, 120)])
    event_queue.put_frame(
        DepthFrame(
            camera="front", sequence=1, t_exposure_ns=1, t_arrival_ns=2, depth_mm=np.full((120, 160), 3000, np.uint16)
        )
    )
    loop.open()
    assert until(lambda: all(thread.name != "pipeline" for thread in threading.enumerate()))
    assert published == []
    assert not loop.started.is_set()
    assert loop.failure == ""


def test_a_second_camera_that_opens_while_the_kernels_are_loaded_leaves_no_log_without_an_image(tmp_path: Path) -> None:
    """What came meanwhile is handled at one go: frames that were passed over, the other camera, then the first image."""
    flight = SimulatedFlight("street", width=160, height=120, duration_s=0.5, rates=Rates(depth_hz=20.0))
    info, recorder = camera_info(160, 120, ke_per_m=flight.cameras[0].ke_per_m), recorder_in(tmp_path / "logs")
    event_queue, warm, published = EventQueue(), threading.Event(), list[int]()

    def warm_up() -> None:
        assert warm.wait(60.0)

    loop = loop_of(event_queue, recorder, lambda result, prisms: published.append(result.sequence), warm_up)
    recorder.open()
    loop.open()
    event_queue.put([info])
    for event in flight.events():
        if not isinstance(event, DepthFrame):
            event_queue.put([event])
            continue
        event_queue.put_frame(event)
        if event.sequence == 4:
            event_queue.put([replace(info, camera="right")])
    warm.set()
    assert until(lambda: published == [10])
    assert loop.wait_idle(60.0)
    loop.close()
    recorder.close()
    (log,) = (tmp_path / "logs").iterdir()
    assert kinds(log)["CAUSE_BUSY"] == 10
    result = replay(log, Options(check=True))
    assert result.comparison is not None
    assert result.comparison.passed
    assert result.comparison.compared == 1
