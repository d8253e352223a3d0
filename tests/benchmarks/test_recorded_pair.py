"""The check of recorded stereo pairs measures a shifted texture and refuses what is no image."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.open_air.recorded_pair import WIDTH, load, main, picture
from core.types import GREATEST_MARK_MM

F_PX, BASELINE_M, SHIFT_PX = 375.0, 0.12, 15


@pytest.fixture
def images(tmp_path: Path) -> tuple[Path, Path]:
    """A textured wall at F_PX * BASELINE_M / SHIFT_PX = 3 m."""
    rng = np.random.default_rng(1)
    wall = cv2.GaussianBlur(rng.integers(0, 255, (376, WIDTH + SHIFT_PX), np.uint8), (5, 5), 1.0)
    wall = cv2.normalize(wall, None, 40, 220, cv2.NORM_MINMAX)
    paths = (tmp_path / "left.png", tmp_path / "right.png")
    cv2.imwrite(str(paths[0]), wall[:, :WIDTH])
    cv2.imwrite(str(paths[1]), wall[:, SHIFT_PX:])
    return paths


def test_a_wall_is_measured(images: tuple[Path, Path]) -> None:
    pair = load(*images, F_PX, BASELINE_M)
    depth = pair.depth()
    measured = depth[depth > GREATEST_MARK_MM]
    assert measured.size > 0.5 * depth.size
    assert np.median(measured) == pytest.approx(3000.0, rel=0.02)
    assert picture(pair, depth).shape == (3 * depth.shape[0], WIDTH, 3)


def test_what_is_no_image_is_refused(
    tmp_path: Path, images: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(images[0]), str(tmp_path / "none.png"), "--f-px", "375", "--baseline-m", "0.12"]) == 1
    assert "none.png: not a readable image" in capsys.readouterr().err
