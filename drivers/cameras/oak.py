"""Luxonis OAK cameras through DepthAI v3, with stereo matching on the device or of its rectified images on the host.

The library may hang or abort its process, so a source runs in a process of its own (companion.cameras.worker). The
source uses the middle of the exposure on the host's monotonic clock and the intrinsics of the first frame. Automatic
reconnection is disabled: the supervisor restarts the process."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, DepthFrame

from ..base import BadData, DeviceLost, DeviceNotFound
from .bounded_close import close_within
from .clock_correction import ClockCorrection
from .depth_alignment import DepthAlignment
from .device_matches import confirmed_depth
from .oak_images import distances, half_exposure_ns
from .oak_message import RESTART, OakMessages
from .oak_pipeline import (
    DEPTH,
    LEFT,
    RIGHT,
    OakLink,
    OakSettings,
    connect_device,
    first_line,
)
from .oak_stamps import OakStamps
from .oak_view import SAME_INTRINSICS_PX, check_view
from .row_alignment import RowAlignment
from .stereo import Gray, StereoMatcher, nearest_m, pair_crc
from .stereo_errors import bias_coefficient, noise_coefficient

DISPARITY_SIGMA_PX = 0.25
"""Noise of the subpixel matching on textured surfaces: a prior, the extractor measures the actual noise."""
MOST_APART_S = 0.001
"""Left and right image are exposed together, within this time. At 60 deg/s and a focal length of 450 px an image moves by 0.5 px
in it: 0.4 m at 5 m. Stamps of cameras with one clock differ by 0.02 ms."""
_POLL_S = 0.002
_FRAMES = {
    (DEPTH,): "depth frame",
    (DEPTH, LEFT, RIGHT): "depth frame with both rectified images",
    (LEFT, RIGHT): "pair of rectified images",
}


class OakSource:
    """A DepthSource. `connect` creates the pipeline; tests pass one that runs on the host."""

    def __init__(
        self,
        settings: OakSettings,
        connect: Callable[[OakSettings], OakLink] | None = None,
        correction: ClockCorrection | None = None,
    ) -> None:
        self.settings = settings
        self._correction = correction or ClockCorrection()
        self._rows = self._alignment()
        self._depth_alignment = DepthAlignment(settings.camera)
        self._matcher = StereoMatcher(settings.match) if settings.host_matching else None
        self._connect = connect or connect_device
        self._link: OakLink | None = None
        self._info: CameraInfo | None = None
        self._waiting: DepthFrame | None = None
        self._stamps = OakStamps(settings.camera, self._correction)
        self._messages = OakMessages(settings)

    @property
    def info(self) -> CameraInfo:
        """Known after open(). Raises DeviceNotFound before."""
        if self._info is None:
            raise DeviceNotFound(f"camera {self.settings.camera}: not open; call open() first")
        return self._info

    def open(self) -> None:
        """Boots the device, waits for its first frame, which contains the intrinsics, measures the rows of the first images, and compares
        what they state about their view. Raises DeviceNotFound, DeviceLost and BadData; a partially opened device is closed, which is
        awaited for at most CLOSE_S."""
        self._stamps = OakStamps(self.settings.camera, self._correction)
        self._rows = self._alignment()
        self._depth_alignment = DepthAlignment(self.settings.camera)
        self._link = self._connect(self.settings)
        try:
            message = self._first()
            self._info = self._describe(message)
            if len(self.settings.streams) > 1:
                message = self._align(message)
                self._info = self._describe(message)
            images = {name: self._messages.part(message, name) for name in self.settings.streams}
            check_view(images, self.settings.camera)
            self._waiting = self._frame(message)
        except Exception:
            close_within(self.close)
            raise

    @property
    def notice(self) -> str:
        """See `DepthSource.notice`."""
        return self._rows.notice(self.info.intrinsics)

    @property
    def identity(self) -> str:
        """See `DepthSource.identity`."""
        return "" if self._link is None else self._link.identity

    def close(self) -> None:
        """Closes the device. May be called twice."""
        link, self._link = self._link, None
        if link is not None:
            with contextlib.suppress(RuntimeError):  # of a lost device, whose cause is raised already
                link.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, or None after timeout_s, and where the images were not exposed together. Raises
        DeviceLost and BadData."""
        if self._waiting is not None:
            frame, self._waiting = self._waiting, None
            return frame
        message = self._next(timeout_s)
        self._stamps.check_clock()
        together = message is not None and self._messages.apart_s(message) <= MOST_APART_S
        return self._frame(message) if together else None

    def _first(self) -> Any:
        """The first message whose images were exposed together. Raises DeviceLost, and BadData where none were."""
        settings, apart_s = self.settings, 0.0
        until_s = time.monotonic() + settings.first_frame_s
        while (message := self._next(max(0.0, until_s - time.monotonic()))) is not None:
            apart_s = self._messages.apart_s(message)
            if apart_s <= MOST_APART_S:
                return message
        if apart_s > MOST_APART_S:
            raise BadData(
                f"camera {settings.camera}: left and right image are exposed {1000.0 * apart_s:.1f} ms apart; in a turn every "
                "depth would be wrong. Use a device whose cameras are synchronised, or connect their frame synchronisation"
            )
        raise DeviceLost(
            f"camera {settings.camera}: no {_FRAMES[settings.streams]} within {settings.first_frame_s:g} s; check that the "
            "cable is USB 3 and the power supply sufficient (OAK needs up to 1.5 A)"
        )

    def _alignment(self) -> RowAlignment:
        """One for each opening of the device."""
        remedy = "the stereo calibration of the device is wrong, as after a crash: calibrate it again"
        return RowAlignment(self.settings.camera, remedy, corrects=self.settings.host_matching)

    def _align(self, message: Any) -> Any:
        """Aligns the rows by this message and those that follow, until they are known or show too few corners; returns the last
        one. Raises DeviceLost and BadData."""
        while self._take_rows(*self._messages.pair(message)) and not self._rows.settled:
            message = self._first()
        self._rows.opened(self.info.intrinsics)
        return message

    def _take_rows(self, left: Gray, right: Gray) -> bool:
        k = self.info.intrinsics
        return self._rows.take(left, self._rows.rotation.turned(right, k), k)

    def _next(self, timeout_s: float) -> Any:
        """The newest message of the queue, None after timeout_s."""
        link = self._open_link()
        import depthai as dai

        until_s = time.monotonic() + timeout_s
        while True:
            try:
                messages = link.queue.tryGetAll()
            except (RuntimeError, dai.MessageQueue.QueueException) as error:  # the link is down or the queue closed
                raise DeviceLost(
                    f"camera {self.settings.camera}: the device was lost ({first_line(error)}); check cable and power"
                ) from error
            if messages:
                return messages[-1]
            if not link.running():
                raise DeviceLost(f"camera {self.settings.camera}: the device stopped; check cable and power")
            if time.monotonic() >= until_s:
                return None
            time.sleep(_POLL_S)

    def _frame(self, message: Any) -> DepthFrame:
        arrival_ns = time.monotonic_ns()
        self._check_view(message)
        first = self._messages.part(message, self.settings.streams[0])
        half_ns = 0
        if LEFT in self.settings.streams and not first.getExposureTime():  # the image states it, if the depth does not
            half_ns = half_exposure_ns(self._messages.part(message, LEFT))
        return DepthFrame(
            camera=self.settings.camera,
            sequence=int(first.getSequenceNum()) % (1 << 32),
            t_exposure_ns=self._stamps.exposure_ns(first, half_ns, arrival_ns),
            t_arrival_ns=arrival_ns,
            depth_mm=self._depth(message),
            images_crc=self._images_crc(),
        )

    def _check_view(self, message: Any) -> None:
        """Raises BadData where size or intrinsics are not those of the first frame, which the service uses for all."""
        expected, found = self.info.intrinsics, self._messages.intrinsics(message)
        if (found.width, found.height) != (expected.width, expected.height) or any(
            abs(getattr(found, name) - getattr(expected, name)) > SAME_INTRINSICS_PX
            for name in ("fx", "fy", "cx", "cy")
        ):
            raise BadData(
                f"camera {self.settings.camera}: a frame has other intrinsics ({found}) than the first one ({expected}). "
                f"{RESTART}"
            )

    def _depth(self, message: Any) -> NDArray[np.uint16]:
        """(H, W) uint16 mm: matched on the host, or the device's depth, of which the images confirm each match. Raises
        BadData."""
        settings = self.settings
        if len(settings.streams) == 1:
            return distances(self._messages.pixels(self._messages.part(message, DEPTH)))
        left, right = self._messages.pair(message)
        if self._rows.due:
            self._take_rows(left, right)
        right = self._rows.rotation.turned(right, self.info.intrinsics)
        if self._matcher is not None:
            return self._matcher.depth(left, right, self.info.intrinsics.fx, self._open_link().baseline_m)
        depth = distances(self._messages.pixels(self._messages.part(message, DEPTH)))
        if self._depth_alignment.due:
            self._depth_alignment.take(depth, (left, right), self._f_b_px_m(), settings.match)
        return confirmed_depth(depth, (left, right), self._f_b_px_m(), settings.match)

    def _images_crc(self) -> int:
        """Of the newest pair, see `DepthFrame.images_crc`."""
        pair = self._messages.newest_pair
        return 0 if self._matcher is None or pair is None else pair_crc(*pair)

    def _f_b_px_m(self) -> float:
        """Focal length times baseline."""
        return self.info.intrinsics.fx * self._open_link().baseline_m

    def _open_link(self) -> OakLink:
        """Raises DeviceNotFound before open()."""
        if self._link is None:
            raise DeviceNotFound(f"camera {self.settings.camera}: not open; call open() first")
        return self._link

    def _describe(self, message: Any) -> CameraInfo:
        intrinsics = self._messages.intrinsics(message)
        optics = intrinsics.fx, self._open_link().baseline_m
        return CameraInfo(
            self.settings.camera,
            intrinsics,
            min_range_m=max(self.settings.min_range_m, nearest_m(optics[0] * optics[1], self.settings.searched)),
            max_range_m=self.settings.max_range_m,
            ke_per_m=noise_coefficient(DISPARITY_SIGMA_PX, *optics),
            marks_smooth=self.settings.host_matching and self.settings.match.mark_smooth,
            bias_per_m=bias_coefficient(intrinsics, optics[1], self._rows.row_error_px),
        )
