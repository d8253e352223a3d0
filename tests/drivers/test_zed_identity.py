"""The calibration file of another ZED, by its name and the serial number of the connected camera."""

from __future__ import annotations

import functools
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.base import BadData
from drivers.cameras import row_alignment, zed_uvc
from drivers.cameras.video_identity import VideoIdentity
from drivers.cameras.zed_calibration import parse_zed_calibration
from drivers.cameras.zed_identity import refuse_other_calibration
from drivers.cameras.zed_uvc import ZedSource

from .test_zed import SETTINGS, after_opening
from .zed_images import CALIBRATION, NEW, side_by_side

ZED2 = VideoIdentity("2b03:f780", "ZED 2", "OV0001")
VIDEO, SENSORS, OTHER_SENSORS = ("2b03", "f780", "OV0001"), ("2b03", "f781", "37612345"), ("2b03", "f781", "12345678")
MINI_SENSORS, INTEL = ("2b03", "f681", "12345678"), ("8086", "f781", "12345678")


def usb(folder: Path, *devices: tuple[str, str, str]) -> Path:
    """A tree as below /sys/bus/usb/devices: vendor, product and serial number of each."""
    shutil.rmtree(folder / "usb", ignore_errors=True)
    for k, stated in enumerate(devices):
        device = folder / "usb" / f"1-{k}"
        device.mkdir(parents=True)
        for name, text in zip(("idVendor", "idProduct", "serial"), stated, strict=True):
            (device / name).write_text(f"{text}\n")
    return folder / "usb"


@pytest.mark.parametrize(
    ("devices", "calibration", "refused"),
    [
        ([VIDEO, SENSORS], "SN37612345.conf", False),
        ([VIDEO, SENSORS], "SN037612345.CONF", False),
        ([VIDEO, OTHER_SENSORS], "SN37612345.conf", True),
        ([VIDEO, OTHER_SENSORS], "front.conf", False),
        ([VIDEO], "SN37612345.conf", False),
        ([], "SN37612345.conf", False),
        ([VIDEO, VIDEO, SENSORS, OTHER_SENSORS], "SN37612345.conf", False),
        ([VIDEO, VIDEO, SENSORS, OTHER_SENSORS], "SN55555555.conf", True),
        ([VIDEO, VIDEO, OTHER_SENSORS], "SN37612345.conf", False),
        ([VIDEO, MINI_SENSORS], "SN37612345.conf", False),
        ([VIDEO, INTEL], "SN37612345.conf", False),
    ],
    ids=[
        "the connected one",
        "leading zeros",
        "another one",
        "a file without a number",
        "sensors not there yet",
        "nothing stated",
        "one of two",
        "none of two",
        "sensors of one of two are missing",
        "sensors of another model",
        "another maker",
    ],
)
def test_a_file_of_another_camera_is_refused(
    devices: list[tuple[str, str, str]], calibration: str, refused: bool, tmp_path: Path
) -> None:
    def check() -> None:
        refuse_other_calibration("front", Path("/etc") / calibration, ZED2, usb(tmp_path, *devices))

    if not refused:
        check()
        return
    with pytest.raises(BadData, match=r"camera front: /etc/SN\d+.conf is the calibration of another ZED"):
        check()


@pytest.mark.parametrize(
    ("product", "baseline_mm", "refused"),
    [
        ("f780", 119.9, False),
        ("f780", 63.0, True),
        ("f682", 63.0, False),
        ("f682", 119.9, True),
        ("f582", 63.0, True),
        ("f880", 119.9, False),
        ("ff00", 63.0, False),
    ],
)
def test_the_calibration_of_another_model_is_refused(product: str, baseline_mm: float, refused: bool) -> None:
    """Its rows fit: with the file of a ZED 2 all depths of a ZED Mini were twice the true ones."""
    calibration = parse_zed_calibration(
        NEW.replace("Baseline=119.9", f"Baseline={baseline_mm}"), "front.conf", 672, 376
    )
    video = after_opening(side_by_side())
    video.identity = VideoIdentity(f"2b03:{product}", "ZED", "OV0001")
    source = ZedSource(replace(SETTINGS, calibration=Path("front.conf")), video, calibration)
    if not refused:
        source.open()
        source.close()
        return
    with pytest.raises(
        BadData, match=rf"front\.conf has a baseline of {baseline_mm:.0f} mm, the connected ZED \(2b03:{product}\)"
    ):
        source.open()
    assert video.closed == 1


def test_a_first_zed_beside_a_zed_2_is_not_compared(tmp_path: Path) -> None:
    """It has no sensors."""
    first = VideoIdentity("2b03:f582", "ZED", "OV0001")
    devices = usb(tmp_path, ("2b03", "f582", "OV0001"), VIDEO, OTHER_SENSORS)
    refuse_other_calibration("front", Path("SN1234.conf"), first, devices)


def test_another_zed_at_the_port_is_refused_also_if_its_sensors_appear_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rows may fit, and its video device states the same as that of the former one: it was used with the other calibration."""
    devices = usb(tmp_path, VIDEO)
    check = functools.partial(refuse_other_calibration, usb=devices)
    monkeypatch.setattr(zed_uvc, "refuse_other_calibration", check)
    for name in ("CHECK_SOON_NS", "CHECK_AGAIN_NS"):
        monkeypatch.setattr(row_alignment, name, 0)
    video = after_opening(side_by_side(), side_by_side(), side_by_side())
    source = ZedSource(replace(SETTINGS, calibration=Path("SN37612345.conf")), video, CALIBRATION)
    source.open()
    assert source.read(1.0) is not None
    assert source.read(1.0) is not None
    usb(tmp_path, VIDEO, OTHER_SENSORS)
    with pytest.raises(BadData, match="the connected one has the serial number 12345678; connect the other one"):
        source.read(1.0)
    source.close()
    with pytest.raises(BadData, match=r"SN37612345\.conf is the calibration of another ZED"):
        ZedSource(replace(SETTINGS, calibration=Path("SN37612345.conf")), after_opening(), CALIBRATION).open()
