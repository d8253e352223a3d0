"""Random valid configurations: file, log, service, sectors and client. The large runs: `python -m benchmarks.configs`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from benchmarks.configs.draw import JUDGED_KEYS, judged_key, random_config, random_flight, toml
from benchmarks.configs.effects import SECTIONS, digest, other_values, without_effect
from benchmarks.configs.flight import ConfiguredFlight, ConfiguredService
from benchmarks.configs.judge import ConfiguredJudge
from companion.cli import main
from companion.config.loader import Config, ConfigError, config_from_text, config_of, config_text, load_config
from companion.config.sections import fields_of
from companion.live.run import check_live
from companion.pipeline.results import PrismsResult
from core.param_field import is_safety_key
from core.params import Params
from drivers.mavlink.session_types import ARDUPILOT, PX4
from osape_client.model import CameraModel
from osape_client.query.space import Occupancy

DATA = Path(__file__).resolve().parents[1] / "data"


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
    _, config, _ = random_flight(np.random.default_rng([92, seed]), 0.4, judged_key)
    flight = ConfiguredFlight(config, seed, 1.2)
    flight.fly(1.2)
    assert flight.models > 5
    assert flight.violations() == []


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
    assert flight.violations() == []
    return flight


def test_the_judge_notices_a_solid_in_a_clear_sector(flown: ConfiguredFlight) -> None:
    judge = ConfiguredJudge([], flown.kind, config=flown.config)
    judge.sent(flown, [round(100 * flown.avoid.max_distance_m) + 1] * 72)
    assert any("is clear, a solid is" in v.what for v in judge.violations)


def test_the_wall_all_around_px4_may_be_farther_than_a_solid(flown: ConfiguredFlight) -> None:
    assert flown.kind == PX4
    judge = ConfiguredJudge([], flown.kind, config=flown.config)
    judge.sent(flown, [1100] * 72)
    assert judge.violations == []
    judge.sent(flown, [1100] * 71 + [1099])
    assert judge.violations != []


def test_the_judge_notices_a_path_that_is_free_behind_a_wall(flown: ConfiguredFlight) -> None:
    assert isinstance(flown.service, ConfiguredService)
    assert flown.service.guard is not None
    sight = flown.service.guard.sight
    assert sight is not None
    judge = ConfiguredJudge([], flown.kind, config=flown.config)
    judge.path(flown, replace(sight, course_rad=0.0, free_m=30.0))
    assert len(judge.wrong) == judge.free_paths == 1


def test_the_judge_notices_a_client_for_which_everything_is_free(
    flown: ConfiguredFlight, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert flown.judge.points > 20
    everywhere = SimpleNamespace(points=lambda points: [Occupancy.FREE] * len(points))
    monkeypatch.setattr("benchmarks.configs.judge.Space", lambda models: everywhere)
    monkeypatch.setattr("benchmarks.configs.judge.PlacedModel", lambda model, at: None)
    judge = ConfiguredJudge([], flown.kind, config=flown.config)
    result, model = cast(PrismsResult, SimpleNamespace(frame="ned")), cast(CameraModel, None)
    judge.model(flown, result, model, flown.truth())
    assert len(judge.wrong) == judge.points > 20


@pytest.mark.parametrize("section", SECTIONS)
def test_other_values_are_valid_and_differ(section: str) -> None:
    for key in fields_of(section):
        values = other_values(key)
        assert values, key.name
        assert key.default not in values
        for value in values:
            if section in ("extractor", "expert"):
                assert getattr(Params(**{key.name: value}), key.name) == value


def test_a_key_without_effect_is_found() -> None:
    """A recording of ten frames does not hold more than 256 samples."""
    log = DATA / "trees.mcap"
    assert digest(Config(), log) == digest(config_of({"record": {"file_s": 10.0}}, "x"), log)
    assert digest(Config(), log) != digest(config_of({"extractor": {"column_step": 2}}, "x"), log)
    assert "[sync] held_samples" in without_effect([log], ["sync"])


def test_judged_keys_are_keys() -> None:
    for section, names in JUDGED_KEYS.items():
        assert all(is_safety_key(key) for key in fields_of(section) if key.name in names)
        assert set(names) <= {key.name for key in fields_of(section)}
