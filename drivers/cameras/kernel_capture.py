"""Images of a video device as the kernel's driver fills them: bytes, stamps, and whether all of an image arrived.

The kernel's driver appends what arrives: a lost packet moves up all that follows, and fewer bytes are stated for the buffer, whose
rest keeps an earlier image. It marks such a buffer as faulty, older versions not where the camera uses bulk transfers."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Protocol

from ..base import BadData, DeviceNotFound
from ..optional_library import install_command


@dataclass(frozen=True, slots=True, kw_only=True)
class CaptureFormat:
    """What is requested of a device. width, height: pixels; pixel_format: the four characters of V4L2; hint: what to do where the
    device gives another format."""

    camera: str
    device: str
    width: int
    height: int
    pixel_format: str
    fps: float
    hint: str = ""

    def least_bytes(self, bytes_per_line: int) -> int:
        """Bytes of an image of two bytes per pixel whose last line has no padding. bytes_per_line: 0: no padding."""
        return (bytes_per_line or 2 * self.width) * (self.height - 1) + 2 * self.width

    def is_whole(self, buffer: RawBuffer) -> bool:
        """Whether all of a buffer arrived."""
        return not buffer.faulty and len(buffer.data) >= self.least_bytes(buffer.bytes_per_line)


@dataclass(frozen=True, slots=True)
class RawBuffer:
    """One filled buffer. data: as many bytes as arrived; stamp_ns: the kernel's, on CLOCK_MONOTONIC; faulty: the driver reports
    missing data."""

    data: bytes
    bytes_per_line: int
    sequence: int
    stamp_ns: int
    faulty: bool = False


class Capture(Protocol):
    """A running stream of one device."""

    def fileno(self) -> int: ...
    def read(self) -> RawBuffer:
        """The next buffer; call it after fileno() became readable. Raises OSError."""
        ...

    def close(self) -> None: ...


class LinuxpyCapture:
    """A stream through linuxpy, with memory-mapped buffers."""

    def __init__(self, wanted: CaptureFormat) -> None:
        try:
            from linuxpy.video import device as v4l2
        except ImportError as error:
            raise DeviceNotFound(
                f"camera {wanted.camera}: linuxpy is not installed; run {install_command('linuxpy>=0.20')}"
            ) from error
        self._flag_error = v4l2.BufferFlag.ERROR
        self._device = v4l2.Device(wanted.device, blocking=False)
        try:
            self._device.open()
            self._stream = v4l2.VideoCapture(self._device, size=4)
            self._set_format(wanted)
            self._stream.open()
            self._line = self._stream.buffer.format.bytes_per_line
        except (OSError, v4l2.V4L2Error) as error:
            self._device.close()
            raise DeviceNotFound(
                f"camera {wanted.camera}: {wanted.device} cannot be opened "
                f"({getattr(error, 'strerror', None) or error}); check that it is connected (ls /dev/v4l/by-path), that "
                "no other program uses it and that the user is in the group video"
            ) from error
        except BadData:
            self._device.close()
            raise

    def _set_format(self, wanted: CaptureFormat) -> None:
        """Sets the format and reads it back, since the driver may choose another one."""
        self._stream.set_format(wanted.width, wanted.height, wanted.pixel_format)
        got = self._stream.get_format()
        name = "".join(chr((int(got.pixel_format) >> shift) & 0x7F) for shift in (0, 8, 16, 24))
        if (got.width, got.height, name) != (wanted.width, wanted.height, wanted.pixel_format):
            raise BadData(
                f"camera {wanted.camera}: requested {wanted.width}x{wanted.height} {wanted.pixel_format.strip()}, the device "
                f"gives {got.width}x{got.height} {name.strip()}; `v4l2-ctl -d {wanted.device} --list-formats-ext` "
                f"lists the supported formats{wanted.hint}"
            )
        self._stream.set_fps(wanted.fps)

    def fileno(self) -> int:
        """The file descriptor for select."""
        return int(self._device.fileno())

    def read(self) -> RawBuffer:
        """The next filled buffer; its pixels are copied and the buffer is returned to the driver."""
        frame = self._stream.buffer.raw_read()
        stamp = frame.buff.timestamp
        return RawBuffer(
            bytes(frame.data),
            self._line,
            int(frame.frame_nb),
            stamp.secs * 1_000_000_000 + stamp.usecs * 1000,
            bool(self._flag_error in frame.flags),
        )

    def close(self) -> None:
        """Stops the stream. May be called twice; an unplugged device cannot be stopped."""
        with contextlib.suppress(OSError):
            self._stream.close()
        self._device.close()
