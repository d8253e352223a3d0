"""Mistakes of the first hour: each is answered with its cause and a remedy."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from companion.cameras.status import CameraCondition, CameraStatus
from companion.cli import main
from companion.config.loader import ConfigError, config_of, load_config
from companion.config.sections import fields_of
from companion.live.staleness import StalenessMonitor
from drivers.simulation.flights import FLIGHTS

from ..small_recordings import START_NS

ROOT = Path(__file__).resolve().parents[3]


def problems_of(text: str) -> str:
    with pytest.raises(ConfigError) as error:
        config_of(tomllib.loads(text), "my.toml")
    return "\n".join(error.value.problems)


def test_the_service_does_not_run_with_the_configuration_of_a_recording() -> None:
    """It would open the recording again and again, and stay blind."""
    command = [sys.executable, "-m", "companion", "run", "-c", str(ROOT / "configs" / "default.toml")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 1
    assert '"front": kind = "mcap" is a recording' in ended.stderr
    assert "`companion setup`" in ended.stderr
    assert "`companion configs`" in ended.stderr


def test_an_unknown_flight_is_refused_when_the_configuration_is_read() -> None:
    text = problems_of('[[camera]]\nname = "front"\nkind = "simulated"\nflight = "demos"')
    assert "flight" in text
    assert '"by_hand"' in text


def test_the_configuration_knows_all_flights() -> None:
    flight = next(f for f in fields_of("camera") if f.name == "flight")
    assert set(flight.metadata["choices"]) == set(FLIGHTS)


def test_a_number_in_quotes_is_told_from_one_out_of_range() -> None:
    """ "2 m" is in the range that was named as the remedy."""
    text = problems_of('[extractor]\npassable_width_m = "2 m"')
    assert 'passable_width_m = "2 m": expected a number without quotes and unit, ' in text
    assert "without quotes" not in problems_of("[extractor]\npassable_width_m = -1.0")


def test_a_decimal_comma_is_named(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text("[service]\nhang_s = 10,0\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="decimals have a dot"):
        load_config(file)


def test_a_device_as_address_is_completed() -> None:
    text = problems_of('[autopilot]\naddress = "/dev/ttyACM0"')
    assert text == '[autopilot] address: "/dev/ttyACM0" is not an address; did you mean serial:/dev/ttyACM0?'
    assert "udpin:HOST:PORT" in problems_of('[autopilot]\naddress = "com3"')


@pytest.mark.parametrize(("word", "answer"), [("dmo", "did you mean `companion demo`?"), ("xyz", "`companion --help`")])
def test_a_mistyped_command_is_corrected(word: str, answer: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([word]) == 2
    assert answer in capsys.readouterr().err


def test_the_command_comes_before_its_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["-c", "my.toml", "run"]) == 2
    assert capsys.readouterr().err == "companion: error: options follow the command: companion run -c my.toml\n"


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("[extractor]\nmax_range_m = 12", "[extractor] max_range_m: belongs under [[camera]]"),
        ('kind = "oak"', "kind: belongs under [[camera]]; put it below that line"),
        (
            '[[camera]]\nname = "a"\npassable_width_m = 1',
            "[[camera]] number 1: passable_width_m: belongs under [extractor] or [world]",
        ),
        ("[share]\nsend = true", "[share] send: belongs under [avoid]"),
    ],
)
def test_a_key_of_another_section_is_named_with_its_own(text: str, answer: str) -> None:
    """The most similar key of the wrong section would mislead."""
    assert problems_of(text) == answer


def test_a_flight_log_is_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "flight.tlog"
    log.write_bytes(b"\0" * 100)
    assert main(["import", str(log), "-o", str(tmp_path / "out.mcap")]) == 1
    assert "without images; give the folder of the depth images" in capsys.readouterr().err


def test_a_camera_that_is_opened_again_and_again_has_one_cause() -> None:
    """Each change of the text is logged: a missing device filled the journal with a line per second."""
    seen = StalenessMonitor(("front",), 0.3)
    texts = {
        seen.cause(
            "front",
            START_NS,
            CameraStatus(
                camera="front", condition=condition, cause=cause, since_ns=0, last_loss="camera front: no OAK was found"
            ),
        )
        for condition, cause in (
            (CameraCondition.LOST, "no OAK was found"),
            (CameraCondition.STARTING, "opening the camera again, after: no OAK was found"),
        )
    }
    assert texts == {"lost: no OAK was found"}


@pytest.mark.parametrize(
    "text", ["[avoid]\nsend = false\n[avoid]\nradius_m = 0.4\n", "[avoid]\nradius_m = 1\nradius_m = 2\n"]
)
def test_a_section_or_key_that_stands_twice_names_the_remedy(tmp_path: Path, text: str) -> None:
    path = tmp_path / "twice.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="put all keys of a section under one header"):
        load_config(path)
