"""Each kind of live camera is complete: it has a source, and a shipped configuration that agrees with its entry."""

from __future__ import annotations

import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

import pytest

from companion.cameras.factory import MAKERS, make_source
from companion.config.camera import CameraConfig
from companion.config.camera_kinds import CAMERA_KINDS, RECORDED, live_kinds
from companion.config.loader import ConfigError, config_of, load_config
from companion.setup.configuration import Answers, configuration_text
from core.types import Intrinsics
from drivers.cameras.realsense_calibration import DepthCalibration

CONFIGS = Path(__file__).resolve().parents[3] / "configs"


def test_each_kind_has_a_source_and_a_recording_has_none() -> None:
    assert set(MAKERS) == set(CAMERA_KINDS)
    assert RECORDED not in CAMERA_KINDS


@pytest.mark.parametrize("kind", CAMERA_KINDS)
def test_the_shipped_configuration_of_a_kind_is_what_setup_writes(kind: str) -> None:
    (camera,) = load_config(CONFIGS / f"{kind}.toml").cameras
    known = CAMERA_KINDS[kind]
    assert camera.kind == kind
    assert (camera.width_px, camera.height_px, camera.fps) == (known.width_px, known.height_px, known.fps)
    if camera.max_range_m is not None:
        assert camera.max_range_m == known.max_range_m
    assert known.clear_m < known.max_range_m


@pytest.mark.parametrize("kind", CAMERA_KINDS)
def test_setup_sets_each_key_that_the_shipped_configuration_sets(kind: str) -> None:
    """It left out exposure_latency_s: stamps of a RealSense were 15 ms late, those of a ZED 20 ms."""
    (shipped,) = load_config(CONFIGS / f"{kind}.toml").cameras
    measured = DepthCalibration(
        intrinsics=Intrinsics(width=640, height=480, fx=383, fy=383, cx=320, cy=240),
        depth_unit_mm=1.0,
        emitter=None,
        serial="",
    )
    answers = Answers(kind=kind, device=shipped.device, calibration_file=shipped.calibration, calibration=measured)
    (written,) = config_of(tomllib.loads(configuration_text(answers)), "my.toml").cameras
    asked = {"roll_deg", "pitch_deg", "yaw_deg", "x_m", "y_m", "z_m", "max_range_m"}
    names = {f.name for f in fields(CameraConfig)} - asked
    assert {n: getattr(written, n) for n in names} == {n: getattr(shipped, n) for n in names}


@pytest.mark.parametrize(("kind", "key"), [(k, key) for k, known in CAMERA_KINDS.items() for key in known.needs])
def test_a_kind_needs_each_of_its_keys(kind: str, key: str) -> None:
    given = dict.fromkeys(CAMERA_KINDS[kind].needs, 400.0) | {"device": "/dev/video0", "calibration": "SN1.conf"}
    given = {name: value for name, value in given.items() if name in CAMERA_KINDS[kind].needs and name != key}
    with pytest.raises(ConfigError, match=f'"front" of kind "{kind}" needs {key}'):
        config_of({"camera": [{"name": "front", "kind": kind, **given}]}, "my.toml")


@pytest.mark.parametrize(
    ("kind", "given", "refused"),
    [
        ("zed", {"width_px": 672, "disparities": 512}, False),
        ("oak", {"width_px": 320, "disparities": 310, "match_on": "host"}, True),
        ("oak", {"width_px": 320, "disparities": 304, "match_on": "host"}, False),
        ("oak", {"width_px": 320, "disparities": 512}, False),
        ("simulated", {"width_px": 64, "render": "stereo"}, True),
        ("simulated", {"width_px": 64}, False),
    ],
)
def test_a_search_as_wide_as_the_image_is_refused(kind: str, given: dict[str, object], refused: bool) -> None:
    """No pixel could have a depth, and the process of the camera crashed."""
    needed = {"device": "/dev/video0", "calibration": "SN1.conf"} if kind == "zed" else {}
    camera = {"name": "front", "kind": kind, **needed, **given}
    if not refused:
        config_of({"camera": [camera]}, "my.toml")
        return
    with pytest.raises(
        ConfigError, match=r"disparities = \d+, rounded up to a multiple of 16, must be less than width_px"
    ):
        config_of({"camera": [camera]}, "my.toml")


def test_messages_name_all_kinds() -> None:
    assert live_kinds().replace(" or ", ", ").split(", ") == list(CAMERA_KINDS)
    assert " or " in live_kinds()


class _Watched(CameraConfig):
    """Notes the keys that are read."""

    read: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        _Watched.read.add(name)
        return super().__getattribute__(name)


@pytest.mark.parametrize("kind", CAMERA_KINDS)
def test_a_source_reads_the_keys_of_its_kind_and_of_no_other(kind: str) -> None:
    given: dict[str, Any] = {"device": "/dev/video9", "calibration": "SN1.conf"}
    given |= dict.fromkeys(("fx_px", "fy_px", "cx_px", "cy_px"), 400.0)
    section = _Watched(name="front", kind=kind, match_on="host", **given)
    _Watched.read.clear()
    make_source(section)
    own = {key for k in CAMERA_KINDS.values() for key in k.own_keys}
    assert _Watched.read & own == set(CAMERA_KINDS[kind].own_keys)
