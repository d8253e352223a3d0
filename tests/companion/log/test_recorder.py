"""The recorder: what is recorded, held and dropped, and what a disk that hangs or is full does."""

from __future__ import annotations

import itertools
import shutil
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from companion.config.camera import OutputConfig
from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.log import current_file as log_current
from companion.log import record_queue
from companion.log import recorder as recorder_module
from companion.log.log_directory import files_of, new_flight, part_path
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import Repairs
from companion.pipeline.configured import make_pipeline
from companion.pipeline.events import RawMavlink
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.state import PipelineState
from companion.replay.replay import Options, replay
from core.types import AttitudeSample, DepthFrame
from drivers.logs.reader import McapRecording
from tests.waiting import until

from ..recorded import PROMPT, SMALL, A, events_of, flight, recorded, run_through

pytestmark = pytest.mark.process
CHECK = "check the disk, its mount and the rights of the directory"


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


def test_a_file_that_waits_to_be_begun_is_not_asked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that was slow while the next file was asked for: the file after it began at once, and it held nothing."""
    writes = threading.Event()
    writes.set()
    monkeypatch.setattr(log_current.CurrentLog, "sync", lambda log: writes.wait(60.0))
    monkeypatch.setattr(log_current.CurrentLog, "wants_successor", property(lambda log: log.files < 2))
    recorder = Recorder(tmp_path, run_info("live"), SMALL)
    recorder.open()
    recorder.begin(0, flight().cameras, PipelineState())
    assert until(lambda: recorder.wants_begin)
    writes.clear()
    recorder.event(next(e for e in events_of(1.0) if isinstance(e, AttitudeSample)))
    assert until(lambda: recorder.status.queued == 0)
    recorder.begin(1, flight().cameras, PipelineState())
    writes.set()
    assert until(lambda: recorder.status.files == 2)
    assert not recorder.wants_begin
    recorder.close()


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
        recorder.mavlink([RawMavlink(b"x", 1), RawMavlink(b"y", 2), RawMavlink(b"z", 3)])
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


def test_parameters_that_cannot_be_are_named() -> None:
    with pytest.raises(ValueError, match="record: record = 'sometimes': expected one of always, armed, off"):
        RecordParams(record="sometimes")
    with pytest.raises(ValueError, match=r"record: file_mb = 0: expected 1.0..4096.0 MB"):
        RecordParams(file_mb=0)
    with pytest.raises(ValueError, match=r"record: zstd_level = 22: expected -20..9"):
        RecordParams(zstd_level=22)
