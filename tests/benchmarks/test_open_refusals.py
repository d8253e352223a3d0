"""Why directions are not open: the reasons of the stage, one by one, and the counts of rendered frames."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.open_air.directions import judged_azimuths
from benchmarks.open_air.open_claims import marked
from benchmarks.open_air.refusals import OPEN, REASONS, reasons_of, share_table
from benchmarks.open_air.views import Seen, View, profile_of, see
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.open_blocks import BEYOND_ALL, BLOCK, CONTINUED, MEASURED, OUTSIDE, SMOOTH, TEXTURED
from core.stages.open_columns import OPEN_SETTINGS, Refusal, empty_columns
from core.stages.open_space import judge_columns
from drivers.simulation.stereo.stereo_profiles import StereoCamera

PRESUME = OpenSkyParams(mode="presume")
ROWS, HORIZON = 60, 30
BLOCK_DEG = math.degrees(math.atan(BLOCK / 350.0))


def refusal(
    column: list[tuple[int, int]], near_m: float = 30.0, beside: list[tuple[int, int]] | None = None
) -> Refusal:
    """The refusal of the second of three equal columns, each given as (kind, rows) from above, the first `beside` another."""
    s = np.zeros(1, OPEN_SETTINGS)
    s["f_px"], s["horizon_row"], s["most_m"], s["reach_blocks"], s["floating_reach"] = 350.0, 4 * HORIZON, 12.0, 1, 20.0
    s["upper_border"] = s["neighbours"] = s["floating"] = True
    for name in ("horizon", "gap", "continued", "least_rise"):
        s[f"{name}_t"] = math.tan(math.radians(getattr(PRESUME, f"{name}_deg")))
    first = np.repeat(*np.array(beside or column).T)
    kind = np.stack([first, *(np.repeat(*np.array(column).T),) * 2]).astype(np.uint8)
    near = np.where(kind == MEASURED, np.float32(near_m), BEYOND_ALL).astype(np.float32)
    cells = np.repeat(np.repeat(np.left_shift(1, kind), BLOCK, axis=0), BLOCK, axis=1).astype(np.uint8)
    columns = empty_columns(len(kind))
    judge_columns(kind, near, cells, s[0], columns)
    return Refusal(int(columns.refusal[1]))


FIELD = [(SMOOTH, HORIZON), (TEXTURED, 1), (MEASURED, ROWS - HORIZON - 1)]


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (FIELD, Refusal.NONE),
        ([(TEXTURED, HORIZON), (MEASURED, ROWS - HORIZON)], Refusal.NO_SKY),
        ([(OUTSIDE, HORIZON - 5), (SMOOTH, 5), (MEASURED, ROWS - HORIZON)], Refusal.LOW_SKY),
        ([(SMOOTH, HORIZON - 5), (MEASURED, ROWS - HORIZON + 5)], Refusal.EDGE_ABOVE_HORIZON),
        ([(SMOOTH, HORIZON + 5), (MEASURED, ROWS - HORIZON - 5)], Refusal.EDGE_BELOW_HORIZON),
        ([(SMOOTH, HORIZON), (TEXTURED, 4), (MEASURED, ROWS - HORIZON - 4)], Refusal.WIDE_EDGE),
        ([(SMOOTH, HORIZON), (TEXTURED, 1), (CONTINUED, ROWS - HORIZON - 1)], Refusal.SMOOTH_STRIP),
        ([(SMOOTH, HORIZON), (TEXTURED, 1), (SMOOTH, ROWS - HORIZON - 1)], Refusal.NOT_MEASURED),
    ],
)
def test_each_rule_of_a_column_names_itself(column: list[tuple[int, int]], expected: Refusal) -> None:
    assert refusal(column) is expected


def test_the_rules_of_what_is_beside_name_themselves() -> None:
    assert refusal(FIELD, near_m=5.0) is Refusal.NEAR_BASE
    unmeasured = [(TEXTURED, ROWS)]
    assert refusal(FIELD, beside=unmeasured) is Refusal.NO_EVIDENCE_BESIDE
    tall = [(MEASURED, ROWS)]
    assert refusal(FIELD, near_m=10.0, beside=tall) in (Refusal.NEAR_BASE, Refusal.NEAR_ABOVE)
    balloon = [(SMOOTH, 10), (MEASURED, 4), (SMOOTH, HORIZON - 14), (TEXTURED, 1), (MEASURED, ROWS - HORIZON - 1)]
    assert refusal(FIELD, near_m=10.0, beside=balloon) is not Refusal.NONE


@pytest.fixture(scope="module")
def clouds() -> Seen:
    camera = StereoCamera(marked(profile_of("zed")))
    return next(see(View(scene="field", sky="clouds"), (1.0,), camera, Extractor(Params(), PRESUME)))


@pytest.mark.slow
def test_under_clouds_the_sky_is_not_smooth_and_that_is_the_reason(clouds: Seen) -> None:
    counts = reasons_of(
        clouds.frame, clouds.model, (clouds.unmatched_left_px, clouds.unmatched_right_px), Params(), PRESUME
    )
    assert set(counts) <= {OPEN, *REASONS}
    assert counts["no sky"] + counts["low sky"] >= 0.9 * counts.total() > 20
    assert "no sky" in share_table({"field": counts}, REASONS)


def test_directions_that_reach_into_columns_without_a_match_are_not_judged(clouds: Seen) -> None:
    _, every = judged_azimuths(clouds.frame, clouds.model, 0)
    _, some = judged_azimuths(clouds.frame, clouds.model, clouds.unmatched_left_px, clouds.unmatched_right_px)
    k, edges = clouds.frame.info.intrinsics, clouds.model.free.azimuth_edges_rad
    u = k.cx + k.fx * np.tan(edges.astype(np.float64))
    whole = (u[:-1] >= clouds.unmatched_left_px - 0.5) & (u[1:] <= k.width - clouds.unmatched_right_px - 0.5)
    assert len(every) == len(edges) - 1
    assert some.tolist() == np.flatnonzero(whole).tolist()
