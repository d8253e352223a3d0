"""Rows of the fidelity run made by hand."""

from __future__ import annotations

from benchmarks.fidelity.metrics import RANGE_BINS, RangeCounts, Score
from benchmarks.fidelity.result import Case, GridScore, Row


def made(seed: int, rays: int = 1000, valid: bool = True, **figures: float) -> Row:
    """A row whose figures are 0 but for those given."""
    score = (
        dict.fromkeys(Score.__dataclass_fields__, 0.0)
        | {"obstacle_rays": rays, "open_rays": 500, "planes": 4}
        | figures
    )
    bins = [0] * RANGE_BINS
    return Row(
        case=Case(scene="wall", ke_per_m=0.005, configured_ke_per_m=0.005, seed=seed),
        family="structured",
        valid=valid,
        score=Score(**score),
        by_range=RangeCounts(obstacle=bins, missed=bins, phantom=bins, open_phantom=bins),
        false_free=0.0,
        bytes=100,
        plane_bytes=96,
        prisms=1,
        ground_seen=True,
        ground_height_m=2.0,
        ke_estimate_per_m=0.005,
        grids=[
            GridScore(cell_m=0.1, planes=200, bytes=9000, mean_m=0.4, perfect_mean_m=0.1),
            GridScore(cell_m=0.8, planes=16, bytes=400, mean_m=0.9, perfect_mean_m=0.7),
        ],
        openings=[],
        recall=[],
    )
