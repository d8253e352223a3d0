"""Compares the calibration file of a ZED, by its name, with the serial number of the connected one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from drivers.cameras.usb_devices import USB
from drivers.cameras.zed_identity import named_serial, stated_serials

from ..config.camera import CameraConfig
from ..diagnostic import DiagnosticCode
from .finding import Finding


def zed_serial_findings(cameras: Iterable[CameraConfig], usb: Path = USB) -> Iterator[Finding]:
    """One finding per ZED whose file is named after another serial number than the connected ones have. The sensors of a ZED
    report it on USB; one without sensors is not compared."""
    serials, _ = stated_serials(usb)
    for camera in cameras:
        named = named_serial(Path(camera.calibration))
        if camera.kind == "zed" and named and serials and named not in serials:
            text = (
                f"{camera.calibration} is the calibration of another ZED: the connected one has the serial number "
                f"{' or '.join(serials)}; download the file of that number"
            )
            yield Finding(f"camera {camera.name}", False, text, DiagnosticCode.INTRINSICS_DIFFER)
