"""Which pixels refuse directions, and which rule of the matching dropped them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_air.lost_pixels import (
    RULES,
    SKY,
    UNMATCHED_BELOW,
    below_horizon,
    dropped_of,
    kinds_of,
    steps_of,
)
from benchmarks.open_air.open_claims import marked
from benchmarks.open_air.refusals import OPEN, share_table
from benchmarks.open_air.views import Seen, View, profile_of, see
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import BEYOND_MM, TEXTURED_MM, FreeProfile
from drivers.cameras.stereo import MatchParams, confidence_limits
from drivers.simulation.stereo.stereo_profiles import StereoCamera

PRESUME = OpenSkyParams(mode="presume")


def without_open(free: FreeProfile) -> FreeProfile:
    return replace(free, open_from_dm=np.zeros_like(free.open_from_dm), open_to_dm=np.zeros_like(free.open_to_dm))


@pytest.fixture(scope="module")
def crest() -> Seen:
    camera = StereoCamera(marked(profile_of("zed")))
    return next(see(View(scene="hill_crest"), (1.0,), camera, Extractor(Params(), PRESUME)))


def test_each_truly_free_direction_has_one_kind(crest: Seen) -> None:
    counts = kinds_of(crest, Params(), PRESUME)
    assert counts.total() > 20
    assert counts[OPEN] > 0
    assert counts[UNMATCHED_BELOW] > 0, "holes near the crest"
    nothing_open = replace(crest, model=replace(crest.model, free=without_open(crest.model.free)))
    refused = kinds_of(nothing_open, Params(), OpenSkyParams(mode="presume", least_rise_deg=45.0))
    assert refused.total() == counts.total()
    assert refused[OPEN] == 0
    assert refused[SKY] > counts[SKY]


def test_the_rules_drop_what_the_driver_drops(crest: Seen) -> None:
    params = MatchParams(mark_smooth=True)
    assert steps_of(confidence_limits(params))[-1] == confidence_limits(params)
    counts = dropped_of(crest, params)
    band, mm = below_horizon(crest), crest.frame.depth_mm
    assert counts["pixels"] == band.sum()
    assert counts["measured"] == (band & ((mm == BEYOND_MM) | (mm > TEXTURED_MM))).sum()
    dropped = counts["matching"] + sum(counts[name] for name, _ in RULES)
    # the border of the image is not used either
    assert (
        0.95 * np.count_nonzero(band & (mm == TEXTURED_MM)) <= dropped <= np.count_nonzero(band & (mm == TEXTURED_MM))
    )


def test_a_table_states_shares_of_the_whole() -> None:
    assert share_table({"a": Counter({OPEN: 3, SKY: 1})}, (OPEN, SKY, "b")).splitlines()[2] == "| a | 4 | 75.0 | 25.0 |"
