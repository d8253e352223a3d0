"""Images of a USB video device that arrived in part."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.base import BadData
from drivers.cameras.torn_images import MOST_IN_A_ROW, TornImageCheck, one_repeats

Image = NDArray[np.uint8]
HEIGHT, WIDTH = 120, 320
ZED_HEIGHT, ZED_WIDTH = 376, 1344


def view(number: int) -> Image:
    """A live image of one scene: texture, and noise of its own."""
    texture = np.random.Generator(np.random.PCG64(0)).integers(40, 200, (HEIGHT, WIDTH, 3)).astype(float)
    noise = np.random.Generator(np.random.PCG64(number + 1)).normal(0.0, 1.0, texture.shape)
    return np.clip(texture + noise, 0, 255).astype(np.uint8)


def torn(new: Image, held: Image, rows: int) -> Image:
    """What a buffer holds of which only the first rows, and a part of the next one, arrived."""
    image = held.copy()
    image[:rows] = new[:rows]
    image[rows, :100] = new[rows, :100]
    return image


def verdicts(images: list[Image]) -> list[bool]:
    check = TornImageCheck("front")
    return [check.is_torn(image) for image in images]


@pytest.mark.parametrize("rows", [0, 60, 110, 118])
@pytest.mark.parametrize("buffers", [1, 2, 4])
def test_an_image_that_arrived_in_part_is_found(rows: int, buffers: int) -> None:
    """The rest of the buffer holds rows of an earlier image: what they show was there then."""
    images = [view(k) for k in range(7)]
    images[5] = torn(images[5], images[5 - buffers], rows)
    assert verdicts(images) == [False] * 5 + [True, False]


def test_the_same_rest_of_a_buffer_is_found_again_and_again() -> None:
    first = view(0)
    assert verdicts([first, *(torn(view(k), first, 60) for k in range(1, 5))]) == [False] + [True] * 4


def test_an_earlier_image_that_returns_is_found_and_one_that_is_repeated_is_not() -> None:
    """Buffers that are delivered without new content. A repeated image is known as frozen."""
    images = [view(k) for k in range(3)]
    assert verdicts([*images, images[1], images[1]]) == [False, False, False, True, False]


@pytest.mark.parametrize("rows", [HEIGHT // 2, HEIGHT * 2])
def test_an_image_of_another_height_is_not_torn_although_it_ends_alike(rows: int) -> None:
    first = view(0)
    other = np.resize(view(1), (rows, WIDTH, 3))
    other[-1] = first[-1]
    assert verdicts([first, other]) == [False, False]


def test_images_that_always_arrive_in_part_name_the_cause() -> None:
    first = view(0)
    with pytest.raises(BadData, match="camera front: the last 10 images arrived in part only; check the cable"):
        verdicts([first, *(torn(view(k), first, 60) for k in range(1, MOST_IN_A_ROW + 1))])


@pytest.mark.parametrize("grey", [0, 16, 255])
def test_rows_without_contrast_may_repeat(grey: int) -> None:
    """A dark ground of which some pixels are hot, below what can be seen; and a saturated one."""
    images = [view(k) for k in range(4)]
    for image in images:
        image[50:] = grey
        image[60::20, 20::80] = 128
    assert not any(verdicts(images))
    assert not any(verdicts([np.full((HEIGHT, WIDTH, 3), grey, np.uint8)] * 4))


@pytest.mark.parametrize(
    ("rows", "steps", "torn_too"), [(10, 60, False), (10, 120, True), (110, 200, False), (110, 400, True)]
)
def test_equal_rows_count_where_enough_of_their_pixels_show_something(rows: int, steps: int, torn_too: bool) -> None:
    """100 steps at least, and of 110 rows 351: a hundredth of their pixels. The last row is black."""
    dark = np.zeros((rows - 1, WIDTH), np.uint8)
    dark.reshape(-1)[1 : 3 * (steps // 2) : 3] = 10  # single pixels, two steps each
    images = [view(0), view(1)]
    for image in images:
        image[HEIGHT - rows :] = 0
        image[HEIGHT - rows : -1] = dark[..., None]
    assert verdicts(images) == [False, torn_too]


def test_the_first_image_is_torn_where_its_buffer_is_still_empty() -> None:
    """Bytes that were lost in the middle shift all that follows, in both eyes alike: it matches at the wrong place."""
    empty = cv2.cvtColor(np.zeros((HEIGHT, WIDTH, 2), np.uint8), cv2.COLOR_YUV2BGR_YUYV)
    assert verdicts([torn(view(0), empty, 110), view(1)]) == [True, False]
    assert verdicts([empty, view(1)]) == [True, False]


@pytest.mark.parametrize("colour", [(0, 135, 0), (128, 128, 128), (90, 90, 90), (0, 0, 255)])
@pytest.mark.parametrize("rows", [1, 60])
def test_an_image_that_ends_in_one_colour_is_found(colour: tuple[int, int, int], rows: int) -> None:
    """Whatever fills the rest of a buffer: no sensor delivers a row without noise, unless it is black or saturated."""
    image = view(0)
    image[-rows:] = colour
    assert verdicts([image, view(1)]) == [True, False]


def test_an_image_that_ends_with_a_repeated_row_is_found() -> None:
    image = view(0)
    image[100:] = image[99]
    assert verdicts([image, view(1)]) == [True, False]


def test_a_dark_night_is_not_torn() -> None:
    """Rows of a night are black without noise where the sensor clips it, and hold hot pixels that stay."""
    rng = np.random.Generator(np.random.PCG64(2))
    hot = rng.random((HEIGHT, WIDTH)) < 0.001
    nights = [np.clip(rng.normal(0.0, 1.0, (HEIGHT, WIDTH, 3)), 0, 255).astype(np.uint8) for _ in range(4)]
    for night in nights:
        night[-40:] = 0
        night[hot] = 200
    assert not any(verdicts(nights))


def yuyv(number: int) -> bytes:
    """A live image of both eyes as a ZED sends it: two bytes per pixel."""
    texture = np.random.Generator(np.random.PCG64(0)).integers(40, 200, (ZED_HEIGHT, ZED_WIDTH)).astype(float)
    noise = np.random.Generator(np.random.PCG64(number + 1)).normal(0.0, 1.0, texture.shape)
    grey = np.clip(texture + noise, 16, 235).astype(np.uint8)
    return np.dstack([grey, np.full_like(grey, 128)]).tobytes()


def decoded(data: bytes) -> Image:
    rows = np.frombuffer(data, np.uint8).reshape(ZED_HEIGHT, ZED_WIDTH, 2)
    return np.asarray(cv2.cvtColor(rows, cv2.COLOR_YUV2BGR_YUYV), np.uint8)


@pytest.mark.parametrize("lost", [1012, 1344, 2024, 2 * ZED_WIDTH, 3060, 33_000])
@pytest.mark.parametrize("buffers", [1, 4])
def test_a_packet_that_was_lost_inside_of_an_image_is_found(lost: int, buffers: int) -> None:
    """The kernel's driver moves up what follows, so that the eyes are mixed from there on, and the end of the buffer keeps as
    many bytes as were lost: for one packet of USB less than a row."""
    sent = [yuyv(k) for k in range(6)]
    begin = 100 * 2 * ZED_WIDTH + 400
    held = sent[5 - buffers]
    arrived = sent[5][:begin] + sent[5][begin + lost :] + held[-lost:]
    assert verdicts([decoded(data) for data in [*sent[:5], arrived]]) == [False] * 5 + [True]
    empty = sent[5][:begin] + sent[5][begin + lost :] + bytes(lost)
    assert verdicts([decoded(empty)]) == [True]


def test_an_image_of_another_size_is_compared_with_none() -> None:
    assert not any(verdicts([view(0), view(1)[:60], view(2)]))


@pytest.mark.parametrize("first", [0, 1])
def test_one_camera_of_a_pair_that_repeats_its_image_is_found(first: int) -> None:
    left, right = ([view(k)[:, :, 0] for k in range(n, n + 2)] for n in (0, 5))
    before, live, held = (left[0], right[0]), (left[1], right[1]), (left[first], right[1 - first])
    assert one_repeats(held, before)
    assert not one_repeats(live, before)
    assert not one_repeats(before, before)  # both: the depth repeats too, which the supervision judges


def test_a_dark_camera_of_a_pair_does_not_count_as_repeating() -> None:
    dark = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert not one_repeats((view(1)[:, :, 0], dark), (view(0)[:, :, 0], dark))
    assert not one_repeats((view(1)[:60, :, 0], dark), (view(0)[:, :, 0], dark))
