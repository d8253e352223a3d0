"""The stream of a video device without the buffers that arrived in part."""

from __future__ import annotations

import select
import time
from collections.abc import Callable

from ..base import BadData, DeviceLost
from .kernel_capture import Capture, CaptureFormat, LinuxpyCapture, RawBuffer
from .video_identity import VideoIdentity, video_identity

MOST_IN_A_ROW = 10
"""Number of buffers that may arrive in part, one after the other."""


class WholeBuffers:
    """A running stream. `connect` opens it; tests pass their own. Raises DeviceNotFound and BadData."""

    def __init__(self, wanted: CaptureFormat, connect: Callable[[CaptureFormat], Capture] = LinuxpyCapture) -> None:
        self._wanted = wanted
        self._capture = connect(wanted)
        self._partial = 0

    def newest(self, timeout_s: float) -> RawBuffer | None:
        """The newest unread buffer of which all arrived, None after timeout_s. Raises DeviceLost, and BadData after many that arrived in
        part."""
        until_s = time.monotonic() + timeout_s
        newest: RawBuffer | None = None
        while (buffer := self._next(0.0 if newest else max(0.0, until_s - time.monotonic()))) is not None:
            if self._is_whole(buffer):
                newest = buffer
        return newest

    def _next(self, wait_s: float) -> RawBuffer | None:
        """The next buffer, None after wait_s. Raises DeviceLost."""
        try:
            # an unplugged device is readable, and its read fails
            ready, _, _ = select.select([self._capture], [], [], wait_s)
            return self._capture.read() if ready else None
        except (OSError, ValueError) as error:  # linuxpy raises the latter for a closed file
            reason = getattr(error, "strerror", None) or error
            raise DeviceLost(
                f"camera {self._wanted.camera}: {self._wanted.device} was lost ({reason}); check cable and power"
            ) from error

    def _is_whole(self, buffer: RawBuffer) -> bool:
        """Whether all of a buffer arrived: not every kernel reports missing data. Raises BadData after many that did not."""
        whole = self._wanted.is_whole(buffer)
        self._partial = 0 if whole else self._partial + 1
        if self._partial >= MOST_IN_A_ROW:
            raise BadData(
                f"camera {self._wanted.camera}: the last {self._partial} images arrived in part only; check the cable, use a USB 3 "
                "port of its own, lower fps, or set width_px and height_px to the camera's format"
            )
        return whole

    def identity(self) -> VideoIdentity:
        """Which device it is."""
        return video_identity(self._capture.fileno())

    def close(self) -> None:
        """Closes the device. May be called twice."""
        self._capture.close()
