"""The rules by which surfaces become cues on the mount, each at its limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.self_check.mount_cues import NO_CUES, Walls, cues_of, walls_of
from core.self_check.surface_types import Surface, Surfaces

SLOPE_DEG = 5.0
NOISE, PRIOR = 0.0015, 0.003


def wall(
    lean_deg: float, share: float = 0.1, bearing_deg: float = 0.0, sd_deg: float = 0.1, misfit: float = 1.0
) -> Surface:
    """A wall 6 m away whose normal points this far down."""
    lean, bearing = math.radians(lean_deg), math.radians(bearing_deg)
    normal = (math.cos(lean) * math.cos(bearing), math.cos(lean) * math.sin(bearing), math.sin(lean))
    return Surface(normal, 6.0, share, math.radians(sd_deg), misfit)


def upright(*shares: float) -> list[Surface]:
    return [wall(0.0, share) for share in shares]


def leaning(*shares: float) -> list[Surface]:
    """As with a mount that is wrong by the slope."""
    return [wall(SLOPE_DEG, share) for share in shares]


@pytest.mark.parametrize(
    ("planes", "walls"),
    [
        (upright(0.081), Walls.VERTICAL),
        (upright(0.079), Walls.UNDECIDED),
        (leaning(0.031), Walls.LEANING),
        (leaning(0.029), Walls.UNDECIDED),
        (upright(0.09) + leaning(0.05), Walls.UNDECIDED),
        (upright(0.05) + leaning(0.09), Walls.UNDECIDED),
        (upright(0.09) + leaning(0.04), Walls.VERTICAL),
        (upright(0.04) + leaning(0.09), Walls.LEANING),
        (upright(0.5) + leaning(0.06), Walls.UNDECIDED),  # a wall counts as a tenth of the image at most
        (upright(0.06) + leaning(0.5), Walls.UNDECIDED),
        (upright(*[0.014] * 10), Walls.UNDECIDED),  # of small surfaces no number counts
        (leaning(*[0.014] * 10), Walls.UNDECIDED),
        ([wall(0.0, sd_deg=1.7)], Walls.VERTICAL),
        ([wall(0.0, sd_deg=1.8)], Walls.UNDECIDED),  # known to less than 0.35 of the slope
        ([wall(0.0, misfit=1.4)], Walls.VERTICAL),
        ([wall(0.0, misfit=1.6)], Walls.UNDECIDED),  # several objects
        ([wall(2.5)], Walls.UNDECIDED),  # neither
        ([wall(SLOPE_DEG - 1.6)], Walls.LEANING),
        ([wall(-SLOPE_DEG)], Walls.UNDECIDED),
        ([wall(-SLOPE_DEG, bearing_deg=180.0)], Walls.LEANING),  # seen from its other side
        ([wall(0.0, bearing_deg=64.0)], Walls.VERTICAL),
        ([wall(0.0, bearing_deg=68.0)], Walls.UNDECIDED),  # its lean would be 0.37 of the slope
        ([wall(36.0)], Walls.UNDECIDED),
    ],
)
def test_walls_decide_by_their_share_their_lean_and_its_error(planes: list[Surface], walls: Walls) -> None:
    assert walls_of(tuple(planes), math.radians(SLOPE_DEG), 0.0) is walls


def test_walls_show_nothing_about_a_slope_of_less_than_two_degrees() -> None:
    planes = tuple(upright(*[0.1] * 5))
    assert walls_of(planes, 0.0, 0.0) is Walls.UNDECIDED
    assert walls_of(planes, math.radians(1.9), 0.0) is Walls.UNDECIDED
    assert walls_of(planes, math.radians(2.1), 0.0) is Walls.VERTICAL
    assert walls_of((wall(0.0, bearing_deg=90.0),), 0.0, math.radians(2.1)) is Walls.VERTICAL


def ground(
    slope_deg: float = 0.0,
    share: float = 0.25,
    spread_per_m: float = math.inf,
    sd_rad: float = 0.01,
    misfit: float = 1.0,
) -> Surface:
    """Ground 1.5 m below the camera that descends ahead by this slope."""
    a = math.radians(slope_deg)
    return Surface((-math.sin(a), 0.0, math.cos(a)), 1.5, share, sd_rad, misfit, spread_per_m)


def surfaces(plane: Surface, below: float = 0.0, below_m: float = 1.0) -> Surfaces:
    """A surface with 100 patches 10 m ahead, of which this share lies so far below it."""
    x, _, z = plane.normal
    centres = np.tile([10.0, 0.0, (plane.distance_m - 10.0 * x) / z], (100, 1))
    centres[: round(100 * below), 2] += below_m
    return Surfaces((plane,), 1.0, centres, NOISE, PRIOR)


@pytest.mark.parametrize(
    ("found", "is_ground"),
    [
        (surfaces(ground(share=0.031)), True),
        (surfaces(ground(share=0.029)), False),
        (surfaces(ground(34.0)), True),
        (surfaces(ground(36.0)), False),
        (surfaces(ground(spread_per_m=2.1 * PRIOR)), True),
        (surfaces(ground(spread_per_m=1.9 * PRIOR)), False),
        (surfaces(ground(), below=0.05), True),
        (surfaces(ground(), below=0.06), False),  # it lies above something: a table
        (surfaces(ground(), below=0.06, below_m=0.23), True),  # within four sigma of the noise at 10 m, and 0.15 m
        (surfaces(ground(), below=0.06, below_m=0.26), False),
    ],
)
def test_ground_is_large_not_steep_spread_in_depth_and_nothing_is_below_it(found: Surfaces, is_ground: bool) -> None:
    cues = cues_of(found)
    assert cues.ground is is_ground
    assert (cues == NO_CUES) is not is_ground


@pytest.mark.parametrize("slope_deg", [-8.0, 3.0])
def test_the_slope_is_an_angle_that_is_positive_where_the_ground_descends(slope_deg: float) -> None:
    cues = cues_of(surfaces(ground(slope_deg)))
    assert math.degrees(cues.slope_x_rad) == pytest.approx(slope_deg)
    assert cues.slope_y_rad == pytest.approx(0.0)
    assert cues.distance_m == 1.5


def test_the_error_of_the_slope_is_that_of_its_fit_and_of_what_stands_at_its_edge() -> None:
    edge_rad = 0.2 * NOISE * 1.5 / math.sqrt(0.25)
    assert cues_of(surfaces(ground(misfit=0.5))).slope_sd_rad == pytest.approx(3.0 * 0.01 + edge_rad)
    assert cues_of(surfaces(ground(misfit=2.0))).slope_sd_rad == pytest.approx(3.0 * 0.01 * 4.0 + edge_rad)
