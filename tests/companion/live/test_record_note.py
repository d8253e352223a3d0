"""What a service says of its recording, and which configuration it takes without `-c`."""

from __future__ import annotations

from pathlib import Path

import pytest

import companion.config.installed as installed
from companion.cli import main
from companion.config.camera import CameraConfig
from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.live.record_note import RecordRate, record_note
from companion.log.recorder import RecordStatus
from companion.paths import Folders

NS = 1_000_000_000
HERE = Folders(Path("/run/x"), Path("/var/lib/x"))
CAMERA = CameraConfig(name="front", kind="oak", width_px=640, height_px=480, fps=30.0)


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (RecordParams(record="off"), ["nothing is recorded"]),
        (RecordParams(), ["/var/lib/x/logs always", "up to 1106 MB a minute", "budget_mb = 16384"]),
        (RecordParams(depth_hz=2.0), ["up to 74 MB a minute", "now 2 (0: every image)"]),
        (RecordParams(depth_hz=60.0), ["up to 1106 MB a minute"]),
        (
            RecordParams(depth=False, folder="/data", record="armed"),
            ["/data while the vehicle is armed", "without depth"],
        ),
    ],
)
def test_the_place_and_the_amount_are_stated(record: RecordParams, expected: list[str]) -> None:
    text = record_note(Config(cameras=(CAMERA,), record=record), HERE)
    for part in expected:
        assert part in text


def test_the_rate_is_measured_once() -> None:
    rate = RecordRate()
    on = RecordStatus(recording=True, file="/data/a.mcap.active", bytes=5_000_000)
    assert rate.note(RecordStatus(), 0) == ""
    assert rate.note(on, 10 * NS) == ""
    assert rate.note(on, 69 * NS) == ""
    later = RecordStatus(recording=True, file="/data/a.mcap.active", bytes=805_000_000)
    assert rate.note(later, 70 * NS) == "recorded 800 MB in the last minute, in /data"
    assert rate.note(later, 200 * NS) == ""


def test_a_pause_begins_the_measurement_anew() -> None:
    rate = RecordRate()
    on = RecordStatus(recording=True, file="/data/a.mcap.active", bytes=0)
    rate.note(on, 0)
    rate.note(RecordStatus(), 30 * NS)
    assert rate.note(on, 61 * NS) == ""


def test_without_a_configuration_the_commands_name_the_ways_to_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(installed, "INSTALLED", tmp_path / "config.toml")
    assert main(["doctor"]) == 1
    output = capsys.readouterr().err
    assert "companion setup" in output
    assert "companion configs" in output


def test_the_installed_configuration_is_the_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "INSTALLED", tmp_path / "config.toml")
    (tmp_path / "config.toml").write_text("")
    assert installed.config_path(None) == tmp_path / "config.toml"
    assert installed.config_path(Path("mine.toml")) == Path("mine.toml")
