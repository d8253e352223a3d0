"""The configuration: shipped files load, all mistakes are reported at once, and the text in a log gives the same
configuration."""

from __future__ import annotations

import errno
import json
import math
import os
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.camera import CameraConfig
from companion.config.loader import (
    Config,
    ConfigError,
    config_from_text,
    config_of,
    config_text,
    load_config,
    values_of,
)
from companion.config.retired_constants import CONSTANTS_OF
from companion.config.sections import SECTIONS, fields_of
from companion.config.sync import SyncParams
from core.params import Params
from core.types import CameraInfo, CameraMount, Intrinsics

ROOT = Path(__file__).resolve().parents[3]
SHIPPED = sorted((ROOT / "configs").glob("*.toml"))
INFO = CameraInfo("front", Intrinsics(640, 480, 450.0, 450.0, 319.5, 239.5))


def problems(content: dict[str, object]) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        config_of(content, "my.toml")
    assert "my.toml" in str(caught.value)
    return caught.value.problems


def test_there_are_shipped_files() -> None:
    assert {p.name for p in SHIPPED} >= {"default.toml", "indoor.toml", "simulated.toml"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.name)
def test_every_shipped_file_loads_and_survives_the_log(path: Path) -> None:
    config = load_config(path)
    assert config_from_text(config_text(config)) == config


def test_default_file_holds_the_defaults() -> None:
    config = load_config(ROOT / "configs" / "default.toml")
    assert config.extractor == Params()
    assert config.sync == SyncParams()


def test_an_empty_file_is_the_default(tmp_path: Path) -> None:
    empty = tmp_path / "e.toml"
    empty.write_text("")
    assert load_config(empty) == Config()


def test_whole_numbers_become_floats() -> None:
    """A kernel called with an int would be compiled once more, in flight."""
    value = config_of({"extractor": {"passable_height_m": 2}}, "x").extractor.passable_height_m
    assert value == 2.0
    assert type(value) is float


def test_all_mistakes_at_once() -> None:
    found = problems(
        {
            "extractor": {"min_obstacel_height_m": 1.0, "passable_height_m": 99.0, "column_step": 1.5},
            "sync": {"max_gap_s": -1.0, "use_pose": 1},
            "cameras": [],
            "camera": [{"nmae": "a"}, {"name": "b", "kind": "sonar", "x_m": "1"}],
            "max_extrapolation_s": 0.1,
        }
    )
    text = "\n".join(found)
    assert len(found) == 11
    assert "min_obstacel_height_m: no such key; did you mean min_obstacle_height_m?" in text
    assert "[extractor] passable_height_m = 99.0: expected 0.2..10 m" in text
    assert "[extractor] column_step = 1.5: expected a whole number 1..16" in text
    assert "[sync] max_gap_s = -1.0: expected 0.005..1 s" in text
    assert "[sync] use_pose = 1: expected true or false" in text
    assert "[cameras]: no such section; did you mean camera?" in text
    assert "[[camera]] number 1: name is missing" in text
    assert "[[camera]] number 1: nmae: no such key; did you mean name?" in text
    assert '[[camera]] number 2: kind = "sonar": expected one of "mcap", "oak"' in text
    assert '[[camera]] number 2: x_m = "1": expected a number without quotes and unit, -10..10 m' in text
    assert "max_extrapolation_s: belongs under [sync]" in text


@pytest.mark.parametrize("key", ["baud", "baudrate", "baud_rate", "device", "port"])
def test_what_belongs_into_the_address_of_the_autopilot(key: str) -> None:
    """A baud rate as a key of its own was answered with the list of all keys."""
    (problem,) = problems({"autopilot": {"address": "serial:/dev/ttyAMA0", key: 921600}})
    assert problem == (
        f"[autopilot] {key}: no such key; it is a part of address, such as serial:/dev/ttyAMA0:921600 or udpin:0.0.0.0:14540"
    )


def test_all_mistakes_that_concern_several_keys_at_once() -> None:
    found = problems(
        {
            "camera": [
                {"name": "a", "min_range_m": 9.0, "max_range_m": 5.0},
                {"name": "b", "kind": "zed"},
            ],
            "publish": {"prisms": "tcp://0.0.0.0"},
        }
    )
    assert len(found) == 3
    text = "\n".join(found)
    assert 'prisms = "tcp://0.0.0.0": expected' in text
    assert '"a": min_range_m = 9 must be less than max_range_m = 5' in text
    assert '"b" of kind "zed" needs device, calibration' in text


@pytest.mark.parametrize("baud", ["0", "9600000000", "115"])
def test_a_baud_rate_that_no_port_has_is_a_mistake(baud: str) -> None:
    (text,) = problems({"autopilot": {"address": f"serial:/dev/ttyACM0:{baud}"}})
    assert f'the baud rate is "{baud}", expected 1200 to 12000000' in text


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"camera": {"name": "x"}}, "[[camera]] with double brackets"),
        ({"camera": [{"name": "a/b"}]}, 'name = "a/b": not of the expected form (letters, digits, dot'),
        ({"extractor": 3}, "expected a section [extractor] with single brackets"),
        ({"avoid": [{"rays": 3}]}, "expected a section [avoid] with single brackets"),
        ({"record": {"file_mb": 100.0, "budget_mb": 50.0}}, "[record] file_mb = 100 must be less than"),
        ({"mount_check": {"degraded_deg": 4.0}}, "[mount_check] degraded_deg = 4 must not exceed"),
        (
            {"camera": [{"name": "x", "kind": "simulated", "follow": "com3"}]},
            '[[camera]] "x": follow: "com3" is not an address: expected serial:',
        ),
        (
            {"camera": [{"name": "x", "kind": "simulated", "width_px": 320, "unmatched_left_px": 320}]},
            "unmatched_left_px = 320 must be less than width_px = 320",
        ),
        ({"publish": {"prisms": "ipc://{runs}/prisms"}}, "{run} is the only placeholder"),
        ({"publish": {"prisms": "tcp://127.0.0.1:\u0665"}}, "expected ipc://PATH or tcp://HOST:PORT"),
        ({"publish": {"prisms": "ipc://@osape"}}, 'prisms = "ipc://@osape": expected ipc://PATH'),
        ({"camera": [{"name": "x"}, {"name": "x"}]}, "occurs 2 times"),
        ({"camera": [{"name": "x", "min_range_m": 5.0, "max_range_m": 2.0}]}, "must be less than"),
        ({"camera": [{"name": "a b"}]}, "letters, digits"),
        ({"sync": {"max_gap_s": math.nan}}, "expected 0.005..1 s"),
        *(
            ({"publish": {"prisms": address}}, f'prisms = "{address}": expected ipc://PATH or tcp://HOST:PORT')
            for address in (
                "ipc://",
                "tcp://",
                "tcp://:5601",
                "tcp://127.0.0.1",
                "tcp://127.0.0.1:0",
                "tcp://h:65536",
                "tcp://::1:5601",
                "x",
            )
        ),
        ({"publish": {"prisms": "ipc:///run/a\0b"}}, "a NUL character cannot be in a text; remove it"),
        ({"camera": [{"name": "x", "device": "\0"}]}, "a NUL character cannot be in a text; remove it"),
        ({"avoid": {"send": True}}, "nothing could be sent"),
        # ArduPilot does not read messages with its own ids
        ({"autopilot": {"component_id": 1}}, "[autopilot] component_id = 1: expected a whole number 2..255"),
        (
            {
                "autopilot": {"address": "udpin:0.0.0.0:14540"},
                "avoid": {"send": True, "near_m": 6.0},
                "guard": {"enabled": True, "horizon_m": 6.0},
            },
            "the guard would stop the vehicle everywhere",
        ),
        (
            {"avoid": {"send": True}, "autopilot": {"address": "tcp:127.0.0.1:5760"}, "service": {"timeout_s": 0.5}},
            "timeout_s = 0.5 with [avoid] rate_hz = 15",
        ),
    ],
)
def test_single_mistakes(content: dict[str, object], text: str) -> None:
    assert text in problems(content)[0]


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (b"[extractor\n", "not valid TOML"),
        (b"\xff\xfe\x00", "save it with the encoding UTF-8"),
        ("[avoid]\n".encode("utf-16-le"), "save it with the encoding UTF-8"),
        (b"[avoid]\nsend = True\n", "true and false are in lower case"),
        (b'[record]\nfolder = "C:\\logs"\n', "use single quotes"),
        (b"#" * 1_000_001, "larger than 1 MB"),
        (b"camera = [1]", r"\[\[camera\]\] number 1: expected \[\[camera\]\]"),
        (b"[sync]\nmax_gap_s = .1\n", "line 2"),
        (b"[service]\nmetrics_port = " + b"1" * 5000, "a number has thousands of digits; correct it"),
        (
            b"[service]\nmetrics_port = 0x" + b"f" * 5000,
            r"metrics_port = \(a number of thousands of digits\): expected",
        ),
    ],
)
def test_unreadable_files(tmp_path: Path, raw: bytes, text: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(raw)
    with pytest.raises(ConfigError, match=text):
        load_config(path)


def test_a_mark_before_the_text_is_no_part_of_it(tmp_path: Path) -> None:
    """As editors of Windows write it."""
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf[service]\nhang_s = 20\n")
    assert load_config(path).service.hang_s == 20.0


def test_a_number_of_thousands_of_digits_in_a_log_is_refused() -> None:
    with pytest.raises(ConfigError, match="the log is damaged"):
        config_from_text('{"service": {"metrics_port": ' + "1" * 5000 + "}}")


def test_a_file_that_the_user_may_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may read every file, and tests may run as root: the refusal is made up."""

    def refuse(path: Path, *options: object) -> str:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    (tmp_path / "private.toml").write_text("")
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(ConfigError, match=r"Permission denied\); give the user \S+ the permission to read it"):
        load_config(tmp_path / "private.toml")


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"check the path"):
        load_config(tmp_path / "none.toml")


JSON_PIECES = [*'{}[]:,"\\ \n\0é', "null", "true", "1e400", "-0", '"service"', '"camera"', "\udcff"]


@given(text=st.lists(st.sampled_from(JSON_PIECES), max_size=20).map("".join))
def test_a_damaged_text_in_a_log_is_refused_or_whole(text: str) -> None:
    config, found_problems = None, ()
    try:
        config = config_from_text(text)
    except ConfigError as error:
        found_problems = error.problems
    assert config == Config() if not found_problems else config is None


NUMBERS = [f for f in fields(Params) if "min" in f.metadata and f.type == "float"]


@given(st.data())
def test_any_values_in_range_survive_the_log(data: st.DataObject) -> None:
    values = {f.name: data.draw(st.floats(f.metadata["min"], f.metadata["max"]), f.name) for f in NUMBERS}
    config = Config(
        extractor=Params(**values), cameras=(CameraConfig(name="a", pitch_deg=data.draw(st.floats(-90, 90))),)
    )
    assert config_from_text(config_text(config)) == config


def test_a_camera_section_changes_only_the_keys_it_has() -> None:
    recorded = CameraInfo("front", INFO.intrinsics, CameraMount(pitch_rad=0.3, x_m=0.2), 0.4, 12.0, 0.002)
    config = config_of({"camera": [{"name": "front", "roll_deg": 90, "max_range_m": 8}]}, "x")
    info = config.camera("front").applied_to(recorded)
    assert info.mount == CameraMount(roll_rad=math.pi / 2, pitch_rad=0.3, x_m=0.2)
    assert (info.min_range_m, info.max_range_m, info.ke_per_m) == (0.4, 8.0, 0.002)
    assert config.camera("rear").applied_to(recorded) == recorded
    stated = config_of({"camera": [{"name": "front", "bias_per_m": 0.01}]}, "x")
    assert stated.camera("front").applied_to(recorded) == replace(recorded, bias_per_m=0.01)
    assert stated.camera("front").applied_to(replace(recorded, bias_per_m=0.02)).bias_per_m == 0.01
    narrow = config_of({"camera": [{"name": "front", "min_range_m": 10}]}, "x").camera("front")
    with pytest.raises(ValueError, match=r'^\[\[camera\]\] "front": .* set both, min_range_m less than max_range_m'):
        narrow.applied_to(replace(recorded, max_range_m=8.0))


def test_every_key_has_its_meaning_and_bounds() -> None:
    for section, owner in SECTIONS.items():
        for f in fields(owner):
            assert f.metadata.get("doc"), f"[{section}] {f.name}"
            assert "unit" in f.metadata, f"[{section}] {f.name}"


@pytest.mark.parametrize("section", CONSTANTS_OF)
def test_a_key_that_became_a_constant_is_accepted_with_its_value_only(
    section: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, constants = tmp_path / "old.toml", CONSTANTS_OF[section]
    path.write_text(f"[{section}]\n" + "\n".join(f"{key} = {value}" for key, value in constants.items()))
    assert load_config(path) == Config()
    assert len(caplog.records) == len(constants)
    key = next(iter(constants))
    path.write_text(f"[{section}]\n{key} = 0.123\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    (problem,) = caught.value.problems
    assert problem.startswith(f"[{section}] {key} = 0.123 is not available any more")
    content = json.loads(config_text(Config()))
    content[section] |= constants
    assert config_from_text(json.dumps(content)) == Config()


def test_a_log_of_the_release_before_can_be_replayed() -> None:
    """It holds each key, also those that are constants now; the default of one was changed before. tests/data/config-0.1.0.json:
    the configuration that a log of 0.1.0 with its defaults holds."""
    text = (ROOT / "tests" / "data" / "config-0.1.0.json").read_text(encoding="utf-8")
    recorded, content = config_from_text(text), json.loads(text)
    for section in ("extractor", "expert", "sync", "world"):
        for f in fields_of(section):
            if f.name in content[section]:
                assert getattr(values_of(recorded, section), f.name) == content[section][f.name], (section, f.name)


@pytest.mark.parametrize(
    ("section", "key"), [(s, k) for s in ("avoid", "guard", "publish", "service") for k in CONSTANTS_OF[s]]
)
def test_a_log_is_not_refused_for_what_no_frame_depends_on(section: str, key: str) -> None:
    """A log of 0.1.0 recorded with another rate of the depth preview, or with another constant of the guard, could not be replayed."""
    text = (ROOT / "tests" / "data" / "config-0.1.0.json").read_text(encoding="utf-8")
    content = json.loads(text)
    content[section][key] = 10.0
    assert config_from_text(json.dumps(content)) == config_from_text(text)
    with pytest.raises(ConfigError, match=r"held_samples = 100 is not available any more.* cannot be replayed with it"):
        config_from_text(json.dumps(content | {"sync": content["sync"] | {"held_samples": 100}}))


def test_the_two_tables_of_the_algorithm_hold_each_parameter_once() -> None:
    names = [f.name for section in ("extractor", "expert") for f in fields_of(section)]
    assert sorted(names) == sorted(f.name for f in fields(Params))
    assert 10 <= len(fields_of("extractor")) <= 14


def test_expert_keys_fill_the_same_parameters() -> None:
    config = config_of({"extractor": {"column_step": 2}, "expert": {"link_gap_px": 5}}, "x")
    assert config.extractor == Params(column_step=2, link_gap_px=5)
    assert config_from_text(config_text(config)) == config


def test_a_misspelled_expert_key_is_recognised_under_extractor() -> None:
    (problem,) = problems({"extractor": {"link_gap_pixel": 5}})
    assert problem == "[extractor] link_gap_pixel: no such key; did you mean link_gap_px below [expert]?"
    (problem,) = problems({"extractor": {"link_gap_px": 5}})
    assert problem == "[extractor] link_gap_px: belongs under [expert]"
