"""A ZED as a plain USB video device: side-by-side images through the kernel's driver, stereo matching on the processor.

It needs the camera's calibration file, but no manufacturer's library. The delivered images are not rectified."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, DepthFrame

from ..base import BadData, DeviceLost, DeviceNotFound
from .kernel_stamps import KernelStamps
from .pair_video import DeviceVideo, FileVideo, PairVideo, pair_format
from .row_alignment import RowAlignment
from .stereo import MatchParams, StereoDepth, nearest_m, pair_crc
from .stereo_errors import bias_coefficient, noise_coefficient
from .torn_images import TornImageCheck
from .zed_calibration import StereoCalibration, load_zed_calibration
from .zed_identity import refuse_other_baseline, refuse_other_calibration

DISPARITY_SIGMA_PX = 0.3
"""Prior of the matching noise; the extractor measures the actual noise."""
FIRST_IMAGE_S = 5.0
"""Longest wait for each image that the opening needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZedSettings:
    """device: best under /dev/v4l/by-id, of several ZED by-path. width, height: per eye. calibration: SN<serial>.conf.
    exposure_latency_s: from the middle of the exposure to the kernel's stamp."""

    camera: str
    device: str
    calibration: Path
    width: int = 672
    height: int = 376
    fps: float = 30.0
    exposure_latency_s: float = 0.0
    min_range_m: float = 0.5
    max_range_m: float = 15.0
    match: MatchParams = field(default_factory=MatchParams)

    @property
    def is_device(self) -> bool:
        """False: a video file."""
        return self.device.startswith("/dev/")


def open_video(settings: ZedSettings) -> PairVideo:
    """Opens the device, or a video file in its place. Raises DeviceNotFound and BadData."""
    if not settings.is_device:
        return FileVideo(settings.camera, settings.device)
    return DeviceVideo(pair_format(settings.camera, settings.device, (settings.width, settings.height), settings.fps))


class _Arrived(NamedTuple):
    """An image of both eyes, its stamp, and when it was read, before anything was computed from it; ns on CLOCK_MONOTONIC."""

    image: NDArray[np.uint8]  # (H, W, 3)
    stamp_ns: int
    arrival_ns: int


class ZedSource:
    """A DepthSource. `connect` opens the video; tests pass a file or a device of their own."""

    def __init__(
        self,
        settings: ZedSettings,
        connect: Callable[[ZedSettings], PairVideo] = open_video,
        calibration: StereoCalibration | None = None,
    ) -> None:
        self._settings, self._connect, self._given = settings, connect, calibration
        self._video: PairVideo | None = None
        self._stereo: StereoDepth | None = None
        self._sequence = 0
        self._first: _Arrived | None = None
        self._stamps = KernelStamps(settings.camera)
        self._torn = TornImageCheck(settings.camera)
        self._rows = self._alignment()

    @property
    def info(self) -> CameraInfo:
        """Known after open(). Raises DeviceNotFound before."""
        stereo, s = self._stereo, self._settings
        if stereo is None:
            raise DeviceNotFound(f"camera {s.camera}: not open; call open() first")
        optics = stereo.intrinsics.fx, stereo.baseline_m
        return CameraInfo(
            s.camera,
            stereo.intrinsics,
            min_range_m=max(s.min_range_m, nearest_m(optics[0] * optics[1], s.match.searched)),
            max_range_m=s.max_range_m,
            ke_per_m=noise_coefficient(DISPARITY_SIGMA_PX, *optics),
            marks_smooth=s.match.mark_smooth,
            bias_per_m=bias_coefficient(stereo.intrinsics, optics[1], self._rows.row_error_px),
        )

    @property
    def notice(self) -> str:
        """See `DepthSource.notice`."""
        return self._rows.notice(self.info.intrinsics)

    @property
    def identity(self) -> str:
        """See `DepthSource.identity`."""
        return "" if self._video is None else str(self._video.identity)

    def open(self) -> None:
        """Opens the device, reads its first images, checks the calibration with them and aligns their rows, or does so with
        later ones if these have too few corners. Raises DeviceNotFound, DeviceLost and BadData; a partially opened device is
        closed."""
        s = self._settings
        calibration = self._given or load_zed_calibration(s.calibration, s.width, s.height)
        self._stereo, self._rows = StereoDepth(calibration, s.match), self._alignment()
        self._stamps, self._torn = KernelStamps(s.camera), TornImageCheck(s.camera)
        self._video = self._connect(s)
        try:
            refuse_other_baseline(s.camera, s.calibration, calibration.baseline_m, self._video.identity)
            measured = True
            while measured and not self._rows.settled:
                self._first = self._awaited_image()
                measured = self._check(self._first.image)
            self._rows.opened(self._stereo.intrinsics)
        except (DeviceNotFound, DeviceLost, BadData):
            self.close()
            raise

    def close(self) -> None:
        """Closes the device. May be called twice."""
        video, self._video = self._video, None
        if video is not None:
            video.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, or None after timeout_s, and for an image that is torn. Raises DeviceLost and BadData."""
        s = self._settings
        taken, self._first = self._first, None
        if taken is None:
            taken = self._image(timeout_s)
            if taken is None:
                return None
            if self._rows.due:
                self._check(taken.image)
        assert self._stereo is not None
        left, right = halves(taken.image)
        depth = self._stereo.depth(left, right)
        self._sequence += 1
        return DepthFrame(
            camera=s.camera,
            sequence=self._sequence,
            t_exposure_ns=taken.stamp_ns - round(s.exposure_latency_s * 1e9),
            t_arrival_ns=taken.arrival_ns,
            depth_mm=depth,
            images_crc=pair_crc(left, right),
        )

    def _alignment(self) -> RowAlignment:
        """One for each opening of the camera."""
        s = self._settings
        return RowAlignment(
            s.camera, f"{s.calibration} belongs to another camera, or this camera was bent", corrects=True
        )

    def _awaited_image(self) -> _Arrived:
        """The next image of the opening. Raises DeviceLost after FIRST_IMAGE_S, and BadData."""
        until_s = time.monotonic() + FIRST_IMAGE_S
        while (left_s := until_s - time.monotonic()) > 0.0:
            if (taken := self._image(left_s)) is not None:
                return taken
        raise DeviceLost(
            f"camera {self._settings.camera}: {self._settings.device} delivers no images; use a USB 3 port and cable, lower fps, and "
            "plug the camera in again"
        )

    def _image(self, timeout_s: float) -> _Arrived | None:
        """The newest image; None after timeout_s, and for a torn one. Raises DeviceLost and BadData."""
        s = self._settings
        if self._video is None:
            raise DeviceNotFound(f"camera {s.camera}: not open; call open() first")
        taken = self._video.read(timeout_s)
        if taken is None:
            return None
        (image, stamp_ns), arrival_ns = taken, time.monotonic_ns()
        if image.shape[:2] != (s.height, 2 * s.width):
            raise BadData(
                f"camera {s.camera}: images of {image.shape[1]}x{image.shape[0]}, expected {2 * s.width}x{s.height} "
                "(both eyes side by side); set width_px and height_px to the camera's format"
            )
        if not s.is_device:  # a file has no buffers that are filled again
            return _Arrived(image, stamp_ns, arrival_ns)
        stamp_ns = self._stamps.accepted_ns(stamp_ns, arrival_ns)
        return None if self._torn.is_torn(image) else _Arrived(image, stamp_ns, arrival_ns)

    def _check(self, image: NDArray[np.uint8]) -> bool:
        """Checks the calibration and aligns the rows; returns whether these could be measured. Raises BadData."""
        s, stereo, rows = self._settings, self._stereo, self._rows
        assert stereo is not None
        assert self._video is not None
        # not only once: the sensors of a ZED, which state its number, may appear after its video device
        refuse_other_calibration(s.camera, s.calibration, self._video.identity)
        measured = rows.take(*stereo.rectified(*halves(image)), stereo.intrinsics)
        if rows.rotation != stereo.rotation:
            stereo.align(rows.rotation)
        return measured


def halves(image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Left and right eye in gray from a side-by-side image."""
    gray = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    middle = gray.shape[1] // 2
    return np.ascontiguousarray(gray[:, :middle]), np.ascontiguousarray(gray[:, middle:])
