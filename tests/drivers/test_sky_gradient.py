"""A face of one brightness is no sky: that of a sky changes with height."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import TEXTURELESS_MM
from drivers.cameras.textureless import SmoothLimits, limits_of, mark_unmeasured

HEIGHT, WIDTH = 200, 240
Gray = NDArray[np.uint8]


def sky_share(change: float, top_loss: float = 0.0, horizon: int = 120, limits: SmoothLimits | None = None) -> float:
    """Share of textureless pixels above the horizon. change: of the brightness over 24 rows above it; top_loss: share of the light that
    the lens loses at the upper border, with the square of the distance from the middle."""
    rng = np.random.default_rng(3)
    rows = np.arange(HEIGHT)[:, None]
    image = np.where(rows < horizon, 150.0 * (1.0 + change * (rows - horizon) / 24.0), 70.0)
    image = image * (1.0 - top_loss * ((rows - 0.5 * HEIGHT) / (0.5 * HEIGHT)) ** 2)
    image = np.repeat(image, WIDTH, axis=1)
    left, right = (np.clip(np.rint(image + rng.standard_normal(image.shape)), 0, 255).astype(np.uint8) for _ in "lr")
    nothing = np.full(left.shape, -1.0, np.float32)
    marks = mark_unmeasured(np.zeros(left.shape, np.uint16), nothing, left, right, limits or SmoothLimits())
    return float((marks[: horizon - 10, 20:-20] == TEXTURELESS_MM).mean())


@pytest.mark.parametrize("top_loss", [0.0, 0.02, 0.05])
def test_a_face_of_one_brightness_is_no_sky(top_loss: float) -> None:
    """Brighter than the ground below its lower edge, it was open in level views, also where the lens loses light at the border."""
    assert sky_share(0.0, top_loss) == 0.0


@pytest.mark.parametrize("change", [-0.04, -0.02, 0.012, 0.02, 0.06])
def test_a_sky_that_changes_with_height_stays(change: float) -> None:
    """Of a clear sky 0.06 over 4 degrees, of a hazy one 0.012, of a closed cover darker towards the horizon."""
    assert sky_share(change) > 0.9


def test_the_height_of_the_comparison_is_an_angle() -> None:
    """With twice the pixels for a degree the same sky changes half as much from row to row."""
    assert limits_of(700.0, 0.12).rise_px == 2 * limits_of(350.0, 0.12).rise_px
    assert sky_share(0.007, limits=limits_of(700.0, 0.12)) > 0.9


def test_a_sky_too_low_to_be_compared_stays() -> None:
    """Core requires 5 degrees of it."""
    assert sky_share(0.0, horizon=30) > 0.5


def test_a_speck_high_in_a_hazy_sky_closes_no_other_columns() -> None:
    """There such a sky changes too little. Where means held its columns, 15 columns on each side of it were no sky."""
    rows = np.arange(HEIGHT)[:, None]
    image = np.repeat(np.where(rows < 120, 200.0 - 0.12 * np.clip(120.0 - rows, 0.0, 60.0), 70.0), WIDTH, axis=1)
    image[40:42, 118:121] = 120.0
    rng = np.random.default_rng(3)
    left, right = (np.clip(np.rint(image + rng.standard_normal(image.shape)), 0, 255).astype(np.uint8) for _ in "lr")
    nothing = np.full(left.shape, -1.0, np.float32)
    marks = mark_unmeasured(np.zeros(left.shape, np.uint16), nothing, left, right, SmoothLimits())
    assert (marks[60:110, np.r_[20:108, 130:220]] == TEXTURELESS_MM).mean() > 0.95
