"""Intrinsics of a RealSense, read by its library, and compared by the doctor."""

from __future__ import annotations

import sys
import types
from dataclasses import replace
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion.cli import main
from companion.config.camera import CameraConfig
from companion.diagnostic import DiagnosticCode
from companion.doctor import intrinsics_check
from drivers.base import DeviceNotFound
from drivers.cameras.realsense_calibration import read_calibration

from ..usb_tree import CALIBRATION, camera


class Profile:
    """A stream of the fake device, as pyrealsense2 describes it."""

    def __init__(self, size: tuple[int, int], kind: str = "depth") -> None:
        self._size, self._kind = size, kind

    def stream_type(self) -> str:
        return self._kind

    def format(self) -> str:
        return "z16"

    def as_video_stream_profile(self) -> Profile:
        return self

    def width(self) -> int:
        return self._size[0]

    def height(self) -> int:
        return self._size[1]

    def get_intrinsics(self) -> Any:
        return SimpleNamespace(width=self._size[0], height=self._size[1], fx=391.2, fy=391.3, ppx=322.1, ppy=238.7)


def board_serial(serial: str) -> str:
    """The serial number of the main board, which USB and the names in /dev/v4l/by-id contain; `serial` is that of the optics."""
    return serial.replace("1", "7")


def library(*serials: str) -> types.ModuleType:
    """A pyrealsense2 with these devices, each with two depth streams."""
    sensor = SimpleNamespace(
        get_stream_profiles=lambda: [Profile((640, 480), "color"), Profile((848, 480)), Profile((640, 480))],
        get_depth_scale=lambda: 0.001,
        supports=lambda option: True,
        get_option=lambda option: 1.0,
    )
    devices = [
        SimpleNamespace(
            get_info=lambda kind, s=s: s if kind == "serial_number" else board_serial(s),
            supports=lambda kind: True,
            first_depth_sensor=lambda: sensor,
        )
        for s in serials
    ]
    module = types.ModuleType("pyrealsense2")
    module.__spec__ = ModuleSpec("pyrealsense2", loader=None)
    for name, value in {
        "context": lambda: SimpleNamespace(query_devices=lambda: devices),
        "camera_info": SimpleNamespace(serial_number="serial_number", asic_serial_number="asic_serial_number"),
        "stream": SimpleNamespace(depth="depth"),
        "format": SimpleNamespace(z16="z16"),
        "option": SimpleNamespace(emitter_enabled="emitter_enabled"),
    }.items():
        setattr(module, name, value)
    return module


@pytest.fixture
def one_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", library("123"))


@pytest.mark.usefixtures("one_device")
def test_intrinsics_unit_and_emitter_are_read() -> None:
    assert read_calibration(640, 480) == CALIBRATION
    with pytest.raises(DeviceNotFound, match="it offers 640x480, 848x480"):
        read_calibration(1280, 720)
    with pytest.raises(DeviceNotFound, match="connected: 123"):
        read_calibration(640, 480, serial="999")


def test_of_several_devices_none_is_guessed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", library("1", "2"))
    with pytest.raises(DeviceNotFound, match="2 match"):
        read_calibration(640, 480)
    assert read_calibration(640, 480, serial="2").serial == "2"


def test_the_device_is_found_by_its_serial_number_on_usb(monkeypatch: pytest.MonkeyPatch) -> None:
    """A D400 has another one there than the library reports as its own: the intrinsics of none were read."""
    monkeypatch.setitem(sys.modules, "pyrealsense2", library("813112060123", "943222072600"))
    assert read_calibration(640, 480, serial="873772060723").serial == "813112060123"
    with pytest.raises(DeviceNotFound, match="0 match; connected: 813112060123, 943222072600"):
        read_calibration(640, 480, serial="111111111111")


@pytest.mark.usefixtures("one_device")
@pytest.mark.parametrize(
    ("configured", "wrong"),
    [(camera(391.0), ""), (camera(383.0), "fx_px = 391.2"), (camera(391.2, 0.1), "depth_unit_mm = 1.0")],
)
def test_the_doctor_compares_with_the_device(configured: CameraConfig, wrong: str) -> None:
    (finding,) = intrinsics_check.intrinsics_findings([configured, CameraConfig(name="right", kind="oak")])
    assert finding.ok == (not wrong)
    assert wrong in finding.text
    assert finding.code == (DiagnosticCode.INTRINSICS_DIFFER if wrong else "")


def test_the_doctor_compares_with_the_device_at_a_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cameras are connected, and the path of the port does not name the maker."""
    monkeypatch.setitem(sys.modules, "pyrealsense2", library("123", "456"))
    node = tmp_path / "usb" / "1-2" / "1-2:1.0" / "video4linux" / "video5"
    node.mkdir(parents=True)
    (node / "name").write_text("Intel(R) RealSense(TM) Depth Ca\n")
    (node / "device").symlink_to(node.parents[1])
    (node.parents[2] / "serial").write_text(board_serial("123") + "\n")
    (tmp_path / "port").symlink_to("/dev/video5")
    configured = replace(camera(383.0), device=str(tmp_path / "port"))
    (finding,) = intrinsics_check.intrinsics_findings([configured], node.parent)
    assert "RealSense 123 reports other values" in finding.text
    (node / "name").write_text("a webcam\n")
    assert list(intrinsics_check.intrinsics_findings([configured], node.parent)) == []


def test_without_the_library_nothing_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(intrinsics_check.importlib.util, "find_spec", lambda name: None)
    assert list(intrinsics_check.intrinsics_findings([camera(383.0)])) == []


@pytest.mark.parametrize("name", ["v4l2", "zed"])
def test_the_template_s_intrinsics_are_refused(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    shipped = Path(__file__).resolve().parents[3] / "configs" / f"{name}.toml"
    assert main(["check-config", str(shipped)]) == 1
    output = capsys.readouterr()
    assert "usable" not in output.out
    assert f"configs/{name}.toml" in output.err
