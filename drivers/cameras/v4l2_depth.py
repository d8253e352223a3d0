"""Depth cameras that speak plain V4L2 with Z16 pixels (RealSense and others), without their makers' libraries.

The kernel stamps each buffer on the monotonic clock when it is filled; how long before that the middle of the exposure
was (`exposure_latency_s`), what a unit of depth is and the intrinsics are not told by the device: they come from the
configuration."""

from __future__ import annotations

import contextlib
import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.types import SATURATED_MM, CameraInfo, DepthFrame, Intrinsics

from ..base import BadData, DeviceLost, DeviceNotFound

AHEAD_NS = 5_000_000
"""Stamps that the kernel computes of the device's own clock may lie a little ahead of now; they are taken as now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class V4l2Settings:
    """device: best under /dev/v4l/by-id, whose names survive unplugging. depth_unit_mm: millimetres a unit of Z16."""

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


@dataclass(frozen=True, slots=True)
class RawBuffer:
    """One filled buffer; stamp_ns: the kernel's, on CLOCK_MONOTONIC. faulty: the driver says that data are missing."""

    data: bytes
    bytes_per_line: int
    sequence: int
    stamp_ns: int
    faulty: bool = False


class Capture(Protocol):
    """A running stream of one device."""

    def fileno(self) -> int: ...
    def read(self) -> RawBuffer:
        """The next buffer; only after fileno() was readable. Raises OSError."""
        ...

    def close(self) -> None: ...


class V4l2Source:
    """A DepthSource. `connect` opens the stream; tests give one of their own."""

    def __init__(self, settings: V4l2Settings, connect: Callable[[V4l2Settings], Capture] | None = None) -> None:
        self._settings = settings
        self._connect = connect or LinuxpyCapture
        self._capture: Capture | None = None
        self.faulty = 0

    @property
    def info(self) -> CameraInfo:
        """All of it from the settings."""
        s = self._settings
        return CameraInfo(
            s.camera, s.intrinsics, min_range_m=s.min_range_m, max_range_m=s.max_range_m, ke_per_m=s.ke_per_m
        )

    def open(self) -> None:
        """Raises DeviceNotFound and BadData."""
        self._capture = self._connect(self._settings)

    def close(self) -> None:
        """May be called again."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest frame not yet delivered, or None after timeout_s. Raises DeviceLost and BadData."""
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
                    f"camera {self._settings.camera}: {self._settings.device} is gone ({reason}); was it unplugged?"
                ) from error
            if buffer.faulty:
                self.faulty += 1
            else:
                newest = buffer
        return self._frame(newest) if newest is not None else None

    def _frame(self, buffer: RawBuffer) -> DepthFrame:
        arrival_ns = time.monotonic_ns()
        s = self._settings
        if not arrival_ns - 2_000_000_000 < buffer.stamp_ns <= arrival_ns + AHEAD_NS:
            raise BadData(
                f"camera {s.camera}: a buffer stamped {(buffer.stamp_ns - arrival_ns) / 1e9:+.3f} s from now; its driver "
                "does not stamp on the monotonic clock, so its frames cannot be matched with attitudes"
            )
        exposure_ns = min(buffer.stamp_ns, arrival_ns) - round(s.exposure_latency_s * 1e9)
        return DepthFrame(
            camera=s.camera,
            sequence=buffer.sequence,
            t_exposure_ns=exposure_ns,
            t_arrival_ns=arrival_ns,
            depth_mm=depth_from_buffer(buffer, s),
        )


def depth_from_buffer(buffer: RawBuffer, settings: V4l2Settings) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres of a Z16 buffer; what is beyond 65.5 m is no measurement. Raises BadData."""
    width, height = settings.intrinsics.width, settings.intrinsics.height
    line = buffer.bytes_per_line or 2 * width
    if line < 2 * width or len(buffer.data) < line * (height - 1) + 2 * width:
        raise BadData(
            f"camera {settings.camera}: a buffer of {len(buffer.data)} bytes, {line} a line, holds no {width}x{height} "
            "pixels; set width_px and height_px to what the camera delivers"
        )
    padded = np.frombuffer(buffer.data, np.uint8, line * (height - 1) + 2 * width)
    if line == 2 * width:
        units = padded.view("<u2").reshape(height, width)
    else:
        rows = np.zeros((height, line), np.uint8)
        rows.reshape(-1)[: len(padded)] = padded
        units = np.ascontiguousarray(rows[:, : 2 * width]).view("<u2")
    if settings.depth_unit_mm == 1.0:
        return units.astype(np.uint16)
    mm = units * np.float64(settings.depth_unit_mm) + 0.5
    return np.where(mm < SATURATED_MM, mm, 0.0).astype(np.uint16)


class LinuxpyCapture:
    """A stream through linuxpy, with memory-mapped buffers."""

    def __init__(self, settings: V4l2Settings) -> None:
        try:
            from linuxpy.video import device as v4l2
        except ImportError as error:
            raise DeviceNotFound(
                f"camera {settings.camera}: linuxpy is not installed; pip install 'osape-companion[v4l2]'"
            ) from error
        self._flag_error = v4l2.BufferFlag.ERROR
        self._device = v4l2.Device(settings.device, blocking=False)
        try:
            self._device.open()
            self._stream = v4l2.VideoCapture(self._device, size=4)
            self._set_format(settings)
            self._stream.open()
            self._line = self._stream.buffer.format.bytes_per_line
        except (OSError, v4l2.V4L2Error) as error:
            self._device.close()
            raise DeviceNotFound(
                f"camera {settings.camera}: {settings.device} cannot be opened ({getattr(error, 'strerror', None) or error}); "
                "is it plugged in (ls /dev/v4l/by-id), does another program hold it, is the user in the group video?"
            ) from error
        except BadData:
            self._device.close()
            raise

    def _set_format(self, settings: V4l2Settings) -> None:
        """The driver may take something else without a word: what it took is read back."""
        width, height = settings.intrinsics.width, settings.intrinsics.height
        self._stream.set_format(width, height, settings.pixel_format)
        got = self._stream.get_format()
        name = "".join(chr((int(got.pixel_format) >> shift) & 0x7F) for shift in (0, 8, 16, 24))
        if (got.width, got.height, name) != (width, height, settings.pixel_format):
            raise BadData(
                f"camera {settings.camera}: asked for {width}x{height} {settings.pixel_format.strip()}, the device gives "
                f"{got.width}x{got.height} {name.strip()}; `v4l2-ctl -d {settings.device} --list-formats-ext` tells what it can"
            )
        self._stream.set_fps(settings.fps)

    def fileno(self) -> int:
        """For select."""
        return int(self._device.fileno())

    def read(self) -> RawBuffer:
        """The next filled buffer; its pixels are copied, the buffer goes back to the driver."""
        frame = self._stream.buffer.raw_read()
        stamp = frame.buff.timestamp
        return RawBuffer(
            bytes(frame.data), self._line, int(frame.frame_nb), stamp.secs * 1_000_000_000 + stamp.usecs * 1000,
            bool(self._flag_error in frame.flags),
        )  # fmt: skip

    def close(self) -> None:
        """May be called again; an unplugged device cannot be told to stop."""
        with contextlib.suppress(OSError):
            self._stream.close()
        self._device.close()
