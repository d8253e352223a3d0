"""Keeps one camera's process alive: starts it, watches it, names what is wrong, starts it again.

Noticed: a process that ended, one that says nothing, a camera that is silent, one that repeats its image though its
stamps go on, and one whose stamps stand still. The service and the other cameras go on meanwhile."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fastcrc.crc32 import iso_hdlc

from core.types import CameraInfo, DepthFrame
from drivers.base import BadData, DeviceLost
from drivers.cameras.frame_channel import FrameReader, Notification
from drivers.watched_thread import WatchedThread

from ..config.camera import CameraConfig
from ..config.service import SupervisorParams
from .worker import info_from_json

NS = 1_000_000_000
_READ_S = 0.1
"""Longest wait for a word: between frames of 12 Hz nobody has to wake. The end of the process is noticed at once."""
_POLL_S = 0.05
_STABLE_RUN_S = 3.0
"""A camera that gave frames so long after its start is started again without delay; one that did not, later and later."""
_SAMPLED_ROWS = 16
"""Every so many rows are compared to tell a frozen image: enough, since noise changes any of them."""


class CameraCondition(StrEnum):
    """How a camera is."""

    STARTING = "starting"
    RUNNING = "running"
    SILENT = "silent"
    FROZEN = "frozen"
    LOST = "lost"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStatus:
    """What is known of a camera. cause: why it does not run, in words; since_ns: of this condition; last_loss: why its
    process had to be started anew the last time."""

    camera: str
    condition: CameraCondition
    cause: str
    since_ns: int
    frames: int = 0
    dropped: int = 0
    starts: int = 0
    last_loss: str = ""
    last_arrival_ns: int | None = None
    info: CameraInfo | None = None
    alive_ns: int = 0


class CameraSupervisor:
    """One camera. on_info: its description, whenever it was opened; on_frame: each newest frame; both are called from
    the supervisor's thread and must not block."""

    def __init__(
        self,
        section: CameraConfig,
        on_info: Callable[[CameraInfo], None],
        on_frame: Callable[[DepthFrame], None],
        params: SupervisorParams | None = None,
        command: tuple[str, ...] = (sys.executable, "-m", "companion.cameras.worker"),
    ) -> None:
        self.section = section
        self._on_info, self._on_frame = on_info, on_frame
        self._params = params or SupervisorParams()
        self._command = command
        self._stop = threading.Event()
        self._status = CameraStatus(
            camera=section.name, condition=CameraCondition.STARTING, cause="not started yet", since_ns=_now()
        )
        self._thread = WatchedThread(self._run, f"camera {section.name}")
        self._process: subprocess.Popen[bytes] | None = None
        self._frozen_detector = FrozenFrameDetector(self._params.frozen_frames)

    @property
    def status(self) -> CameraStatus:
        """How the camera is now."""
        return self._status

    @property
    def pid(self) -> int | None:
        """Of the camera's process."""
        return self._process.pid if self._process is not None else None

    @property
    def failure(self) -> str:
        """The exception that ended the thread, in words; empty: none did."""
        return self._thread.failure

    def open(self) -> None:
        """Starts the thread; the camera may come later."""
        self._thread.start()

    def close(self) -> None:
        """Stops the process and the thread. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def _run(self) -> None:
        backoff_s = self._params.first_backoff_s
        while not self._stop.is_set():
            begun_ns = _now()
            self._frozen_detector = FrozenFrameDetector(self._params.frozen_frames)
            cause = self._run_process()
            if self._stop.is_set():
                break
            self._set_condition(CameraCondition.LOST, cause)
            self._update(last_loss=cause)
            if (self._status.last_arrival_ns or begun_ns) - begun_ns > _STABLE_RUN_S * NS:
                backoff_s = self._params.first_backoff_s  # in flight every second without it counts
            self._wait(backoff_s)
            backoff_s = min(max(2.0 * backoff_s, 0.1), self._params.longest_backoff_s)
        self._set_condition(CameraCondition.STOPPED, "the service stops")

    def _run_process(self) -> str:
        """One life of the process; returns why it ended."""
        reader = FrameReader(self.section.name)
        config = json.dumps({k: v for k, v in dataclasses.asdict(self.section).items() if v is not None})
        self._set_condition(CameraCondition.STARTING, self._with_last_loss("opening the camera"))
        self._update(starts=self._status.starts + 1)
        self._process = subprocess.Popen(
            [*self._command, str(reader.child_fd), config], pass_fds=[reader.child_fd], stdin=subprocess.DEVNULL
        )
        reader.close_child()
        try:
            return self._watch(reader)
        except (DeviceLost, BadData) as error:
            return self._last_cause or str(error)
        finally:
            reader.close()
            self._process.kill()
            self._process.wait()

    def _watch(self, reader: FrameReader) -> str:
        """Passes frames on; returns why the process has to be started anew."""
        self._last_cause = ""
        begun_ns = received_ns = _now()
        opened_ns: int | None = None
        dropped = self._status.dropped
        while not self._stop.is_set():
            frame, notifications = reader.read(_READ_S)
            now_ns = _now()
            for notification in notifications:
                received_ns = now_ns
                if notification.kind == "opened":
                    opened_ns = now_ns
                self._handle_notification(notification)
            if frame is not None:
                received_ns = now_ns
                self._handle_frame(frame, now_ns, dropped + reader.dropped)
            else:
                self._update(alive_ns=now_ns)
            reason = self._restart_reason(now_ns, begun_ns, opened_ns, received_ns)
            if reason:
                return reason
        return "the service stops"

    def _handle_notification(self, notification: Notification) -> None:
        if notification.kind == "failed":
            self._last_cause = str(notification.payload.get("cause", "no cause was given"))
        elif notification.kind == "opened":
            try:
                info = info_from_json(notification.payload["info"])
            except (KeyError, TypeError, ValueError) as error:
                raise BadData(f"camera {self.section.name}: its description cannot be used: {error}") from error
            self._update(info=info, cause=self._with_last_loss("no frame yet"))
            self._on_info(info)

    def _handle_frame(self, frame: DepthFrame, now_ns: int, dropped: int) -> None:
        frozen = self._frozen_detector.check(frame)
        now = CameraCondition.FROZEN if frozen else CameraCondition.RUNNING
        if not frozen:  # what does not change says nothing about now
            self._on_frame(frame)  # before the status is made: the pipeline's thread wakes up meanwhile
        frames = self._status.frames + 1
        self._set_condition(now, frozen, frames=frames, dropped=dropped, last_arrival_ns=now_ns, alive_ns=now_ns)

    def _restart_reason(self, now_ns: int, begun_ns: int, opened_ns: int | None, received_ns: int) -> str:
        """Names silence, and returns why the process has to be started anew, if it has."""
        p, status = self._params, self._status
        if opened_ns is None:
            late_s = (now_ns - begun_ns) / NS
            return f"the camera did not open within {p.open_s:g} s" if late_s > p.open_s else ""
        last_ns = max(opened_ns, status.last_arrival_ns or 0)
        silent_s = (now_ns - last_ns) / NS
        if silent_s > p.silent_s:
            process_silent = now_ns - received_ns > p.silent_s * NS
            what = "its process says nothing" if process_silent else "no frame"
            self._set_condition(CameraCondition.SILENT, f"{what} for {silent_s:.1f} s")
        # the first frame may take long: pipelines start, models load, kernels compile
        delivered = status.last_arrival_ns is not None and status.last_arrival_ns >= opened_ns
        if silent_s > (p.restart_s if delivered else p.open_s):
            return f"silent for {silent_s:.1f} s"
        if status.condition is CameraCondition.FROZEN and now_ns - status.since_ns > p.restart_s * NS:
            return status.cause
        return ""

    def _with_last_loss(self, what: str) -> str:
        """What happens now, and why it has to happen again."""
        lost = self._status.last_loss
        return f"{what} again, after: {lost}" if lost else what

    def _wait(self, seconds: float) -> None:
        until_ns = _now() + round(seconds * NS)
        while _now() < until_ns and not self._stop.wait(_POLL_S):
            self._update(alive_ns=_now())

    def _set_condition(self, condition: CameraCondition, cause: str, **changes: Any) -> None:
        """The condition, with whatever else changes: one new status, since making it is most of a frame's work here."""
        since_ns = self._status.since_ns if self._status.condition is condition else _now()
        self._update(condition=condition, cause=cause, since_ns=since_ns, **changes)

    def _update(self, **changes: Any) -> None:
        self._status = dataclasses.replace(self._status, **changes)


class FrozenFrameDetector:
    """Tells a camera that repeats itself: its image though the stamps go on, or its stamps and sequence."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._fingerprint: int | None = None
        self._stamp: tuple[int, int] | None = None
        self._same_images = self._unchanged_stamps = 0

    def check(self, frame: DepthFrame) -> str:
        """Why the camera is frozen, in words; empty when it is not."""
        sampled = iso_hdlc(frame.depth_mm[::_SAMPLED_ROWS].tobytes())
        stamp = (frame.sequence, frame.t_exposure_ns)
        self._same_images = self._same_images + 1 if sampled == self._fingerprint else 0
        self._unchanged_stamps = (
            self._unchanged_stamps + 1 if self._stamp is not None and frame.t_exposure_ns <= self._stamp[1] else 0
        )
        self._fingerprint, self._stamp = sampled, stamp
        if self._same_images >= self._frames:
            return f"the same image {self._same_images + 1} times in a row"
        if self._unchanged_stamps >= self._frames:
            return f"its stamps have not moved for {self._unchanged_stamps} frames"
        return ""


def _now() -> int:
    return time.monotonic_ns()
