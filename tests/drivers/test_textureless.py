"""Smooth pixels of a stereo pair: sky and blank paint, distinguished from edges, wires, dark and saturated pixels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import BEYOND_MM, CONTINUED_MM, TEXTURED_MM, TEXTURELESS_MM, UNKNOWN_MM
from drivers.cameras.textureless import SmoothLimits, edges, mark_unmeasured, noise_grey, smooth

HEIGHT, WIDTH = 180, 240
LIMITS = SmoothLimits()
Image = NDArray[np.float64]
Mask = NDArray[np.bool_]
INNER = np.s_[20:-20, 20:-20]


def sky() -> Image:
    """Brighter towards the horizon, by up to half a grey level a row."""
    rows = np.linspace(0.0, 1.0, HEIGHT)
    return np.repeat((120.0 + 50.0 * rows**2)[:, None], WIDTH, axis=1)


def pair(image: Image, noise: float = 1.0, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Both images of something at infinity, each with its own noise."""
    rng = np.random.Generator(np.random.PCG64(seed))
    left, right = (np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255) for _ in range(2))
    return left.astype(np.uint8), right.astype(np.uint8)


@pytest.mark.parametrize("noise", [0.5, 1.0, 1.5])
def test_a_clear_sky_is_smooth(noise: float) -> None:
    left, right = pair(sky(), noise)
    assert smooth(left, right, edges(left, LIMITS), LIMITS)[INNER].mean() > 0.999


@pytest.mark.parametrize("noise", [0.5, 1.0, 1.5])
def test_the_noise_is_measured(noise: float) -> None:
    assert noise_grey(pair(sky(), noise)[0]) == pytest.approx(noise, rel=0.15)


def rectified(image: NDArray[np.uint8], right_px: float, down_px: float) -> NDArray[np.uint8]:
    """An image as rectification moves it: by interpolation between its pixels."""
    move = np.array([[1.0, 0.0, right_px], [0.0, 1.0, down_px]])
    return np.asarray(cv2.warpAffine(image, move, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT_101), np.uint8)


INTERPOLATED_PX = [(0.5, 0.5), (0.0, 0.5), (0.25, 0.25), (0.3, 0.1)]


@pytest.mark.parametrize("moved_px", INTERPOLATED_PX)
@pytest.mark.parametrize("noise", [0.5, 1.0, 1.5])
def test_a_rectified_sky_is_smooth(noise: float, moved_px: tuple[float, float]) -> None:
    """Noise of neighbours is alike there. Taken for less than it is, it made a tenth of a clear sky edges, and nothing was open."""
    left, right = (rectified(image, *moved_px) for image in pair(sky(), noise))
    assert smooth(left, right, edges(left, LIMITS), LIMITS)[INNER].mean() > 0.99


@pytest.mark.parametrize("moved_px", INTERPOLATED_PX)
def test_a_faint_edge_of_a_rectified_image_is_found(moved_px: tuple[float, float]) -> None:
    image = sky()
    image[90:] += 4.0
    left, right = (rectified(i, *moved_px) for i in pair(image))
    assert (~smooth(left, right, edges(left, LIMITS), LIMITS))[84:97, 20:-20].any(axis=0).mean() > 0.98


@pytest.mark.parametrize("noise", [0.5, 1.0, 1.5])
def test_a_faint_horizontal_edge_is_found_over_its_whole_length(noise: float) -> None:
    image = sky()
    image[90:] += 2.0 + 2.0 * noise
    left, right = pair(image, noise)
    assert (~smooth(left, right, edges(left, LIMITS), LIMITS))[84:97, 20:-20].any(axis=0).mean() > 0.98


def test_a_thin_wire_is_found() -> None:
    image = sky()
    image[100] -= 25.0
    left, right = pair(image)
    assert not smooth(left, right, edges(left, LIMITS), LIMITS)[100, 20:-20].any()
    assert smooth(left, right, edges(left, LIMITS), LIMITS)[60, 20:-20].all()


@pytest.mark.parametrize("grey", [10.0, 254.0])
def test_dark_and_saturated_pixels_are_not_evaluated(grey: float) -> None:
    left, right = pair(np.full((HEIGHT, WIDTH), grey), 0.5)
    assert not smooth(left, right, edges(left, LIMITS), LIMITS).any()


@pytest.mark.parametrize("grey", [0.0, 10.0, 255.0])
def test_what_the_right_camera_does_not_show_is_not_smooth(grey: float) -> None:
    """Its lens is covered by mud, or faces the sun, in the greater part of the image: the difference in brightness is that of
    most pixels there, and was taken for one of the two cameras."""
    left, right = pair(sky())
    rng = np.random.Generator(np.random.PCG64(3))
    covered = np.s_[: HEIGHT * 2 // 3]
    right[covered] = np.clip(grey + rng.standard_normal(right[covered].shape), 0, 255).astype(np.uint8)
    found = smooth(left, right, edges(left, LIMITS), LIMITS)
    assert not found[covered].any()
    assert found[HEIGHT * 2 // 3 + 8 : -20, 20:-20].mean() > 0.95


def test_texture_is_not_smooth() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    image = sky()
    image[:, 120:] += 12.0 * rng.standard_normal((HEIGHT, WIDTH - 120))
    left, right = pair(image)
    assert smooth(left, right, edges(left, LIMITS), LIMITS)[20:-20, 150:].mean() < 0.02


def test_a_near_surface_of_another_brightness_than_the_right_image_is_not_smooth() -> None:
    left, _ = pair(sky())
    other = sky()
    other[:, :100] += 12.0  # there the right imager sees past the edge of something near
    _, right = pair(other)
    found = smooth(left, right, edges(left, LIMITS), LIMITS)
    assert not found[20:-20, 20:90].any()
    assert found[20:-20, 120:-20].all()


def test_marks_stand_for_unmeasured_pixels_only() -> None:
    left, right = pair(sky())
    depth = np.full((HEIGHT, WIDTH), UNKNOWN_MM, np.uint16)
    depth[:, :50] = 4000
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[:, :50], disparity[:, 50:60] = 10.0, 0.1
    marks = mark_unmeasured(depth, disparity, left, right, LIMITS)
    assert (marks[:, :50] == 4000).all()
    assert (marks[:, 50:60] == BEYOND_MM).all()
    assert (marks[20:-20, 80:-20] == TEXTURELESS_MM).mean() > 0.99


def ground(
    step_grey: float, unmatched_rows: int = 0
) -> tuple[NDArray[np.uint16], NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]:
    """Ground below row 120, matched but for its first rows, above it 40 smooth rows that differ from it by step_grey, then the sky."""
    image = sky()
    rng = np.random.Generator(np.random.PCG64(4))
    image[80:] = 80.0
    image[80:120] += step_grey
    image[120:] += 8.0 * rng.standard_normal((HEIGHT - 120, WIDTH))
    left, right = pair(image)
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[120 + unmatched_rows :] = 3.0
    depth = np.where(disparity > 0.0, np.uint16(14_000), np.uint16(UNKNOWN_MM)).astype(np.uint16)
    return depth, disparity, left, right


def test_smooth_ground_of_the_same_brightness_continues_what_is_matched_below() -> None:
    depth, disparity, left, right = ground(0.0)
    marks = mark_unmeasured(depth, disparity, left, right, LIMITS)
    assert (marks[90:112, 20:-20] == CONTINUED_MM).mean() > 0.9
    assert not (marks[:70] == CONTINUED_MM).any()


@pytest.mark.parametrize("step_grey", [-7.0, 7.0, 12.0])
def test_a_smooth_beam_of_another_brightness_does_not(step_grey: float) -> None:
    """Of little more than like_grey too: the ground is compared without the rows of the beam that a mean at its border holds."""
    depth, disparity, left, right = ground(step_grey)
    assert not (mark_unmeasured(depth, disparity, left, right, LIMITS) == CONTINUED_MM).any()


def test_a_smooth_wall_beyond_rows_without_a_match_does_not() -> None:
    """Of the same brightness as the ground: these rows may be the lower edge of something near."""
    depth, disparity, left, right = ground(0.0, unmatched_rows=12)
    assert not (mark_unmeasured(depth, disparity, left, right, LIMITS) == CONTINUED_MM).any()


def test_unmatched_texture_is_marked_and_dark_and_saturated_pixels_are_not() -> None:
    image = sky()
    rng = np.random.Generator(np.random.PCG64(5))
    image[:60] = 120.0 + 20.0 * rng.standard_normal((60, WIDTH))
    image[60:90], image[90:120] = 10.0, 255.0
    left, right = pair(image)
    nothing = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    marks = mark_unmeasured(np.zeros((HEIGHT, WIDTH), np.uint16), nothing, left, right, LIMITS)
    assert (marks[5:55, 20:-20] == TEXTURED_MM).mean() > 0.98
    assert (marks[65:85] == UNKNOWN_MM).all()
    assert (marks[95:115] == UNKNOWN_MM).all()


def below_horizon(first: int, end: int, slope_deg: float) -> Mask:
    """(H, W) rows first..end - 1 of a view whose horizon, in row 90 at the middle, is inclined."""
    rise = np.round(np.tan(np.radians(slope_deg)) * (np.arange(WIDTH) - WIDTH / 2)).astype(int)
    v = np.arange(HEIGHT)[:, None] - rise
    return np.asarray((v >= first) & (v < end))


def horizon_and_rod(rod_grey: float | None, slope_deg: float = 0.0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A sky that ends at row 90, unmatched texture below it, and 8 rows lower a level rod of two rows."""
    image = sky()
    rng = np.random.Generator(np.random.PCG64(6))
    ground = below_horizon(90, 2 * HEIGHT, slope_deg)
    image[ground] = 90.0 + 12.0 * rng.standard_normal(int(ground.sum()))
    if rod_grey is not None:
        image[below_horizon(98, 100, slope_deg)] = rod_grey
    return pair(image)


@pytest.mark.parametrize("roll_deg", [-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0])
@pytest.mark.parametrize(("rod_grey", "is_unknown"), [(150.0, True), (40.0, True), (None, False)])
def test_a_level_line_below_the_horizon_is_unknown_and_the_horizon_is_not(
    rod_grey: float | None, is_unknown: bool, roll_deg: float
) -> None:
    """Texture without a match is passed over for 1.5 degrees below the sky, a rod must not be."""
    left, right = horizon_and_rod(rod_grey, roll_deg)
    nothing = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    marks = mark_unmeasured(np.zeros((HEIGHT, WIDTH), np.uint16), nothing, left, right, LIMITS)[:, 20:-20]
    rod, edge, ground = (
        below_horizon(*rows, roll_deg)[:, 20:-20] for rows in ((97, 101), (90, 92), (105, HEIGHT - 20))
    )
    assert (marks[rod] == UNKNOWN_MM).mean() == pytest.approx(float(is_unknown), abs=0.1)
    assert (marks[edge] == TEXTURED_MM).mean() > 0.98
    assert (marks[ground] == TEXTURED_MM).mean() > 0.98


def lower_edge_marks(rows_of_sky: int, sharpened: float = 0.0) -> NDArray[np.uint16]:
    """The marks (rows above and below, columns) of a blank thing that ends so many rows above the horizon, in row 90, with a brighter
    sky between both; 0: a sky that ends there. All of it gets brighter downwards. sharpened: how much an unsharp mask adds."""
    image = np.full((HEIGHT, WIDTH), 170.0)
    if rows_of_sky:
        image[: 90 - rows_of_sky] = 130.0
    image[90:] = 80.0
    image += 0.2 * (np.arange(HEIGHT)[:, None] - 90.0)
    image += sharpened * (image - cv2.GaussianBlur(image, (0, 0), 1.0))
    left, right = pair(image)
    nothing = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    return mark_unmeasured(np.zeros((HEIGHT, WIDTH), np.uint16), nothing, left, right, LIMITS)[70:90, 20:-20]


@pytest.mark.parametrize("rows_of_sky", [4, 8, 10])
def test_a_lower_edge_with_brighter_sky_below_it_is_unknown(rows_of_sky: int) -> None:
    """With 8 and 10 rows of sky the dark thing was taken for sky: its edge was the lower edge of smooth pixels, and the horizon that of the
    smooth rows between both."""
    marks = lower_edge_marks(rows_of_sky)
    assert (marks == UNKNOWN_MM).any(axis=0).mean() > 0.95
    assert (marks[:4] == TEXTURELESS_MM).mean() > 0.95


@pytest.mark.parametrize("sharpened", [0.0, 0.5, 1.0])
def test_the_edge_of_a_sky_is_marked_in_sharpened_images_too(sharpened: float) -> None:
    marks = lower_edge_marks(0, sharpened)
    assert (marks != UNKNOWN_MM).mean() > 0.98


def test_what_is_matched_on_a_level_line_stays() -> None:
    left, right = horizon_and_rod(150.0)
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[95:] = 8.0
    depth = np.where(disparity > 0.0, np.uint16(5000), np.uint16(UNKNOWN_MM)).astype(np.uint16)
    assert (mark_unmeasured(depth, disparity, left, right, LIMITS)[95:] == 5000).all()


def test_noise_is_no_edge_at_the_border_of_the_image_either() -> None:
    """Windows at the border hold fewer pixels, so their means are noisier."""
    found = np.zeros((HEIGHT, WIDTH))
    for seed in range(20):
        left, _ = pair(np.full((HEIGHT, WIDTH), 128.0), 1.5, seed)
        found += edges(left, LIMITS)
    assert found.mean() < 1e-3
    border = np.concatenate([found[:8].ravel(), found[-8:].ravel(), found[:, :8].ravel(), found[:, -8:].ravel()])
    assert border.mean() < 3e-3
