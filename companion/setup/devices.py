"""Finds depth cameras and serial ports in the file system of the kernel, without any camera library."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.cameras.usb_devices import INTEL, MOVIDIUS, STEREOLABS, USB, text_of

LINKS: Final = Path("/dev/v4l/by-id"), Path("/dev/v4l/by-path")
"""Names of video nodes: by maker, product and serial number of the USB device, and by its port."""
SERIAL: Final = Path("/dev/serial/by-id")
UARTS: Final = ("ttyAMA0", "ttyTHS1", "ttyTHS0")
"""Ports on the pins of a Raspberry Pi and of a Jetson, which have no entry by id."""


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera that was found."""

    # kind, device: as in the configuration
    kind: str
    device: str
    name: str  # for people
    serial: str = ""  # of the maker, empty: unknown


def find_cameras(usb: Path = USB, links: tuple[Path, Path] = LINKS) -> list[FoundCamera]:
    """The connected cameras that a driver exists for."""
    found = list(_cameras(usb, links))
    oaks = [camera for camera in found if camera.kind == "oak"]
    if len(oaks) == 1:  # the driver takes the only one, whose id changes when its firmware is loaded
        found[found.index(oaks[0])] = FoundCamera("oak", "", oaks[0].name, oaks[0].serial)
    return found


def _cameras(usb: Path, links: tuple[Path, Path]) -> Iterator[FoundCamera]:
    devices = sorted(usb.glob("*")) if usb.is_dir() else []
    identities = {d: tuple(text_of(d / name) for name in ("idVendor", "product", "serial")) for d in devices}
    known = Counter(identities.values())
    for device, identity in identities.items():
        vendor, product, serial = identity
        if vendor == MOVIDIUS:
            yield FoundCamera("oak", serial, f"Luxonis OAK ({product or 'Movidius'})", serial)
            continue
        kind = "zed" if vendor == STEREOLABS else "v4l2" if vendor == INTEL and "realsense" in product.lower() else ""
        # the sensors of a ZED are a device of their own without video
        if kind and (path := _image_node(device, links, unique=known[identity] == 1)):
            yield FoundCamera(kind, path, product or "ZED", serial)


def _image_node(device: Path, links: tuple[Path, Path], unique: bool) -> str:
    """The name of the first image node of a USB device, of a RealSense that of its depth; empty: it has none. unique: no other device
    has its maker, product and serial number.

    Nodes of two devices, or of two functions of one (depth and colour of a D435), may share their name by id, which is then
    that of one or the other after each connection: they are named by their port."""
    nodes = sorted(n for n in device.glob("*/video4linux/video*") if text_of(n / "index") == "0")
    if not nodes:
        return ""
    for folder in links if unique and len(nodes) == 1 else links[1:]:
        for entry in sorted(folder.iterdir()) if folder.is_dir() else []:
            if entry.resolve().name == nodes[0].name:
                return str(entry)
    return f"/dev/{nodes[0].name}"


def find_serial_ports(by_id: Path = SERIAL, dev: Path = Path("/dev")) -> list[str]:
    """Serial ports, best names first."""
    named = sorted(str(entry) for entry in by_id.iterdir()) if by_id.is_dir() else []
    return [*named, *(str(dev / name) for name in UARTS if (dev / name).exists())]
