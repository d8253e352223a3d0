"""Supervises one camera process: starts it, detects its faults and restarts it.

Detected: the process ended; it sends no notifications; no frame arrives; images repeat although their stamps advance;
the stamps do not advance. The service and the other cameras are not affected."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any

from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import BadData, DeviceLost
from drivers.cameras.frame_channel import FrameReader, Notification
from drivers.cameras.oak_view import SAME_INTRINSICS_PX
from drivers.watched_thread import WatchedThread

from ..config.camera import CameraConfig
from ..config.service import SupervisorParams
from .frozen_frames import FrozenFrameDetector
from .process_output import forward
from .status import CameraCondition, CameraStatus
from .worker import info_from_json

NS = 1_000_000_000
_READ_S = 0.1
"""Longest wait for a notification. The end of the process is detected at once."""
_POLL_S = 0.05
_EXIT_S = 0.5
"""Time for the exit status of a process that has closed its channel."""
_CLOSE_NS = 2 * NS
"""Time in which a process that reported a failure has to close its camera. The library of a lost device may wait for it for ever."""
_STOP_S = 2.0
"""Time for the exit status at a stop of the service, of a process that was killed."""
_STALLED_NS = NS // 2
"""After a longer time between two reads this process did not run, and the camera process probably did not either: it was
paused, or the computer had no memory or processor time. The camera gets the full time before a restart again."""
_NO_RESOURCES = "its process cannot be started or read"
NO_FRAME_REMEDY = "check cable and power, and that it is on USB 3"
_STABLE_RUN_S = 3.0
"""A camera that delivered frames for this long after its start is restarted without delay; otherwise the delay grows.
"""


class CameraSupervisor:
    """Supervises one camera. on_info: called with its description at each opening; on_frame: with each newest frame.
    Both are called from the supervisor's thread and must not block."""

    def __init__(
        self,
        section: CameraConfig,
        on_info: Callable[[CameraInfo], None],
        on_frame: Callable[[DepthFrame], None],
        params: SupervisorParams | None = None,
        command: tuple[str, ...] = (sys.executable, "-m", "companion.cameras.worker"),
        least_share: float = 0.0,
    ) -> None:
        """least_share: images of which no greater share is measured are not frozen, see FrozenFrameDetector."""
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
        self._frozen_detector = FrozenFrameDetector(self._params.frozen_frames, least_share)
        self._stalled_ns = 0
        self._last_cause = ""  # of the end of the process, as it reported it
        self._opened_first: tuple[str, Intrinsics] | None = None  # identity and intrinsics at the first opening

    @property
    def status(self) -> CameraStatus:
        """The present state."""
        return self._status

    @property
    def pid(self) -> int | None:
        """Process id of the camera process."""
        return self._process.pid if self._process is not None else None

    @property
    def failure(self) -> str:
        """The exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    def open(self) -> None:
        """Starts the thread. It retries until the camera can be opened."""
        self._thread.start()

    def stop(self) -> None:
        """Begins to stop the process and the thread, without waiting."""
        self._stop.set()

    def close(self) -> None:
        """Stops the process and the thread. May be called twice."""
        self.stop()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def _run(self) -> None:
        backoff_s = self._params.first_backoff_s
        while not self._stop.is_set():
            begun_ns = _now()
            cause = self._run_process()
            if self._stop.is_set():
                break
            self._set_condition(CameraCondition.LOST, cause)
            self._update(last_loss=cause, last_loss_ns=_now())
            if (self._status.last_arrival_ns or begun_ns) - begun_ns > _STABLE_RUN_S * NS:
                backoff_s = self._params.first_backoff_s  # a short delay limits the time without this camera in flight
            self._wait(backoff_s)
            backoff_s = min(max(2.0 * backoff_s, 0.1), self._params.longest_backoff_s)
        self._set_condition(CameraCondition.STOPPED, "the service is stopping")

    def _run_process(self) -> str:
        """Runs the process once; returns why it ended."""
        try:
            with closing(FrameReader(self.section.name)) as reader:
                return self._run_with(reader)
        except OSError as error:  # no memory, process or descriptor is left: that may pass
            return f"{_NO_RESOURCES} ({error})"

    def _run_with(self, reader: FrameReader) -> str:
        config = json.dumps({k: v for k, v in dataclasses.asdict(self.section).items() if v is not None})
        self._set_condition(CameraCondition.STARTING, self._with_last_loss("opening the camera"))
        self._update(starts=self._status.starts + 1)
        # a process group of its own: Ctrl-C in a terminal reaches the service alone, which ends this process
        self._process = subprocess.Popen(
            [*self._command, str(reader.child_fd), config],
            pass_fds=[reader.child_fd],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            process_group=0,
        )
        reader.close_child()
        try:
            self._forward_output(self._process)
            cause = self._watch(reader)
        except DeviceLost as error:
            cause = self._last_cause or f"{error}{_exit_text(self._process)}"
        except BadData as error:
            cause = self._last_cause or str(error)
        except OSError as error:  # as below, but its process runs and has to be collected
            cause = f"{_NO_RESOURCES} ({error})"
        finally:
            self._process.kill()
        self._await_end(self._process, cause)
        return cause

    def _forward_output(self, process: subprocess.Popen[bytes]) -> None:
        """Logs what the process prints, in a thread of its own, which ends with the process. Raises OSError without a thread."""
        assert process.stdout is not None
        name = self.section.name
        try:
            WatchedThread(forward, f"output of camera {name}", (name, process.stdout)).start()
        except RuntimeError as error:
            process.stdout.close()
            raise OSError(str(error)) from error

    def _await_end(self, process: subprocess.Popen[bytes], cause: str) -> None:
        """Waits for the end of a killed process, at a stop for at most _STOP_S.

        A process that waits in the kernel for a device does not end before that responds, which may never be. The other
        cameras must not be affected: the thread is alive meanwhile."""
        killed_ns = _now()
        while True:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_POLL_S)
                return
            waited_s = (_now() - killed_ns) / NS
            if self._stop.is_set() and waited_s > _STOP_S:
                return
            self._update(alive_ns=_now())
            if waited_s > _EXIT_S and self._status.condition is not CameraCondition.LOST:
                text = f"{cause}; its process is still held by the kernel: unplug the camera, or restart the computer"
                self._set_condition(CameraCondition.LOST, text, last_loss=text, last_loss_ns=_now())

    def _watch(self, reader: FrameReader) -> str:
        """Passes frames on; returns why the process has to be restarted."""
        self._last_cause = ""
        begun_ns = received_ns = now_ns = _now()
        opened_ns: int | None = None
        dropped = self._status.dropped
        while not self._stop.is_set():
            read_ns = now_ns
            frame, notifications = reader.read(_READ_S)
            now_ns = _now()
            if now_ns - read_ns > _STALLED_NS:
                self._stalled_ns = now_ns
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
        return "the service is stopping"

    def _handle_notification(self, notification: Notification) -> None:
        if notification.kind == "failed":
            self._last_cause = str(notification.payload.get("cause", "no cause was reported"))
            self._set_condition(CameraCondition.LOST, self._last_cause)
        elif notification.kind == "opened":
            try:
                info = info_from_json(notification.payload["info"])
            except (KeyError, TypeError, ValueError) as error:
                raise BadData(
                    f"camera {self.section.name}: its process sent an invalid description: {error}"
                ) from error
            notice = str(notification.payload.get("notice", ""))
            self._check_same(str(notification.payload.get("identity", "")), info.intrinsics)
            self._update(info=info, notice=notice, cause=self._with_last_loss("no frame yet"))
            self._on_info(info)

    def _check_same(self, identity: str, intrinsics: Intrinsics) -> None:
        """Raises BadData for another camera than the one that was opened first, whose intrinsics and mount are not known, and for other
        intrinsics: either these or the first ones are wrong."""
        if self._opened_first is None:
            self._opened_first = identity, intrinsics
        first_identity, first = self._opened_first
        if identity != first_identity:
            found = identity or "it states no product and no serial number"
            known = first_identity or "one that states no product and no serial number"
            raise BadData(
                f"camera {self.section.name}: another camera ({found}) is connected than at the start ({known}); "
                "connect that one, or set intrinsics and mount to those of the other and restart the service"
            )
        pairs = zip(dataclasses.astuple(intrinsics), dataclasses.astuple(first), strict=True)
        if any(abs(found - known) > SAME_INTRINSICS_PX for found, known in pairs):
            raise BadData(
                f"camera {self.section.name}: its intrinsics ({intrinsics}) differ from those at the start ({first}), so that one of both is "
                "wrong; restart the camera and the service"
            )

    def _handle_frame(self, frame: DepthFrame, now_ns: int, dropped: int) -> None:
        frozen = self._frozen_detector.check(frame)
        now = CameraCondition.FROZEN if frozen else CameraCondition.RUNNING
        if self._last_cause:  # a report of failure was read together with the frame, and was sent after it
            now = CameraCondition.LOST
        if not frozen and not self._frozen_detector.repeats:  # a repeated image does not describe the present
            self._on_frame(frame)  # before the status is updated, so that the pipeline's thread wakes up at once
        frames = self._status.frames + 1
        cause = self._last_cause or frozen
        self._set_condition(now, cause, frames=frames, dropped=dropped, last_arrival_ns=now_ns, alive_ns=now_ns)

    def _restart_reason(self, now_ns: int, begun_ns: int, opened_ns: int | None, received_ns: int) -> str:
        """Sets the condition SILENT where due; returns why the process has to be restarted, "" if it has not."""
        p, status = self._params, self._status
        if self._last_cause:
            return self._last_cause if now_ns - received_ns > _CLOSE_NS else ""
        if opened_ns is None:
            late_s = (now_ns - max(begun_ns, self._stalled_ns)) / NS
            return f"the camera did not open within {p.open_s:g} s; {NO_FRAME_REMEDY}" if late_s > p.open_s else ""
        last_ns = max(opened_ns, status.last_arrival_ns or 0)
        silent_s = (now_ns - last_ns) / NS
        if silent_s > p.silent_s:
            process_silent = now_ns - received_ns > p.silent_s * NS
            what = "camera process silent" if process_silent else "no frame"
            self._set_condition(CameraCondition.SILENT, f"{what} for {silent_s:.1f} s")
        # the first frame may be late: pipelines start, models load, kernels compile
        delivered = status.last_arrival_ns is not None and status.last_arrival_ns >= opened_ns
        counted_s = min(silent_s, (now_ns - self._stalled_ns) / NS)
        if counted_s > (p.restart_s if delivered else p.open_s):
            return f"silent for {silent_s:.1f} s; {NO_FRAME_REMEDY}"
        if status.condition is CameraCondition.FROZEN and now_ns - status.since_ns > p.restart_s * NS:
            return f"{status.cause}; if this stays, unplug the camera and plug it in again"
        return ""

    def _with_last_loss(self, what: str) -> str:
        """The action; after a loss with its cause."""
        lost = self._status.last_loss
        return f"{what} again, after: {lost}" if lost else what

    def _wait(self, seconds: float) -> None:
        until_ns = _now() + round(seconds * NS)
        while _now() < until_ns and not self._stop.wait(_POLL_S):
            self._update(alive_ns=_now())

    def _set_condition(self, condition: CameraCondition, cause: str, **changes: Any) -> None:
        """Updates the condition together with other fields: one new status object, since creating it dominates the cost
        per frame."""
        since_ns = self._status.since_ns if self._status.condition is condition else _now()
        self._update(condition=condition, cause=cause, since_ns=since_ns, **changes)

    def _update(self, **changes: Any) -> None:
        self._status = dataclasses.replace(self._status, **changes)


def _exit_text(process: subprocess.Popen[bytes]) -> str:
    """How a process that has closed its channel ended, to be added to a cause; empty: it still runs."""
    try:
        status = process.wait(_EXIT_S)
    except subprocess.TimeoutExpired:
        return ""
    if status >= 0:
        return f", exit status {status}"
    name = signal.Signals(-status).name if -status in set(signal.Signals) else "unknown"
    return f" by signal {-status} ({name})"


def _now() -> int:
    return time.monotonic_ns()
