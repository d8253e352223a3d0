"""Another camera at the same port is not taken for the configured one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.camera import CameraConfig
from drivers.base import BadData
from drivers.cameras import whole_buffers
from drivers.cameras.v4l2_depth import V4l2Source
from drivers.cameras.video_identity import VideoIdentity, check_serial, video_identity

from .test_v4l2_depth import SETTINGS, FakeStream

D435 = VideoIdentity("8086:0b07", "Intel(R) RealSense(TM) Depth Camera 435", "843112071234")


@pytest.fixture
def null() -> Iterator[int]:
    """An open character device: 1:3 in every Linux."""
    descriptor = os.open("/dev/null", os.O_RDONLY)
    yield descriptor
    os.close(descriptor)


def tree(folder: Path, stated: dict[str, str]) -> Path:
    """As below /sys: the interface of a video device lies in the folder of its USB device."""
    usb = folder / "devices" / "usb2" / "2-1"
    interface = usb / "2-1:1.0"
    (interface / "video4linux" / "video0").mkdir(parents=True)
    (interface / "video4linux" / "video0" / "device").symlink_to(interface)
    for name, text in stated.items():
        (usb / name).write_text(f"{text}\n")
    (folder / "char").mkdir()
    (folder / "char" / "1:3").symlink_to(interface / "video4linux" / "video0")
    return folder / "char"


def test_the_usb_device_behind_an_open_file_is_found(null: int, tmp_path: Path) -> None:
    stated = {"idVendor": "8086", "idProduct": "0b07", "product": D435.product, "serial": D435.serial}
    assert video_identity(null, tree(tmp_path, stated)) == D435
    assert str(D435) == "Intel(R) RealSense(TM) Depth Camera 435 (8086:0b07) serial 843112071234"


def test_a_device_that_states_nothing_has_no_identity(null: int, tmp_path: Path) -> None:
    found = video_identity(null, tree(tmp_path, {}))
    assert (found, str(found)) == (VideoIdentity(), "")
    assert str(video_identity(null, tmp_path / "none")) == ""
    with (tmp_path / "a file").open("w") as file:
        assert str(video_identity(file.fileno())) == ""


@pytest.mark.parametrize("serial", ["", "843112071234", "0843112071234"])
def test_the_configured_camera_is_accepted(serial: str) -> None:
    check_serial("front", "/dev/video0", serial, D435)


def test_a_camera_without_a_serial_number_is_not_one_of_zeros() -> None:
    """Some makers leave the number at zeros: it was equal to none."""
    check_serial("front", "/dev/video0", "0000", replace(D435, serial="0000"))
    with pytest.raises(BadData, match="without a serial number"):
        check_serial("front", "/dev/video0", "0000", replace(D435, serial=""))


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (replace(D435, serial="999"), r"is Intel.* serial 999, serial = '843112071234' is configured; connect"),
        (replace(D435, serial=""), r"is Intel.* without a serial number, serial = '843112071234' is configured"),
        (VideoIdentity(), r"is a camera without a serial number, serial = '843112071234'"),
    ],
)
def test_another_camera_at_the_port_is_refused_and_closed(
    found: VideoIdentity, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was used with the intrinsics and the mount of the configured one."""
    monkeypatch.setattr(whole_buffers, "video_identity", lambda descriptor: found)
    stream = FakeStream()
    source = V4l2Source(replace(SETTINGS, serial=D435.serial), stream)
    with pytest.raises(BadData, match=text):
        source.open()
    assert stream.closed == 1
    assert source.identity == ""


D405 = VideoIdentity("8086:0b5b", "Intel(R) RealSense(TM) Depth Camera 405", "130322270000")


@pytest.mark.parametrize(("unit_mm", "refused"), [(1.0, True), (0.11, True), (0.1, False), (0.05, False)])
def test_a_camera_with_a_smaller_depth_unit_than_the_configured_one_is_refused(
    unit_mm: float, refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the default of the configuration a wall at 0.5 m before a D405 was measured at 5 m, and the way to it free."""
    monkeypatch.setattr(whole_buffers, "video_identity", lambda descriptor: D405)
    stream = FakeStream()
    source = V4l2Source(replace(SETTINGS, depth_unit_mm=unit_mm), stream)
    if not refused:
        source.open()
        source.close()
        return
    with pytest.raises(BadData, match=r"Camera 405 .* measures in units of 0\.1 mm, .*Set depth_unit_mm = 0\.1;"):
        source.open()
    assert stream.closed == 1


def test_a_serial_that_no_driver_compares_is_an_error() -> None:
    with pytest.raises(ValueError, match='serial is for kind "v4l2"; remove it'):
        CameraConfig(name="front", kind="oak", serial="843112071234")


def test_an_opened_camera_states_its_identity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_buffers, "video_identity", lambda descriptor: D435)
    source = V4l2Source(replace(SETTINGS, serial=D435.serial), FakeStream())
    source.open()
    assert source.identity == str(D435)
    source.close()
