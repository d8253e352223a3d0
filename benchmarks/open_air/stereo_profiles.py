"""Stereo cameras beside the ZED, with the matching of those that match on the device.

What is public of each camera is in docs/explanation/stereo-depth.md with its source. What is not public (cost tables of the
hardware) is left at values with which the method works; figures of these profiles show what the kind of matching does, not
what one device does."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.open_air.census_matching import CensusParams
from drivers.cameras.stereo import MatchParams
from drivers.simulation.stereo.shading import Projector
from drivers.simulation.stereo.stereo_profiles import ZED, StereoProfile, view_of

ZED_RECTIFIED = replace(
    ZED,
    name="zed_rectified",
    view=replace(ZED.view, imagers_deg=((0.1, -0.15, 0.2), (-0.1, 0.12, -0.15))),
)
"""The same with imagers that are turned as those of a real camera, so that its images are interpolated."""
ZED_HD = replace(ZED, name="zed_hd", view=view_of(1280, 720, 700.0, 0.12), match=MatchParams(disparities=192))
"""The same at twice the resolution."""
ZED_WIDE = replace(ZED, name="zed_wide", view=view_of(672, 376, 235.0, 0.12))
"""A lens of 110 degrees."""
LONG = StereoProfile(
    name="long", view=view_of(640, 480, 450.0, 0.25), match=MatchParams(disparities=128), max_range_m=20.0
)
"""A wide baseline: a range of 20 m."""
OAK = StereoProfile(
    name="oak",
    view=view_of(640, 400, 441.0, 0.075),
    device=CensusParams(subpixel_bits=5, threshold_grey=1, least_margin=0.15, most_cost=0.25),
    min_range_m=0.4,
    disparity_sigma_px=0.25,
    host_check=True,
)
OAK_HOST = replace(OAK, name="oak_host", device=None, host_check=False)
"""An OAK whose rectified images are matched on the host (`match_on = "host"`)."""
OAK_WIDE = replace(OAK_HOST, name="oak_wide", view=view_of(640, 400, 285.0, 0.075), max_range_m=10.0)
"""The same with the wide lenses."""
OAK_HALF = replace(
    OAK_HOST,
    name="oak_half",
    view=view_of(320, 200, 220.5, 0.075),
    match=MatchParams(disparities=48),
    min_range_m=0.4,
    max_range_m=10.0,
)
"""The same at half of the resolution."""
D400 = StereoProfile(
    name="d400",
    view=view_of(640, 480, 385.0, 0.05),
    device=CensusParams(
        disparities=128, rows=7, columns=9, paths=2, p1=3, p2=12, subpixel_bits=5, least_margin=0.08, speckle_px=40
    ),
    min_range_m=0.2,
    max_range_m=6.0,
)
D400_ACTIVE = replace(D400, name="d400_active", projector=Projector(offset_m=0.025, strength=2.0))
_ALL = (ZED, ZED_RECTIFIED, ZED_HD, ZED_WIDE, LONG, OAK, OAK_HOST, OAK_WIDE, OAK_HALF, D400, D400_ACTIVE)
PROFILES: dict[str, StereoProfile] = {p.name: p for p in _ALL}
