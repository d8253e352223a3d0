"""Differences from the defaults, and which keys are marked as safety keys."""

from __future__ import annotations

import json

import pytest

from companion.config.camera import CameraConfig
from companion.config.differences import differences, expert_lines
from companion.config.loader import Config, ConfigError, config_from_text, config_of
from companion.config.sections import SECTIONS, fields_of
from companion.doctor.doctor import config_findings
from companion.log.provenance import run_info
from core.param_field import is_safety_key

from ..configuration_tables import settings

MARKED = {
    "extractor": {"max_tilt_deg", "min_obstacle_height_m"},
    "expert": {"min_measured_share", "max_flying_share", "max_noisy_share", "estimate_noise", "margin_sigmas",
               "free_share", "clear_sigmas", "noise_prior_span"},
    "sync": {"max_gap_s", "max_extrapolation_s"},
    "camera": {"required", "masks", "max_range_m", "min_range_m", "ke_per_m", "unmatched_left_px"},
    "avoid": {"clear_share", "silence_s", "remember_s", "remember_m", "remember_free_s", "radius_m", "blind",
              "unseen", "recover_frames", "stop_hold_s", "avoid_margin_m"},
    "world": {"free_age_s", "pose_sigma_m", "passable_width_m", "jump_m"},
    "supervision": {"silent_s", "frozen_frames"},
    "service": {"timeout_s", "hang_s"},
    "mount_check": {"enabled", "degraded_deg", "invalid_deg", "unverified_deg", "interval_s", "terrain_deg_per_sqrt_s"},
}  # fmt: skip
UNMARKED = {
    "expert": {"merge_candidates", "meet_columns", "merge_rounds"},
    "camera": {"name", "kind", "device", "pitch_deg", "fps"},
    "output": {"scene", "transforms", "copy_input"},
    "publish": {"prisms", "depth_hz"},
    "record": {"record", "zstd_level"},
    "autopilot": {"address", "system_id"},
}


def test_keys_whose_purpose_is_safety_are_marked() -> None:
    marked = {section: {f.name for f in fields_of(section) if is_safety_key(f)} for section in SECTIONS}
    for section, names in MARKED.items():
        assert names <= marked[section]
    for section, names in UNMARKED.items():
        assert not names & marked[section]


def test_the_defaults_do_not_differ() -> None:
    assert differences(Config()) == []
    assert differences(Config(cameras=(CameraConfig(name="front"),))) == []


def test_marked_keys_in_the_documentation() -> None:
    rows = {row.split("|")[1].strip(): row for row in settings().splitlines() if row.startswith("| `")}
    assert rows["`max_flying_share`"].endswith("| yes |")
    assert rows["`zstd_level`"].endswith("|  |")


def test_the_log_holds_the_changed_safety_keys() -> None:
    config = config_of({"avoid": {"clear_share": 0.5}, "record": {"zstd_level": 2}}, "x")
    assert list(run_info("live", config).changed_safety_keys) == ["[avoid] clear_share = 0.5 (default 0.8)"]
    assert json.loads(run_info("live", config).config_json)["avoid"]["clear_share"] == 0.5
    assert run_info("live").config_json == ""


def test_a_log_recorded_with_another_value_of_a_constant_is_refused_with_a_message() -> None:
    with pytest.raises(ConfigError, match=r"noise_hold = 0.5 is not available any more.* cannot be replayed with it"):
        config_from_text(json.dumps({"expert": {"noise_hold": 0.5}}))


def test_deeply_nested_json_in_a_log_is_refused_with_a_message() -> None:
    with pytest.raises(ConfigError, match="nested"):
        config_from_text('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}")


def test_changed_expert_keys_are_named_and_in_the_log() -> None:
    config = config_of({"extractor": {"column_step": 2}, "expert": {"link_gap_px": 5, "free_share": 0.9}}, "x")
    named = ["[expert] link_gap_px = 5 px (default 4 px)", "[expert] free_share = 0.9 (default 0.8)"]
    assert expert_lines(config) == named
    assert list(run_info("live", config).changed_expert_keys) == named
    assert "expert keys" in {finding.part for finding in config_findings(config)}
    assert expert_lines(Config()) == []
