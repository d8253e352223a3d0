"""A nearly level rod before texture is not measured as what is behind it; what its own row locates, or what stands out, stays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.cameras.level_lines import level_lines, without_level_lines

HEIGHT, WIDTH, BEHIND_PX, LENGTH_PX, LEAST = 80, 240, 3, 61, 0.8
TOP, ROWS = 40, 3
ROD = np.s_[TOP : TOP + ROWS, 40:-40]
Gray = NDArray[np.uint8]


def pair(rod_grey: int | None) -> tuple[Gray, Gray]:
    """Both images of a textured surface at BEHIND_PX, with a level rod of a brightness before it; None: no rod."""
    rng = np.random.Generator(np.random.PCG64(3))
    wide = rng.normal(90.0, 20.0, (HEIGHT, WIDTH + BEHIND_PX))
    images = wide[:, :WIDTH].copy(), wide[:, BEHIND_PX:].copy()
    for image in images:
        if rod_grey is not None:
            image[TOP : TOP + ROWS] = rod_grey
        image += rng.normal(0.0, 1.0, image.shape)
    left, right = (np.clip(image, 0, 255).astype(np.uint8) for image in images)
    return left, right


def test_a_rod_is_not_measured_as_what_is_behind_it() -> None:
    left, right = pair(160)
    found = np.full(left.shape, BEHIND_PX, np.float32)  # as the window gives it
    kept = without_level_lines(left, right, found, LENGTH_PX, LEAST)
    assert (kept[ROD] < 0.0).mean() > 0.95
    rows = (kept[:, 60:-60] < 0.0).mean(axis=1) > 0.9
    assert rows.sum() >= 5  # more than the rows of a hole that is filled
    assert (kept[: TOP - 6] >= 0.0).all()
    assert (kept[TOP + ROWS + 6 :] >= 0.0).all()


@pytest.mark.parametrize("slope_deg", [-4.5, -4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0, 4.5])
def test_an_inclined_rod_is_not_measured_as_what_is_behind_it(slope_deg: float) -> None:
    """The vehicle rolls, or the rod is inclined: along 61 pixels it leaves its row, and was not found from 3 degrees on."""
    left, right = pair(None)
    rise = np.round(math.tan(math.radians(slope_deg)) * (np.arange(WIDTH) - WIDTH / 2)).astype(int)
    v = np.arange(HEIGHT)[:, None]
    rod = (v >= TOP + rise) & (v < TOP + rise + ROWS)
    rng = np.random.Generator(np.random.PCG64(4))
    images = [np.where(rod, 160.0 + rng.normal(0.0, 1.0, rod.shape), image).astype(np.uint8) for image in (left, right)]
    kept = without_level_lines(images[0], images[1], np.full(left.shape, BEHIND_PX, np.float32), LENGTH_PX, LEAST)
    inner = np.s_[:, 40:-40]
    assert (kept[inner][rod[inner]] < 0.0).mean() > 0.9
    beside = (v < TOP + rise - 8) | (v > TOP + rise + ROWS + 8)
    assert (kept[inner][beside[inner]] >= 0.0).mean() > 0.99


def test_texture_without_a_line_stays() -> None:
    left, right = pair(None)
    found = np.full(left.shape, BEHIND_PX, np.float32)
    assert (without_level_lines(left, right, found, LENGTH_PX, LEAST) >= 0.0).mean() > 0.99


def test_a_line_with_texture_of_its_own_stays() -> None:
    """A painted stripe on a wall, a course of bricks: the texture of its row agrees in both images."""
    left, right = pair(None)
    left, right = left.copy(), right.copy()
    left[TOP : TOP + ROWS], right[TOP : TOP + ROWS] = (
        left[TOP : TOP + ROWS] // 2 + 110,
        right[TOP : TOP + ROWS] // 2 + 110,
    )
    assert level_lines(left, LENGTH_PX)[TOP - 1 : TOP + ROWS + 1, 60:-60].any(axis=0).mean() > 0.9
    found = np.full(left.shape, BEHIND_PX, np.float32)
    assert (without_level_lines(left, right, found, LENGTH_PX, LEAST)[ROD] >= 0.0).mean() > 0.9


@pytest.mark.parametrize("nearer_px", [4, 12])
def test_a_rod_that_stands_out_stays(nearer_px: int) -> None:
    left, right = pair(160)
    found = np.full(left.shape, BEHIND_PX, np.float32)
    found[TOP : TOP + ROWS] = BEHIND_PX + nearer_px
    kept = without_level_lines(left, right, found, LENGTH_PX, LEAST)
    assert (kept[ROD] == BEHIND_PX + nearer_px).all()
