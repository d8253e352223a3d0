"""The space that the recording leaves on the disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.config.service import RecordParams
from companion.log import current_file
from companion.log import recorder as recorder_module
from companion.log.log_directory import files_of, used_bytes
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.pipeline.state import PipelineState
from core.types import DepthFrame
from drivers.logs.reader import McapRecording
from tests.waiting import until

from ..small_recordings import INFO, MS

pytestmark = pytest.mark.process

LEAST_FREE = 2_000_000
PARAMS = RecordParams(file_mb=100.0, budget_mb=1000.0, least_free_mb=LEAST_FREE / 1e6, queue_mb=4.0)


class Disk:
    """A disk that holds nothing but the logs. least: the least free space after any write."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
        self.folder, self.size, self.least = folder, size, size
        monkeypatch.setattr(current_file, "free_bytes", lambda folder: self.free)
        for name in ("event", "sync", "finish", "begin"):
            monkeypatch.setattr(LogWriter, name, self._watched(getattr(LogWriter, name)))

    @property
    def free(self) -> int:
        return self.size - used_bytes(self.folder)

    def _watched(self, method: Callable[..., Any]) -> Callable[..., Any]:
        def write(log: LogWriter, *args: Any, **more: Any) -> Any:
            try:
                return method(log, *args, **more)
            finally:
                self.least = min(self.least, self.free)

        return write


def noise(k: int) -> DepthFrame:
    """An image of 0.6 MB that cannot be compressed."""
    depth_mm = np.random.default_rng(k).integers(0, 65535, (480, 640), np.uint16)
    return DepthFrame(
        camera="front", sequence=k, t_exposure_ns=(k + 1) * 33 * MS, t_arrival_ns=(k + 2) * 33 * MS, depth_mm=depth_mm
    )


def record(recorder: Recorder, k: int) -> None:
    """Records a frame, as the pipeline does."""
    frame = noise(k)
    if recorder.wants_begin:
        recorder.begin(frame.t_arrival_ns, (INFO,), PipelineState())
    recorder.event(frame)
    assert until(lambda: recorder.status.queued == 0, 60.0)


def test_the_recording_stops_before_the_disk_has_less_free_space_than_configured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that was begun was written on until the disk was full."""
    monkeypatch.setattr(recorder_module, "RETRY_NS", 0)
    disk = Disk(tmp_path, monkeypatch, 40_000_000)
    recorder = Recorder(tmp_path, run_info("live"), PARAMS)
    recorder.open()
    for k in range(70):
        record(recorder, k)
    assert disk.least >= LEAST_FREE
    assert f"{tmp_path}: less than" in recorder.status.fault
    assert "free disk space" in recorder.status.fault
    assert not recorder.status.recording
    (log,) = files_of(tmp_path)
    assert not log.active
    with McapRecording(log.path) as recording:
        frames = [item.sequence for item in recording.messages("depth")]
    assert frames == list(range(len(frames)))
    assert len(frames) > 20
    disk.size = 80_000_000  # the user has freed space
    record(recorder, 70)
    assert until(lambda: recorder.status.recording and not recorder.status.fault, 60.0)
    recorder.close()
    assert len(files_of(tmp_path)) == 2
