"""`companion check-config`: its words, its object and its exit status."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from companion.cli import main
from companion.config.loader import ConfigError
from companion.install.install import config_step
from companion.install.steps import install_paths

ROOT = Path(__file__).resolve().parents[3]
EYE = "fx=350\nfy=350\ncx=336\ncy=188\nk1=0\nk2=0\np1=0\np2=0\n"
CALIBRATION = f"[LEFT_CAM_VGA]\n{EYE}[RIGHT_CAM_VGA]\n{EYE}[STEREO]\nBaseline=120\nCV_VGA=0.01\nRX_VGA=0\nRZ_VGA=0\n"
"""Of a ZED."""


def call(*arguments: str) -> int:
    return main(["check-config", *arguments])


def test_a_usable_file_is_called_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(ROOT / "configs" / "indoor.toml")) == 0
    out = capsys.readouterr().out
    assert "usable" in out
    assert "safety key: [extractor] min_obstacle_height_m = 0.2 m (default 0.6 m)" in out


def test_json_of_a_usable_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(ROOT / "configs" / "default.toml"), "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "file": str(ROOT / "configs" / "default.toml"),
        "ok": True,
        "problems": [],
        "lacks_for_run": ["a [[camera]] of a live kind", "[autopilot] address"],
        "warnings": [],
        "changes": {},
    }


@pytest.mark.parametrize(
    ("text", "lacks"),
    [
        ("", "a [[camera]] of a live kind and [autopilot] address"),
        ("# [[camera]]\n", "a [[camera]] of a live kind and [autopilot] address"),
        ('[autopilot]\naddress = "udpin:127.0.0.1:14540"\n', "a [[camera]] of a live kind"),
        ('[[camera]]\nname = "front"\nkind = "simulated"\n', "[autopilot] address"),
        (
            '[autopilot]\naddress = "udpin:127.0.0.1:14540"\n[[camera]]\nname = "front"\nkind = "simulated"\n'
            '[[camera]]\nname = "rear"\n',
            "a live kind of [[camera]] rear",
        ),
    ],
)
def test_what_a_service_would_wait_for_is_named(
    text: str, lacks: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An empty file was called usable."""
    (path := tmp_path / "my.toml").write_text(text)
    assert call(str(path)) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first == f"{path}: usable for `companion replay`"
    assert second == f"  for `companion run` it lacks {lacks}; `companion setup` writes a complete one"


def test_a_complete_file_lacks_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    path = ROOT / "configs" / "simulated.toml"
    assert call(str(path)) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{path}: usable\n")
    assert "lacks" not in out


@pytest.mark.parametrize("name", ["simulated", "simulated.toml", "configs/simulated.toml"])
@pytest.mark.parametrize("command", ["check-config", "doctor -c"])
def test_a_shipped_configuration_that_is_not_here_is_named_with_the_command_that_copies_it(
    command: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), name]) == 1
    assert (
        "cannot be read (No such file or directory); simulated is a shipped configuration: `companion configs simulated` "
        "copies it to simulated.toml\n"
    ) in capsys.readouterr().err


def test_a_directory_is_no_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(tmp_path)) == 1
    assert "cannot be read (Is a directory); give the TOML file in it" in capsys.readouterr().err


EVERY_SECTION = """
[extractor]
column_step = 2
[expert]
max_flying_share = 0.9
link_gap_px = 5
[sync]
max_gap_s = 0.2
[output]
scene = false
[avoid]
clear_share = 0.5
silence_s = 9.0
points = true
[autopilot]
attitude_hz = 50.0
[publish]
depth = ""
[world]
free_age_s = 120.0
[record]
zstd_level = 3
[supervision]
frozen_frames = 100
[service]
timeout_s = 0.25
[[camera]]
name = "front"
kind = "oak"
required = false
pitch_deg = -10.0
"""


def test_every_section_is_compared_and_safety_keys_are_marked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "all.toml"
    path.write_text(EVERY_SECTION)
    assert call(str(path)) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    marked = [
        "[extractor] column_step = 2 (default 1)",
        "[expert] max_flying_share = 0.9 (default 0.03)",
        "[sync] max_gap_s = 0.2 s (default 0.15 s)",
        '[[camera]] "front" required = false (default true)',
        "[avoid] clear_share = 0.5 (default 0.8)",
        "[avoid] silence_s = 9 s (default 2 s)",
        "[world] free_age_s = 120 s (default 60 s)",
        "[supervision] frozen_frames = 100 (default 4)",
        "[service] timeout_s = 0.25 s (default 0.3 s)",
    ]
    plain = [
        "[expert] link_gap_px = 5 px (default 4 px)",
        "[output] scene = false (default true)",
        '[[camera]] "front" kind = "oak" (default "mcap")',
        '[[camera]] "front" pitch_deg = -10 deg (default: as the camera or the recording has it)',
        "[avoid] points = true (default false)",
        "[autopilot] attitude_hz = 50 Hz (default 100 Hz)",
        '[publish] depth = "" (default "ipc://{run}/depth")',
        "[record] zstd_level = 3 (default -1)",
    ]
    assert {line for line in lines if line.startswith("[")} == set(plain)
    assert {line.removeprefix("safety key: ") for line in lines if line.startswith("safety key: ")} == set(marked)


def test_json_holds_every_difference_with_its_mark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "all.toml"
    path.write_text(EVERY_SECTION)
    assert call(str(path), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["changes"]["avoid"]["clear_share"] == {"value": 0.5, "default": 0.8, "unit": "", "safety": True}
    assert printed["changes"]["camera front"]["pitch_deg"] == {
        "value": -10.0,
        "default": None,
        "unit": "deg",
        "safety": False,
    }
    assert set(printed["changes"]) == {
        "extractor", "expert", "sync", "output", "avoid", "autopilot", "publish", "world", "record", "supervision", "service",
        "camera front",
    }  # fmt: skip


def test_a_changed_value_of_a_retired_key_is_refused_by_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "old.toml"
    path.write_text("[expert]\nnoise_hold = 0.5\n")
    errors = []
    for arguments in (["check-config", str(path)], ["doctor", "-c", str(path)]):
        assert main(arguments) == 1
        errors.append(capsys.readouterr().err)
    command = [sys.executable, "-m", "companion", "run", "-c", str(path)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert ran.returncode == 1
    errors.append(ran.stderr)
    (tmp_path / "image" / "etc").mkdir(parents=True)
    with pytest.raises(ConfigError) as refused:
        config_step(install_paths(tmp_path / "image"), path, False)
    errors.append(str(refused.value))
    for error in errors:
        assert str(path) in error
        assert "[expert] noise_hold = 0.5 is not available any more" in error
        assert "Remove the line" in error


def test_deeply_nested_files_are_refused_with_a_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("a = " + "[" * 20_000 + "]" * 20_000, "[extractor]\nnoise_quantile" + ".a" * 5_000 + " = 1\n"):
        path = tmp_path / "deep.toml"
        path.write_text(text)
        assert call(str(path)) == 1
        error = capsys.readouterr().err
        assert str(path) in error
        assert "nested" in error
        assert len(error) < 1000


def test_mistakes_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[extractor]\npassable_hight_m = 1.0\n")
    assert call(str(bad), "--json") == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)["ok"] is False
    assert "did you mean passable_height_m?" in captured.err


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('[autopilot]\naddress = "com3"\n', "[autopilot] address"),
        ('[autopilot]\naddress = "udpin:0.0.0.0:70000"\n', "[autopilot] address"),
        ('[share]\ntunnel = "com3"\n', "[share] tunnel"),
    ],
)
def test_an_address_that_the_service_would_refuse_is_refused(
    text: str, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The unit would start again and again."""
    file = tmp_path / "my.toml"
    file.write_text('[[camera]]\nname = "front"\nkind = "simulated"\n' + text)
    assert main(["check-config", str(file)]) == 1
    error = capsys.readouterr().err
    assert key in error
    assert "expected serial:/dev/serial/by-id/NAME[:BAUD], udpin:HOST:PORT" in error


def test_an_installation_without_a_camera_is_announced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path := tmp_path / "empty.toml").touch()
    (tmp_path / "image" / "etc").mkdir(parents=True)
    config_step(install_paths(tmp_path / "image"), path, False)
    assert f"{path} lacks a [[camera]] of a live kind and [autopilot] address" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("size", "file", "text"),
    [
        ("width_px = 672\nheight_px = 376", "", ""),
        ("", "", "no calibration for 640x480; a ZED delivers 2208x1242, 1920x1080, 1280x720, 672x376 per eye"),
        ("width_px = 672\nheight_px = 376", "SN8.conf", "SN8.conf: No such file or directory; download the camera's"),
    ],
    ids=["usable", "the size of another camera", "missing"],
)
def test_a_calibration_that_does_not_fit_is_announced(
    size: str, file: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file was called usable, and the camera did not open. It may be for another computer, so it is not refused."""
    calibration = tmp_path / "SN7.conf"
    calibration.write_text(CALIBRATION)
    config = tmp_path / "zed.toml"
    config.write_text(
        f'[[camera]]\nname = "front"\nkind = "zed"\ndevice = "/dev/video5"\n{size}\n'
        f'calibration = "{tmp_path / (file or calibration.name)}"\n'
    )
    assert call(str(config)) == 0
    printed = capsys.readouterr()
    assert "usable" in printed.out
    assert text in printed.err
    assert bool(printed.err) == bool(text)


@pytest.mark.parametrize("name", ["indoor", "oak", "two-cameras", "simulated", "default"])
def test_the_keys_of_the_shipped_configurations_are_used(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(ROOT / "configs" / f"{name}.toml")) == 0
    assert "does not use" not in capsys.readouterr().err


def test_keys_of_another_kind_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They had no effect, without a word."""
    (path := tmp_path / "my.toml").write_text(
        '[[camera]]\nname = "front"\nkind = "oak"\ndepth_unit_mm = 0.1\nflight = "street"\nconfidence = 100\n'
        '[[camera]]\nname = "rear"\ndepth_unit_mm = 0.1\n'
    )
    assert call(str(path)) == 0
    error = capsys.readouterr().err
    text = '[[camera]] "front": kind "oak" does not use flight, depth_unit_mm; remove that, or correct kind'
    assert f"{text}\n" in error
    assert call(str(path), "--json") == 0
    assert text in json.loads(capsys.readouterr().out)["warnings"]
    assert "rear" not in error


def test_missing_files_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file was called usable, and the service did not start. It may be for another computer, so it is not refused."""
    (path := tmp_path / "my.toml").write_text(
        f'[autopilot]\nsigning_key = "{tmp_path}/signing.key"\n[publish]\nkeys = "{tmp_path}"\n'
    )
    assert call(str(path)) == 0
    error = capsys.readouterr().err
    assert (
        f'[autopilot] signing_key = "{tmp_path}/signing.key" does not exist on this computer; make or copy it' in error
    )
    assert "keys =" not in error
