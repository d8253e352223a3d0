"""The baseline of an OAK from real calibrations of depthai, and the end of a device whose calibration cannot be used."""

from __future__ import annotations

import os

import pytest

os.environ.setdefault("DEPTHAI_LEVEL", "error")
os.environ.setdefault("DEPTHAI_INSTALL_SIGNAL_HANDLER", "0")

import depthai as dai

from drivers.base import BadData
from drivers.cameras.oak_calibration import baseline_m
from drivers.cameras.oak_faults import refuse_known_fault
from drivers.cameras.oak_pipeline import OakSettings, start_pipeline

pytestmark = pytest.mark.process

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
MATRIX = [[450.0, 0.0, 320.0], [0.0, 450.0, 200.0], [0.0, 0.0, 1.0]]


def calibration(measured_cm: float, design_cm: float) -> dai.CalibrationHandler:
    """Of two cameras side by side, 0: not stored."""
    handler = dai.CalibrationHandler()
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    for socket in (left, right):
        handler.setCameraIntrinsics(socket, MATRIX, dai.Size2f(640.0, 400.0))
    handler.setCameraExtrinsics(left, right, IDENTITY, [-measured_cm, 0.0, 0.0], [-design_cm, 0.0, 0.0])
    handler.setStereoLeft(left, IDENTITY)
    handler.setStereoRight(right, IDENTITY)
    return handler


@pytest.mark.parametrize(
    ("measured_cm", "design_cm", "used_m"),
    [(7.309, 7.5, 0.075), (7.6, 7.5, 0.075), (7.3, 0.0, 0.073), (0.0, 7.5, 0.075)],
)
def test_the_baseline_is_that_of_the_device_s_own_depth(measured_cm: float, design_cm: float, used_m: float) -> None:
    assert baseline_m(calibration(measured_cm, design_cm), "front") == pytest.approx(used_m, rel=1e-6)


@pytest.mark.parametrize("measured_cm", [7.0, 8.0, 4.0])
def test_a_calibration_that_does_not_fit_the_design_is_refused(measured_cm: float) -> None:
    with pytest.raises(BadData, match=r"camera front: .* its design has 0.0750 m; .* Calibrate the device again"):
        baseline_m(calibration(measured_cm, 7.5), "front")


@pytest.mark.parametrize("handler", [dai.CalibrationHandler(), calibration(0.0, 0.0)], ids=["empty", "zero"])
def test_a_device_without_a_baseline_is_refused(handler: dai.CalibrationHandler) -> None:
    with pytest.raises(BadData, match="reports no baseline; check that it has its factory calibration"):
        baseline_m(handler, "front")


class OpenedDevice:
    """An opened device, as far as the driver asks it before it makes the pipeline."""

    closed = False

    def __init__(self, sensor: str = "OV9282") -> None:
        self.sensor = sensor

    def getCameraSensorNames(self) -> dict[dai.CameraBoardSocket, str]:
        return {dai.CameraBoardSocket.CAM_A: "IMX214", dai.CameraBoardSocket.CAM_B: self.sensor}

    def setMaxReconnectionAttempts(self, attempts: int) -> None:
        assert attempts == 0

    def readCalibration(self) -> dai.CalibrationHandler:
        return dai.CalibrationHandler()

    def close(self) -> None:
        self.closed = True


def test_a_device_that_cannot_be_used_is_closed() -> None:
    device = OpenedDevice()
    with pytest.raises(BadData, match="reports no baseline"):
        start_pipeline(OakSettings(camera="front"), device)
    assert device.closed


@pytest.mark.parametrize("version", ["3.7.1", "3.8.0", "3.10.0"])
def test_cameras_that_stop_with_this_version_of_the_library_are_refused(
    version: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An OAK-D Lite: the message of the library names neither the cause nor the remedy."""
    monkeypatch.setattr(dai, "__version__", version)
    device = OpenedDevice("OV7251")
    with pytest.raises(
        BadData, match=rf"camera front: .* installed is {version}. .*python\S* -m pip install 'depthai==3\.6\.1'"
    ):
        start_pipeline(OakSettings(camera="front"), device)
    assert device.closed


@pytest.mark.parametrize(
    ("sensor", "version"), [("OV7251", "3.6.1"), ("OV7251", "3.11.0"), ("OV7251", "3.12.0"), ("OV9282", "3.8.0")]
)
def test_other_combinations_are_not_refused(sensor: str, version: str) -> None:
    refuse_known_fault(["IMX214", sensor], version, "front")
