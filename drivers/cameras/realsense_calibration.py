"""Reads intrinsics, depth unit and dot projector of a RealSense with the maker's library, where it is installed.

The service itself reads images through the kernel and needs no such library: the values go into the configuration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from core.types import Intrinsics
from drivers.base import DeviceNotFound
from drivers.optional_library import optional_module

LIBRARY = "pyrealsense2"


@dataclass(frozen=True, slots=True)
class DepthCalibration:
    """Of one depth stream. depth_unit_mm: millimetres per unit; emitter: whether the dot projector is on, None: there is
    none; serial: of the device."""

    intrinsics: Intrinsics
    depth_unit_mm: float
    emitter: bool | None

    @property
    def dot_projector(self) -> str:
        """Its state as text: on, off or none."""
        return "none" if self.emitter is None else "on" if self.emitter else "off"

    serial: str


def read_calibration(width_px: int, height_px: int, serial: str = "") -> DepthCalibration:
    """The calibration of the depth stream of this size. serial: of the device, as the library or as USB reports it, empty: the
    only one. Raises DeviceNotFound without the library, the device or a stream of this size."""
    rs = optional_module(
        LIBRARY,
        f"the intrinsics of a RealSense are read with {LIBRARY}",
        "pyrealsense2>=2.54",
        otherwise=" (x86-64 only), or enter the values that `rs-enumerate-devices -c` prints on any computer",
    )
    sensor, found_serial = _depth_sensor(rs, serial)
    sizes = []
    for profile in sensor.get_stream_profiles():
        if profile.stream_type() != rs.stream.depth or profile.format() != rs.format.z16:
            continue
        video = profile.as_video_stream_profile()
        if (video.width(), video.height()) == (width_px, height_px):
            k = video.get_intrinsics()
            return DepthCalibration(
                Intrinsics(k.width, k.height, k.fx, k.fy, k.ppx, k.ppy),
                1000.0 * float(sensor.get_depth_scale()),
                _emitter(rs, sensor),
                found_serial,
            )
        sizes.append(f"{video.width()}x{video.height()}")
    raise DeviceNotFound(
        f"RealSense {found_serial}: no depth stream of {width_px}x{height_px}; it offers {', '.join(sorted(set(sizes)))}"
    )


def _depth_sensor(rs: Any, serial: str) -> tuple[Any, str]:
    """The depth sensor and the serial number of its device."""
    devices = {d.get_info(rs.camera_info.serial_number): d for d in rs.context().query_devices()}
    chosen = {name: d for name, d in devices.items() if serial in ("", name, _board_serial(rs, d))}
    if len(chosen) != 1:
        there = ", ".join(sorted(devices)) or "none"
        raise DeviceNotFound(f"RealSense {serial or 'camera'}: {len(chosen)} match; connected: {there}")
    ((name, device),) = chosen.items()
    return device.first_depth_sensor(), name


def _board_serial(rs: Any, device: Any) -> str:
    """The serial number of the main board, which USB reports; serial_number is that of the optical module."""
    kind = rs.camera_info.asic_serial_number
    return str(device.get_info(kind)) if device.supports(kind) else ""


def _emitter(rs: Any, sensor: Any) -> bool | None:
    option = rs.option.emitter_enabled
    return bool(sensor.get_option(option)) if sensor.supports(option) else None
