"""Depth cameras with plain V4L2 and Z16 pixels (RealSense and others), without the manufacturers' libraries.

The kernel stamps each buffer on the monotonic clock when its first bytes arrive. The device does not report the delay since
the middle of the exposure (`exposure_latency_s`), the depth unit and the intrinsics: they come from the configuration."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.types import FAR_MM, SATURATED_MM, UNKNOWN_MM, CameraInfo, DepthFrame, Intrinsics

from ..base import BadData, DeviceNotFound
from .depth_units import refuse_greater_unit
from .kernel_capture import Capture, CaptureFormat, LinuxpyCapture, RawBuffer
from .kernel_stamps import KernelStamps
from .video_identity import check_serial
from .whole_buffers import WholeBuffers


@dataclass(frozen=True, slots=True, kw_only=True)
class V4l2Settings:
    """device: best under /dev/v4l/by-id or by-path, whose names survive reconnection. serial: that the device must state on USB; empty:
    any. depth_unit_mm: millimetres per unit of Z16."""

    camera: str
    device: str
    intrinsics: Intrinsics
    serial: str = ""
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

    notice = identity = ""

    def __init__(self, settings: V4l2Settings, connect: Callable[[CaptureFormat], Capture] = LinuxpyCapture) -> None:
        self._settings = settings
        self._connect = connect
        self._buffers: WholeBuffers | None = None
        self._stamps = KernelStamps(settings.camera)

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
        """Opens the stream. Raises DeviceNotFound, and BadData also for a camera of another serial number, or whose depths would be
        too great."""
        s = self._settings
        self._stamps = KernelStamps(s.camera)
        self._buffers = WholeBuffers(s.capture, self._connect)
        try:
            found = self._buffers.identity()
            check_serial(s.camera, s.device, s.serial, found)
            refuse_greater_unit(s.camera, found, s.depth_unit_mm)
        except BadData:
            self.close()
            raise
        self.identity = str(found)

    def close(self) -> None:
        """Closes the stream. May be called twice."""
        buffers, self._buffers = self._buffers, None
        if buffers is not None:
            buffers.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, or None after timeout_s. Raises DeviceLost and BadData."""
        if self._buffers is None:
            raise DeviceNotFound(f"camera {self._settings.camera}: not open; call open() first")
        buffer = self._buffers.newest(timeout_s)
        return None if buffer is None else self._frame(buffer)

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
    """(H, W) uint16 millimetres of a whole Z16 buffer; beyond 65.5 m, and where the raw value is 65535, is no measurement."""
    units = buffer.pixels(settings.capture, np.dtype("<u2"))
    if settings.depth_unit_mm == 1.0:
        return np.where(units < FAR_MM, units, np.uint16(UNKNOWN_MM))
    mm = units * np.float64(settings.depth_unit_mm) + 0.5
    # the greatest value is no distance in any unit: in tenths of a millimetre it would be one of 6.55 m
    return np.where((mm < FAR_MM) & (units != SATURATED_MM), mm, float(UNKNOWN_MM)).astype(np.uint16)
