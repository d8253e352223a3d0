"""Depth cameras with plain V4L2 and Z16 pixels (RealSense and others), without the manufacturers' libraries.

The kernel stamps each buffer on the monotonic clock when its first bytes arrive. The device does not report the delay since
the middle of the exposure (`exposure_latency_s`), the depth unit and the intrinsics: they come from the configuration."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.types import FAR_MM, SATURATED_MM, UNKNOWN_MM, CameraInfo, DepthFrame, Intrinsics

from ..base import BadData, DeviceLost, DeviceNotFound
from .kernel_capture import Capture, CaptureFormat, LinuxpyCapture, RawBuffer
from .kernel_stamps import KernelStamps

MOST_IN_A_ROW = 10
"""Number of buffers that may be filled in part, one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class V4l2Settings:
    """device: best under /dev/v4l/by-id or by-path, whose names survive reconnection. depth_unit_mm: millimetres per unit of
    Z16."""

    camera: str
    device: str
    intrinsics: Intrinsics
    fps: float = 30.0
    pixel_format: str = "Z16 "
    depth_unit_mm: float = 1.0
    exposure_latency_s: float = 0.0
    min_range_m: float = 0.3
    max_range_m: float = 10.0
    ke_per_m: float = 0.005
    bias_per_m: float = 0.01
    """2 % at 2 m, the maker's greatest error of a RealSense D435."""

    @property
    def capture(self) -> CaptureFormat:
        """What is requested of the device."""
        return CaptureFormat(
            camera=self.camera,
            device=self.device,
            width=self.intrinsics.width,
            height=self.intrinsics.height,
            pixel_format=self.pixel_format,
            fps=self.fps,
            hint=". Of a RealSense a path in /dev/v4l/by-id may be that of its colour images: set the one in /dev/v4l/by-path that has "
            "the depth",
        )


class V4l2Source:
    """A DepthSource. `connect` opens the stream; tests pass their own."""

    notice = ""

    def __init__(self, settings: V4l2Settings, connect: Callable[[CaptureFormat], Capture] = LinuxpyCapture) -> None:
        self._settings = settings
        self._connect = connect
        self._capture: Capture | None = None
        self._stamps = KernelStamps(settings.camera)
        self._partial = 0

    @property
    def info(self) -> CameraInfo:
        """The description, from the settings."""
        s = self._settings
        return CameraInfo(
            s.camera,
            s.intrinsics,
            min_range_m=s.min_range_m,
            max_range_m=s.max_range_m,
            ke_per_m=s.ke_per_m,
            bias_per_m=s.bias_per_m,
        )

    def open(self) -> None:
        """Opens the stream. Raises DeviceNotFound and BadData."""
        self._capture = self._connect(self._settings.capture)

    def close(self) -> None:
        """Closes the stream. May be called twice."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, or None after timeout_s. Raises DeviceLost and BadData."""
        if self._capture is None:
            raise DeviceNotFound(f"camera {self._settings.camera}: not open; call open() first")
        until_s = time.monotonic() + timeout_s
        newest: RawBuffer | None = None
        while True:
            wait_s = 0.0 if newest is not None else max(0.0, until_s - time.monotonic())
            try:
                ready, _, broken = select.select([self._capture], [], [self._capture], wait_s)
                if broken:
                    raise OSError("the device reports an error")
                if not ready:
                    break
                buffer = self._capture.read()
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or error
                raise DeviceLost(
                    f"camera {self._settings.camera}: {self._settings.device} was lost ({reason}); check cable and "
                    "power"
                ) from error
            if self._is_whole(buffer):
                newest = buffer
        return self._frame(newest) if newest is not None else None

    def _is_whole(self, buffer: RawBuffer) -> bool:
        """Whether all of a buffer arrived: not every kernel reports missing data. Raises BadData after many that did not."""
        whole = self._settings.capture.is_whole(buffer)
        self._partial = 0 if whole else self._partial + 1
        if self._partial >= MOST_IN_A_ROW:
            raise BadData(
                f"camera {self._settings.camera}: the last {self._partial} buffers were filled in part only; check the cable, use "
                "a USB 3 port of its own, lower fps, or set width_px and height_px to the camera's format"
            )
        return whole

    def _frame(self, buffer: RawBuffer) -> DepthFrame:
        arrival_ns = time.monotonic_ns()
        s = self._settings
        exposure_ns = self._stamps.accepted_ns(buffer.stamp_ns, arrival_ns) - round(s.exposure_latency_s * 1e9)
        return DepthFrame(
            camera=s.camera,
            sequence=buffer.sequence,
            t_exposure_ns=exposure_ns,
            t_arrival_ns=arrival_ns,
            depth_mm=depth_from_buffer(buffer, s),
        )


def depth_from_buffer(buffer: RawBuffer, settings: V4l2Settings) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres of a Z16 buffer; beyond 65.5 m, and where the raw value is 65535, is no measurement. Raises
    BadData."""
    width, height = settings.intrinsics.width, settings.intrinsics.height
    line = buffer.bytes_per_line or 2 * width
    needed = settings.capture.least_bytes(buffer.bytes_per_line)
    if line < 2 * width or len(buffer.data) < needed:
        raise BadData(
            f"camera {settings.camera}: a buffer of {len(buffer.data)} bytes, {line} per line, is too small for "
            f"{width}x{height} pixels; set width_px and height_px to the camera's format"
        )
    padded = np.frombuffer(buffer.data, np.uint8, needed)
    if line == 2 * width:
        units = padded.view("<u2").reshape(height, width)
    else:
        rows = np.zeros((height, line), np.uint8)
        rows.reshape(-1)[: len(padded)] = padded
        units = np.ascontiguousarray(rows[:, : 2 * width]).view("<u2")
    if settings.depth_unit_mm == 1.0:
        return np.where(units < FAR_MM, units, np.uint16(UNKNOWN_MM))
    mm = units * np.float64(settings.depth_unit_mm) + 0.5
    # the greatest value is no distance in any unit: in tenths of a millimetre it would be one of 6.55 m
    return np.where((mm < FAR_MM) & (units != SATURATED_MM), mm, float(UNKNOWN_MM)).astype(np.uint16)
