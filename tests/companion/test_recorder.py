"""The recorder: whole files under any end, and no hole that a replay would not notice."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from companion.config.camera import OutputConfig
from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.log import current_file as log_current
from companion.log import record_queue
from companion.log import recorder as recorder_module
from companion.log.current_file import Begin, CurrentLog
from companion.log.log_directory import files_of, make_room, new_flight, part_path, recovering_files
from companion.log.log_file import FileInUseError
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import CHILD, Repairs, leftovers, repair_file
from companion.pipeline.configured import make_pipeline
from companion.pipeline.events import RawFrame
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.state import PipelineState
from companion.replay.replay import Options, replay
from core.params import Params
from core.stages.model import blind_model
from core.types import AttitudeSample, CameraInfo, DepthFrame, ExtractorState, InvalidCause
from drivers.base import Event
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import Rates, SimulatedFlight

pytestmark = pytest.mark.process

CHECK = "check the disk, its mount and the rights of the directory"
SMALL = RecordParams(file_mb=1.0, file_s=600.0, budget_mb=100.0, least_free_mb=1.0)

PROMPT = (sys.executable, "-c", CHILD.replace("os.nice(19); ", ""))
"""A repair that does not wait until all other tests leave it a processor."""


def until(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.005)
    return condition()


def repair(folder: Path, running: str) -> list[str]:
    """Repairs the unfinished files of other flights in this process; returns the results."""
    return [repair_file(path) for path in leftovers(folder, running)]


def flight(duration_s: float = 1.0) -> SimulatedFlight:
    return SimulatedFlight("street", width=160, height=120, duration_s=duration_s, rates=Rates(depth_hz=20.0))


def run_through(recorder: Recorder, pipeline: Pipeline, events: Iterator[Event], pause_s: float = 0.0) -> None:
    """What the service does with each event."""
    for event in events:
        if recorder.wants_begin:
            recorder.begin(event.t_arrival_ns, pipeline.cameras, pipeline.state())
        recorder.event(event)
        for output in pipeline.handle(event):
            recorder.output(output)
        if pause_s:
            time.sleep(pause_s)


def recorded(folder: Path, params: RecordParams, duration_s: float = 1.0, pause_s: float = 0.0) -> Recorder:
    source = flight(duration_s)
    recorder = Recorder(folder, run_info("live"), params)
    recorder.open()
    run_through(recorder, make_pipeline(Config(), source.cameras), source.events(), pause_s)
    recorder.close()
    return recorder


def test_what_was_recorded_replays_to_the_same_prisms(tmp_path: Path) -> None:
    recorder = recorded(tmp_path, SMALL)
    (log,) = files_of(tmp_path)
    assert not log.active
    result = replay(log.path, Options(check=True))
    assert result.comparison is not None
    assert result.comparison.passed
    assert result.comparison.compared > 15
    assert recorder.status.dropped == 0


def test_a_disk_that_hangs_is_reported_until_it_responds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A call of the kernel for a worn SD card may take minutes. The log then ends long before the flight does."""
    responds = threading.Event()
    sync = LogWriter.sync

    def hangs(log: LogWriter) -> None:
        responds.wait(60.0)
        sync(log)

    monkeypatch.setattr(LogWriter, "sync", hangs)
    monkeypatch.setattr(recorder_module, "STALLED_NS", recorder_module.NS // 2, raising=False)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    recorder.begin(time.monotonic_ns(), flight().cameras, PipelineState())
    assert until(lambda: f"{tmp_path}: the disk has not taken the log" in recorder.status.fault), recorder.status
    recorder.close()  # does not wait for it
    assert recorder.status.fault
    responds.set()
    assert until(lambda: not recorder.status.recording and not recorder.status.fault)
    (log,) = files_of(tmp_path)
    assert not log.active


@pytest.mark.parametrize("drawn", [True, False])
def test_a_recorded_log_opens_in_viewers_with_obstacles_in_it(tmp_path: Path, drawn: bool) -> None:
    """[output] scene and transforms decide it for the service as for a replay."""
    recorder = Recorder(tmp_path, run_info("live"), SMALL, OutputConfig(scene=drawn, transforms=drawn))
    recorder.open()
    source = flight(1.0)
    run_through(recorder, make_pipeline(Config(), source.cameras), source.events())
    recorder.close()
    (log,) = files_of(tmp_path)
    found: Counter[str] = Counter()
    with McapRecording(log.path) as recording:
        for item in recording.messages("prisms", "scene", "transform"):
            found[item.key] += 1
    assert found["prisms"] > 15
    assert found["scene"] == (found["prisms"] if drawn else 0)
    assert (found["transform"] > 0) is drawn


def test_the_level_of_compression_is_what_was_asked_for(tmp_path: Path) -> None:
    sizes = []
    for level in (-20, -1, 9):
        folder = tmp_path / f"{level}"
        recorded(folder, RecordParams(least_free_mb=1.0, zstd_level=level))
        (log,) = files_of(folder)
        sizes.append(log.bytes)
        result = replay(log.path, Options(check=True))
        assert result.comparison is not None
        assert result.comparison.passed
    assert sizes[0] > sizes[1] > sizes[2]


def test_each_file_of_a_rotated_flight_replays_by_itself(tmp_path: Path) -> None:
    recorded(tmp_path, SMALL, duration_s=3.0, pause_s=0.02)
    logs = files_of(tmp_path)
    assert len(logs) >= 2
    assert [f.part for f in logs] == list(range(len(logs)))
    frames = 0
    for log in logs:
        result = replay(log.path, Options(check=True))
        assert result.comparison is not None
        assert result.comparison.different == 0, (log.path, result.comparison.first)
        assert result.comparison.compared > 0 or log is logs[-1]  # the last one may begin after the last frame
        frames += result.comparison.compared
    assert frames >= 55


def test_what_is_held_is_handed_over_at_the_end_and_counts_before(tmp_path: Path) -> None:
    """While a frame is worked on the recorder's thread has nothing to do."""
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    source = flight(1.0)
    pipeline = make_pipeline(Config(), source.cameras)
    events = [e for e in source.events() if isinstance(e, DepthFrame)]
    with recorder.deferred():
        recorder.begin(events[0].t_arrival_ns, pipeline.cameras, pipeline.state())
        for event in events:
            recorder.event(event)
        time.sleep(0.3)  # longer than the thread waits before it looks by itself
        assert recorder.status.queued == len(events) + 1
        assert not recorder.status.recording
    assert until(lambda: recorder.status.queued == 0 and recorder.status.recording)
    recorder.close()
    (log,) = files_of(tmp_path)
    with McapRecording(log.path) as recording:
        assert sum(isinstance(e, DepthFrame) for e in recording.events()) == len(events)


def test_subscribers_are_served_first_and_closing_does_not_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame waits for the recorder's pause, here an hour; with the next one, or at the end, it is over."""
    source = flight(1.0)
    pipeline = make_pipeline(Config(), source.cameras)
    frames = [e for e in source.events() if isinstance(e, DepthFrame)][:3]
    monkeypatch.setattr(record_queue, "_AFTER_S", 3600.0)
    monkeypatch.setattr(record_queue, "_WAKE_BYTES", frames[0].depth_mm.nbytes)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    recorder.begin(frames[0].t_arrival_ns, pipeline.cameras, pipeline.state())
    assert until(lambda: recorder.status.recording)  # a few bytes neither wake the thread nor wait for it
    waits, wait = [], recorder._queue.lock.wait
    monkeypatch.setattr(recorder._queue.lock, "wait", lambda seconds: (waits.append(seconds), wait(seconds))[1])
    monkeypatch.setattr(record_queue, "IDLE_S", 3600.0)
    assert until(lambda: 3600.0 in waits)  # the wait at hand is over, and one that only a frame ends has begun
    recorder.event(frames[0])
    assert not until(lambda: recorder.status.queued == 0, 0.5)
    recorder.event(frames[1])
    assert until(lambda: recorder.status.queued == 0)
    recorder.event(frames[2])
    recorder.close()
    (log,) = files_of(tmp_path)
    assert not log.active
    with McapRecording(log.path) as recording:
        logged = [e.sequence for e in recording.events() if isinstance(e, DepthFrame)]
    assert logged == [frame.sequence for frame in frames]


def test_what_is_held_is_bounded_too(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, run_info("live"), RecordParams(queue_items=100, least_free_mb=1.0))
    recorder.open()
    sample = AttitudeSample(1, 1, (1.0, 0.0, 0.0, 0.0), None)
    with recorder.deferred():
        recorder.begin(1, (), Pipeline((), lambda info: pytest.fail("no camera")).state())
        for _ in range(150):
            recorder.event(sample)
        assert recorder.status.queued == 100
        assert recorder.status.dropped == 51
        recorder.events([sample, sample])  # not taken any more, and each is counted
        recorder.frames([RawFrame(b"x", 1), RawFrame(b"y", 2), RawFrame(b"z", 3)])
        assert recorder.status.dropped == 56
        assert recorder.wants_begin
    recorder.close()


def test_after_a_drop_everything_waits_for_a_new_file(tmp_path: Path) -> None:
    """A queue that is full: no attitude that the next frames rest on may be missing in silence."""
    params = RecordParams(file_mb=1.0, queue_items=100, queue_mb=4.0, least_free_mb=1.0)
    recorder = Recorder(tmp_path, run_info("live"), params)
    recorder._folder.mkdir(exist_ok=True)
    recorder.flight = new_flight(tmp_path)  # its thread does not run yet: the disk is stuck
    source = flight(2.0)
    pipeline = make_pipeline(Config(), source.cameras)
    events = list(source.events())
    recorder.begin(events[0].t_arrival_ns, pipeline.cameras, pipeline.state())
    half = len(events) // 2
    for event in events[:half]:
        recorder.event(event)
        for output in pipeline.handle(event):
            recorder.output(output)
    assert recorder.status.dropped > 0
    assert recorder.wants_begin
    recorder._thread.start()
    assert until(lambda: recorder.status.queued == 0)
    run_through(recorder, pipeline, iter(events[half:]))
    recorder.close()
    logs = files_of(tmp_path)
    assert len(logs) == 2
    for log in logs:
        result = replay(log.path, Options(check=True))
        assert result.comparison is not None
        assert result.comparison.passed


def test_a_queue_of_images_is_bounded_by_its_bytes(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, run_info("live"), RecordParams(queue_mb=4.0))
    source = flight()
    recorder.begin(0, source.cameras, make_pipeline(Config(), source.cameras).state())
    for k in range(100):
        depth = np.zeros((480, 640), np.uint16)
        recorder.event(DepthFrame(camera="front", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=depth))
    assert recorder.status.queued <= 8
    assert recorder.status.dropped > 90


def test_a_full_disk_is_reported_and_recording_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [10**12]
    monkeypatch.setattr(log_current, "free_bytes", lambda folder: free[0])
    monkeypatch.setattr(recorder_module, "RETRY_NS", 50_000_000)
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    free[0] = 999_999 + log_current.begin_bytes(SMALL)
    recorder.begin(0, pipeline.cameras, pipeline.state())
    assert until(lambda: "less than 73 MB free" in recorder.status.fault)
    assert not recorder.status.recording
    free[0] += 1
    assert until(lambda: recorder.wants_begin)
    run_through(recorder, pipeline, source.events())
    assert until(lambda: recorder.status.recording and recorder.status.fault == "")
    recorder.close()
    assert len(files_of(tmp_path)) == 1


def test_a_write_that_fails_leaves_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    recorder.begin(0, pipeline.cameras, pipeline.state())
    assert until(lambda: recorder.status.recording)

    def no_space(log: object) -> None:
        raise OSError(28, "No space left on device")

    recorder._enqueue(no_space, 10)
    assert until(lambda: recorder.status.fault == f"recording stopped: {tmp_path}: No space left on device; {CHECK}")
    recorder.close()
    (left,) = files_of(tmp_path)
    assert left.active


def test_nothing_is_recorded_while_it_is_not_to_be(tmp_path: Path) -> None:
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    recorder.begin(0, pipeline.cameras, pipeline.state())
    recorder.event(AttitudeSample(1, 1, (1.0, 0.0, 0.0, 0.0)))
    recorder.end()
    for k in range(50):
        recorder.event(AttitudeSample(k + 2, k + 2, (1.0, 0.0, 0.0, 0.0)))
    recorder.close()
    (log,) = files_of(tmp_path)
    with McapRecording(log.path) as recording:
        assert len(list(recording.events())) == 1
    assert recorder.status.dropped == 0


A, B, C, D = (f"2026010{day}-000000" for day in (1, 2, 3, 4))
"""Flights, in order."""


def fake_log(folder: Path, flight: str, part: int, size: int, age_s: int, *, idle: bool = False) -> Path:
    path = part_path(folder, flight, part, idle)
    path.write_bytes(bytes(size))
    stamp = 1_700_000_000 - age_s
    os.utime(path, (stamp, stamp))
    return path


def test_the_oldest_flights_go_first_and_the_running_one_never(tmp_path: Path) -> None:
    running = fake_log(tmp_path, C, 0, 5000, 900)
    old = fake_log(tmp_path, A, 0, 3000, 500)
    newer = fake_log(tmp_path, B, 0, 3000, 100)
    (tmp_path / "notes.txt").write_bytes(bytes(9000))
    assert make_room(tmp_path, 9000, C) == [old]
    assert make_room(tmp_path, 1000, C) == [newer]
    assert running.exists()
    assert (tmp_path / "notes.txt").exists()


def test_what_was_recorded_before_arming_goes_before_any_flight(tmp_path: Path) -> None:
    """Also that of the running flight: a vehicle that waits for hours deletes no flight."""
    armed = fake_log(tmp_path, A, 1, 3000, 0)
    idle = [fake_log(tmp_path, flight, 0, 3000, 0, idle=True) for flight in (B, C)]
    open_file = LogWriter(part_path(tmp_path, C, 1, idle=True))
    open_file.sync()
    assert make_room(tmp_path, 6500, C) == idle[:1]
    assert make_room(tmp_path, 3500, C) == idle[1:]
    assert make_room(tmp_path, 0, C) == [armed]
    assert open_file.in_place


@pytest.mark.parametrize(
    "name", ["survey.2024.mcap", "bag.001.mcap", "20260101-000000.mcap", "my 20260101-000000.000.mcap"]
)
def test_logs_of_others_are_neither_deleted_nor_repaired(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bytes(9000))
    (tmp_path / (name + ".active")).write_bytes(b"")
    assert make_room(tmp_path, 0, C) == []
    assert repair(tmp_path, C) == []
    assert len(list(tmp_path.iterdir())) == 2


def test_the_flight_that_another_service_records_is_not_deleted(tmp_path: Path) -> None:
    finished = fake_log(tmp_path, A, 0, 3000, 900)
    other = LogWriter(part_path(tmp_path, A, 1))
    other.begin(run_info("live"), flight().cameras)
    other.sync()
    assert make_room(tmp_path, 0, C) == []
    assert other.in_place
    other.abandon()
    assert make_room(tmp_path, 0, C) == [finished, other.active_path]


def test_a_flight_recorded_before_the_clock_was_set_is_not_taken_for_the_oldest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a battery the clock begins at the same date after each start."""
    monkeypatch.setattr(time, "time_ns", lambda: 1_800_000_000 * 10**9)
    before = fake_log(tmp_path, new_flight(tmp_path), 0, 3000, 0)
    monkeypatch.setattr(time, "time_ns", lambda: 12 * 10**9)
    names = []
    for _ in range(11):
        names.append(new_flight(tmp_path))
        path = fake_log(tmp_path, names[-1], 0, 3000, 0)
        os.utime(path, (12, 12))
    assert len(set(names)) == len(names)
    assert [f.flight for f in files_of(tmp_path)] == [before.name.partition(".")[0], *names]
    assert make_room(tmp_path, 12 * 3000 - 1, "") == [before]


def test_a_flight_named_by_a_clock_in_the_future_does_not_name_the_later_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They have the date of their own clock, and stay in order."""
    names = []
    for seconds in (4_000_000_000, 1_800_000_000, 1_800_000_060, 1_800_000_060, 4_000_000_000):
        monkeypatch.setattr(time, "time_ns", lambda s=seconds: s * 10**9)
        names.append(new_flight(tmp_path))
        fake_log(tmp_path, names[-1], 0, 3000, 0)
    future, present, later = "20961002-070640", "20270115-080000", "20270115-080100"
    assert names == [future, f"{present}-2", f"{later}-2", f"{later}-3", f"{future}-3"]
    assert [f.flight for f in files_of(tmp_path)] == names


def test_a_file_that_cannot_be_deleted_does_not_keep_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A damaged disk, or a file that belongs to somebody else in a directory with the sticky bit."""
    stuck = fake_log(tmp_path, A, 0, 3000, 0)
    newer = fake_log(tmp_path, B, 0, 3000, 0)
    unlink = Path.unlink

    def fails(path: Path, missing_ok: bool = False) -> None:
        if path == stuck:
            raise OSError(5, "Input/output error", str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", fails)
    assert make_room(tmp_path, 3000, C) == [newer]


def test_two_writers_of_one_file_exclude_each_other(tmp_path: Path) -> None:
    first = LogWriter(tmp_path / "a.mcap")
    first.begin(run_info("live"), flight().cameras)
    first.sync()
    content = first.active_path.read_bytes()
    with pytest.raises(FileInUseError, match="another process writes it"):
        LogWriter(tmp_path / "a.mcap")
    assert first.active_path.read_bytes() == content
    first.finish()
    LogWriter(tmp_path / "a.mcap").abandon()  # a new file: the finished one stays
    assert (tmp_path / "a.mcap").read_bytes()[: len(content)] == content


def test_two_services_of_one_second_record_two_flights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both found the name unused, and wrote into one file."""
    names = iter([A, A, B])
    monkeypatch.setattr(log_current, "new_flight", lambda folder: next(names))
    logs = [CurrentLog(tmp_path, "", run_info("live"), SMALL, Repairs(tmp_path)) for _ in range(2)]
    for log in logs:
        log.begin(Begin(1, flight().cameras, PipelineState()))
    for log in logs:
        log.finish()
    assert [f.flight for f in files_of(tmp_path)] == [A, B]


def test_a_directory_that_comes_later_is_recorded_into_and_repaired(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is mounted after the start. Before, the service did not start without it."""
    monkeypatch.setattr(recorder_module, "RETRY_NS", 50_000_000)
    (tmp_path / "disk").touch()
    folder = tmp_path / "disk" / "logs"
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    recorder = Recorder(folder, run_info("live"), SMALL)
    recorder._repairs = Repairs(folder, PROMPT)
    recorder.open()
    assert until(lambda: recorder.status.fault == f"recording stopped: {folder}: Not a directory; {CHECK}")
    recorder.begin(0, pipeline.cameras, pipeline.state())
    assert until(lambda: recorder.status.dropped > 0)
    (tmp_path / "disk").unlink()
    folder.mkdir(parents=True)
    part_path(folder, A, 0).with_suffix(".mcap.active").touch()
    assert until(lambda: recorder.wants_begin)
    run_through(recorder, pipeline, source.events())
    assert until(lambda: bool(recorder._repairs.results))
    recorder.close()
    assert recorder.status.fault == ""
    (log,) = files_of(folder)
    assert log.flight == recorder.flight


def test_a_copy_that_cannot_be_deleted_does_not_end_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power failure during a repair, and then a disk with errors."""
    (tmp_path / f"{A}.000.mcap.active.recovering").touch()

    def fails(path: Path, missing_ok: bool = False) -> None:
        raise OSError(5, "Input/output error", str(path))

    monkeypatch.setattr(Path, "unlink", fails)
    recorder = recorded(tmp_path, SMALL)
    assert recorder.status.fault == ""
    assert len(files_of(tmp_path)) == 1


def test_a_flight_that_has_spent_the_budget_stops_being_recorded(tmp_path: Path) -> None:
    recorder = recorded(tmp_path, RecordParams(file_mb=9.0, budget_mb=10.0, least_free_mb=1.0))
    source = flight()
    pipeline = make_pipeline(Config(), source.cameras)
    again = Recorder(tmp_path, run_info("live"), RecordParams(file_mb=9.9, budget_mb=10.0, least_free_mb=1.0))
    again.flight = recorder.flight  # the same flight goes on
    fake_log(tmp_path, recorder.flight, 1, 5_000_000, 0)
    again._thread.start()
    again.begin(0, pipeline.cameras, pipeline.state())
    assert until(lambda: bool(again.status.fault))
    again.close()


def test_two_flights_in_one_second_have_two_names(tmp_path: Path) -> None:
    first = new_flight(tmp_path)
    fake_log(tmp_path, first, 0, 1, 0)
    assert new_flight(tmp_path) != first


class FixedModel:
    """An extractor that returns an empty model at once: nothing has to be compiled."""

    def extract(self, depth: Any, info: CameraInfo, R: Any, state: Any = None, *, keep_strips: bool = False) -> Any:
        return blind_model(info, InvalidCause.NO_MEASUREMENT, Params()), ExtractorState()


SERVICE = textwrap.dedent("""
    import sys
    from pathlib import Path
    from tests.companion.test_recorder import SMALL, Pipeline, Recorder, FixedModel, flight, run_info, run_through
    source = flight(30.0)
    recorder = Recorder(Path(sys.argv[1]), run_info("live"), SMALL)
    recorder.open()
    run_through(recorder, Pipeline(source.cameras, lambda info: FixedModel()), source.events(), 0.001)
""")


def test_a_killed_recording_is_made_whole_at_the_next_start(tmp_path: Path) -> None:
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    service = subprocess.Popen([sys.executable, "-c", SERVICE, str(tmp_path)], env=env)
    try:
        assert until(lambda: any(f.bytes > 300_000 for f in files_of(tmp_path)), 60.0)
    finally:
        service.send_signal(signal.SIGKILL)
        service.wait()
    assert any(f.active for f in files_of(tmp_path))
    results = repair(tmp_path, "another flight")
    assert any("messages recovered" in s for s in results)
    logs = files_of(tmp_path)
    assert not any(f.active for f in logs)
    with McapRecording(logs[0].path) as recording:
        events = list(recording.events())
    assert len(events) > 20
    for event, sent in zip(events, flight(30.0).events(), strict=False):
        assert (event.t_arrival_ns, type(event)) == (sent.t_arrival_ns, type(sent))


SAMPLES = textwrap.dedent("""
    import sys, time
    from pathlib import Path
    from tests.companion.test_recorder import SMALL, AttitudeSample, ExtractorState, Recorder, flight, run_info
    from companion.pipeline.state import PipelineState
    recorder = Recorder(Path(sys.argv[1]), run_info("live"), SMALL)
    recorder.open()
    recorder.begin(1, flight().cameras, PipelineState())
    for number in range(1, 10_000):
        recorder.event(AttitudeSample(number, number, (1.0, 0.0, 0.0, 0.0), None))
        print(number, flush=True)
        time.sleep(0.05)
""")


def test_a_kill_loses_a_second_also_without_images(tmp_path: Path) -> None:
    """Small messages fill no chunk in many seconds: a killed service lost up to 40 s of them. Here they would fill it in minutes,
    and the log is looked at while they come, as a kill would leave it."""
    logs = tmp_path / "logs"
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    service = subprocess.Popen([sys.executable, "-c", SAMPLES, str(logs)], env=env, stdout=subprocess.PIPE, text=True)
    assert service.stdout is not None
    sent = next(number for number in map(int, service.stdout) if number > 20)

    def recovered() -> list[int]:
        left = Path(mkdtemp(dir=tmp_path)) / "left"
        shutil.copytree(logs, left)
        (result,) = repair(left, "another flight")
        assert "messages recovered" in result
        with McapRecording(files_of(left)[0].path) as recording:
            return [event.t_arrival_ns for event in recording.events()]

    try:
        assert until(lambda: len(recovered()) >= sent)
    finally:
        service.kill()
        service.wait()
    found = recovered()
    assert found == list(range(1, len(found) + 1))


def test_a_log_of_which_the_first_second_was_written_is_recovered(tmp_path: Path) -> None:
    """The service may be killed at any time. Before, such a file held no chunk."""
    log = CurrentLog(tmp_path, new_flight(tmp_path), run_info("live"), SMALL, Repairs(tmp_path))
    log.begin(Begin(1, flight().cameras, PipelineState()))
    log.write(lambda writer: writer.event(AttitudeSample(2, 2, (1.0, 0.0, 0.0, 0.0), None)))
    log.sync()  # after the first items
    assert log.path is not None
    killed = tmp_path / "killed"
    killed.mkdir()
    shutil.copy(log.path, killed)
    log.finish()
    (result,) = repair(killed, "another flight")
    assert "messages recovered" in result
    with McapRecording(files_of(killed)[0].path) as recording:
        assert [event.t_arrival_ns for event in recording.events()] == [2]


STUCK = (sys.executable, "-c", "import sys; sys.stdin.read()")
"""A repair that does not end by itself."""


def unfinished(folder: Path, name: str = "20260101-000000") -> Path:
    """What a killed run left."""
    log = LogWriter(part_path(folder, name, 0))
    source = flight(3.0)
    log.begin(run_info("live"), source.cameras, make_pipeline(Config(), source.cameras).state())
    for event in source.events():
        log.event(event)
    log.sync()
    log.abandon()
    return log.active_path


def test_the_flight_is_recorded_while_an_old_file_is_repaired(tmp_path: Path) -> None:
    old = unfinished(tmp_path)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder._repairs = Repairs(tmp_path, STUCK)
    recorder.open()
    source = flight()
    run_through(recorder, make_pipeline(Config(), source.cameras), source.events())
    assert until(lambda: recorder.status.repairing == old.name)
    assert recorder.status.recording
    assert until(lambda: recorder.status.queued == 0)
    assert recorder.status.dropped == 0
    recorder.close()  # and the repair with it
    assert recorder.status.repairing == old.name
    assert [f.active for f in files_of(tmp_path)] == [True, False]


def test_an_old_file_is_repaired_beside_the_recording_and_that_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "companion")
    old = unfinished(tmp_path)
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder._repairs = Repairs(tmp_path, PROMPT)
    recorder.open()
    source = flight()
    run_through(recorder, make_pipeline(Config(), source.cameras), source.events())
    assert until(lambda: bool(recorder._repairs.results))
    recorder.close()
    assert recorder.status.fault == ""
    assert not old.exists()
    assert any("repairing 20260101-000000.000.mcap.active" in m for m in caplog.messages)
    assert any("20260101-000000.000.mcap: " in m and "messages recovered" in m for m in caplog.messages)
    assert len(files_of(tmp_path)) == 2
    assert not recovering_files(tmp_path)


def test_a_repair_has_the_lowest_priority(tmp_path: Path) -> None:
    unfinished(tmp_path)
    repairs = Repairs(tmp_path)
    repairs.begin("now")
    repairs.step(lambda size: True)
    process = repairs._process
    assert process is not None
    assert until(lambda: os.getpriority(os.PRIO_PROCESS, process.pid) == 19)
    repairs.stop()


def test_a_kill_during_a_repair_loses_nothing(tmp_path: Path) -> None:
    old = unfinished(tmp_path)
    content = old.read_bytes()
    part = old.with_name(old.name + ".recovering")
    part.write_bytes(content[: len(content) // 2])  # what a killed repair leaves
    repairs = Repairs(tmp_path, STUCK)
    repairs.begin("now")
    assert not part.exists()
    repairs.step(lambda size: True)
    assert repairs.repairing == old.name
    assert repairs._process is not None
    assert os.getpgid(repairs._process.pid) != os.getpgrp()  # Ctrl-C does not reach it
    repairs.stop()
    assert old.read_bytes() == content
    (results,) = repair(tmp_path, "now")
    assert "messages recovered" in results


def test_a_repair_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    code = "import companion.log.repair as r, time; r.repair_file = lambda p: time.sleep(600); r.run_child()"
    process = subprocess.Popen([sys.executable, "-c", code, "x"], stdin=subprocess.PIPE)
    assert process.poll() is None
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(60.0) == 1


def test_a_file_that_is_written_is_not_repaired(tmp_path: Path) -> None:
    log = LogWriter(part_path(tmp_path, A, 0))
    (results,) = repair(tmp_path, "mine")
    assert "another process writes" in results
    log.abandon()


def test_a_copy_counts_in_the_budget_and_is_deleted_before_the_recording(tmp_path: Path) -> None:
    params = RecordParams(file_mb=1.0, budget_mb=10.0, least_free_mb=1.0)
    (tmp_path / f"{A}.000.mcap.active.recovering").write_bytes(bytes(9_500_000))
    old = fake_log(tmp_path, B, 0, 3000, 100)
    repairs = Repairs(tmp_path, STUCK)
    repairs._waiting = [unfinished(tmp_path, C)]
    repairs.step(lambda size: True)
    current = log_current.CurrentLog(tmp_path, D, run_info("live"), params, repairs)
    source = flight()
    current.begin(log_current.Begin(0, source.cameras, make_pipeline(Config(), source.cameras).state()))
    assert not old.exists()
    assert repairs.repairing == ""
    assert not recovering_files(tmp_path)
    current.abandon()


@pytest.mark.parametrize(
    ("copy_mb", "free_mb", "fits"),
    [(4.9, 100.0, True), (5.1, 100.0, False), (4.0, 15.1, True), (4.0, 14.9, False), (0.0, 10.9, False)],
)
def test_a_repair_begins_only_where_its_copy_and_the_recording_have_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, copy_mb: float, free_mb: float, fits: bool
) -> None:
    """A budget of 10 MB: 4 MB of a running flight, 1 MB for the file being written. Of the disk 10 MB are kept free."""
    params = RecordParams(file_mb=1.0, budget_mb=10.0, least_free_mb=10.0)
    monkeypatch.setattr(log_current, "free_bytes", lambda folder: round(free_mb * 1e6))
    fake_log(tmp_path, A, 0, 4_000_000, 100)
    current = CurrentLog(tmp_path, A, run_info("live"), params, Repairs(tmp_path))
    assert current.room_for(round(copy_mb * 1e6)) is fits


@pytest.mark.parametrize("how", ["deleted", "moved", "file deleted"])
def test_a_folder_that_is_taken_away_in_flight_is_made_again(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "state" / "logs"
    recorder = Recorder(folder, run_info("live"), SMALL)
    recorder.open()
    source = flight(4.0)
    pipeline = make_pipeline(Config(), source.cameras)
    events = source.events()
    run_through(recorder, pipeline, itertools.islice(events, 60))
    assert until(lambda: recorder.status.recording)
    first = recorder.status.file
    if how == "moved":
        folder.parent.rename(tmp_path / "elsewhere")
    elif how == "deleted":
        shutil.rmtree(folder.parent)
    else:
        Path(first).unlink()
    assert until(lambda: recorder.wants_begin)
    assert "was deleted or moved" in recorder.status.fault
    run_through(recorder, pipeline, events)
    assert until(lambda: recorder.status.recording and not recorder.status.fault)
    recorder.close()
    logs = files_of(folder)
    assert logs
    for log in logs:
        result = replay(log.path, Options(check=True))
        assert result.comparison is not None
        assert result.comparison.different == 0, (log.path, result.comparison.first)
        assert result.comparison.compared > 0 or log is logs[-1]  # the last one may begin after the last frame


def test_an_unfinished_file_without_a_byte_is_deleted(tmp_path: Path) -> None:
    """The power failed at the begin of a file: each later start reported it as a fault."""
    empty = tmp_path / f"{A}.000.mcap.active"
    empty.touch()
    repairs = Repairs(tmp_path, PROMPT)
    repairs.begin("now")
    repairs.step(lambda size: True)
    assert until(lambda: repairs.step(lambda size: True) or bool(repairs.results))
    assert repairs.results == [f"{empty.name}: empty, deleted"]
    assert repairs.fault == ""
    assert not empty.exists()


def test_a_repair_that_cannot_be_started_is_reported(tmp_path: Path) -> None:
    """Without memory for another process the file was forgotten, and counted as being repaired."""
    old = unfinished(tmp_path)
    repairs = Repairs(tmp_path, ("/there/is/no/such/command",))
    repairs.begin("now")
    repairs.step(lambda size: True)
    assert repairs.fault == f"{old.name}: left as it is (No such file or directory; the next start tries again)"
    assert repairs.repairing == ""
    assert old.exists()


def test_a_file_of_another_service_is_no_fault(tmp_path: Path) -> None:
    """The second service was degraded for its whole flight."""
    log = LogWriter(part_path(tmp_path, A, 0))
    repairs = Repairs(tmp_path)
    repairs.begin("now")
    for _ in range(2):
        repairs.step(lambda size: True)
    assert (repairs.fault, repairs.repairing) == ("", "")
    log.abandon()


def test_repair_leaves_what_it_cannot_read(tmp_path: Path) -> None:
    broken = tmp_path / "20260101-000000.000.mcap.active"
    broken.write_bytes(b"no log at all")
    (results,) = repair(tmp_path, "x")
    assert "left as it is" in results
    assert broken.read_bytes() == b"no log at all"


def test_parameters_that_cannot_be_are_named() -> None:
    with pytest.raises(ValueError, match="record: record = 'sometimes': expected one of always, armed, off"):
        RecordParams(record="sometimes")
    with pytest.raises(ValueError, match=r"record: file_mb = 0: expected 1.0..4096.0 MB"):
        RecordParams(file_mb=0)
    with pytest.raises(ValueError, match=r"record: zstd_level = 22: expected -20..9"):
        RecordParams(zstd_level=22)
