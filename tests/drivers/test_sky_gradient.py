"""A face of one brightness is no sky: that of a sky changes with height."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import TEXTURELESS_MM
from drivers.cameras.textureless import SmoothLimits, limits_of, mark_unmeasured

HEIGHT, WIDTH = 200, 240
Floats = NDArray[np.float64]


def textureless(
    left: Floats, right: Floats, limits: SmoothLimits | None = None, noise_grey: float = 1.0
) -> NDArray[np.bool_]:
    """Which pixels of a pair are marked as textureless. left, right: (H, W) grey levels without noise."""
    rng = np.random.default_rng(3)
    images = [i + noise_grey * rng.standard_normal(i.shape) for i in (left, right)]
    one, other = (np.clip(np.rint(i), 0, 255).astype(np.uint8) for i in images)
    nothing = np.full(one.shape, -1.0, np.float32)
    marks = mark_unmeasured(np.zeros(one.shape, np.uint16), nothing, one, other, limits or SmoothLimits())
    return np.asarray(marks == TEXTURELESS_MM)


def sky_share(
    change: float,
    top_loss: float = 0.0,
    horizon: int = 120,
    limits: SmoothLimits | None = None,
    greys: tuple[float, float] = (150.0, 70.0),
    noise_grey: float = 1.0,
) -> float:
    """Share of textureless pixels above the horizon. change: of the brightness over 24 rows above it; top_loss: share of the light that
    the lens loses at the upper border, with the square of the distance from the middle; greys: above and below the horizon."""
    rows = np.arange(HEIGHT)[:, None]
    image = np.where(rows < horizon, greys[0] * (1.0 + change * (rows - horizon) / 24.0), greys[1])
    image = image * (1.0 - top_loss * ((rows - 0.5 * HEIGHT) / (0.5 * HEIGHT)) ** 2)
    image = np.repeat(image, WIDTH, axis=1)
    return float(textureless(image, image, limits, noise_grey)[: horizon - 10, 20:-20].mean())


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
    """Core requires 5 degrees of it, 31 rows and more."""
    assert sky_share(0.0, horizon=20) > 0.5


@pytest.mark.parametrize("horizon", [28, 32, 36])
def test_a_low_face_is_compared_over_the_rows_there_are(horizon: int) -> None:
    """Pitched down, an image of 320 x 200 shows 23 rows of 5 degrees of sky, 2 fewer than were compared: a slab was open."""
    assert sky_share(0.0, horizon=horizon) == 0.0
    assert sky_share(0.03, horizon=horizon) > 0.8


@pytest.mark.parametrize("change", [-0.003, 0.003])
def test_a_face_that_hardly_changes_is_no_sky(change: float) -> None:
    assert sky_share(change) == 0.0


def test_a_speck_high_in_a_hazy_sky_closes_no_other_columns() -> None:
    """There such a sky changes too little. Where means held its columns, 15 columns on each side of it were no sky."""
    rows = np.arange(HEIGHT)[:, None]
    image = np.repeat(np.where(rows < 120, 200.0 - 0.12 * np.clip(120.0 - rows, 0.0, 60.0), 70.0), WIDTH, axis=1)
    image[40:42, 118:121] = 120.0
    assert textureless(image, image)[60:110, np.r_[20:108, 130:220]].mean() > 0.95


@pytest.mark.parametrize("noise_grey", [1.5, 2.5])
@pytest.mark.parametrize("greys", [(80.0, 50.0), (60.0, 42.0), (45.0, 32.0)])
def test_the_noise_of_a_dim_face_is_no_change(greys: tuple[float, float], noise_grey: float) -> None:
    """The noise of most columns was more than 0.6 % of the brightness, in one direction or the other: up to 94 % of it was sky."""
    assert sky_share(0.0, greys=greys, noise_grey=noise_grey) < 0.01


def test_a_dim_clear_sky_stays() -> None:
    assert sky_share(0.06, greys=(45.0, 32.0), noise_grey=2.0) > 0.9


@pytest.mark.parametrize("change_grey", [-0.1, 0.2])
def test_a_face_of_uneven_light_beside_a_sky_of_one_brightness_is_no_sky(change_grey: float) -> None:
    """A near outline with a step of brightness separates them: one is a thing. When the sky was removed first, the face stayed sky."""
    rows = np.arange(HEIGHT)[:, None]

    def image(shift: int) -> Floats:
        """The face begins `shift` columns farther to the left."""
        grey = np.full((HEIGHT, WIDTH), 180.0)
        grey[:, WIDTH // 2 - shift :] = 130.0 + change_grey * (rows - 120)
        grey[120:] = 80.0
        return grey

    assert not textureless(image(0), image(8))[20:100].any()
