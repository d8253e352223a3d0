"""Configurations in which a camera could open the device of another one, or a recording as a camera."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.cli import main
from companion.config.loader import ConfigError, config_of
from companion.live.run import check_live

BY_ID = "/dev/v4l/by-id/usb-Intel_R__RealSense_TM__Depth_Camera_435_"
ZED_BY_ID = "/dev/v4l/by-id/usb-Technologies__Inc._ZED_2i_OV0001-video-index0"
V4L2 = {"kind": "v4l2", "fx_px": 384.1, "fy_px": 384.1, "cx_px": 321.0, "cy_px": 239.0}
ZED = {"kind": "zed", "calibration": "SN1.conf", "width_px": 672, "height_px": 376}


def problems(*cameras: dict[str, object]) -> str:
    """What `run` refuses of these cameras, empty: nothing."""
    sections = [{"name": name, **camera} for name, camera in zip(("front", "rear"), cameras, strict=False)]
    try:
        check_live(config_of({"camera": sections}, "my.toml"), Path("my.toml"))
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("cameras", "text"),
    [
        (({"kind": "oak"}, {"kind": "oak"}), '"front": device is empty, with 2 cameras of kind "oak" configured'),
        (({"kind": "oak", "device": "A"}, {"kind": "oak"}), '"rear": device is empty'),
        (({"kind": "oak", "device": "A"}, {"kind": "oak", "device": "A"}), 'front, rear: device = "A" occurs 2 times'),
        ((V4L2 | {"device": BY_ID + "1"}, V4L2 | {"device": BY_ID + "1"}), "occurs 2 times"),
        (
            (V4L2 | {"device": "/dev/video0"}, V4L2 | {"device": "/dev/video4"}),
            "may be another camera after each start",
        ),
        (
            (V4L2 | {"device": BY_ID + "1"}, ZED | {"device": "/dev/video4"}),
            '"rear": device = "/dev/video4" may be another',
        ),
        (
            (ZED | {"device": ZED_BY_ID}, ZED | {"device": "/dev/v4l/by-path/b"}),
            f'"front": device = "{ZED_BY_ID}" may be the other ZED after each connection',
        ),
        ((ZED | {"device": "flight.avi"},), "is no device but a file, whose images would count as taken now"),
        ((ZED | {"device": "/home/pilot/flight.avi"},), "is no device but a file"),
    ],
)
def test_cameras_that_cannot_be_told_apart_are_refused(cameras: tuple[dict[str, object], ...], text: str) -> None:
    assert text in problems(*cameras)


@pytest.mark.parametrize(
    "cameras",
    [
        ({"kind": "oak"},),
        ({"kind": "oak", "device": "A"}, {"kind": "oak", "device": "B"}),
        ({"kind": "oak"}, V4L2 | {"device": "/dev/video0"}),
        (V4L2 | {"device": BY_ID + "1"}, V4L2 | {"device": BY_ID + "2"}),
        (V4L2 | {"device": "/dev/v4l/by-path/a"}, ZED | {"device": BY_ID + "2"}),
        (ZED | {"device": "/dev/v4l/by-path/a"}, ZED | {"device": "/dev/v4l/by-path/b"}),
        ({"kind": "simulated"}, {"kind": "simulated"}),
    ],
)
def test_cameras_that_can_be_told_apart_are_accepted(cameras: tuple[dict[str, object], ...]) -> None:
    assert problems(*cameras) == ""


def test_a_log_with_such_cameras_can_still_be_replayed() -> None:
    """The configuration is one; only a service refuses it."""
    assert len(config_of({"camera": [{"name": n, "kind": "oak"} for n in ("a", "b")]}, "log").cameras) == 2


def test_check_config_and_the_doctor_report_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "two.toml"
    path.write_text("".join(f'[[camera]]\nname = "{n}"\nkind = "oak"\n' for n in ("front", "rear")))
    assert main(["check-config", str(path)]) == 1
    assert "device is empty, with 2 cameras" in "".join(capsys.readouterr())
    assert main(["doctor", "-c", str(path), "--patience", "0.1"]) == 1
    assert "device is empty, with 2 cameras" in "".join(capsys.readouterr())
