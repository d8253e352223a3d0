"""`companion demo`: everything it promises is there, the words are a newcomer's, the same run gives the same logs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from companion.cli import main
from companion.config import Config, load_config
from companion.config_live import AutopilotConfig
from companion.demo import CAMERA, DemoOptions, simulated_flight
from companion.warmup import run_kernels
from core.types import DepthFrame

from .recordings import events_of

ROOT = Path(__file__).resolve().parents[2]


def test_the_demo_makes_what_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # the kernels are compiled here, as those of all other tests, and not in a child process of another start
    monkeypatch.setattr("companion.demo.warm_up", run_kernels)
    out = tmp_path / "out"
    assert main(["demo", "--fast", "--frames", "4", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    for name in ("view/flight.html", "prisms.mcap", "flight.mcap", "view/*.png"):
        assert name in said
    assert "vertical planes" in said
    assert (out / "view" / "flight.html").stat().st_size > 10_000
    assert len(list((out / "view").glob("*.png"))) >= 4
    frames = [e for e in events_of(out / "flight.mcap") if isinstance(e, DepthFrame)]
    assert len(frames) == 4
    assert frames[0].depth_mm.shape == (240, 320)
    logs = [(out / name).read_bytes() for name in ("flight.mcap", "prisms.mcap")]
    assert main(["demo", "--fast", "--frames", "4", "-o", str(out), "--json"]) == 0
    object_said = json.loads(capsys.readouterr().out)
    assert object_said["frames"] == 4
    assert object_said["problems"] == []
    assert logs == [(out / name).read_bytes() for name in ("flight.mcap", "prisms.mcap")]


def test_the_embedded_default_is_the_shipped_file() -> None:
    shipped = load_config(ROOT / "configs" / "simulated.toml")
    # the demo needs no autopilot; the service that the file is for as well waits for one
    assert dataclasses.replace(shipped, autopilot=AutopilotConfig()) == Config(cameras=(CAMERA,))


def test_the_configuration_chooses_the_flight(tmp_path: Path) -> None:
    config = Config(
        cameras=(CAMERA.__class__(name="nose", kind="simulated", flight="alley", width_px=320, pitch_deg=-9),)
    )
    flight = simulated_flight(config, DemoOptions(frames=3))
    assert (flight.plan.name, flight.frame_count()) == ("alley", 3)
    assert flight.cameras[0].camera == "nose"
    assert flight.cameras[0].intrinsics.height == 240
    assert flight.cameras[0].mount.pitch_rad < -0.1


@pytest.mark.parametrize("words", [["--frames", "0"], ["--frames", "many"]])
def test_wrong_use(words: list[str]) -> None:
    assert main(["demo", *words]) == 2


def test_a_flight_that_does_not_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "c.toml"
    config.write_text('[[camera]]\nname = "front"\nkind = "simulated"\nflight = "moon"\n')
    assert main(["demo", "-c", str(config), "-o", str(tmp_path / "out")]) == 1
    assert "no flight 'moon'; there are: demo, street" in capsys.readouterr().err
