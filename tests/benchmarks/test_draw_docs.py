"""The pictures of the documentation can be drawn from the stages as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks import draw_docs
from benchmarks.draw_pixels import is_ground, levelled


def test_every_picture_is_drawn_and_the_folder_of_the_pages_holds_each(tmp_path: Path) -> None:
    from PIL import Image

    assert draw_docs.main(["--out", str(tmp_path)]) == 0
    names = [draw_docs.OVERVIEW, *draw_docs.PICTURES]
    for name in names:
        assert (draw_docs.FOLDER / f"{name}.png").is_file(), name
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert len(picture.getcolors(draw_docs.COLORS) or []) > 8, f"{name} shows nothing"


def test_what_is_painted_as_ground_is_what_the_search_for_strips_left_out() -> None:
    _, calls, _, _ = draw_docs.look("street")
    ground = is_ground(calls)
    found, ground_px, _ = calls.of("extract_strips").result
    assert found > 0
    assert np.count_nonzero(ground) == ground_px > 1000
    assert not ground[levelled(calls) <= 1].any()
