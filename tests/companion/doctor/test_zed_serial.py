"""`companion doctor` with the calibration file of another ZED."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.config.camera import CameraConfig
from companion.diagnostic import DiagnosticCode
from companion.doctor.zed_serial_check import zed_serial_findings


def usb(folder: Path, *devices: tuple[str, str]) -> Path:
    """A tree as below /sys/bus/usb/devices: vendor and serial number of each."""
    for k, (vendor, serial) in enumerate(devices):
        (folder / f"1-{k}").mkdir()
        (folder / f"1-{k}" / "idVendor").write_text(vendor + "\n")
        (folder / f"1-{k}" / "serial").write_text(serial + "\n")
    return folder


def camera(calibration: str) -> CameraConfig:
    return CameraConfig(name="front", kind="zed", device="/dev/video0", calibration=calibration)


VIDEO, SENSORS, OTHER = ("2b03", "OV0001"), ("2b03", "37612345"), ("8086", "12345678")


@pytest.mark.parametrize(
    ("calibration", "ok"),
    [("/etc/osape-companion/SN37612345.conf", True), ("SN037612345.CONF", True), ("/etc/SN12345678.conf", False)],
)
def test_the_file_is_that_of_the_connected_camera(calibration: str, ok: bool, tmp_path: Path) -> None:
    """The sensors of a ZED have the serial number of the camera, its video device has the same one for all."""
    found = list(zed_serial_findings([camera(calibration)], usb(tmp_path, VIDEO, SENSORS, OTHER)))
    assert [f.code for f in found] == ([] if ok else [DiagnosticCode.INTRINSICS_DIFFER])
    assert all("the connected one has the serial number 37612345" in f.text for f in found)


def test_without_a_serial_number_nothing_is_compared(tmp_path: Path) -> None:
    """A ZED of the first generation has no sensors, and a file may have any name."""
    assert not list(zed_serial_findings([camera("SN12345678.conf")], usb(tmp_path, VIDEO, OTHER)))
    assert not list(zed_serial_findings([camera("SN12345678.conf")], tmp_path / "none"))
    (tmp_path / "a").mkdir()
    others = [camera("front.conf"), CameraConfig(name="rear", kind="oak")]
    assert not list(zed_serial_findings(others, usb(tmp_path / "a", VIDEO, SENSORS)))
