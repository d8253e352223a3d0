"""Compares the calibration file of a ZED, by its name, with the serial number of the connected one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from drivers.cameras.usb_devices import STEREOLABS, USB, text_of

from ..config.camera import CameraConfig
from ..diagnostic import DiagnosticCode
from .finding import Finding

_NAME = re.compile(r"SN0*(\d+)\.conf", re.IGNORECASE)


def zed_serial_findings(cameras: Iterable[CameraConfig], usb: Path = USB) -> Iterator[Finding]:
    """One finding per ZED whose file is named after another serial number than the connected ones have. The sensors of a ZED
    report it on USB; one without sensors is not compared."""
    makers = (d for d in usb.glob("*") if text_of(d / "idVendor") == STEREOLABS)
    serials = sorted(s.lstrip("0") for s in map(text_of, (d / "serial" for d in makers)) if s.isdecimal())
    for camera in cameras:
        named = _NAME.fullmatch(Path(camera.calibration).name)
        if camera.kind == "zed" and named and serials and named[1] not in serials:
            text = (
                f"{camera.calibration} is the calibration of another ZED: the connected one has the serial number "
                f"{' or '.join(serials)}; download the file of that number"
            )
            yield Finding(f"camera {camera.name}", False, text, DiagnosticCode.INTRINSICS_DIFFER)
