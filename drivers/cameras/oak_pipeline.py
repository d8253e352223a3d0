"""The pipeline on a Luxonis OAK: rectified cameras, stereo matching on the device, and the queue of its results."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any, Final, Protocol

from ..base import DeviceNotFound
from ..optional_library import install_command
from .bounded_close import close_within
from .device_matches import needs_images
from .oak_calibration import baseline_m
from .oak_devices import find_device
from .oak_faults import refuse_known_fault
from .stereo import MatchParams

# read by the library: no signal handlers, nothing sent to its maker, and no calibration from what the cameras see at a start,
# which changes all depths while frames are delivered and is written into the device (default since 3.6)
for _name, _value in (
    ("DEPTHAI_LEVEL", "error"),
    ("DEPTHAI_INSTALL_SIGNAL_HANDLER", "0"),
    ("DEPTHAI_DISABLE_CRASHDUMP_COLLECTION", "1"),
    ("DEPTHAI_AUTOCALIBRATION", "OFF"),
    ("DEPTHAI_TELEMETRY", "0"),
    ("DEPTHAI_DISABLE_STARTUP_NOTIFICATIONS", "1"),
):
    os.environ.setdefault(_name, _value)


DEPTH, LEFT, RIGHT = "depth", "left", "right"
"""Names of the streams: depth, and the rectified images."""


SEARCHED: Final = 96
"""Number of disparities that the device searches, from 0 on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OakSettings:
    """Settings of the device.

    Attributes:
        device: its id, USB port or address; empty: the only device.
        host_matching: whether the host matches the rectified images; the device then sends no depth.
        confidence: 0..255, see `configure`.
        match: parameters of the host's matching, or the rules by which the device's matches are tested on the host;
            without any rule the device's depth is sent without images.
        emitter: intensity of the dot projector, 0..1.
        first_frame_s: time limit to find, boot and deliver."""

    camera: str
    device: str = ""
    width: int = 640
    height: int = 400
    fps: float = 30.0
    host_matching: bool = False
    confidence: int = 55
    match: MatchParams = field(default_factory=MatchParams)
    emitter: float = 0.0
    max_range_m: float = 15.0
    min_range_m: float = 0.4
    find_s: float = 5.0
    first_frame_s: float = 20.0

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the requested images, first the one whose stamp and intrinsics are those of the frame."""
        if self.host_matching:
            return (LEFT, RIGHT)
        return (DEPTH, LEFT, RIGHT) if needs_images(self.match) else (DEPTH,)

    @property
    def searched(self) -> int:
        """Number of disparities that are searched, from 0 on."""
        return self.match.searched if self.host_matching else SEARCHED

    @property
    def same_exposure_s(self) -> float:
        """Stamps of one exposure differ by less. Exposures are a period apart; those of both cameras need not be at one instant."""
        return 0.4 / self.fps


class OakLink(Protocol):
    """A running pipeline: its queue and its end. queue: of depth (dai.ImgFrame), or with several streams of groups
    (dai.MessageGroup) with an image of each. identity: see `DepthSource.identity`."""

    queue: Any
    baseline_m: float
    identity: str

    def running(self) -> bool: ...
    def close(self) -> None: ...


def configure(config: Any, confidence: int) -> None:
    """Sets a dai.StereoDepthConfig. confidence: disparities of a higher confidence are accepted, the others have no depth.
    In DepthAI 2 a low value meant high confidence, in DepthAI 3 a high one does (its commit ab4e2ddd4); 55 is its default.

    Nothing is filled, smoothed, decimated or kept from earlier frames: that would create depths where no surface is. All that could
    do so is set here, since the defaults of the library change from version to version, and its profiles switch most of it on. What
    only an OAK4 (RVC4) does has no effect on other devices."""
    import depthai as dai

    control = dai.StereoDepthConfig.AlgorithmControl
    config.algorithmControl.disparityShift = 0
    config.costMatching.disparityWidth = dai.StereoDepthConfig.CostMatching.DisparityWidth.DISPARITY_96  # SEARCHED
    config.costMatching.enableCompanding = False
    config.costMatching.invalidDisparityValue = 0
    config.setExtendedDisparity(False)
    config.setConfidenceThreshold(confidence)
    # an OAK4 applies the threshold by software, and only where it is switched on
    config.costMatching.enableSwConfidenceThresholding = True
    config.setLeftRightCheck(True)
    config.setSubpixel(True)
    # the default takes the side that is closer to the colour camera
    config.setDepthAlign(control.DepthAlign.RECTIFIED_LEFT)
    config.setDepthUnit(control.DepthUnit.MILLIMETER)
    config.setMedianFilter(dai.StereoDepthConfig.MedianFilter.MEDIAN_OFF)
    processing = config.postProcessing
    # both are on by default: pixels of little confidence would get the mean disparity of their surroundings
    processing.holeFilling.enable = False
    processing.adaptiveMedianFilter.enable = False
    processing.spatialFilter.enable = False
    processing.temporalFilter.enable = False
    processing.decimationFilter.decimationFactor = 1
    processing.bilateralSigmaValue = 0


def synchronised(pipeline: Any, outputs: dict[str, Any], same_exposure_s: float) -> Any:
    """The output of groups of messages of one exposure. outputs: by name. The host groups them: where one of them is missing, no
    group comes."""
    import depthai as dai

    sync = pipeline.create(dai.node.Sync)
    sync.setRunOnHost(True)
    sync.setSyncThreshold(timedelta(seconds=same_exposure_s))
    for name, output in outputs.items():
        output.link(sync.inputs[name])
    return sync.out


class DeviceLink:
    """A pipeline on a device: two rectified cameras, stereo depth, and a queue of the newest two frames.

    A StereoDepth node enables the outputs that are linked."""

    def __init__(self, settings: OakSettings, device: Any) -> None:
        import depthai as dai

        self._device = device
        device.setMaxReconnectionAttempts(0)
        refuse_known_fault(device.getCameraSensorNames().values(), dai.__version__, settings.camera)
        self.baseline_m = baseline_m(device.readCalibration(), settings.camera)
        self.identity = f"OAK {device.getDeviceId()}"
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
        configure(stereo.initialConfig, settings.confidence)
        outputs = {DEPTH: stereo.depth, LEFT: stereo.rectifiedLeft, RIGHT: stereo.rectifiedRight}
        wanted = {name: outputs[name] for name in settings.streams}
        output = stereo.depth
        if len(wanted) > 1:
            output = synchronised(self._pipeline, wanted, settings.same_exposure_s)
        self.queue = output.createOutputQueue(maxSize=2, blocking=False)
        self._pipeline.start()
        if settings.emitter > 0.0:
            device.setIrLaserDotProjectorIntensity(settings.emitter)

    def running(self) -> bool:
        """Whether the pipeline runs."""
        return bool(self._pipeline.isRunning()) and not self._device.isClosed()

    def close(self) -> None:
        """Waits for the end of the pipeline: the release of the device deadlocks otherwise."""
        try:
            self._pipeline.stop()
            self._pipeline.wait()
        finally:
            self._device.close()


def connect_device(settings: OakSettings) -> DeviceLink:
    """Finds the device and starts its pipeline. Raises DeviceNotFound, and BadData where its calibration cannot be used."""
    try:
        import depthai as dai
    except ImportError as error:
        raise DeviceNotFound(
            f"camera {settings.camera}: depthai is not installed; run {install_command('depthai>=3.0,<4')}"
        ) from error
    found = find_device(settings.camera, settings.device, settings.find_s)
    try:
        return start_pipeline(settings, dai.Device(found))
    except RuntimeError as error:
        raise DeviceNotFound(
            f"camera {settings.camera}: the device {found.getDeviceId()} does not start ({first_line(error)}); "
            "another program may use it, or the udev rule is missing (docs/how-to/connect-oak.md)"
        ) from error


def start_pipeline(settings: OakSettings, device: Any) -> DeviceLink:
    """Starts the pipeline on an opened device; where that fails, closes the device: it could not be opened again."""
    try:
        return DeviceLink(settings, device)
    except Exception:
        close_within(device.close)
        raise


def first_line(error: Exception) -> str:
    """The first line of an error's text, its type where it has none."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
