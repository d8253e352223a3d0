"""The picture of a case shows the frame that the fidelity run scores."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import pytest

from benchmarks.fidelity import draw_case
from benchmarks.fidelity.case import run_case
from benchmarks.fidelity.run import asked, parse
from core.extractor import Extractor

TREES = ["--scenes", "trees", "--tilts", "0:0", "--ke", "0.005", "--seed", "3", "--width", "160"]


@pytest.mark.parametrize("frames", [[], ["--frames", "2"]])
def test_the_frame_of_the_run_is_drawn(frames: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    real = draw_case.score
    monkeypatch.setattr(draw_case, "score", lambda *given: drawn.append(real(*given)) or drawn[-1])
    assert draw_case.main([*TREES, *frames, "--out", str(tmp_path)]) == 0
    args = parse([*TREES, *frames])
    wanted = run_case(asked(args)[0], Extractor(), args.frames, grids=False).score
    assert wanted.planes > 0
    assert astuple(drawn[0]) == astuple(wanted)
    assert len(list(tmp_path.glob("case_trees*.png"))) == 1
