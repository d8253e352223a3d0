"""Each kind of live camera is complete: it has a source, and a shipped configuration that agrees with its entry."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.cameras.factory import MAKERS
from companion.config.camera_kinds import CAMERA_KINDS, RECORDED, live_kinds
from companion.config.loader import ConfigError, config_of, load_config

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


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


@pytest.mark.parametrize(("kind", "key"), [(k, key) for k, known in CAMERA_KINDS.items() for key in known.needs])
def test_a_kind_needs_each_of_its_keys(kind: str, key: str) -> None:
    given = dict.fromkeys(CAMERA_KINDS[kind].needs, 400.0) | {"device": "/dev/video0", "calibration": "SN1.conf"}
    given = {name: value for name, value in given.items() if name in CAMERA_KINDS[kind].needs and name != key}
    with pytest.raises(ConfigError, match=f'"front" of kind "{kind}" needs {key}'):
        config_of({"camera": [{"name": "front", "kind": kind, **given}]}, "my.toml")


def test_messages_name_all_kinds() -> None:
    assert live_kinds().replace(" or ", ", ").split(", ") == list(CAMERA_KINDS)
    assert " or " in live_kinds()
