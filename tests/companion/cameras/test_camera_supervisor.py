"""Camera processes: started, supervised, ended and started again."""

from __future__ import annotations

import dataclasses
import errno
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from companion.cameras import supervisor as camera_supervisor
from companion.cameras import worker
from companion.cameras.status import CameraCondition, CameraStatus
from companion.cameras.supervisor import CameraSupervisor
from companion.config.camera import CameraConfig
from companion.config.service import SupervisorParams
from core.types import (
    CameraInfo,
    DepthFrame,
    Intrinsics,
)
from drivers.base import DepthSource, DeviceLost
from drivers.cameras.frame_channel import FrameReader, Notification

from ..watched_camera import CAMERA

pytestmark = pytest.mark.process
QUICK = SupervisorParams(silent_s=0.3, restart_s=1.0, first_backoff_s=0.0, longest_backoff_s=0.2)
PATIENT = SupervisorParams(silent_s=10.0, restart_s=30.0, first_backoff_s=0.0, longest_backoff_s=0.2)
"""Where silence is not the subject: a slow machine may hold up a camera process for seconds."""


class Watched:
    """A supervisor with a camera of a given habit, and all that came of it."""

    def __init__(
        self, folder: Path, habit: str, params: SupervisorParams = QUICK, command: tuple[str, ...] | None = None
    ) -> None:
        script = folder / "camera.py"
        script.write_text(CAMERA)
        self.frames: list[DepthFrame] = []
        self.infos: list[CameraInfo] = []
        self.causes: list[str] = []
        command = command or (sys.executable, str(script), habit)
        section = CameraConfig(name="front", kind="simulated")
        self.supervisor = CameraSupervisor(section, self.infos.append, self.frames.append, params, command)

    def __enter__(self) -> Watched:
        self.supervisor.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.supervisor.close()

    def until(self, condition: Callable[[], bool], seconds: float = 60.0) -> bool:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            cause = self.supervisor.status.cause
            if cause and (not self.causes or self.causes[-1] != cause):
                self.causes.append(cause)
            if condition():
                return True
            time.sleep(0.005)
        return False

    def is_(self, condition: CameraCondition) -> bool:
        return self.supervisor.status.condition is condition


@pytest.fixture(autouse=True)
def _import_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))


def test_the_notice_of_a_camera_is_that_of_its_last_opening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Watched(tmp_path, "misaligned:0") as w:
        assert w.until(lambda: bool(w.frames))
        assert w.supervisor.status.notice == "the rows differ"
        (tmp_path / "was_open").touch()
        assert w.supervisor.pid is not None
        os.kill(w.supervisor.pid, signal.SIGKILL)
        assert w.until(lambda: len(w.infos) == 2)
        assert w.until(lambda: w.supervisor.status.notice == "")


def test_another_camera_in_the_place_of_the_first_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plugged into the same port while the service runs: it was used with the intrinsics and the mount of the first."""
    monkeypatch.chdir(tmp_path)
    with Watched(tmp_path, "exchanged:0") as w:
        assert w.until(lambda: bool(w.frames))
        (tmp_path / "is_exchanged").touch()
        assert w.supervisor.pid is not None
        os.kill(w.supervisor.pid, signal.SIGKILL)
        text = "another camera (serial 2) is connected than at the start (serial 1); connect that one"
        assert w.until(lambda: text in w.supervisor.status.last_loss)
        w.frames.clear()
        starts = w.supervisor.status.starts
        assert w.until(lambda: w.supervisor.status.starts > starts + 1)
        assert (len(w.infos), w.frames) == (1, [])
        (tmp_path / "is_exchanged").unlink()
        assert w.until(lambda: bool(w.frames))


def test_a_camera_that_states_nothing_in_the_place_of_one_that_did_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a camera on the board that took the name /dev/video0 of one on USB."""
    monkeypatch.chdir(tmp_path)
    with Watched(tmp_path, "nameless:0") as w:
        assert w.until(lambda: bool(w.frames))
        (tmp_path / "is_nameless").touch()
        assert w.supervisor.pid is not None
        os.kill(w.supervisor.pid, signal.SIGKILL)
        text = "another camera (it states no product and no serial number) is connected than at the start (serial 1)"
        assert w.until(lambda: text in w.supervisor.status.last_loss)
        w.frames.clear()
        assert len(w.infos) == 1
        (tmp_path / "is_nameless").unlink()
        assert w.until(lambda: bool(w.frames))


def test_the_last_frame_of_a_camera_that_failed_does_not_make_it_run() -> None:
    """Both are read at once: it was stated as running while its process closed it, for up to 2 s."""
    frames: list[DepthFrame] = []
    supervisor = CameraSupervisor(CameraConfig(name="front", kind="simulated"), lambda info: None, frames.append)
    info = CameraInfo("front", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))
    depth = np.random.default_rng(0).integers(2000, 3000, (48, 64)).astype(np.uint16)
    now_ns = time.monotonic_ns()
    frame = DepthFrame(camera="front", sequence=0, t_exposure_ns=now_ns, t_arrival_ns=now_ns, depth_mm=depth)
    conditions: list[CameraCondition] = []

    class Reader:
        """What the process of the camera sends: it opens, delivers a frame and fails; then it closes the camera."""

        dropped = 0
        batches: ClassVar = [
            (None, [Notification("opened", {"info": dataclasses.asdict(info)})]),
            (frame, [Notification("failed", {"cause": "the cable is out"})]),
            (None, []),
        ]

        def read(self, timeout_s: float) -> tuple[DepthFrame | None, list[Notification]]:
            conditions.append(supervisor.status.condition)
            if not self.batches:
                raise DeviceLost("its process has ended")
            return self.batches.pop(0)

    with pytest.raises(DeviceLost):
        supervisor._watch(Reader())
    assert conditions[2:] == [CameraCondition.LOST] * 2
    assert supervisor.status.cause == "the cable is out"
    assert [f.sequence for f in frames] == [0]  # it was taken before the failure


def test_a_process_that_cannot_be_started_is_tried_again(tmp_path: Path) -> None:
    """As with no memory or no descriptor left: the thread that would restart the camera must not end."""
    program, script = tmp_path / "camera", tmp_path / "camera.py"
    with Watched(tmp_path, "well:0", command=(str(program),)) as w:
        assert w.until(lambda: "cannot be started or read" in w.supervisor.status.last_loss)
        assert "No such file" in w.supervisor.status.last_loss
        assert w.supervisor.failure == ""
        unfinished = tmp_path / "unfinished"
        unfinished.write_text(f'#!/bin/sh\nexec {sys.executable} {script} well:0 "$@"\n')
        unfinished.chmod(0o755)
        unfinished.rename(program)
        assert w.until(lambda: w.is_(CameraCondition.RUNNING))


def test_a_process_that_cannot_be_ended_does_not_stop_its_supervision(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process waits in the kernel for a USB device that was reset: a signal ends it only after that. It must neither end
    the service, and with it the other cameras, nor the time that a stop may take."""
    kill = subprocess.Popen.kill
    ends: list[subprocess.Popen[bytes]] = []
    monkeypatch.setattr(subprocess.Popen, "kill", lambda process: ends.append(process))
    with Watched(tmp_path, "hangs:3") as w:
        assert w.until(lambda: bool(ends))
        alive_ns = w.supervisor.status.alive_ns
        assert w.until(lambda: "still held by the kernel" in w.supervisor.status.cause), w.supervisor.status
        assert w.until(lambda: w.supervisor.status.alive_ns > alive_ns)
        assert w.is_(CameraCondition.LOST)
        assert w.supervisor.status.starts == 1  # the device is in use by the process
        kill(ends[0])
        monkeypatch.undo()
        assert w.until(lambda: w.is_(CameraCondition.RUNNING)), w.supervisor.status
        monkeypatch.setattr(subprocess.Popen, "kill", lambda process: ends.append(process))
        w.supervisor.close()
        assert w.is_(CameraCondition.STOPPED)
        kill(ends[-1])
        ends[-1].wait()


def test_the_process_of_a_channel_that_fails_is_collected_before_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as when there is no memory for the frames. A process that is not waited for remains a zombie, here until the next
    start, which may be delayed for long."""
    read = FrameReader.read

    def failing(reader: FrameReader, timeout_s: float) -> object:
        if read(reader, timeout_s)[0] is None:
            return None, []
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr(FrameReader, "read", failing)
    late = dataclasses.replace(QUICK, first_backoff_s=10.0, longest_backoff_s=10.0)
    with Watched(tmp_path, "well:0", late) as w:
        assert w.until(lambda: "cannot be started or read" in w.supervisor.status.last_loss)
        assert w.supervisor.status.starts == 1
        pid = w.supervisor.pid
        assert pid is not None
        with pytest.raises(ChildProcessError):
            os.waitpid(pid, os.WNOHANG)


def test_ctrl_c_in_the_terminal_reaches_the_service_alone(tmp_path: Path) -> None:
    """A camera process that was still importing its modules printed a traceback."""
    with Watched(tmp_path, "well:0", PATIENT) as w:
        assert w.until(lambda: w.supervisor.pid is not None)
        assert w.supervisor.pid is not None
        assert os.getpgid(w.supervisor.pid) != os.getpgrp()


def test_the_cause_of_a_failure_may_be_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library may put a whole dump into its message."""

    def failing(section: CameraConfig) -> DepthSource:
        raise DeviceLost("the device answered " + "x" * 100_000)

    monkeypatch.setattr(worker, "make_source", failing)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    reader = FrameReader("front")
    assert worker.main([str(os.dup(reader.child_fd)), json.dumps({"name": "front", "kind": "simulated"})]) == 1
    (failed,) = reader.read(1.0)[1]
    assert failed.kind == "failed"
    assert failed.payload["cause"].startswith("the device answered xxx")
    assert failed.payload["cause"].endswith("(98020 more characters)")


def test_frames_of_a_camera_flow(tmp_path: Path) -> None:
    with Watched(tmp_path, "well:0", PATIENT) as w:
        assert w.until(lambda: len(w.frames) > 20)
        assert w.is_(CameraCondition.RUNNING)
        assert w.infos[0].intrinsics.width == 64
        assert w.supervisor.status.starts == 1


def test_a_killed_process_is_started_again(tmp_path: Path) -> None:
    with Watched(tmp_path, "well:0", PATIENT) as w:
        assert w.until(lambda: len(w.frames) > 5)
        assert w.supervisor.status.last_loss_ns is None
        pid = w.supervisor.pid
        assert pid is not None
        killed_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGKILL)
        assert w.until(lambda: w.supervisor.status.starts == 2 and w.is_(CameraCondition.RUNNING))
        assert w.supervisor.status.last_loss == "camera front: its process has ended by signal 9 (SIGKILL)"
        assert killed_ns <= (w.supervisor.status.last_loss_ns or 0) <= time.monotonic_ns()


def test_the_exit_status_of_a_process_without_a_cause_is_reported(tmp_path: Path) -> None:
    with Watched(tmp_path, "exits:3", PATIENT) as w:
        assert w.until(lambda: bool(w.supervisor.status.last_loss))
        assert w.supervisor.status.last_loss == "camera front: its process has ended, exit status 7"


def test_the_cause_that_a_camera_gives_is_reported(tmp_path: Path) -> None:
    with Watched(tmp_path, "ends:5", PATIENT) as w:
        assert w.until(lambda: w.supervisor.status.last_loss == "the cable is out")
        assert w.until(lambda: w.supervisor.status.starts >= 2)


def starts_of(folder: Path, habit: str, monkeypatch: pytest.MonkeyPatch, starts: int) -> list[float]:
    """The waits before each restart of a camera that behaves so, in order; the test does not wait."""
    waits: list[float] = []
    monkeypatch.setattr(CameraSupervisor, "_wait", lambda self, seconds: waits.append(seconds))
    slow = SupervisorParams(first_backoff_s=0.5, longest_backoff_s=4.0)
    with Watched(folder, habit, slow) as w:
        assert w.until(lambda: w.supervisor.status.starts >= starts)
    return waits[: starts - 1]


def test_one_that_gives_no_frames_is_tried_later_and_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert starts_of(tmp_path, "ends:0", monkeypatch, 6) == [0.5, 1.0, 2.0, 4.0, 4.0]


def test_one_that_ran_well_is_started_again_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_supervisor, "_STABLE_RUN_S", 0.05)
    assert starts_of(tmp_path, "ends:20", monkeypatch, 4) == [0.5, 0.5, 0.5]


def test_a_process_that_does_not_end_after_its_failure_is_ended_with_that_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library of a lost device may wait for it for ever. The process was called silent, after restart_s."""
    monkeypatch.setattr(camera_supervisor, "_CLOSE_NS", 200_000_000)
    with Watched(tmp_path, "fails:5", PATIENT) as w:
        assert w.until(lambda: w.supervisor.status.starts == 2)
        assert w.supervisor.status.last_loss == "the cable is out"
        assert "the cable is out" in w.causes


@pytest.mark.parametrize(("habit", "text"), [("silent:5", "no frame for"), ("hangs:5", "camera process silent for")])
def test_silence_is_named_and_ends_in_a_new_start(tmp_path: Path, habit: str, text: str) -> None:
    with Watched(tmp_path, habit) as w:
        assert w.until(lambda: w.is_(CameraCondition.SILENT))
        assert w.until(lambda: w.supervisor.status.starts >= 2)
        assert any(text in c for c in w.causes)
        assert "silent for" in w.supervisor.status.last_loss


def differing(frames: list[DepthFrame]) -> bool:
    """Whether no image is that of the frame before."""
    return not any(np.array_equal(a.depth_mm, b.depth_mm) for a, b in itertools.pairwise(frames))


def test_a_frozen_image_is_named_and_not_passed_on(tmp_path: Path) -> None:
    with Watched(tmp_path, "frozen:10") as w:
        assert w.until(lambda: w.is_(CameraCondition.FROZEN))
        passed = len(w.frames)
        assert w.until(lambda: w.supervisor.status.starts >= 2)
        assert any("the same image" in c for c in w.causes)
        assert differing(w.frames[:passed])


def test_a_repeated_image_is_not_passed_on_with_a_new_stamp(tmp_path: Path) -> None:
    """In a turn of 60 deg/s the attitude of the next frame at 30 Hz is 2 degrees from that of the image, after four frames 8."""
    with Watched(tmp_path, "twice:0", PATIENT) as w:
        assert w.until(lambda: len(w.frames) > 10)
        assert w.is_(CameraCondition.RUNNING)
        assert differing(w.frames)


def test_an_image_that_is_frozen_after_the_restart_too_is_not_passed_on_again(tmp_path: Path) -> None:
    """A device that hangs keeps its image although its process is new: each restart passed it on for 0.3 s."""
    with Watched(tmp_path, "stands:0") as w:
        assert w.until(lambda: w.supervisor.status.starts >= 3 and w.is_(CameraCondition.FROZEN))
        assert len(w.frames) == 1


def test_stamps_that_stand_still_are_named(tmp_path: Path) -> None:
    with Watched(tmp_path, "stuck:10") as w:
        found: list[CameraStatus] = []
        assert w.until(lambda: (found.append(w.supervisor.status), found[-1].condition is CameraCondition.FROZEN)[1])
        assert "its stamps have not moved" in found[-1].cause


def test_a_camera_that_cannot_be_opened_names_the_cause(tmp_path: Path) -> None:
    section = CameraConfig(name="front", kind="simulated", flight="nowhere")
    w = Watched(tmp_path, "well:0")
    w.supervisor = CameraSupervisor(section, w.infos.append, w.frames.append, QUICK)
    with w:
        assert w.until(lambda: "no flight 'nowhere'" in w.supervisor.status.last_loss)
        assert w.until(lambda: w.supervisor.status.starts >= 2)


def test_the_simulated_camera_in_its_own_process(tmp_path: Path) -> None:
    section = CameraConfig(name="front", kind="simulated", flight="street", width_px=160)
    w = Watched(tmp_path, "well:0")
    w.supervisor = CameraSupervisor(section, w.infos.append, w.frames.append)
    with w:
        assert w.until(lambda: len(w.frames) > 3, 60.0)
        assert w.frames[0].depth_mm.shape == (120, 160)
        assert w.infos[0].camera == "front"


def test_the_process_ends_with_the_service(tmp_path: Path) -> None:
    with Watched(tmp_path, "well:0", PATIENT) as w:
        assert w.until(lambda: len(w.frames) > 2)
        pid = w.supervisor.pid
        assert pid is not None
    assert w.is_(CameraCondition.STOPPED)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
