"""Supervision of real camera processes: what they do wrong is noticed, named and mended."""

from __future__ import annotations

import dataclasses
import errno
import itertools
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.cameras import supervisor as camera_supervisor
from companion.cameras import worker
from companion.cameras.factory import make_source
from companion.cameras.frozen_frames import FrozenFrameDetector
from companion.cameras.status import CameraCondition, CameraStatus
from companion.cameras.supervisor import CameraSupervisor
from companion.cameras.worker import info_from_json
from companion.config.camera import CameraConfig
from companion.config.service import SupervisorParams
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL
from core.params import Params
from core.types import (
    FAR_MM,
    GREATEST_MARK_MM,
    SATURATED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    CameraInfo,
    CameraMount,
    DepthFrame,
    Intrinsics,
)
from drivers.base import DepthSource, DeviceLost
from drivers.cameras.frame_channel import FrameReader

pytestmark = pytest.mark.process

QUICK = SupervisorParams(silent_s=0.3, restart_s=1.0, first_backoff_s=0.0, longest_backoff_s=0.2)
PATIENT = SupervisorParams(silent_s=10.0, restart_s=30.0, first_backoff_s=0.0, longest_backoff_s=0.2)
"""Where silence is not the subject: a slow machine may hold up a camera process for seconds."""

CAMERA = textwrap.dedent("""
    import json, os, sys, time
    from dataclasses import asdict
    import numpy as np
    from core.types import CameraInfo, DepthFrame, Intrinsics
    from drivers.base import DeviceLost
    from drivers.cameras.frame_channel import FrameWriter

    writer = FrameWriter(int(sys.argv[2]), "front")
    habit, times = sys.argv[1].split(":")
    rng = np.random.default_rng(0)
    info = CameraInfo("front", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))
    notice = "the rows differ" if habit == "misaligned" and not os.path.exists("was_open") else ""
    exchanged = habit == "exchanged" and os.path.exists("is_exchanged")
    identity = "serial 2" if exchanged else "serial 1" if habit == "exchanged" else ""
    writer.send("opened", info=asdict(info), notice=notice, identity=identity)
    depth = np.full((48, 64), 3000, np.uint16)
    for k in range(1 << 30):
        after = k >= int(times)
        if habit == "twice" and k % 2 or habit == "frozen" and after or habit == "stands":
            pass  # the image before
        else:
            depth = rng.integers(2000, 3000, (48, 64)).astype(np.uint16)
        if after and habit == "ends":
            writer.send("failed", cause="the cable is out")
            sys.exit(1)
        if after and habit == "fails":
            writer.send("failed", cause="the cable is out")
            time.sleep(1000)
        if after and habit == "exits":
            os._exit(7)
        if after and habit == "hangs":
            time.sleep(1000)
        now = time.monotonic_ns()
        if after and habit == "silent":
            writer.send("alive")
        else:
            try:
                stamp = 5 if after and habit == "stuck" else now
                writer.write(DepthFrame(camera="front", sequence=k, t_exposure_ns=stamp, t_arrival_ns=now, depth_mm=depth))
            except DeviceLost:
                sys.exit(1)
        time.sleep(0.01)
""")


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
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))


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


@pytest.mark.parametrize(
    ("habit", "text"), [("silent:5", "no frame for"), ("hangs:5", "no notification of its process for")]
)
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


def frame_of(depth_mm: NDArray[np.uint16], k: int) -> DepthFrame:
    return DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=depth_mm)


def test_a_static_scene_with_noise_is_not_frozen_and_one_without_is() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    judge = FrozenFrameDetector(4)
    for k in range(20):
        depth = rng.integers(2990, 3010, (48, 64)).astype(np.uint16)
        assert judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=depth)) == ""
    same = np.full((48, 64), 3000, np.uint16)
    texts = [
        judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=k, t_arrival_ns=k, depth_mm=same))
        for k in range(20, 26)
    ]
    assert texts == ["", "", "", "", "the same image 5 times in a row", "the same image 6 times in a row"]


@pytest.mark.parametrize("mark", [UNKNOWN_MM, TEXTURELESS_MM, GREATEST_MARK_MM, SATURATED_MM])
def test_images_without_any_measurement_are_not_frozen(mark: int) -> None:
    """A covered lens, darkness or a cloudless sky gives the same image again and again, and a restart would only make the
    camera blind for longer. Such a frame is invalid."""
    detector, blank = FrozenFrameDetector(4), np.full((48, 64), mark, np.uint16)
    assert [detector.check(frame_of(blank, k)) for k in range(20)] == [""] * 20
    blank = blank.copy()
    blank[40] = 3000
    assert detector.check(frame_of(blank, 20)) == ""


@pytest.mark.parametrize(("measured_px", "frozen"), [(61, False), (62, True)])
def test_an_image_that_is_invalid_for_lack_of_measurements_is_not_frozen(measured_px: int, frozen: bool) -> None:
    """A lamp in the dark: its depth may repeat, since nothing else is measured and its steps are coarse. Frames of which 2 %
    or less are measured are invalid, so that an old one cannot be taken for the present; a restart every few seconds would
    make the camera blind when light returns."""
    detector, image = FrozenFrameDetector(4, Params().min_measured_share), np.zeros((48, 64), np.uint16)
    image.ravel()[1000 : 1000 + measured_px] = 3000
    image.ravel()[1000] = FAR_MM
    assert any(detector.check(frame_of(image, k)) for k in range(20)) is frozen


def test_what_counts_as_too_few_measurements_is_invalid_for_the_extractor() -> None:
    info = CameraInfo("a", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))
    image = np.zeros((48, 64), np.uint16)
    image.ravel()[1000:1061] = 3000
    image.ravel()[1000] = FAR_MM
    model, _ = Extractor(Params()).extract(image, info, R_CAMFRD_OPTICAL)
    assert not model.valid


@pytest.mark.parametrize("depth_mm", [3000, FAR_MM])
def test_one_repeated_pixel_that_counts_as_measured_is_enough(depth_mm: int) -> None:
    """FAR_MM is free space: an old image of it must not pass."""
    detector, image = FrozenFrameDetector(4), np.zeros((48, 64), np.uint16)
    image[41, 5] = depth_mm
    assert [bool(detector.check(frame_of(image, k))) for k in range(6)] == [False] * 4 + [True] * 2


def test_any_pixel_that_changes_shows_a_live_image() -> None:
    detector = FrozenFrameDetector(4)
    for k in range(20):
        image = np.full((48, 64), 3000, np.uint16)
        image[41, 5] += k
        assert detector.check(frame_of(image, k)) == ""
        assert not detector.repeats


@pytest.mark.parametrize("ring", [1, 2, 4, 32])
def test_a_camera_that_delivers_its_buffers_again_is_frozen(ring: int) -> None:
    """A driver that loses count delivers a ring of old images under new stamps: each differs from the one before."""
    rng = np.random.Generator(np.random.PCG64(0))
    images = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(40)]
    detector = FrozenFrameDetector(4)
    for k, image in enumerate(images):
        assert detector.check(frame_of(image, k)) == ""
        assert not detector.repeats
    texts = []
    for k in range(12):
        texts.append(detector.check(frame_of(images[40 - ring + k % ring], 40 + k)))
        assert detector.repeats  # none of them is used
    assert texts[:3] == [""] * 3
    assert all(texts[4:])
    fresh = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(2)]
    assert [bool(detector.check(frame_of(image, 60 + k))) for k, image in enumerate(fresh)] == [True, False]
    assert not detector.repeats


def test_one_new_image_of_a_frozen_camera_is_no_sign_of_life() -> None:
    """A camera that hangs keeps its image over a restart. The host aligns the rows of both images anew, with this image alone, so that
    its depth differs from the one before: each restart passed one old image on as the present."""
    rng = np.random.Generator(np.random.PCG64(0))
    detector = FrozenFrameDetector(4)
    openings = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(4)]
    causes = [detector.check(frame_of(openings[k // 10], k)) for k in range(40)]
    used = [k for k, cause in enumerate(causes) if not cause]
    assert used == [0, 1, 2, 3]
    assert causes[10] == "fewer than 2 new images after repeated ones"
    live = [rng.integers(2990, 3010, (48, 64)).astype(np.uint16) for _ in range(3)]
    twice = [live[k // 2] for k in range(6)]  # a camera may deliver each image twice
    assert [bool(detector.check(frame_of(image, 40 + k))) for k, image in enumerate(twice)] == [True] * 2 + [False] * 4


def test_stamps_that_do_not_advance_four_times_are_frozen() -> None:
    rng = np.random.Generator(np.random.PCG64(0))
    detector, texts = FrozenFrameDetector(4), []
    for t_ns in (7, 7, 7, 7, 8, 8, 8, 7, 7, 9, 10):
        depth = rng.integers(2990, 3010, (48, 64)).astype(np.uint16)
        frame = DepthFrame(camera="a", sequence=0, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=depth)
        texts.append(detector.check(frame))
    assert texts == [""] * 8 + [
        "its stamps have not moved for 4 frames",
        "fewer than 2 new images after repeated ones",
        "",
    ]


@pytest.mark.parametrize(("hz", "repetitions"), [(60, 4), (15, 4), (10, 3), (5, 2), (2, 2)])
def test_a_slow_camera_is_frozen_after_fewer_repetitions(hz: int, repetitions: int) -> None:
    """At 5 Hz an image of 0.8 s ago was still used."""
    judge, same = FrozenFrameDetector(4), np.full((48, 64), 3000, np.uint16)
    texts = []
    for k in range(6):
        t_ns = k * 10**9 // hz
        texts.append(
            judge.check(DepthFrame(camera="a", sequence=k, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=same))
        )
    assert [bool(text) for text in texts] == [k >= repetitions for k in range(6)]


def test_a_description_survives_the_way_between_processes() -> None:
    info = CameraInfo(
        "a", Intrinsics(64, 48, 60.0, 61.0, 32.0, 24.0), CameraMount(0.1, 0.2, 0.3, 1, 2, 3), 0.2, 9.0, 0.004
    )
    assert info_from_json(asdict(info)) == info


def test_a_simulated_camera_takes_rendered_stereo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    section = CameraConfig(
        name="front", kind="simulated", render="stereo", width_px=96, disparities=32, fps=1.0, flight="street"
    )
    assert section.unmatched_px == 32
    assert CameraConfig(name="front", kind="simulated", width_px=96).unmatched_px == 0
    with make_source(section) as source:
        frame = source.read(2.0)
        assert frame is not None
        assert frame.depth_mm.shape == (72, 96)
        assert not (frame.depth_mm[:, :20] > 0).any()
        assert (frame.depth_mm[:, 32:] > 0).mean() > 0.1
        assert source.info.ke_per_m == pytest.approx(0.3 / (67.5 * 0.12))


def test_the_sky_of_a_simulated_camera_is_unmeasured_unless_it_is_configured_as_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both cameras keep their frames in one folder: the setting is part of the frames' name."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    far_px = []
    for sky_is_far in (False, True):
        section = CameraConfig(
            name="front", kind="simulated", width_px=96, fps=1.0, flight="trees", sky_is_far=sky_is_far
        )
        with make_source(section) as source:
            frame = source.read(2.0)
            assert frame is not None
            far_px.append(int((frame.depth_mm == FAR_MM).sum()))
    assert far_px[0] == 0
    assert far_px[1] > 500


@pytest.mark.parametrize("given", [{"kind": "simulated", "render": "stereo"}, {"kind": "oak"}])
def test_a_far_sky_is_refused_where_it_has_no_effect(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="sky_is_far = true is for kind"):
        CameraConfig(name="front", sky_is_far=True, **given)


def test_a_camera_that_follows_an_autopilot_renders_no_stereo() -> None:
    """It would deliver depth of the noise model under the description of a stereo camera."""
    with pytest.raises(ValueError, match='render = "stereo" is not available with follow'):
        CameraConfig(name="front", kind="simulated", follow="udpin:127.0.0.1:14551", render="stereo")


def test_a_recording_is_no_live_camera() -> None:
    with pytest.raises(ValueError, match="is not a live camera"):
        make_source(CameraConfig(name="a", kind="mcap"))


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"supervision: silent_s = 0.0: expected 0.05..10.0 s"):
        SupervisorParams(silent_s=0.0)
