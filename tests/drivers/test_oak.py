"""The OAK driver with real depthai messages and a real pipeline, without a device."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import depthai as dai
import numpy as np
import pytest

from companion.config.camera import CameraConfig
from core.types import FAR_MM, SATURATED_MM, UNKNOWN_MM
from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import SEARCHED, OakSettings, configure
from tests.waiting import until

from .oak_host import DEVICE_ALONE, HEIGHT, MATRIX, WIDTH, HostLink, depth_message, stamp_ns

pytestmark = pytest.mark.process

SETTINGS = OakSettings(camera="front", match=DEVICE_ALONE, first_frame_s=60.0, find_s=0.1)


def test_frames_come_with_intrinsics_stamps_and_millimetres() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    images = [rng.integers(0, FAR_MM, (HEIGHT, WIDTH)).astype(np.uint16) for _ in range(4)]
    stamps_ns = {}

    def make(number: int) -> dai.ImgFrame:
        message = depth_message(number, pixels=images[number % 4])
        stamps_ns[number] = stamp_ns(message)
        return message

    begun_ns = time.monotonic_ns()
    source = OakSource(SETTINGS, HostLink(make))
    source.open()
    try:
        k = source.info.intrinsics
        assert (k.width, k.height, k.fx, k.cy) == (WIDTH, HEIGHT, MATRIX[0][0], MATRIX[1][2])
        assert not source.info.marks_smooth
        assert source.info.ke_per_m == 0.05  # 0.25 px on so short a focal length is more than the bound
        assert source.info.bias_per_m == pytest.approx(0.15 * WIDTH / 640 / (MATRIX[0][0] * 0.075))
        for _ in range(3):
            frame = source.read(60.0)
            assert frame is not None
            assert np.array_equal(frame.depth_mm, images[frame.sequence % 4])
            assert frame.t_exposure_ns == stamps_ns[frame.sequence]
            assert begun_ns <= frame.t_arrival_ns <= time.monotonic_ns()
    finally:
        source.close()
        source.close()


@pytest.mark.parametrize(("baseline_m", "least_m"), [(0.075, 0.4), (2.0, MATRIX[0][0] * 2.0 / (SEARCHED - 1))])
def test_the_range_begins_at_the_greatest_disparity_that_the_device_searches(baseline_m: float, least_m: float) -> None:
    """Of a wide image or a wide baseline this is more than min_range_m: 0.7 m at 1280 x 800."""
    link = HostLink(depth_message)
    link.baseline_m = baseline_m
    source = OakSource(SETTINGS, link)
    source.open()
    assert source.info.min_range_m == pytest.approx(least_m)
    source.close()


def test_the_greatest_values_are_no_distance() -> None:
    """Some cameras write them for invalid pixels; 65534 would be free space up to the range."""
    pixels = np.full((HEIGHT, WIDTH), 3000, np.uint16)
    pixels[1, :3] = 0, FAR_MM, SATURATED_MM
    source = OakSource(SETTINGS, HostLink(lambda number: depth_message(number, pixels=pixels)))
    source.open()
    frame = source.read(60.0)
    source.close()
    assert frame is not None
    assert list(frame.depth_mm[1, :4]) == [UNKNOWN_MM, UNKNOWN_MM, UNKNOWN_MM, 3000]


def test_a_slow_reader_gets_the_newest_frame() -> None:
    made = [0]

    def make(number: int) -> dai.ImgFrame:
        made[0] = number
        return depth_message(number)

    source = OakSource(SETTINGS, HostLink(make, period_s=0.002))
    source.open()
    try:
        first = source.read(60.0)
        assert first is not None
        oldest = first.sequence
        assert until(lambda: made[0] > oldest + 10)
        frame = source.read(60.0)
        assert frame is not None
        assert frame.sequence > first.sequence + 1  # those between them are left out
    finally:
        source.close()


def test_a_pause_is_no_loss_and_a_stop_is() -> None:
    def hesitating(number: int) -> dai.ImgFrame:
        if number >= 3:
            time.sleep(0.5)
        return depth_message(number)

    link = HostLink(hesitating, period_s=0.0)
    source = OakSource(SETTINGS, link)
    source.open()
    while source.read(0.05) is not None:
        pass
    link.stop()
    with pytest.raises(DeviceLost, match="camera front: the device"):
        read_all(source)
    source.close()


def read_all(source: OakSource) -> None:
    """Reads until something is wrong."""
    for _ in range(1000):
        source.read(0.05)


def test_a_lost_device_that_cannot_be_closed_keeps_its_cause() -> None:
    """The error of the library took the place of the cause, and ended the process without one."""

    class Stuck(HostLink):
        """A link that is down: its library reports that when it is closed."""

        def close(self) -> None:
            super().close()
            raise RuntimeError("Communication exception (X_LINK_ERROR)")

    source = OakSource(dataclasses.replace(SETTINGS, first_frame_s=0.1), Stuck(lambda k: None))
    with pytest.raises(DeviceLost, match=r"the device stopped|no depth frame within 0.1 s"):
        source.open()
    source.close()


def test_a_device_that_never_delivers_is_lost_with_a_remedy() -> None:
    source = OakSource(OakSettings(camera="front", match=DEVICE_ALONE, first_frame_s=0.2), HostLink(lambda k: None))
    with pytest.raises(
        DeviceLost, match=r"no depth frame within 0.2 s; check that the cable is USB 3|the device stopped"
    ):
        source.open()


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"pixels": np.zeros((HEIGHT, WIDTH), np.uint8), "kind": dai.ImgFrame.Type.GRAY8}, "expected RAW16"),
        ({"age_s": -100.0}, r"stamped \+\d+\.\d+ s from its arrival"),
        ({"age_s": 100.0}, r"stamped -1\d\d\.\d+ s from its arrival; the device's clock is not synchronised"),
        ({"matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "has its factory calibration"),
        ({"size": (2 * WIDTH, 2 * HEIGHT)}, "intrinsics of an image of 128x80, its pixels are 64x40"),
    ],
)
def test_frames_that_cannot_be_used_name_the_cause(changes: dict[str, object], cause: str) -> None:
    depth_message(0, **changes)  # an exception inside of a node would end this process
    source = OakSource(SETTINGS, HostLink(lambda k: depth_message(k, **changes)))
    with pytest.raises(BadData, match=cause):
        source.open()


@pytest.mark.parametrize(
    "changes",
    [
        {"pixels": np.full((HEIGHT, WIDTH // 2), 1000, np.uint16)},
        {"matrix": [[46.0, 0.0, 31.5], [0.0, 46.0, 19.5], [0.0, 0.0, 1.0]]},
    ],
    ids=["size", "focal length"],
)
def test_a_later_frame_of_another_view_is_refused(changes: dict[str, object]) -> None:
    opened = threading.Event()
    source = OakSource(SETTINGS, HostLink(lambda k: depth_message(k, **(changes if opened.is_set() else {}))))
    source.open()
    opened.set()
    with pytest.raises(BadData, match="a frame has other intrinsics"):
        read_all(source)
    source.close()


def test_a_frame_without_its_bytes_is_refused() -> None:
    def cut(number: int) -> dai.ImgFrame:
        message = depth_message(number)
        message.setData(b"0123456789")
        return message

    link = HostLink(cut)
    with pytest.raises(BadData, match="a depth image cannot be read"):
        OakSource(SETTINGS, link).open()
    assert not link.running()  # it was closed


@pytest.mark.parametrize("lines", [1, HEIGHT // 2, HEIGHT - 1])
def test_a_frame_with_padded_lines_that_lacks_some_bytes_is_refused(lines: int) -> None:
    """The library compares the bytes with those of lines without padding, and reads what lies behind them in memory."""

    def padded(number: int) -> dai.ImgFrame:
        message = depth_message(number)
        line = bytes(2 * WIDTH) + bytes(64)
        message.setStride(len(line))
        message.setData((line * HEIGHT)[: -64 - lines])
        return message

    with pytest.raises(BadData, match=r"a depth image cannot be read \(\d+ of 7616 bytes\)"):
        OakSource(SETTINGS, HostLink(padded)).open()


def test_padding_at_the_end_of_lines_is_no_part_of_the_image() -> None:
    def padded(number: int) -> dai.ImgFrame:
        message = depth_message(number)
        line = np.full(WIDTH, 1000 + number, np.uint16).tobytes() + bytes(64)
        message.setStride(len(line))
        message.setData((line * HEIGHT)[:-64])
        return message

    source = OakSource(SETTINGS, HostLink(padded))
    source.open()
    frame = source.read(60.0)
    source.close()
    assert frame is not None
    assert np.all(frame.depth_mm == 1000 + frame.sequence)


@pytest.mark.parametrize("kind", ["RAW10", "RAW12", "RAW14", "GRAYF16"])
def test_pixels_of_another_type_are_no_millimetres(kind: str) -> None:
    def other(number: int) -> dai.ImgFrame:
        message = depth_message(number)
        message.setType(getattr(dai.ImgFrame.Type, kind))
        return message

    with pytest.raises(BadData, match=f"a frame of type Type.{kind}; expected RAW16, millimetres"):
        OakSource(SETTINGS, HostLink(other)).open()


@pytest.mark.parametrize("message", [dai.Buffer(), dai.IMUData(), dai.EncodedFrame(), dai.ImgFrame()])
def test_a_message_of_another_type_names_the_cause(message: dai.ADatatype) -> None:
    with pytest.raises(BadData, match=r"camera front: .* Restart the device"):
        OakSource(SETTINGS, HostLink(lambda k: message)).open()


def test_without_a_device_the_cause_and_the_remedy_are_reported_soon() -> None:
    with pytest.raises(DeviceNotFound, match=r"no OAK device 19443010 \(connected: none\); check the cable"):
        OakSource(OakSettings(camera="front", device="19443010", find_s=0.1)).open()


def test_reading_before_opening_is_reported() -> None:
    with pytest.raises(DeviceNotFound, match="call open"):
        OakSource(SETTINGS).read(0.1)


def test_the_device_accepts_confident_pixels_and_invents_none() -> None:
    config = dai.StereoDepthConfig()
    # defaults of the library that would fill pixels of little confidence, on an OAK4
    assert config.postProcessing.holeFilling.enable
    configure(config, 80)
    assert config.getConfidenceThreshold() == 80
    assert config.costMatching.enableSwConfidenceThresholding
    assert not config.postProcessing.holeFilling.enable
    assert not config.postProcessing.adaptiveMedianFilter.enable
    assert config.postProcessing.median == dai.StereoDepthConfig.MedianFilter.MEDIAN_OFF
    for smoothing in ("spatialFilter", "temporalFilter"):
        assert not getattr(config.postProcessing, smoothing).enable
    control = config.algorithmControl
    assert control.depthAlign == dai.StereoDepthConfig.AlgorithmControl.DepthAlign.RECTIFIED_LEFT
    assert control.depthUnit == dai.StereoDepthConfig.AlgorithmControl.DepthUnit.MILLIMETER
    assert control.enableLeftRightCheck
    assert control.enableSubpixel


def test_no_filter_of_a_profile_of_the_library_stays_on() -> None:
    """What the profile DEFAULT of an RVC2 switches on (StereoDepth::setRvc2ProfilePreset, DepthAI 3.4), and what else could give a
    depth that is not measured in the frame: a filter over time fills holes with earlier values, smoothing and companding invent some,
    an extended or shifted search gives near surfaces a far depth and far ones a near depth."""
    config = dai.StereoDepthConfig()
    config.setExtendedDisparity(True)
    config.setDisparityShift(48)
    config.setDepthUnit(dai.StereoDepthConfig.AlgorithmControl.DepthUnit.CENTIMETER)
    config.setMedianFilter(dai.StereoDepthConfig.MedianFilter.KERNEL_7x7)
    config.costMatching.disparityWidth = dai.StereoDepthConfig.CostMatching.DisparityWidth.DISPARITY_64
    config.costMatching.enableCompanding = True
    config.costMatching.invalidDisparityValue = 1
    processing = config.postProcessing
    processing.decimationFilter.decimationFactor = 2
    processing.bilateralSigmaValue = 10
    for name in ("spatialFilter", "temporalFilter", "holeFilling", "adaptiveMedianFilter"):
        getattr(processing, name).enable = True
    configure(config, 55)
    fresh = dai.StereoDepthConfig()
    configure(fresh, 55)
    for part in ("algorithmControl", "costMatching", "postProcessing"):
        assert values_of(getattr(config, part)) == values_of(getattr(fresh, part))
    assert not processing.temporalFilter.enable
    assert processing.decimationFilter.decimationFactor == 1
    assert not config.algorithmControl.enableExtended
    assert config.algorithmControl.disparityShift == 0
    assert config.costMatching.disparityWidth.name == f"DISPARITY_{SEARCHED}"


def values_of(settings: object) -> dict[str, object]:
    """The fields of a part of the library's settings, by name."""
    fields = {name: getattr(settings, name) for name in dir(settings) if not name.startswith("_")}
    values = {name: value for name, value in fields.items() if not callable(value)}
    plain = (bool, int, float, str, list, type(None))
    return {k: v if isinstance(v, plain) or hasattr(v, "name") else values_of(v) for k, v in values.items()}


def test_a_high_confidence_is_a_reliable_pixel() -> None:
    """DepthAI 2 had it the other way round. A library that turns it again must be noticed."""
    stated = dai.StereoDepthConfig.CostMatching.confidenceThreshold.__doc__ or ""
    assert "over this threshold are accepted" in stated
    key = next(f for f in dataclasses.fields(CameraConfig) if f.name == "confidence")
    assert "least confidence" in key.metadata["doc"]
    assert "higher: fewer, more reliable" in key.metadata["doc"]
    assert key.default == dai.StereoDepthConfig().getConfidenceThreshold()


ABORTS = textwrap.dedent("""
    from drivers.cameras.oak import OakSource
    from drivers.cameras.oak_pipeline import OakSettings, configure
    from tests.drivers.oak_host import DEVICE_ALONE, HostLink, depth_message

    def make(k):
        if k == 3:
            raise ValueError("a defect in a host node")
        return depth_message(k)

    source = OakSource(OakSettings(camera="front", match=DEVICE_ALONE), HostLink(make))
    source.open()
    while True:
        source.read(0.1)
""")


def test_a_library_that_aborts_takes_its_own_process_only() -> None:
    root = Path(__file__).parents[2]
    child = subprocess.run(
        [sys.executable, "-c", ABORTS], cwd=root, capture_output=True, text=True, timeout=60, check=False
    )
    assert child.returncode != 0


BACKGROUND = textwrap.dedent("""
    {first}
    import depthai as dai

    class Node(dai.node.ThreadedHostNode):
        def run(self):
            pass

    pipeline = dai.Pipeline(createImplicitDevice=False)
    pipeline.create(Node)
    pipeline.start()
    pipeline.stop()
    pipeline.wait()
""")
LIBRARY_VARIABLES = ("DEPTHAI_AUTOCALIBRATION", "DEPTHAI_TELEMETRY", "DEPTHAI_DISABLE_STARTUP_NOTIFICATIONS")


def library_output(first: str, tmp_path: Path) -> str:
    """What the library logs of a pipeline on the host."""
    environment = {k: v for k, v in os.environ.items() if k not in LIBRARY_VARIABLES}
    environment |= {"DEPTHAI_LEVEL": "debug", "DEPTHAI_TELEMETRY_URL": "http://127.0.0.1:9/", "HOME": str(tmp_path)}
    child = subprocess.run(
        [sys.executable, "-c", BACKGROUND.format(first=first)],
        cwd=Path(__file__).parents[2],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return child.stdout + child.stderr


def test_the_device_is_not_calibrated_anew_by_what_it_sees_and_nothing_is_uploaded(tmp_path: Path) -> None:
    """DepthAI 3.6 and later by default: at each start, in flight too, it computes another rotation between both cameras from
    the images, applies it while frames are delivered, and writes it into the device."""
    default = library_output("", tmp_path)
    assert "Skipping AutoCalibration node creation" in default  # it would be created for a device
    assert "Telemetry disabled" not in default
    ours = library_output("import drivers.cameras.oak_pipeline", tmp_path)
    assert "AutoCalibration" not in ours
    assert "Telemetry disabled" in ours
