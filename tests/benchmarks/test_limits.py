"""The measured tables of docs/research/algorithm-measurements.md are those of docs/research/benchmarks/limits.json."""

from __future__ import annotations

import json

import pytest

from benchmarks.fidelity.limits import BLOCKS, FIGURES, PAGE, fill, height_table, range_table, thin_table

DATA = {
    "measured": {"date": "2026-11-23", "commit": "abc1234", "command": "python -m benchmarks"},
    "thin": [
        {"object": "pole", "ke": 0.005, "from_m": 4.0, "kept": 1.0, "count": 3},
        {"object": "wire", "ke": 0.005, "from_m": 6.0, "kept": 0.724, "count": 2},
    ],
    "ranges": [{"family": "structured", "ke": 0.0015, "missed_phantom": [[0.0004, 0.0], None, [0.0, 0.01], None]}],
    "heights": [
        {
            "height_m": 0.7,
            "structured missed": [0.02, 0.001],
            "structured phantom": None,
            "unstructured missed": [0.0, 0.0],
            "unstructured phantom": [1.234, 0.5],
        }
    ],
}


def test_the_page_holds_the_measured_tables() -> None:
    text = PAGE.read_text()
    assert fill(text, json.loads(FIGURES.read_text())) == text, "run `python -m benchmarks.fidelity.limits`"


def test_a_figure_that_is_missing_is_a_dash() -> None:
    assert thin_table(DATA).splitlines()[2:] == ["| pole | 0.005 | 100 % | - |", "| wire | 0.005 | - | 72 % |"]
    assert (
        range_table(DATA).splitlines()[2]
        == "| structured (walls, houses) | 0.0015 | 0.040 / 0.00 | - | 0.000 / 1.00 | - |"
    )
    assert height_table(DATA).splitlines()[2] == "| 0.7 m | 0.02 (0.001) | - | 0 (0) | 1.23 (0.5) |"


def test_blocks_are_written_anew_and_a_missing_one_is_an_error() -> None:
    page = "".join(f"before\n<!-- measured: {name} -->\nold\n<!-- end -->\nafter\n" for name in BLOCKS)
    written = fill(page, DATA)
    assert "old" not in written
    assert written.count("before") == written.count("after") == len(BLOCKS)
    assert "commit abc1234" in written
    with pytest.raises(ValueError, match="no block"):
        fill("no table", DATA)
