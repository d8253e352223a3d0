"""Which camera a video device is, as the kernel states it: two cameras at one port, one after the other, have the same path."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..base import BadData
from .usb_devices import text_of

DEVICES: Final = Path("/sys/dev/char")
"""The device of each open file, by its number."""


@dataclass(frozen=True, slots=True)
class VideoIdentity:
    """What a USB device states of itself; empty: it states nothing, or is no USB device."""

    ids: str = ""  # idVendor:idProduct
    product: str = ""
    serial: str = ""

    def __str__(self) -> str:
        parts = (self.product, f"({self.ids})" if self.ids else "", f"serial {self.serial}" if self.serial else "")
        return " ".join(part for part in parts if part)


def video_identity(descriptor: int, devices: Path = DEVICES) -> VideoIdentity:
    """The identity of the device behind an open file, not behind its path, which may be that of another one by now."""
    number = os.fstat(descriptor).st_rdev
    place = (devices / f"{os.major(number)}:{os.minor(number)}" / "device").resolve()
    for folder in (place, *place.parents):
        if vendor := text_of(folder / "idVendor"):
            ids = f"{vendor}:{text_of(folder / 'idProduct')}"
            return VideoIdentity(ids, text_of(folder / "product"), text_of(folder / "serial"))
    return VideoIdentity()


def check_serial(camera: str, device: str, serial: str, found: VideoIdentity) -> None:
    """Raises BadData where the connected camera is not the configured one. serial: of the configuration; empty: any camera."""
    if not serial or (found.serial and found.serial.lstrip("0") == serial.lstrip("0")):
        return
    stated = str(found) if found.serial else f"{str(found) or 'a camera'} without a serial number"
    raise BadData(
        f"camera {camera}: {device} is {stated}, serial = {serial!r} is configured; connect the configured camera to this port, or set "
        "serial, intrinsics and mount to those of the present one"
    )
