"""The pictures of the documentation can be drawn from the stages as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import draw_docs
from benchmarks.draw_pixels import is_ground, levelled

ALL = [draw_docs.OVERVIEW, *draw_docs.PICTURES]


@pytest.mark.parametrize(
    "names", [["06_strips", "17_free"], pytest.param(ALL, marks=pytest.mark.slow)], ids=["of pixels and planes", "all"]
)
def test_a_picture_is_drawn(names: list[str], tmp_path: Path) -> None:
    from PIL import Image

    assert draw_docs.main([*names, "--out", str(tmp_path)]) == 0
    for name in names:
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert len(picture.getcolors(draw_docs.COLORS) or []) > 8, f"{name} shows nothing"


def test_the_folder_of_the_pages_holds_every_picture() -> None:
    assert [name for name in ALL if not (draw_docs.FOLDER / f"{name}.png").is_file()] == []


def test_what_is_painted_as_ground_is_what_the_search_for_strips_left_out() -> None:
    _, calls, _, _ = draw_docs.look("street")
    ground = is_ground(calls)
    found, ground_px, _ = calls.of("extract_strips").result
    assert found > 0
    assert np.count_nonzero(ground) == ground_px > 1000
    assert not ground[levelled(calls) <= 1].any()
