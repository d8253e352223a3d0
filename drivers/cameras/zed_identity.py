"""Refuses the calibration file of another ZED, by its name and the serial numbers that USB devices state, and by the baseline of the
model.

All video devices of a model state the same number. The sensors of a ZED, which all but the first model have, are a USB device of their
own and state that of the camera. Product ids of both begin with the same three digits (zed-open-capture, include/videocapture_def.hpp and
sensorcapture_def.hpp): f682 and f681, f780 and f781, f880 and f881."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from ..base import BadData
from .usb_devices import STEREOLABS, USB, text_of
from .video_identity import VideoIdentity

_NAME: Final = re.compile(r"SN0*(\d+)\.conf", re.IGNORECASE)
_MODEL_DIGITS: Final = 3
BASELINES_M: Final = {"f58": 0.12, "f68": 0.063, "f78": 0.12, "f88": 0.12}
"""First digits of the product id of a ZED, ZED Mini, ZED 2 and ZED 2i -> distance of both eyes, m, as the maker states it."""
MOST_DIFFERENCE: Final = 0.1
"""Relative. Calibrations differ from the design by a hundredth."""


def named_serial(calibration: Path) -> str:
    """The serial number, without leading zeros, after which a calibration file is named; empty: none."""
    named = _NAME.fullmatch(calibration.name)
    return named[1] if named else ""


def stated_serials(usb: Path = USB, model: str = "") -> tuple[list[str], int]:
    """Serial numbers, without leading zeros, that sensors of connected ZED state, and the number of the maker's other devices. model: the
    first digits of their product ids; empty: all."""
    devices = [d for d in usb.glob("*") if text_of(d / "idVendor") == STEREOLABS]
    found = [text_of(d / "serial") for d in devices if text_of(d / "idProduct").startswith(model)]
    serials = sorted(serial.lstrip("0") for serial in found if serial.isdecimal())
    return serials, len(found) - len(serials)


def refuse_other_calibration(camera: str, calibration: Path, video: VideoIdentity, usb: Path = USB) -> None:
    """Raises BadData where the calibration is named after another serial number than the connected cameras of this model have. video: the
    video device that is open. Nothing is compared while sensors are missing that may be those of this camera."""
    vendor, _, product = video.ids.partition(":")
    named = named_serial(calibration)
    if vendor != STEREOLABS or not named:
        return
    serials, cameras = stated_serials(usb, product[:_MODEL_DIGITS])
    if named not in serials and len(serials) >= max(1, cameras):
        raise BadData(
            f"camera {camera}: {calibration} is the calibration of another ZED: the connected one has the serial number "
            f"{' or '.join(serials)}; connect the other one, or set calibration and mount to those of this one"
        )


def refuse_other_baseline(camera: str, calibration: Path, baseline_m: float, video: VideoIdentity) -> None:
    """Raises BadData where the baseline of the calibration is not that of the connected model: all depths are proportional to it, and
    nothing in the images shows it. A model that is not known is not compared."""
    vendor, _, product = video.ids.partition(":")
    design_m = BASELINES_M.get(product[:_MODEL_DIGITS]) if vendor == STEREOLABS else None
    if design_m is not None and not abs(baseline_m - design_m) <= MOST_DIFFERENCE * design_m:
        raise BadData(
            f"camera {camera}: {calibration} has a baseline of {1000.0 * baseline_m:.0f} mm, the connected {video} has "
            f"{1000.0 * design_m:.0f} mm: all depths would be {baseline_m / design_m:.2g} times the true ones. Set calibration to the "
            "file of this camera"
        )
