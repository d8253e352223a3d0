"""The page of the paper's figures and the measured pieces of docs/research/paper.md."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks.paper import section as section_paper
from benchmarks.paper.equations import Finding
from benchmarks.paper.section import BEGIN, DOC, END, PARTS, filled, main, measured, rows_file

FINDING = Finding(name="units", title="U", head=["a"], digits=[1], rows=[[1.0]])


def test_pieces_are_renewed_between_their_marks_only() -> None:
    text = f"words\n{BEGIN.format(name='a')}\nold\n{END.format(name='a')}\nmore\n{BEGIN.format(name='b')}\nkept\n{END.format(name='b')}\n"
    new = filled(text, {"a": "new", "c": "nowhere"})
    assert new == text.replace("old", "new")
    assert filled(new, {"a": "new"}) == new


def fake(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every part gives one finding; returns the names of those that ran."""
    ran: list[str] = []

    def part(name: str) -> Any:
        def run(quick: bool) -> list[Finding]:
            ran.append(f"{name} {quick}")
            return [FINDING]

        return run

    monkeypatch.setattr(section_paper, "PARTS", {name: part(name) for name in ("times", "findings")})
    return ran


def test_parts_that_are_not_run_come_from_the_last_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = fake(monkeypatch)
    first = measured(tmp_path, True, ["times", "findings"])
    assert ran == ["times True", "findings True"]
    again = measured(tmp_path, True, ["times"])
    assert ran[2:] == ["times True"]
    assert again == first == json.loads(rows_file(tmp_path, True).read_text())
    assert Finding(**again["findings"][0]).markdown() == "| a |\n|---:|\n| 1.0 |"


def test_without_a_last_run_a_part_alone_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--only", "none", "--rows", str(tmp_path), "--doc", str(tmp_path / "no.md")]) == 1
    assert "holds no times, storage" in capsys.readouterr().err


def test_rows_of_a_part_that_is_missing_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(monkeypatch)
    rows_file(tmp_path, True).write_text("{}")
    with pytest.raises(FileNotFoundError, match="holds no findings"):
        measured(tmp_path, True, ["times"])


def test_the_marks_of_the_document_are_whole_and_known() -> None:
    text = DOC.read_text()
    begun = re.findall(r"<!-- measured: (\w+) -->", text)
    assert begun
    assert begun == re.findall(r"<!-- end of (\w+) -->", text)
    assert len(set(begun)) == len(begun)
    for name in begun:
        piece = text.split(BEGIN.format(name=name))[1].split(END.format(name=name))[0]
        assert piece.strip(), f"{name}: never measured"
    assert {"claims", "summary", "stamp"} <= set(begun)


def test_the_parts_cover_the_figures() -> None:
    assert list(PARTS) == ["times", "storage", "tilt", "interval", "shapes", "openings", "findings"]
