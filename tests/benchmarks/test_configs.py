"""Random valid configurations: file, log, service, sectors and client. The large runs: `python -m benchmarks.configs`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.configs.draw import JUDGED_KEYS, judged_key, random_config, toml
from benchmarks.configs.flight import ConfiguredFlight
from benchmarks.configs.judge import ConfiguredJudge
from benchmarks.faults.path import PathClaim, true_room_m
from benchmarks.faults.service import Service
from companion.cli import main
from companion.config.loader import Config, ConfigError, config_from_text, config_of, config_text, load_config
from companion.config.sections import fields_of
from companion.live.run import check_live
from core.param_field import is_safety_key
from drivers.mavlink.session_types import ARDUPILOT, PX4


@pytest.mark.parametrize("seed", range(12))
def test_each_accepted_file_survives_file_and_log_and_is_judged_alike(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, config, _ = random_config(np.random.default_rng([92, seed]), (0.1, 0.4, 1.0)[seed % 3])
    (path := tmp_path / "drawn.toml").write_text(toml(content), encoding="utf-8")
    assert load_config(path) == config == config_from_text(config_text(config))
    usable = main(["check-config", str(path)]) == 0
    live = tuple(c for c in config.cameras if c.kind != "mcap")
    assert usable is (_refusal(replace(config, cameras=live), path) == ""), capsys.readouterr().err


def _refusal(config: Config, path: Path) -> str:
    try:
        check_live(config, path)
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", [1, 5])
def test_a_configuration_never_makes_a_solid_clear(seed: int) -> None:
    _, config, _ = random_config(np.random.default_rng([92, seed]), 0.4, judged_key, flies=True)
    flight = ConfiguredFlight(config, seed, 1.2)
    flight.fly(1.2)
    assert flight.judge.planner > 5
    assert flight.judge.violations == []


@pytest.mark.parametrize(
    "camera",
    [{"masks": "0,0 5000,5000"}, {"masks": "0,0 159,119"}, {"unmatched_left_px": 1024}, {"unmatched_left_px": 159}],
)
def test_a_camera_whose_whole_image_is_hidden_by_mistake_keeps_its_view(camera: dict[str, object]) -> None:
    """No direction was the camera's: ArduPilot was sent unknown all around, which it treats as clear."""
    content = {
        "autopilot": {"address": "udpin:127.0.0.1:14540"},
        "avoid": {"send": True},
        "camera": [{"name": "front"} | camera],
    }
    flight = ConfiguredFlight(config_of(content, "x"), 5, 1.0)
    flight.fly(1.0)
    assert flight.kind == ARDUPILOT
    assert flight.service is not None
    assert flight.service.report is not None
    assert flight.service.report.values is not None
    ahead = flight.service.report.values[[-4, -3, -2, -1, 0, 1, 2, 3, 4]]
    assert (ahead != 65535).all()
    assert flight.judge.messages > 5


@pytest.fixture(scope="module")
def flown() -> ConfiguredFlight:
    """With the guard, before walls."""
    content = {
        "autopilot": {"address": "udpin:127.0.0.1:14540"},
        "avoid": {"send": True},
        "guard": {"enabled": True},
        "camera": [{"name": "front"}],
    }
    flight = ConfiguredFlight(config_of(content, "x"), 10, 1.0)
    flight.fly(1.0)
    assert flight.judge.violations == []
    assert flight.judge.planner > 5
    assert isinstance(flight.service, Service)
    assert flight.service.claim is not None
    return flight


def test_the_judge_notices_a_solid_in_a_clear_sector(flown: ConfiguredFlight) -> None:
    judge = ConfiguredJudge([], flown.kind, config=flown.judge.config)
    judge.sent(flown, [round(100 * flown.avoid.max_distance_m) + 1] * 72)
    assert any("is clear, a solid is" in v.what for v in judge.violations)


def test_the_wall_of_ardupilot_may_be_farther_than_a_solid_that_was_never_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a hull of 5 m, before the first attitude, 0.55 m before a solid."""
    _, config, _ = random_config(np.random.default_rng([92, 10967]), 0.4, judged_key, flies=True)
    flight = ConfiguredFlight(config, 10967, 0.3)
    flight.fly(0.3)
    assert flight.kind == ARDUPILOT
    assert flight.judge.messages > 2
    assert flight.judge.violations == []
    monkeypatch.setattr("benchmarks.configs.judge.WALL_CM", 0)
    flight.fly(0.5)
    assert any("is 212 cm, a solid is" in v.what for v in flight.judge.violations)


def test_the_wall_all_around_px4_may_be_farther_than_a_solid(flown: ConfiguredFlight) -> None:
    assert flown.kind == PX4
    judge = ConfiguredJudge([], flown.kind, config=flown.judge.config)
    judge.sent(flown, [1100] * 72)
    assert judge.violations == []
    judge.sent(flown, [1100] * 71 + [1099])
    assert judge.violations != []


@pytest.mark.parametrize(("radius_m", "wrong"), [(0.4, False), (5.0, True)])
def test_the_judged_path_is_as_wide_as_the_configured_hull(
    flown: ConfiguredFlight, radius_m: float, wrong: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    room_m = true_room_m(flown.field.outline_m, flown.truth(), 0.0, 0.4)
    monkeypatch.setattr(Service, "claim", PathClaim(0.0, room_m))
    monkeypatch.setattr(flown, "avoid", replace(flown.avoid, radius_m=radius_m))
    judge = ConfiguredJudge([], flown.kind, config=flown.judge.config)
    judge.judge_path(flown)
    assert any("the path is free" in v.what for v in judge.violations) is wrong


def test_the_guard_of_the_flight_claims_what_it_assesses(flown: ConfiguredFlight) -> None:
    assert flown.service is not None
    assert flown.service.guard is not None
    verdict = flown.service.guard.verdict
    assert verdict is not None
    assert flown.service.claim is not None
    assert flown.service.claim.room_m == verdict.room_m


def test_judged_keys_are_keys() -> None:
    for section, names in JUDGED_KEYS.items():
        assert all(is_safety_key(key) for key in fields_of(section) if key.name in names)
        assert set(names) <= {key.name for key in fields_of(section)}
