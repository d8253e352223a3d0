"""`companion check-config`: its words, its object and its exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.cli import main

ROOT = Path(__file__).resolve().parents[2]


def call(*words: str) -> int:
    return main(["check-config", *words])


def test_a_usable_file_is_called_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(ROOT / "configs" / "indoor.toml")) == 0
    out = capsys.readouterr().out
    assert "usable" in out
    assert "[extractor] min_obstacle_height_m = 0.2 (default 0.6)" in out


def test_json_of_a_usable_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(str(ROOT / "configs" / "default.toml"), "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "file": str(ROOT / "configs" / "default.toml"),
        "ok": True,
        "problems": [],
        "changes": {},
    }


def test_mistakes_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[extractor]\npassable_hight_m = 1.0\n")
    assert call(str(bad), "--json") == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)["ok"] is False
    assert "did you mean passable_height_m?" in captured.err
