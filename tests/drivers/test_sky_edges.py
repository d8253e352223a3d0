"""The lower edge of a near blank thing that is inclined in the image differs from that of the sky by its rows in both images."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import TEXTURELESS_MM
from drivers.cameras.textureless import SmoothLimits, limits_of, mark_unmeasured

HEIGHT, WIDTH, MIDDLE = 240, 400, 120.0
LIMITS = SmoothLimits()
Gray = NDArray[np.uint8]


def eye(slope_deg: float, lower_px: float, bright: float, seed: int) -> Gray:
    """A smooth area before a darker one; their border is inclined and lies lower by so many pixels. Brighter downwards, as a sky."""
    rng = np.random.default_rng(seed)
    border = MIDDLE + lower_px + np.tan(np.radians(slope_deg)) * (np.arange(WIDTH) - 0.5 * WIDTH)
    above = np.clip(border - np.arange(HEIGHT)[:, None] + 0.5, 0.0, 1.0)
    image = bright * (80.0 + 70.0 * above + 0.2 * (np.arange(HEIGHT)[:, None] - MIDDLE))
    return np.asarray(np.clip(np.rint(image + rng.standard_normal(image.shape)), 0, 255), np.uint8)


def sky_share(
    slope_deg: float,
    disparity_px: float,
    rows_apart: float = 0.0,
    bright: float = 1.0,
    limits: SmoothLimits = LIMITS,
) -> float:
    """Share of textureless pixels above the edge."""
    lower_px = np.tan(np.radians(slope_deg)) * disparity_px + rows_apart
    left, right = eye(slope_deg, 0.0, 1.0, 1), eye(slope_deg, lower_px, bright, 2)
    nothing = np.full(left.shape, -1.0, np.float32)
    marks = mark_unmeasured(np.zeros(left.shape, np.uint16), nothing, left, right, limits)
    return float((marks[10:70, 20:-20] == TEXTURELESS_MM).mean())


@pytest.mark.parametrize("slope_deg", [-8.0, -3.0, 3.0, 8.0])
@pytest.mark.parametrize("disparity_px", [6.0, 14.0])
def test_an_area_above_a_near_inclined_edge_is_no_sky(slope_deg: float, disparity_px: float) -> None:
    """A blank slab that filled the view of a rolled camera was open."""
    assert sky_share(slope_deg, disparity_px) == 0.0


@pytest.mark.parametrize(
    ("slope_deg", "disparity_px"), [(8.0, 35.0), (-8.0, 60.0), (12.0, 20.0), (-12.0, 42.0), (12.0, 60.0), (20.0, 14.0)]
)
def test_an_edge_that_leaves_the_profile_is_near(slope_deg: float, disparity_px: float) -> None:
    """Shifted by 4 to 13 rows, the right image has no edge in the profile, or one half of it. The shift was measured as none."""
    assert sky_share(slope_deg, disparity_px) == 0.0


@pytest.mark.parametrize(("slope_deg", "distance_m"), [(8.0, 8.0), (-8.0, 8.0), (12.0, 8.0), (12.0, 10.0)])
def test_a_near_edge_is_near_by_its_distance(slope_deg: float, distance_m: float) -> None:
    """A camera of 220 px with a baseline of 75 mm has less than the 2 px there that are far for a ZED: such an edge was sky."""
    f_px, baseline_m = 220.0, 0.075
    assert sky_share(slope_deg, f_px * baseline_m / distance_m, limits=limits_of(f_px, baseline_m)) == 0.0
    assert sky_share(slope_deg, 0.0, limits=limits_of(f_px, baseline_m)) > 0.9


@pytest.mark.parametrize("slope_deg", [-8.0, -3.0, -1.0, 0.0, 1.0, 3.0, 8.0])
@pytest.mark.parametrize(("rows_apart", "bright"), [(0.0, 1.0), (0.1, 1.0), (-0.1, 1.0), (0.0, 1.03)])
def test_the_sky_above_a_far_edge_stays(slope_deg: float, rows_apart: float, bright: float) -> None:
    """Rows that differ by a tenth of a pixel and imagers that are not equally bright move no edge so far."""
    assert sky_share(slope_deg, 0.0, rows_apart, bright) > 0.9
