"""USB and video devices as files, and a configured RealSense."""

from __future__ import annotations

from pathlib import Path

from companion.config.camera import CameraConfig
from core.types import Intrinsics
from drivers.cameras.realsense_calibration import DepthCalibration

CALIBRATION = DepthCalibration(Intrinsics(640, 480, 391.2, 391.3, 322.1, 238.7), 1.0, True, "123")
D435 = "usb-Intel_R__RealSense_TM__Depth_Camera_435-video-index0"


def usb(folder: Path, *devices: tuple[str, str, str], functions: dict[int, int] | None = None) -> Path:
    """A tree as below /sys/bus/usb/devices: vendor, product and serial number of each. functions: number of video functions by the
    place of the device, each with an image and a metadata node; of a RealSense D435 depth, then colour."""
    number = 0
    for k, (vendor, product, serial) in enumerate(devices):
        place = folder / "usb" / f"1-{k}"
        place.mkdir(parents=True)
        for name, text in (("idVendor", vendor), ("product", product), ("serial", serial)):
            (place / name).write_text(text + "\n")
        for function in range((functions or {}).get(k, 0)):
            for index in range(2):
                node = place / f"1-{k}:1.{3 * function}" / "video4linux" / f"video{number}"
                node.mkdir(parents=True)
                (node / "index").write_text(f"{index}\n")
                number += 1
    return folder / "usb"


def video(folder: Path, **names: str) -> tuple[Path, Path]:
    """Folders as /dev/v4l/by-id and by-path, which link to the nodes in /dev. names: node -> name, with / before one by path."""
    folders = folder / "by-id", folder / "by-path"
    for place in folders:
        place.mkdir()
    for node, listed in names.items():
        for name in listed.split():
            link = folders[1] / name[1:] if name.startswith("/") else folders[0] / name
            link.symlink_to(folder / "dev" / node)
    return folders


def camera(fx_px: float, unit_mm: float = 1.0) -> CameraConfig:
    return CameraConfig(
        name="front",
        kind="v4l2",
        device=f"/dev/v4l/by-id/{D435}",
        fx_px=fx_px,
        fy_px=391.3,
        cx_px=322.1,
        cy_px=238.7,
        depth_unit_mm=unit_mm,
    )
