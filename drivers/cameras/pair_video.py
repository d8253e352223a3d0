"""Images of both eyes side by side, from a USB video device through the kernel's driver, or from a video file.

OpenCV reads files. It does not read devices: it delivers buffers that arrived in part as whole images, without what the kernel
says about them (docs/explanation/stereo-depth.md)."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ..base import DeviceLost, DeviceNotFound
from .kernel_capture import Capture, CaptureFormat, LinuxpyCapture, RawBuffer
from .video_identity import VideoIdentity
from .whole_buffers import WholeBuffers

_HINT = "; set width_px and height_px to a format of the camera"
StampedImage = tuple[NDArray[np.uint8], int]
"""Image (H, W, 3) uint8, BGR, and its stamp, ns on CLOCK_MONOTONIC."""


class PairVideo(Protocol):
    """An opened device or file. identity: of the device, empty for a file."""

    identity: VideoIdentity

    def read(self, timeout_s: float) -> StampedImage | None:
        """The newest image, None after timeout_s. Raises DeviceLost, and BadData where images always arrive in part."""
        ...

    def close(self) -> None:
        """May be called twice."""
        ...


class DeviceVideo:
    """YUYV images of a device with the kernel's stamps. `connect` opens it; tests pass their own. Raises DeviceNotFound and BadData."""

    def __init__(self, wanted: CaptureFormat, connect: Callable[[CaptureFormat], Capture] = LinuxpyCapture) -> None:
        self._wanted = wanted
        self._buffers = WholeBuffers(wanted, connect)
        self.identity = self._buffers.identity()

    def read(self, timeout_s: float) -> StampedImage | None:
        """See PairVideo."""
        buffer = self._buffers.newest(timeout_s)
        return None if buffer is None else (image_from_buffer(buffer, self._wanted), buffer.stamp_ns)

    def close(self) -> None:
        """See PairVideo."""
        self._buffers.close()


class FileVideo:
    """Images of a file, stamped as they are read. Raises DeviceNotFound."""

    identity = VideoIdentity()

    def __init__(self, camera: str, path: str) -> None:
        self._name = f"camera {camera}: {path}"
        self._video = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
        if not self._video.isOpened():
            raise DeviceNotFound(f"{self._name} cannot be opened; set device to a video file or to a device below /dev")

    def read(self, timeout_s: float) -> StampedImage | None:
        """See PairVideo."""
        good, image = self._video.read()
        if not good:
            raise DeviceLost(f"{self._name} has no more images")
        return np.asarray(image, np.uint8), time.monotonic_ns()

    def close(self) -> None:
        """See PairVideo."""
        self._video.release()


def image_from_buffer(buffer: RawBuffer, wanted: CaptureFormat) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 BGR of a whole YUYV buffer."""
    yuyv = buffer.pixels(wanted, np.dtype(np.uint8), 2)
    return np.asarray(cv2.cvtColor(yuyv, cv2.COLOR_YUV2BGR_YUYV), np.uint8)


def pair_format(camera: str, device: str, size: tuple[int, int], fps: float) -> CaptureFormat:
    """What is requested of a device for images of size (width, height) per eye."""
    return CaptureFormat(
        camera=camera, device=device, width=2 * size[0], height=size[1], pixel_format="YUYV", fps=fps, hint=_HINT
    )
