"""Wrong usage of every command ends with status 2 and a message that names the remedy."""

from __future__ import annotations

import argparse
import errno
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import cast

import pytest

from benchmarks.fidelity.run import parse as fidelity_options
from benchmarks.open_air.view_options import view_parser
from companion import cli
from companion.argument_parser import negative_values_joined
from companion.cli import main, parser_of
from companion.command_list import COMMANDS
from companion.viewer.live_page import LivePage
from companion.viewer.live_server import LiveServer
from drivers.base import DeviceNotFound

WRONG: dict[str, tuple[tuple[str, str], ...]] = {
    "demo": (("--seconds x", "expected 1..600"),),
    "simulate-autopilot": (
        ("-c simulated.toml --drift-ppm x", "expected -1000..1000"),
        ("-c simulated.toml --jitter-ms nan", "expected 0..10000"),
        ("-c simulated.toml --address tcp:1", "udpout:HOST:PORT"),
    ),
    "setup": (
        ("--camera moon", "expected one of oak"),
        ("--autopilot carrier-pigeon", "expected serial"),
        ("--pitch nan", "expected -90..90"),
        ("--pitch 10deg", "'10deg': expected -90..90; write one number without a unit"),
        ("--pitch -20,5", "'-20,5': expected -90..90; write a decimal point"),
        ("--pitch -200.", "expected -90..90"),
        ("--camera realsense", "such as v4l2:/dev/v4l/by-path/NAME for a RealSense"),
        ("--width 0", "expected 0.05..10"),
        ("--height 99", "expected 0.05..5"),
        ("--position 1 2 nan", "expected -10..10"),
        ("-o new.toml --yes --camera oak --autopilot none --calibration SN1.conf", "--calibration is for a zed"),
    ),
    "configs": (("moon", "there are"), ("-o my.toml", "needs the NAME")),
    "check-config": (("", "FILE"),),
    "doctor": (
        ("--yes", "needs --apply"),
        ("--apply --json", "add --yes"),
        ("--apply --mount", "exclude each other"),
        ("--patience nan", "expected 0.1..3600"),
        ("--mount --seconds -1", "expected 1..3600"),
        ("--seconds 30", "needs --mount"),
    ),
    "bench": (("--size 1x1", "such as 640x480"),),
    "warmup": (("--all", "--all"), ("kernels", "`companion warmup --help` lists its arguments")),
    "run": (
        ("--speed 9", "--speed"),
        ("--confg my.toml", "did you mean --config?"),
        ("my.toml", "did you mean -c my.toml?"),
    ),
    "status": (("--timeout nan", "expected 0.1..3600"), ("--timeout -3", "expected 0.1..3600")),
    "view": (
        ("", "give FILE.mcap and -o DIR, or --live"),
        ("log.mcap", "-o DIR is missing: where to draw log.mcap"),
        ("log.mcap -o out --live", "leave FILE.mcap and -o away"),
        ("log.mcap -o out --every x", "expected 1..1000000"),
        ("log.mcap -o out --frame x", "--frame"),
        ("log.mcap -o out --no-png --every 2", "--every chooses pictures"),
        ("log.mcap -o out --no-png --frame 0", "--frame chooses pictures"),
        ("log.mcap -o out --port 0", "--port needs --live"),
        ("log.mcap -o out --listen 0.0.0.0", "--listen needs --live"),
        ("log.mcap -o out --foxglove", "--foxglove needs --live"),
        ("log.mcap -o out --keys keys", "--keys needs --live"),
        ("log.mcap -o out --no-depth", "--no-depth needs --live"),
        ("log.mcap -o out -c my.toml", "--config needs --live"),
        ("--live --every 2", "leave out --every"),
        ("--live --frame 0", "leave out --frame"),
        ("--live --no-png", "leave out --no-png"),
        ("--live --no-page", "leave out --no-page"),
        ("--live --rerun", "leave out --rerun"),
    ),
    "ros2": (("--router moon", "expected PROTOCOL/ADDRESS"), ("--namespace a//b", "a//b")),
    "import": (
        ("folder -o out.mcap --mount 1,2", "three numbers"),
        ("folder -o out.mcap --mount -1,2", "three numbers"),
        ("folder -o out.mcap --mount=0,nan,0", "pitch_deg = NaN: expected -90..90"),
        ("folder -o out.mcap --frame-latency-ms x", "expected 0..5000"),
        ("folder -o out.mcap --tlog-epoch nan", "unix time"),
        ("folder -o out.mcap --max-range-m nan", "max_range_m = NaN: expected"),
        ("folder -o out.mcap --system-id 256", "expected 1..255"),
        (". -o out.mcap --depth-topic /depth", "--depth-topic is for a ROS 2 recording"),
        (". -o out.mcap --base-frame base_link", "--base-frame is for a ROS 2 recording"),
        ("simulated.toml -o out.mcap --no-tlog", "--no-tlog is for a directory of images"),
        ("simulated.toml -o out.mcap --frame-latency-ms 50", "--frame-latency-ms is for a directory of images"),
    ),
    "replay": (("log.mcap --tolerance 0.1", "needs --check"), ("log.mcap --no-depth", "needs -o")),
    "info": (("", "FILE"),),
    "recover": (("log.mcap -o log.mcap", "another name"),),
    "export": (
        ("log.mcap -f npz -o out", ".npz"),
        ("log.mcap -f gltf -o out.txt", ".glb"),
        ("log.mcap -f csv -o out --frame 3", "needs -f gltf"),
    ),
    "batch": (
        ("-o out", "no input"),
        ("logs -o out --address tcp://a:1", "--engine dask or ray"),
        ("logs -o out --engine dask", "needs --address"),
        ("logs -o out --engine ray --address auto --workers 2", "leave it out"),
        ("logs -o out --no-pictures", "needs --compare"),
        ("logs --compare a b -o out", "leave out logs"),
        ("--compare a b -o s3://bucket/out", "local folder"),
        ("--compare a b -o out --planes", "leave out --planes"),
        ("--compare a b -o out --near 0", "leave out --near"),
        ("--compare a b -o out -c x.toml", "leave out --config"),
        ("--compare a b -o out --engine local", "leave out --engine"),
    ),
    "find": (
        ("out moon -o clips", "blind_while_armed"),
        ("out [[1,2]] -o clips", "not a condition"),
        ("out blind -o clips --before x", "expected 0..600"),
        ("out blind -o clips --table frames", "--table is for a filter"),
        ("out rows.parquet -o clips --table events", "--table is for a filter"),
    ),
    "install": (("--replace-config", "needs -c FILE"),),
    "uninstall": (("everything", "everything"),),
    "keys": (
        ("", "FOLDER"),
        ("keys --signing team.key", "exclude each other"),
        ("keys --passphrase", "needs --signing"),
        ("--signing team.key --client ground", "needs FOLDER"),
        ("keys --client a/b", "expected letters"),
        ("keys --client server", "use another name"),
    ),
}
"""Command -> (arguments, part of the message)."""

SETUP = ["--yes", "--camera", "simulated", "--autopilot", "none", "--no-doctor"]
CASES = [(command, line, part) for command, lines in WRONG.items() for line, part in lines]


def test_every_command_is_here() -> None:
    assert WRONG.keys() == COMMANDS.keys()


@pytest.mark.parametrize(("command", "line", "part"), CASES, ids=[f"{c} {line}" for c, line, _ in CASES])
def test_wrong_usage_is_status_2_with_a_remedy_and_writes_nothing(
    command: str,
    line: str,
    part: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["configs", "simulated"]) == 0
    capsys.readouterr()
    assert main([command, *line.split()]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert part in output.err
    assert "error: " in output.err
    assert [f.name for f in tmp_path.iterdir()] == ["simulated.toml"]


@pytest.mark.parametrize(
    ("line", "joined"),
    [
        ("--mount -1,2,3 folder", "--mount=-1,2,3 folder"),
        ("--tilts -10:0,0:5", "--tilts=-10:0,0:5"),
        ("--pitch -20. --roll -.5,3", "--pitch=-20. --roll=-.5,3"),
        ("--pitch -20 -5,3", "--pitch -20 -5,3"),
        ("--pitch=3 -5,3", "--pitch=3 -5,3"),
        ("--position -1 -2 -3", "--position -1 -2 -3"),
        ("--pitch -x", "--pitch -x"),
        ("-c --live", "-c --live"),
        ("--pitch -- -5,3", "--pitch -- -5,3"),
    ],
)
def test_a_list_that_begins_with_a_minus_is_the_value_of_the_option_before_it(line: str, joined: str) -> None:
    assert negative_values_joined(line.split()) == joined.split()


def test_parsers_accept_a_list_that_begins_with_a_minus() -> None:
    assert fidelity_options(["--tilts", "-10:0,0:5"]).tilts == [(-10.0, 0.0), (0.0, 5.0)]
    assert view_parser("", skies=["clear"]).parse_args(["--pitch", "-20,5"]).pitch == ["-20", "5"]


@pytest.mark.parametrize(
    "line",
    [
        "info http://host/a.mcap",
        "replay s3://bucket/a.mcap",
        "import https://host/a.mcap -o b.mcap",
        "replay a.mcap -o s3://bucket/b.mcap",
        "view a.mcap -o s3://bucket/pictures",
    ],
)
def test_an_address_in_place_of_a_file_is_called_so(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`http:/host/a.mcap: the file does not exist`; `view` made a folder `s3:`."""
    (address,) = (word for word in line.split() if "://" in word)
    assert main(line.split()) == 2
    assert f"{address}: an address, and this command takes files of this computer; copy" in capsys.readouterr().err


def test_ctrl_c_while_a_command_is_loaded_prints_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading takes a second or more, in which an interrupt ended with some 40 lines."""

    def interrupt(command: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_module", interrupt)
    assert main(["info", "a.mcap"]) == 130


def test_after_ctrl_c_the_prompt_is_on_a_line_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It followed ^C on the line of a question."""

    def interrupt(command: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_module", interrupt)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["info", "a.mcap"]) == 130
    assert capsys.readouterr().err == "\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_the_refusal_of_a_value_names_no_function(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """argparse prints "invalid NAME value" with the name of the function that converts the text, where that raises
    ValueError. That is clear for int and float only."""
    (found,) = (a for a in parser_of(command)._actions if a.dest == "command")
    assert isinstance(found.choices, dict)
    for action in found.choices[command]._actions:
        if action.type in (None, Path, int, float):
            continue
        assert callable(action.type)
        with pytest.raises(argparse.ArgumentTypeError, match="expected"):
            action.type("x y")


def test_an_address_of_another_computer_is_not_answered_with_a_port() -> None:
    with pytest.raises(DeviceNotFound, match=r"192\.0\.2\.1 cannot be bound .*; give --listen an address of this"):
        LiveServer(cast(LivePage, None), "192.0.2.1", 0).open()


@pytest.mark.process
@pytest.mark.parametrize("words", ["configs", "run -c my.toml", "status"])
def test_without_the_packages_that_it_requires_a_command_names_one(words: str) -> None:
    """As after `pip install --no-deps`: it ended with a traceback."""
    done = subprocess.run(
        [sys.executable, "-S", "-m", "companion", *words.split()],  # without the packages of the environment
        cwd=Path(cli.__file__).parents[1],
        env={"PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert re.fullmatch(r"companion: error: the Python module \w+ is missing: .*-m pip check` lists.*\n", done.stderr)


def test_a_missing_module_of_this_software_is_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(words: object) -> int:
        raise ModuleNotFoundError("No module named 'core.moved'", name="core.moved")

    monkeypatch.setattr(cli, "_run", fail)
    with pytest.raises(ModuleNotFoundError):
        main(["configs"])


def test_a_full_disk_is_reported_by_a_command_whose_output_is_a_text(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(args: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("companion.batch.command.run", fail)
    assert main(["batch", "logs", "-o", "out"]) == 1
    assert "out: No space left on device while writing; check the free space" in capsys.readouterr().err


def test_an_output_that_is_no_file_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As root, `companion replay -o /dev/null` put a log in place of the device."""
    device = tmp_path / "device"
    os.mkfifo(device)
    log = str(Path(__file__).parents[2] / "data" / "street.mcap")
    for words in (["replay", log, "-o"], ["setup", "--replace", *SETUP, "-o"]):
        assert main([*words, str(device)]) == 1
        assert f"{device}: " in capsys.readouterr().err
        assert device.is_fifo()
        assert list(tmp_path.iterdir()) == [device]


def test_the_error_of_an_output_below_a_file_names_the_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It named the temporary file beside it."""
    (tmp_path / "file").write_text("")
    assert main(["configs", "oak", "-o", str(tmp_path / "file" / "my.toml")]) == 1
    assert f"error: {tmp_path / 'file' / 'my.toml'}: Not a directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["replay", ""],
        ["replay", "flight.mcap", "-o", ""],
        ["view", "flight.mcap", "-o", ""],
        ["keys", ""],
        ["check-config", ""],
        ["demo", "--output="],
        ["batch", "", "-o", "out"],
    ],
)
def test_an_empty_path_is_not_the_working_directory(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`companion keys "$FOLDER"` with a misspelt variable wrote secret keys into the working directory."""
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    err = capsys.readouterr().err
    assert "an empty path" in err
    assert "is a variable of the shell not set?" in err
    assert list(tmp_path.iterdir()) == []
