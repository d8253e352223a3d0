"""Blank things that the upper border of the image cuts and that end at the horizon: neither they nor the sky beside them are sky."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import TEXTURELESS_MM, UNKNOWN_MM
from drivers.cameras.textureless import SmoothLimits, limits_of, mark_unmeasured

HEIGHT, WIDTH, HORIZON, NEAR_PX = 240, 400, 120, 8
SKY_GREY, GROUND_GREY = 180.0, 80.0
Gray = NDArray[np.uint8]
Marks = NDArray[np.uint16]
LIMITS = SmoothLimits()
NOTHING = np.full((HEIGHT, WIDTH), -1.0, np.float32)


def eye(
    first: int,
    end: int,
    top: int,
    bottom: int,
    grey: float,
    shift: float,
    seed: int,
    hanging: tuple[int, int, float] | None = None,
    falls: float = 0.0,
) -> Gray:
    """Sky and ground, with one thing without texture: columns first..end and rows top..bottom, `shift` farther to the left. The
    brightness of all changes with height, as that of a sky. hanging: columns and grey of what hangs 60 rows down from its lower edge;
    falls: rows by which that edge falls for each column."""
    rng = np.random.default_rng(seed)
    image = np.full((HEIGHT, WIDTH), SKY_GREY)
    image[HORIZON:] = GROUND_GREY
    covered = np.clip(np.arange(WIDTH) - (first - shift) + 0.5, 0.0, 1.0) * np.clip(
        end - shift - np.arange(WIDTH) + 0.5, 0.0, 1.0
    )
    low = bottom + falls * (np.arange(WIDTH) - (first - shift))
    inside = (np.arange(HEIGHT)[:, None] >= top) & (np.arange(HEIGHT)[:, None] < low)
    image += inside * covered * (grey - image)
    if hanging is not None:
        image[bottom : bottom + 60, hanging[0] - int(shift) : hanging[1] - int(shift)] = hanging[2]
    image += 0.2 * (np.arange(HEIGHT)[:, None] - HORIZON)
    return np.asarray(np.clip(np.rint(image + rng.standard_normal(image.shape)), 0, 255), np.uint8)


def marks_of(
    thing: tuple[int, int, int, int],
    grey: float,
    shift: float,
    matched: bool = False,
    limits: SmoothLimits = LIMITS,
) -> Marks:
    """The marks of an image with such a thing; matched: its upright outlines are."""
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    first, end, top, bottom = thing
    if matched:
        for at in (first, end):
            disparity[top:bottom, max(0, at - 2) : at + 2] = shift
    return marked(eye(*thing, grey, 0, 1), eye(*thing, grey, shift, 2), disparity, limits)


def marked(left: Gray, right: Gray, disparity: NDArray[np.float32] = NOTHING, limits: SmoothLimits = LIMITS) -> Marks:
    """The marks of a pair of which nothing has a depth."""
    return mark_unmeasured(np.full(left.shape, UNKNOWN_MM, np.uint16), disparity, left, right, limits)


def sky_share(marks: Marks, first: int, end: int) -> float:
    """Share of textureless pixels in these columns above the horizon, without the rows at the borders."""
    return float((marks[20 : HORIZON - 20, first:end] == TEXTURELESS_MM).mean())


@pytest.mark.parametrize(("shift", "matched"), [(NEAR_PX, False), (NEAR_PX, True), (5, True)])
@pytest.mark.parametrize("bottom", [HORIZON - 8, HORIZON, HORIZON + 8])
def test_a_near_blank_slab_that_ends_at_the_horizon_is_no_sky(bottom: int, shift: int, matched: bool) -> None:
    """30 degrees beside its measured upright edge such a face was open. Which of both areas is the thing is not known."""
    marks = marks_of((200, WIDTH + 20, 0, bottom), 130.0, shift, matched)
    assert sky_share(marks, 220, WIDTH - 20) == 0.0
    assert sky_share(marks, 20, 180) == 0.0


@pytest.mark.parametrize("shift", [14, 28, 60])
@pytest.mark.parametrize("grey", [60.0, 130.0, 165.0])
def test_a_nearer_slab_is_no_sky_either(shift: int, grey: float) -> None:
    """Beside its outline each image shows another surface over as many columns as the disparity. A step of 15 grey levels was compared
    with the slope of a sky over all of them, and an outline of more than 48 columns was none."""
    marks = marks_of((200, WIDTH + 20, 0, HORIZON), grey, shift)
    assert sky_share(marks, 220, WIDTH - 20) == 0.0
    assert sky_share(marks, 20, 180) == 0.0


@pytest.mark.parametrize("leaf", [(300, 306), (240, 260), (385, WIDTH + 20)])
@pytest.mark.parametrize("leaf_grey", [130.0, 150.0])
def test_what_hangs_below_a_slab_does_not_hide_it(leaf: tuple[int, int], leaf_grey: float) -> None:
    """A leaf, a chain or a lamp of its brightness belongs to the area of the slab, which was compared by its lowest row."""
    left, right = (
        eye(200, WIDTH + 20, 0, HORIZON, 130.0, shift, seed, hanging=(*leaf, leaf_grey))
        for shift, seed in ((0, 1), (NEAR_PX, 2))
    )
    marks = marked(left, right)
    assert sky_share(marks, 220, WIDTH - 20) == 0.0
    assert sky_share(marks, 20, 180) == 0.0


@pytest.mark.parametrize("base_row", [HORIZON + 2, HORIZON + 10])
def test_a_wall_whose_base_leads_to_the_horizon_leaves_the_sky(base_row: int) -> None:
    """A long wall beside the way stands on the ground: near its far end its base lies at the horizon, as that of the sky."""
    left, right = (
        eye(200, WIDTH + 20, 0, base_row, 130.0, shift, seed, falls=0.6) for shift, seed in ((0, 1), (NEAR_PX, 2))
    )
    assert sky_share(marked(left, right), 20, 180) > 0.95


@pytest.mark.parametrize("distance_m", [3.0, 8.0, 10.0])
@pytest.mark.parametrize("grey", [130.0, 165.0])
def test_what_is_near_is_a_distance(distance_m: float, grey: float) -> None:
    """A camera of 220 px with a baseline of 75 mm has a disparity of 2.1 px at 8 m, a ZED at 672 columns of 5.2 px. From 4 px on an
    outline was near, or where it changed the brightness of the right image beside it: by less than 20 grey levels it did not."""
    f_px, baseline_m = 220.0, 0.075
    shift = f_px * baseline_m / distance_m
    marks = marks_of((200, WIDTH + 20, 0, HORIZON), grey, shift, True, limits_of(f_px, baseline_m))
    assert sky_share(marks, 220, WIDTH - 20) == 0.0
    assert sky_share(marks, 20, 180) == 0.0


@pytest.mark.parametrize(
    ("thing", "grey", "shift"),
    [
        ((200, WIDTH + 20, 0, 220), 130.0, NEAR_PX),
        ((200, WIDTH + 20, 30, HORIZON), 130.0, NEAR_PX),
        ((200, 212, 0, HORIZON), 60.0, NEAR_PX),
        ((200, WIDTH + 20, 0, HORIZON), 130.0, 0),
    ],
    ids=["stands on the ground", "below the border", "pole", "far"],
)
def test_the_sky_stays_beside_other_things(thing: tuple[int, int, int, int], grey: float, shift: int) -> None:
    assert sky_share(marks_of(thing, grey, shift), 20, 180) > 0.95
