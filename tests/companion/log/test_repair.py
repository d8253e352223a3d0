"""Logs of a killed service: what of them is recovered, and when."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from tempfile import mkdtemp

import pytest

from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.log import current_file as log_current
from companion.log.current_file import Begin, CurrentLog
from companion.log.log_directory import files_of, new_flight, part_path, recovering_files
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import Repairs
from companion.pipeline.configured import make_pipeline
from companion.pipeline.state import PipelineState
from core.types import AttitudeSample
from drivers.logs.reader import McapRecording
from tests.waiting import until

from ..recorded import PROMPT, SMALL, A, B, C, D, events_of, fake_log, flight, repair, run_through

pytestmark = pytest.mark.process
SERVICE = textwrap.dedent("""
    import sys
    from pathlib import Path
    from companion.log.provenance import run_info
    from companion.log.recorder import Recorder
    from companion.pipeline.pipeline import Pipeline
    from tests.companion.recorded import SMALL, FixedModel, flight, run_through
    source = flight(30.0)
    recorder = Recorder(Path(sys.argv[1]), run_info("live"), SMALL)
    recorder.open()
    run_through(recorder, Pipeline(source.cameras, lambda info: FixedModel()), source.events(), 0.001)
""")


def test_a_killed_recording_is_made_whole_at_the_next_start(tmp_path: Path) -> None:
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
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
    from companion.log.provenance import run_info
    from companion.log.recorder import Recorder
    from core.types import AttitudeSample
    from tests.companion.recorded import SMALL, flight
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
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
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
    cameras = flight().cameras
    log.begin(run_info("live"), cameras, make_pipeline(Config(), cameras).state())
    for event in events_of(3.0):
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
