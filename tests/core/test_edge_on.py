"""A wall seen edge-on is modelled column by column, up to its near end."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fidelity.metrics import stops
from core.extractor import Extractor
from core.params import Params
from core.stages.ramps import ramp_limits
from core.stages.smeared_edges import edges_of, observe_edges, smears
from core.types import FAR_MM, ExtractorState
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import camera_info, render

from ..nightly import nightly

SHARP = ExtractorState(edge_steps=0.99)
"""The state of a camera whose edges are sharp."""


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("ke_per_m", [0.0015, 0.005])
@pytest.mark.parametrize(
    ("width", "aside_m"),
    [(160, 0.1), *nightly((160, 0.2)), (160, 0.3), *nightly((320, 0.1)), (320, 0.2), (640, 0.1), *nightly((640, 0.2))],
)
def test_every_column_of_a_wall_beside_the_path_is_in_the_model(
    width: int, aside_m: float, ke_per_m: float, back: bool
) -> None:
    """The wall is 0.1 m thick, reaches from 2 to 12 m and passes 0.1 to 0.3 m beside the camera. Its side is 5 to 40
    columns wide, and 1/Z changes by up to a half from one to the next."""
    s = SceneBuilder("edge_on")
    s.ground()
    if back:
        s.wall("back", (17.0, -20.0), (17.0, 20.0), 6.0)
    s.wall("wall", (12.0, aside_m), (2.0, aside_m), 3.0, thickness=0.1)
    info = camera_info(width, width * 3 // 4, ke_per_m=ke_per_m)
    sensor = SensorModel(ke_per_m=ke_per_m).scaled_to(width)
    f = render(s.build(), info, sensor=sensor, position_ned_m=(0.0, 0.0, -1.5), seed=1)
    model, _ = Extractor().extract(f.depth_mm, info, f.R_level_optical, SHARP)
    stop_m, which = stops(np.asarray(model.planes, np.float64), info.intrinsics, f.R_level_optical)
    stop_m = stop_m - np.append(model.margin_m, 0.0)[which]
    depth_m = f.truth.depth_m
    side = np.abs(f.truth.points_level_cam_m[..., 1] - aside_m) < 0.01
    side &= f.truth.obstacle() & (depth_m < 10.0) & (f.depth_mm > 0)
    assert side.sum() > 100
    assert not (side & (stop_m > depth_m + 0.5)).any()


@pytest.mark.parametrize(
    ("a_m", "b_m", "height_m", "seed"),
    [((15.59, -0.06), (3.69, -0.33), 6.2, 147), ((10.59, -0.68), (3.17, -0.45), 5.1, 3)],
    ids=["by one frame", "by the mean"],
)
def test_a_wall_that_is_nearly_all_that_is_measured_is_not_taken_for_a_camera_that_smears(
    a_m: tuple[float, float], b_m: tuple[float, float], height_m: float, seed: int
) -> None:
    """Below an unmeasured sky its side is the only edge beside its top: up to 2 m behind its near end it was unknown."""
    s = SceneBuilder("edge_on")
    s.ground()
    s.wall("wall", a_m, b_m, height_m, thickness=0.1)
    info, params, state = camera_info(640, 480, ke_per_m=0.005), Params(), ExtractorState()
    sensor = SensorModel(ke_per_m=0.005).scaled_to(640)
    depth_mm = render(s.build(), info, sensor=sensor, position_ned_m=(0.0, 0.0, -1.5), seed=seed).depth_mm.copy()
    depth_mm[depth_mm == FAR_MM] = 0
    edges = edges_of(depth_mm, ramp_limits(info, 0.005))
    assert edges.ramps > params.smear_min_share * edges.total
    assert edges.at_least(params.smear_clear_edges)
    for _ in range(2 * params.smear_min_frames):
        state = observe_edges(state, edges, params)
        assert not smears(state, edges, params)
