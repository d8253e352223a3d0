"""The layout file for Foxglove and Lichtblick."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from companion.viewer.foxglove_layout import layout
from drivers.logs.topics import TOPICS

from ..small_recordings import write_flight


def placed(tree: Any) -> list[str]:
    """The panels of a layout's tree."""
    return [tree] if isinstance(tree, str) else placed(tree["first"]) + placed(tree["second"])


@pytest.mark.parametrize("cameras", [["front"], ["front", "rear"]])
def test_every_panel_is_described_and_placed_once(cameras: list[str]) -> None:
    made = layout(cameras)
    assert sorted(placed(made["layout"])) == sorted(made["configById"])
    assert [p for p in made["configById"] if p.startswith("Image!")] == [f"Image!{c}" for c in cameras]


def test_every_topic_and_field_is_one_that_a_log_has() -> None:
    text = json.dumps(layout(["front"]))
    paths = set(re.findall(r'"(/[a-z][\w/.]*)"', text))
    topics = {t.of("front"): t.message for t in TOPICS.values()}
    assert len(paths) >= 6
    for path in paths:
        topic, _, fields = path.partition(".")
        descriptor = topics[topic].DESCRIPTOR
        for name in fields.split(".") if fields else ():
            field = descriptor.fields_by_name[name]
            descriptor = field.message_type


def camel(name: str) -> str:
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)


def test_the_settings_are_those_of_foxglove() -> None:
    layouts = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk is not installed (extra foxglove)")
    kinds = {
        "3D": layouts.ThreeDeeConfig,
        "Image": layouts.ImageConfig,
        "Plot": layouts.PlotConfig,
        "StateTransitions": layouts.StateTransitionsConfig,
        "RawMessages": layouts.RawMessagesConfig,
    }
    for panel, config in layout(["front"])["configById"].items():
        known = {camel(f.name) for f in dataclasses.fields(kinds[panel.partition("!")[0]])}
        assert config.keys() <= known, panel
    image = layout(["front"])["configById"]["Image!front"]["imageMode"]
    assert image.keys() <= {camel(f.name) for f in dataclasses.fields(layouts.ImageModeConfig)}


def test_a_log_without_health_reports_has_no_panel_for_them() -> None:
    made = layout(["front"], health=False)
    assert "health" not in json.dumps(made)
    assert "RawMessages!health" in layout(["front"], health=True)["configById"]


def test_view_writes_it_beside_the_page(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["view", str(write_flight(tmp_path / "log.mcap")), "-o", str(out), "--no-png"]) == 0
    assert json.loads((out / "foxglove-layout.json").read_text()) == layout(["front"], health=False)
