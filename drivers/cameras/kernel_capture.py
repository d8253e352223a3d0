"""Images of a video device as the kernel's driver fills them: bytes, stamps, and whether all of an image arrived.

The kernel's driver appends what arrives: a lost packet moves up all that follows, and fewer bytes are stated for the buffer, whose
rest keeps an earlier image. It marks such a buffer as faulty, older versions not where the camera uses bulk transfers."""

from __future__ import annotations

import contextlib
import errno
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ..base import BadData, DeviceNotFound
from ..optional_library import optional_module

BUFFERS: Final = 4
_NO_IMAGES = (
    "delivers no images: it is no camera, or the second node of one, for its metadata; set the path in /dev/v4l/by-path that "
    "ends in -video-index0"
)
_REMEDIES: Final = {
    errno.EACCES: "add the user to the group video, and log in again",
    errno.EBUSY: "another program uses it: end that program",
    errno.ENOENT: "check that it is connected, and set device to a path that `ls /dev/v4l/by-path` lists",
    errno.ENOSPC: "no bandwidth is left on its USB bus: connect it to another controller, or lower fps",
}
"""Error of the kernel at the opening -> remedy."""
_REMEDY = "check that it is connected (ls /dev/v4l/by-path), that no other program uses it and that the user is in the group video"


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

    def pixels(self, size: CaptureFormat, dtype: np.dtype[Any], channels: int = 1) -> NDArray[Any]:
        """(H, W), or (H, W, channels), of a whole buffer, without the padding of its lines. dtype and channels: of two bytes per pixel."""
        line, step = self.bytes_per_line or 2 * size.width, dtype.itemsize
        shape, strides = (size.height, size.width, channels), (line, channels * step, step)
        found: NDArray[Any] = np.ndarray(shape, dtype, self.data, 0, strides)
        return np.ascontiguousarray(found if channels > 1 else found[..., 0])


class Capture(Protocol):
    """A running stream of one device."""

    def fileno(self) -> int: ...
    def read(self) -> RawBuffer:
        """The next buffer; call it after fileno() became readable. Raises OSError."""
        ...

    def close(self) -> None: ...


class LinuxpyCapture:
    """A stream through linuxpy, with memory-mapped buffers. Raises DeviceNotFound, and BadData where the device gives another
    format; a partially opened device is closed."""

    def __init__(self, wanted: CaptureFormat) -> None:
        need = f"camera {wanted.camera}: linuxpy is not installed"
        self._v4l2 = optional_module("linuxpy.video.device", need, "linuxpy>=0.21")
        self._device = self._v4l2.Device(wanted.device)
        self._stream = self._v4l2.VideoCapture(self._device, size=BUFFERS)
        try:
            self._device.open()
            self._start(wanted)
        except OSError as error:
            self.close()
            raise DeviceNotFound(f"camera {wanted.camera}: {wanted.device} {_cause(error)}") from error
        except (DeviceNotFound, BadData):
            self.close()
            raise

    def _start(self, wanted: CaptureFormat) -> None:
        if self._v4l2.Capability.VIDEO_CAPTURE not in self._device.info.device_capabilities:
            raise DeviceNotFound(f"camera {wanted.camera}: {wanted.device} {_NO_IMAGES}")
        self._stream.set_format(wanted.width, wanted.height, wanted.pixel_format)
        self._line = self._check_format(wanted)
        self._stream.set_fps(wanted.fps)
        self._stream.open()

    def _check_format(self, wanted: CaptureFormat) -> int:
        """Bytes per line. Raises BadData where the driver chose another format."""
        # linuxpy's get_format raises ValueError for a pixel format that it does not know
        got = self._v4l2.get_raw_format(self._device.fileno(), self._stream.type).fmt.pix
        name = int(got.pixelformat).to_bytes(4, "little").decode("latin-1")
        if (got.width, got.height, name) != (wanted.width, wanted.height, wanted.pixel_format):
            raise BadData(
                f"camera {wanted.camera}: requested {wanted.width}x{wanted.height} {wanted.pixel_format.strip()}, the device "
                f"gives {got.width}x{got.height} {name.strip() if name.isprintable() else 'an unknown format'}; "
                f"`v4l2-ctl -d {wanted.device} --list-formats-ext` lists the supported formats{wanted.hint}"
            )
        if 0 < got.bytesperline < 2 * wanted.width:
            raise BadData(
                f"camera {wanted.camera}: the driver of {wanted.device} states {got.bytesperline} bytes per line of {wanted.width} "
                "pixels; update the kernel, or set width_px to another width of the camera"
            )
        return int(got.bytesperline)

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
            bool(self._v4l2.BufferFlag.ERROR in frame.flags),
        )

    def close(self) -> None:
        """Stops the stream and releases its buffers: each holds the device open. May be called twice."""
        if self._device.closed:
            return
        buffers: Any = self._stream.buffer
        with contextlib.suppress(OSError):  # of an unplugged device
            self._stream.stream_off()
        if buffers is not None:
            with contextlib.suppress(OSError):
                buffers.close()
        self._device.close()


def _cause(error: OSError) -> str:
    """The end of the message for a device that does not open."""
    if error.errno == errno.ENOTTY:
        return _NO_IMAGES
    return f"cannot be opened ({error.strerror or error}); {_REMEDIES.get(error.errno or 0, _REMEDY)}"
