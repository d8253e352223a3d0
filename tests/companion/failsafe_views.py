"""What cameras see and do not see, for tests of the failsafe."""

from __future__ import annotations

from companion.autopilot.polar_histogram import SectorScan, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams

from .sector_models import HERE, model

AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, min_distance_m=0.2, avoid_margin_m=2.0)
NS, MS = 1_000_000_000, 1_000_000


def front_seen(*planes: tuple[float, ...]) -> SectorScan:
    return scan([View(model(*planes, free_to_m=13.0, view_deg=72.0), HERE)], AVOID)
