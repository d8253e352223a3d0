"""Luxonis OAK cameras through DepthAI v3, with stereo depth computed on the device.

The library may hang or abort its process, so a source runs in a process of its own (companion.cameras.worker). The
source uses the middle of the exposure on the host's monotonic clock and the intrinsics of each frame. Automatic
reconnection is disabled: the supervisor restarts the process."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, DepthFrame, Intrinsics

from ..base import BadData, DeviceLost, DeviceNotFound
from ..optional_library import install_command

# read by the library at its import: no signal handlers, no telemetry
for _name, _value in (
    ("DEPTHAI_LEVEL", "error"),
    ("DEPTHAI_INSTALL_SIGNAL_HANDLER", "0"),
    ("DEPTHAI_DISABLE_CRASHDUMP_COLLECTION", "1"),
):
    os.environ.setdefault(_name, _value)

DISPARITY_SIGMA_PX = 0.25
"""Noise of the device's subpixel matching on textured surfaces: a prior, the extractor measures the actual noise."""
_POLL_S = 0.002


@dataclass(frozen=True, slots=True, kw_only=True)
class OakSettings:
    """Settings of the device. device: its id, USB port or address; empty: the only device. confidence: 0..255, lower
    keeps fewer and more reliable pixels; 55 is the default of DepthAI 3. emitter: intensity of the dot projector, 0..1. first_frame_s: time limit to
    find, boot and deliver."""

    camera: str
    device: str = ""
    width: int = 640
    height: int = 400
    fps: float = 30.0
    confidence: int = 55
    emitter: float = 0.0
    max_range_m: float = 15.0
    min_range_m: float = 0.4
    find_s: float = 5.0
    first_frame_s: float = 20.0


class OakLink(Protocol):
    """A running pipeline: its depth queue and its end."""

    queue: Any
    baseline_m: float | None

    def running(self) -> bool: ...
    def close(self) -> None: ...


class OakSource:
    """A DepthSource. `connect` creates the pipeline; tests pass one that runs on the host."""

    def __init__(self, settings: OakSettings, connect: Callable[[OakSettings], OakLink] | None = None) -> None:
        self._settings = settings
        self._connect = connect or connect_device
        self._link: OakLink | None = None
        self._info: CameraInfo | None = None
        self._waiting: DepthFrame | None = None

    @property
    def info(self) -> CameraInfo:
        """Known after open(). Raises DeviceNotFound before."""
        if self._info is None:
            raise DeviceNotFound(f"camera {self._settings.camera}: not open; call open() first")
        return self._info

    def open(self) -> None:
        """Boots the device and waits for its first frame, which contains the intrinsics. Raises DeviceNotFound,
        DeviceLost and BadData; a partially opened device is closed."""
        self._link = self._connect(self._settings)
        try:
            message = self._next(self._settings.first_frame_s)
            if message is None:
                raise DeviceLost(
                    f"camera {self._settings.camera}: no depth frame within {self._settings.first_frame_s:g} s; check "
                    "that the cable is USB 3 and the power supply sufficient (OAK needs up to 1.5 A)"
                )
            self._info = self._describe(message)
            self._waiting = self._frame(message)
        except (DeviceLost, BadData):
            self.close()
            raise

    def close(self) -> None:
        """Closes the device. May be called twice."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, or None after timeout_s. Raises DeviceLost and BadData."""
        if self._waiting is not None:
            frame, self._waiting = self._waiting, None
            return frame
        message = self._next(timeout_s)
        return self._frame(message) if message is not None else None

    def _next(self, timeout_s: float) -> Any:
        """The newest message of the queue, None after timeout_s."""
        link = self._link
        if link is None:
            raise DeviceNotFound(f"camera {self._settings.camera}: not open; call open() first")
        import depthai as dai

        until_s = time.monotonic() + timeout_s
        while True:
            try:
                messages = link.queue.tryGetAll()
            except (RuntimeError, dai.MessageQueue.QueueException) as error:  # the link is down or the queue closed
                raise DeviceLost(
                    f"camera {self._settings.camera}: the device was lost ({_first_line(error)}); check cable and power"
                ) from error
            if messages:
                return messages[-1]
            if not link.running():
                raise DeviceLost(f"camera {self._settings.camera}: the device stopped; check cable and power")
            if time.monotonic() >= until_s:
                return None
            time.sleep(_POLL_S)

    def _frame(self, message: Any) -> DepthFrame:
        arrival_ns = time.monotonic_ns()
        depth = self._pixels(message)
        exposure_ns = _middle_ns(message)
        if not 0 < exposure_ns <= arrival_ns:
            raise BadData(
                f"camera {self._settings.camera}: a frame is stamped {(exposure_ns - arrival_ns) / 1e9:+.3f} s from "
                "its arrival; the device's clock is not synchronised with the host's. Restart the device"
            )
        return DepthFrame(
            camera=self._settings.camera,
            sequence=int(message.getSequenceNum()) % (1 << 32),
            t_exposure_ns=exposure_ns,
            t_arrival_ns=arrival_ns,
            depth_mm=depth,
        )

    def _pixels(self, message: Any) -> NDArray[np.uint16]:
        pixels = message.getCvFrame()
        if not isinstance(pixels, np.ndarray) or pixels.dtype != np.uint16 or pixels.ndim != 2:
            raise BadData(
                f"camera {self._settings.camera}: a frame of type {message.getType()}; expected RAW16, millimetres"
            )
        return np.ascontiguousarray(pixels)

    def _describe(self, message: Any) -> CameraInfo:
        height, width = self._pixels(message).shape
        matrix = np.array(message.getTransformation().getIntrinsicMatrix(), np.float64)
        try:
            intrinsics = Intrinsics(
                width, height, float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])
            )
        except ValueError as error:
            raise BadData(
                f"camera {self._settings.camera}: {error}; check that the device has its factory calibration"
            ) from error
        baseline_m = self._link.baseline_m if self._link is not None else None
        ke = DISPARITY_SIGMA_PX / (intrinsics.fx * baseline_m) if baseline_m else 0.005
        return CameraInfo(
            self._settings.camera,
            intrinsics,
            min_range_m=self._settings.min_range_m,
            max_range_m=self._settings.max_range_m,
            ke_per_m=min(max(ke, 1e-4), 0.05),
        )


def _middle_ns(message: Any) -> int:
    """Mid-exposure on the host's monotonic clock."""
    import depthai as dai

    stamp: timedelta = message.getTimestamp(dai.CameraExposureOffset.MIDDLE)
    return (stamp.days * 86_400 + stamp.seconds) * 1_000_000_000 + stamp.microseconds * 1000


class DeviceLink:
    """A pipeline on a device: two rectified cameras, stereo depth, and a queue of the newest two frames."""

    def __init__(self, settings: OakSettings, device: Any) -> None:
        import depthai as dai

        self._device = device
        device.setMaxReconnectionAttempts(0)
        self.baseline_m: float | None = _baseline_m(device)
        self._pipeline = dai.Pipeline(device)
        sides = []
        for socket in (dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C):
            camera = self._pipeline.create(dai.node.Camera).build(socket)
            sides.append(
                camera.requestOutput((settings.width, settings.height), dai.ImgFrame.Type.GRAY8, fps=settings.fps)
            )
        stereo = self._pipeline.create(dai.node.StereoDepth)
        sides[0].link(stereo.left)
        sides[1].link(stereo.right)
        stereo.setRectification(True)
        stereo.setLeftRightCheck(True)
        stereo.setSubpixel(True)
        stereo.initialConfig.setConfidenceThreshold(settings.confidence)
        stereo.initialConfig.setDepthUnit(dai.StereoDepthConfig.AlgorithmControl.DepthUnit.MILLIMETER)
        # smoothing across edges would create depths where no surface is
        stereo.initialConfig.setMedianFilter(dai.StereoDepthConfig.MedianFilter.MEDIAN_OFF)
        self.queue = stereo.depth.createOutputQueue(maxSize=2, blocking=False)
        self._pipeline.start()
        if settings.emitter > 0.0:
            device.setIrLaserDotProjectorIntensity(settings.emitter)

    def running(self) -> bool:
        """Whether the pipeline runs."""
        return bool(self._pipeline.isRunning()) and not self._device.isClosed()

    def close(self) -> None:
        """Calls stop() without wait(): wait() deadlocks before the release."""
        self._pipeline.stop()
        self._pipeline.wait()
        self._device.close()


def connect_device(settings: OakSettings) -> DeviceLink:
    """Finds the device and starts its pipeline. Raises DeviceNotFound."""
    try:
        import depthai as dai
    except ImportError as error:
        raise DeviceNotFound(
            f"camera {settings.camera}: depthai is not installed; run {install_command('depthai>=3.0,<4')}"
        ) from error
    found = _find(dai, settings)
    try:
        return DeviceLink(settings, dai.Device(found))
    except RuntimeError as error:
        raise DeviceNotFound(
            f"camera {settings.camera}: the device {found.getDeviceId()} does not start ({_first_line(error)}); "
            "another program may use it, or the udev rule is missing"
        ) from error


def _find(dai: Any, settings: OakSettings) -> Any:
    """The requested device, by polling: the library itself would wait 11 s and then raise."""
    until_s = time.monotonic() + settings.find_s
    while True:
        there = dai.Device.getAllAvailableDevices()
        match = [d for d in there if settings.device in ("", d.getDeviceId(), d.name)]
        if len(match) == 1:
            return match[0]
        if len(match) > 1:
            ids = ", ".join(d.getDeviceId() for d in match)
            raise DeviceNotFound(f"camera {settings.camera}: several OAK devices ({ids}); set device to one of them")
        if time.monotonic() >= until_s:
            break
        time.sleep(0.2)
    wanted = f"OAK device {settings.device}" if settings.device else "OAK device"
    others = ", ".join(d.getDeviceId() for d in there) or "none"
    raise DeviceNotFound(
        f"camera {settings.camera}: no {wanted} (available: {others}); check the cable, the power and the udev rule"
    )


def _baseline_m(device: Any) -> float | None:
    try:
        return float(device.readCalibration().getBaselineDistance()) / 100.0
    except RuntimeError:
        return None  # without calibration: the frame's intrinsics will be invalid


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
