"""The evaluation of open space: it counts what is claimed beyond free, and finds what is wrong with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_air.open_claims import as_free, claims_of, marked
from benchmarks.open_air.views import Seen, View, profile_of, see
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import FreeProfile
from drivers.simulation.stereo.stereo_profiles import StereoCamera


def seen(scene: str, roll_deg: float = 0.0, profile: str = "zed", height_m: float = 2.0) -> Seen:
    camera = StereoCamera(marked(profile_of(profile)))
    extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
    return next(
        see(View(scene=scene, height_m=height_m, roll_deg=roll_deg, profile=profile), (1.0,), camera, extractor)
    )


@pytest.fixture(scope="module")
def field() -> Seen:
    return seen("field")


def test_an_open_field_is_open_and_not_free(field: Seen) -> None:
    claims = claims_of(field.frame, field.model, field.unmatched_left_px, Params())
    assert claims.free == 0
    assert claims.opened >= 0.6 * claims.directions > 0
    assert not claims.wrong_open
    assert claims.more_cells > 0


@pytest.mark.parametrize("roll_deg", [10.0, pytest.param(-10.0, marks=pytest.mark.slow)])
def test_a_rolled_view_of_a_field_is_open(roll_deg: float) -> None:
    """A multirotor rolls whenever it moves sideways. The tilted horizon crosses the rows and is matched."""
    rolled = seen("field", roll_deg)
    claims = claims_of(rolled.frame, rolled.model, rolled.unmatched_left_px, Params())
    assert claims.opened >= 0.8 * claims.directions > 0
    assert not claims.wrong_open


@pytest.mark.slow
def test_an_open_field_is_open_in_rectified_images() -> None:
    """Real images are interpolated. Nothing was open in them."""
    views = [seen("field", profile="zed_rectified", height_m=height_m) for height_m in (2.0, 5.0)]
    claims = [claims_of(f.frame, f.model, f.unmatched_left_px, Params()) for f in views]
    assert sum(c.opened for c in claims) >= 0.3 * sum(c.directions for c in claims) > 0
    assert not any(c.wrong_open for c in claims)


def test_a_blank_bridge_is_not_open() -> None:
    bridge = seen("bridge")
    assert not claims_of(bridge.frame, bridge.model, bridge.unmatched_left_px, Params()).wrong_open


def test_a_claim_into_the_ground_is_found(field: Seen) -> None:
    f = field.model.free
    everything = FreeProfile(
        azimuth_edges_rad=f.azimuth_edges_rad,
        layer_edges_m=f.layer_edges_m,
        free_from_m=f.free_from_m,
        free_to_m=f.free_to_m,
        end=f.end,
        open_from_dm=np.zeros_like(f.open_from_dm),
        open_to_dm=np.full_like(f.open_to_dm, 90),
    )
    # without a ground of its own the model says that it judged all heights
    model = replace(field.model, free=everything, ground=replace(field.model.ground, seen=False))
    wrong = claims_of(field.frame, model, field.unmatched_left_px, Params()).wrong_open
    assert {name for _, name in wrong} == {"ground"}
    # a model that overstates its noise is not excused by it: 196 of 435 wrong cells of four views were left
    loud = replace(model, ke_per_m=5.0 * field.frame.info.ke_per_m)
    exact = replace(model, ke_per_m=field.frame.info.ke_per_m)
    counts = [len(claims_of(field.frame, m, field.unmatched_left_px, Params()).wrong_open) for m in (exact, loud)]
    assert counts[0] == counts[1] > 0


def test_a_profile_without_open_ranges_claims_what_is_free(field: Seen) -> None:
    f = field.model.free
    plain = replace(
        field.model,
        free=FreeProfile(
            azimuth_edges_rad=f.azimuth_edges_rad,
            layer_edges_m=f.layer_edges_m,
            free_from_m=f.free_from_m,
            free_to_m=f.free_to_m,
            end=f.end,
        ),
    )
    assert as_free(plain) is plain
