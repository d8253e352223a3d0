"""Finds depth cameras and serial ports in the file system of the kernel, without any camera library."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

USB: Final = Path("/sys/bus/usb/devices")
VIDEO: Final = Path("/dev/v4l/by-id")
SERIAL: Final = Path("/dev/serial/by-id")
UARTS: Final = ("ttyAMA0", "ttyTHS1", "ttyTHS0")
"""Ports on the pins of a Raspberry Pi and of a Jetson, which have no entry by id."""
MOVIDIUS, STEREOLABS, INTEL = "03e7", "2b03", "8086"


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """kind, device: as in the configuration; name: for people; serial: of the maker, empty: unknown."""

    kind: str
    device: str
    name: str
    serial: str = ""


def find_cameras(usb: Path = USB, video: Path = VIDEO) -> list[FoundCamera]:
    """The connected cameras that a driver exists for."""
    found = list(_cameras(usb, video))
    oaks = [camera for camera in found if camera.kind == "oak"]
    if len(oaks) == 1:  # the driver takes the only one, whose id changes when its firmware is loaded
        found[found.index(oaks[0])] = FoundCamera("oak", "", oaks[0].name, oaks[0].serial)
    return found


def _cameras(usb: Path, video: Path) -> Iterator[FoundCamera]:
    for device in sorted(usb.glob("*")) if usb.is_dir() else []:
        vendor, product, serial = (_text(device / name) for name in ("idVendor", "product", "serial"))
        if vendor == MOVIDIUS:
            yield FoundCamera("oak", serial, f"Luxonis OAK ({product or 'Movidius'})", serial)
        elif vendor == STEREOLABS:
            # a ZED has a video device, and some have a separate one for their sensors
            if path := _video(video, serial, "STEREOLABS", "ZED"):
                yield FoundCamera("zed", path, product or "ZED", serial)
        elif vendor == INTEL and "realsense" in product.lower() and (path := _video(video, serial, "RealSense")):
            yield FoundCamera("v4l2", path, product, serial)


def _video(video: Path, serial: str, *names: str) -> str:
    """The image stream of a device by id, the first one: of a RealSense it is the depth. Where no name holds the serial number of the
    device, the first of its maker."""
    entries = sorted(video.iterdir()) if video.is_dir() else []
    matching = (e for e in entries if any(n.lower() in e.name.lower() for n in names) and e.name.endswith("index0"))
    found = list(matching)
    return str(next((e for e in found if serial and f"_{serial}-" in e.name), next(iter(found), "")))


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def find_serial_ports(by_id: Path = SERIAL, dev: Path = Path("/dev")) -> list[str]:
    """Serial ports, best names first."""
    named = sorted(str(entry) for entry in by_id.iterdir()) if by_id.is_dir() else []
    return [*named, *(str(dev / name) for name in UARTS if (dev / name).exists())]
