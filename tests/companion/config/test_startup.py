"""What the service refuses is refused by every command that examines a configuration, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.cli import main
from companion.config.loader import ConfigError, config_of, load_config
from companion.config.startup import startup_problems
from companion.install.install import config_step
from companion.install.steps import install_paths
from companion.live.run import check_live

CAMERA = '[[camera]]\nname = "front"\nkind = "simulated"\n'
OPEN = CAMERA + '[publish]\nprisms = "tcp://0.0.0.0:5600"\n'
TEXT = "stream prisms: tcp://0.0.0.0:5600 can be reached from other machines and needs keys: make them with `companion keys`"


@pytest.mark.parametrize("address", ["tcp://0.0.0.0:5600", "tcp://*:5600", "tcp://vehicle:5600", "tcp://[::]:5600"])
def test_a_stream_that_others_can_reach_needs_keys(address: str) -> None:
    """check-config called the file usable, and the service ended at each start."""
    content = {"publish": {"prisms": address}}
    (problem,) = startup_problems(config_of(content, "x"))
    assert problem == TEXT.replace("tcp://0.0.0.0:5600", address) + " and set their directory in [publish] keys"
    content["publish"]["keys"] = "/etc/osape-companion/keys"
    assert startup_problems(config_of(content, "x")) == []


@pytest.mark.parametrize(
    ("stream", "opened_by"),
    [
        ("surround", {"camera": [{"name": "a"}, {"name": "b"}]}),
        ("tracks", {"tracking": {"enabled": True}}),
        (
            "neighbours",
            {
                "autopilot": {"address": "udpin:127.0.0.1:14540"},
                "share": {"enabled": True, "tunnel": "autopilot"},
                "publish": {"world": "ipc://{run}/w", "world_requests": "ipc://{run}/r"},
            },
        ),
    ],
)
def test_a_stream_that_is_not_opened_needs_no_keys(stream: str, opened_by: dict[str, dict[str, object]]) -> None:
    address = {stream: "tcp://0.0.0.0:5600"}
    assert startup_problems(config_of({"publish": address}, "x")) == []
    opened = opened_by | {"publish": opened_by.get("publish", {}) | address}
    assert len(startup_problems(config_of(opened, "x"))) == 1


def test_each_command_refuses_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path := tmp_path / "my.toml").write_text(OPEN)
    assert main(["check-config", str(path)]) == 1
    assert TEXT in capsys.readouterr().err
    with pytest.raises(ConfigError, match="needs keys"):
        check_live(load_config(path), path)
    assert main(["doctor", "-c", str(path), "--patience", "0.1"]) == 1
    assert TEXT in "".join(capsys.readouterr())
    (tmp_path / "image" / "etc" / "osape-companion").mkdir(parents=True)
    paths = install_paths(tmp_path / "image")
    with pytest.raises(ConfigError, match="needs keys"):
        config_step(paths, path, False)
    paths.config.write_text(OPEN)
    with pytest.raises(ConfigError, match=f"{paths.config}: 1 mistake\n.* needs keys"):
        config_step(paths, None, False)


def test_a_recording_as_camera_is_not_installed(tmp_path: Path) -> None:
    """kind was forgotten in the second camera: the service ended at each start."""
    (path := tmp_path / "my.toml").write_text(CAMERA + '[[camera]]\nname = "rear"\n')
    (tmp_path / "image" / "etc").mkdir(parents=True)
    with pytest.raises(ConfigError, match='"rear": kind = "mcap" is a recording, not a camera'):
        config_step(install_paths(tmp_path / "image"), path, False)


def test_a_range_that_no_camera_has_is_named_with_its_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """check-config ended with "camera info: range 10..10 m", without file, camera or remedy."""
    (path := tmp_path / "my.toml").write_text(
        '[[camera]]\nname = "front"\nkind = "v4l2"\ndevice = "/dev/v4l/by-id/x"\nmin_range_m = 10\n'
        "fx_px = 380\nfy_px = 380\ncx_px = 320\ncy_px = 240\n"
    )
    assert main(["check-config", str(path), "--json"]) == 1
    error = capsys.readouterr().err
    assert f'{path}: [[camera]] "front": ' in error
    assert "set both, min_range_m less than max_range_m" in error
