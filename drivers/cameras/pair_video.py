"""Images of both eyes side by side, from a USB video device through the kernel's driver, or from a video file.

OpenCV reads files. It does not read devices: it delivers buffers that arrived in part as whole images, without what the kernel
says about them."""

from __future__ import annotations

import select
from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from .kernel_capture import Capture, CaptureFormat, LinuxpyCapture, RawBuffer

SILENT_S = 5.0
"""A device that delivers nothing for this time is lost."""
_BYTES_PER_PIXEL = 2
_HINT = "; set width_px and height_px to a format of the camera"


class Video(Protocol):
    """The used interface of cv2.VideoCapture."""

    def isOpened(self) -> bool: ...
    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        """(False, None): lost; (True, None): an image that arrived in part; else the image (H, W, 3) uint8, BGR."""
        ...

    def get(self, prop: int) -> float:
        """CAP_PROP_POS_MSEC: stamp of the last image, milliseconds."""
        ...

    def release(self) -> None: ...


class KernelVideo:
    """YUYV images of a device. `connect` opens it; tests pass their own. Raises DeviceNotFound and BadData."""

    def __init__(self, wanted: CaptureFormat, connect: Callable[[CaptureFormat], Capture] = LinuxpyCapture) -> None:
        self._wanted = wanted
        self._capture: Capture | None = connect(wanted)
        self._stamp_ns = 0

    def isOpened(self) -> bool:
        """Whether it was not released."""
        return self._capture is not None

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        """The newest image, see Video."""
        newest: RawBuffer | None = None
        try:
            while (buffer := self._next(SILENT_S if newest is None else 0.0)) is not None:
                newest = buffer
        except (OSError, ValueError):  # unplugged; linuxpy raises the latter for a closed file
            return False, None
        if newest is None:
            return False, None
        self._stamp_ns = newest.stamp_ns
        return True, image_from_buffer(newest, self._wanted)

    def _next(self, wait_s: float) -> RawBuffer | None:
        """The next buffer, None after wait_s. Raises OSError where the device reports an error."""
        if self._capture is None:
            return None
        ready, _, broken = select.select([self._capture], [], [self._capture], wait_s)
        if broken:
            raise OSError("the device reports an error")
        return self._capture.read() if ready else None

    def get(self, prop: int) -> float:
        """See Video."""
        return self._stamp_ns / 1e6 if prop == cv2.CAP_PROP_POS_MSEC else 0.0

    def release(self) -> None:
        """Closes the device. May be called twice."""
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.close()


def image_from_buffer(buffer: RawBuffer, wanted: CaptureFormat) -> NDArray[np.uint8] | None:
    """(H, W, 3) uint8 BGR of a YUYV buffer, None where not all of it arrived."""
    line = buffer.bytes_per_line or _BYTES_PER_PIXEL * wanted.width
    if not wanted.is_whole(buffer) or line < _BYTES_PER_PIXEL * wanted.width:
        return None
    padded = np.zeros((wanted.height, line), np.uint8)
    data = np.frombuffer(buffer.data, np.uint8, min(len(buffer.data), padded.size))
    padded.reshape(-1)[: len(data)] = data
    yuyv = padded[:, : _BYTES_PER_PIXEL * wanted.width].reshape(wanted.height, wanted.width, _BYTES_PER_PIXEL)
    return np.asarray(cv2.cvtColor(yuyv, cv2.COLOR_YUV2BGR_YUYV), np.uint8)


def open_video(wanted: CaptureFormat, is_device: bool) -> Video:
    """Opens the device, or a video file in its place. Raises DeviceNotFound and BadData for a device."""
    return KernelVideo(wanted) if is_device else cv2.VideoCapture(wanted.device, cv2.CAP_FFMPEG)


def pair_format(camera: str, device: str, size: tuple[int, int], fps: float) -> CaptureFormat:
    """What is requested of a device for images of size (width, height) per eye."""
    return CaptureFormat(
        camera=camera, device=device, width=2 * size[0], height=size[1], pixel_format="YUYV", fps=fps, hint=_HINT
    )
