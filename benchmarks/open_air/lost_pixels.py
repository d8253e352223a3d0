"""Which pixels refuse truly free directions, and which rule of the matching left the textured ones without a match.

    python -m benchmarks.open_air.lost_pixels
    python -m benchmarks.open_air.lost_pixels --scenes field,street --heights 2,5,10 --pitch=-10,0,10 --roll 0,10

First table: a direction that is not open to 10 m has the kind of most of the cells that are not seen through in the first ring in
which their share is above 1 - open_share. Second table: of the pixels of solids and ground within 5 degrees below the horizon the share
that is measured, and of the textured ones without a match the share that each rule has dropped first."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.open_air.directions import TO_M, judged_azimuths, truth
from benchmarks.open_air.open_claims import as_free, marked
from benchmarks.open_air.refusals import INVALID, OPEN, PLANE, evidence, share_table
from benchmarks.open_air.view_options import REFUSING, seen_views, view_parser
from benchmarks.open_air.views import Seen, profile_of
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.free_rings import least_blocking_code
from core.stages.open_blocks import OUTSIDE
from core.stages.open_space import OpenObservation
from core.stages.view_geometry import Q_UNKNOWN, ViewGeometry
from core.types import BEYOND_MM, CONTINUED_MM, TEXTURED_MM, TEXTURELESS_MM
from drivers.cameras.match_confidence import EVERY_MATCH, ConfidenceLimits, accepted_matches
from drivers.cameras.stereo import MatchParams, compute_disparity, confidence_limits, matcher
from drivers.simulation.stereo.stereo_profiles import StereoCamera

NEARER, HOLE, NO_RING, BESIDE = "measured nearer", "hole or unknown column", "not in view", "outside of the image"
SKY, UNMATCHED_ABOVE = "sky refused", "textured above the horizon"
UNMATCHED_BELOW, SMOOTH_BELOW, OTHER = "textured below the horizon", "smooth below the horizon", "no mark"
KINDS = (INVALID, NEARER, SKY, UNMATCHED_ABOVE, UNMATCHED_BELOW, SMOOTH_BELOW, OTHER, BESIDE, HOLE, NO_RING, PLANE)
_HALF_HEIGHT_M = 0.25
_BAND_DEG = 5.0
_RINGS_M = np.arange(1.0, TO_M + 0.01, 0.5)
RULES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("correlation, texture", ("correlation", "strong_correlation", "far_correlation", "texture")),
    ("repetition", ("period",)),
    ("patch", ("patch_px", "patch_per_px")),
    ("shared edge", ("shared",)),
    ("smear", ("smear_px", "smear_rows")),
    ("level line", ("level_px",)),
)
"""In the order of `accepted_matches`, with the limits that switch them."""
Mask = NDArray[np.bool_]


def unseen_kind(
    d: int, found: OpenObservation, view: ViewGeometry, ke_per_m: float, params: Params, share: float
) -> str:
    """The kind of most cells of direction d that are not seen through, in the first ring behind what is open of it that is not open
    for their share."""
    edges_t, marked_view = found.seen.edges_t, found.marked
    across = (np.arange(view.cols) - view.cu) * float(view.lateral[0]) / view.f_px
    among = np.flatnonzero((across >= edges_t[d]) & (across < edges_t[d + 1]))
    gain, in_view = view.f_px * view.lsb_per_px, False
    layer = int(np.searchsorted(found.seen.layers_m, 0.0, side="right")) - 1
    open_to_m = float(found.seen.free_to_m[d, layer])
    for x in _RINGS_M:
        first = int(np.floor(view.cv - view.f_px * _HALF_HEIGHT_M / x + 0.5))
        end = int(np.ceil(view.cv + view.f_px * _HALF_HEIGHT_M / x - 0.5)) + 1
        if first < 0 or end > view.rows or x <= open_to_m:
            continue
        in_view = True
        blocking = least_blocking_code(gain, params.profile_sigmas * ke_per_m, params.profile_noise_cap, float(x))
        codes, mm = marked_view.codes[among, first:end], marked_view.mm[among, first:end]
        unknown = codes == Q_UNKNOWN
        outside = marked_view.kinds[among, first:end] == 1 << OUTSIDE
        if (~unknown & (codes < blocking)).mean() >= share:
            continue
        above = unknown & (np.arange(first, end) < view.cv)
        below = unknown & ~above
        smooth = (mm == TEXTURELESS_MM) | (mm == CONTINUED_MM)
        counts = {
            NEARER: ~unknown & (codes >= blocking),
            SKY: above & smooth,
            UNMATCHED_ABOVE: above & (mm == TEXTURED_MM),
            UNMATCHED_BELOW: below & (mm == TEXTURED_MM),
            SMOOTH_BELOW: below & smooth,
            BESIDE: outside,
            OTHER: unknown & ~outside & ~smooth & (mm != TEXTURED_MM),
        }
        return max(counts, key=lambda name: int(counts[name].sum()))
    return HOLE if in_view else NO_RING


def kinds_of(seen: Seen, params: Params, open_sky: OpenSkyParams) -> Counter[str]:
    """How many truly free directions of a view are open to TO_M, and the kinds of pixels that refuse the others."""
    frame, model = seen.frame, seen.model
    azimuth, rows = judged_azimuths(frame, model, seen.unmatched_left_px, seen.unmatched_right_px)
    rows = rows[truth(frame, azimuth)] if len(rows) else rows
    if not model.valid:
        return Counter({INVALID: len(rows)})
    levelled, found = evidence(frame, model, params, open_sky)
    layer = int(np.searchsorted(model.free.layer_edges_m, 0.0, side="right")) - 1
    claimed, counts = as_free(model).free, Counter[str]()
    for d in rows:
        begin, end = claimed.free_from_m[d, layer], claimed.free_to_m[d, layer]
        seen_to_m = found.seen.free_to_m[d, layer]
        if end > begin and end >= min(TO_M, 0.999 * frame.info.max_range_m):
            counts[OPEN] += 1
        elif seen_to_m > max(found.seen.free_from_m[d, layer], TO_M - 0.5):
            counts[PLANE] += 1
        else:
            counts[unseen_kind(int(d), found, levelled.exact_view, model.ke_per_m, params, open_sky.open_share)] += 1
    return counts


def steps_of(limits: ConfidenceLimits) -> list[ConfidenceLimits]:
    """The limits with no rule, and with one more at each step."""
    steps = [replace(EVERY_MATCH, window_px=limits.window_px, period_px=limits.period_px)]
    for _, keys in RULES:
        steps.append(replace(steps[-1], **{key: getattr(limits, key) for key in keys}))
    return steps


def below_horizon(seen: Seen) -> Mask:
    """(H, W) pixels of ground and solids within _BAND_DEG below the horizon, without the columns that never have a match."""
    k, R = seen.frame.info.intrinsics, seen.frame.R_level_optical
    v, u = np.mgrid[0 : k.height, 0 : k.width]
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ R.T
    down = np.degrees(np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1])))
    band = (down > 0.0) & (down < _BAND_DEG) & np.isfinite(seen.frame.truth.depth_m)
    band[:, : seen.unmatched_left_px] = False
    band[:, k.width - seen.unmatched_right_px :] = False
    return np.asarray(band)


def dropped_of(seen: Seen, params: MatchParams) -> Counter[str]:
    """Of the pixels of `below_horizon`: all, measured, and textured ones without a match by what dropped them."""
    if seen.pair is None:
        raise ValueError("this view has no images")
    left, right, band, mm = seen.pair.left, seen.pair.right, below_horizon(seen), seen.frame.depth_mm
    matched = (mm == BEYOND_MM) | (mm > TEXTURED_MM)
    lost, found = band & (mm == TEXTURED_MM), compute_disparity(matcher(params), left, right, params)
    kept = [found >= 0.0] + [
        accepted_matches(left, right, found, step) >= 0.0 for step in steps_of(confidence_limits(params))[1:]
    ]
    counts = Counter(
        {"pixels": int(band.sum()), "measured": int((band & matched).sum()), "matching": int((lost & ~kept[0]).sum())}
    )
    for (name, _), (before, after) in zip(RULES, pairwise(kept), strict=True):
        counts[name] = int((lost & before & ~after).sum())
    return counts


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = view_parser(__doc__, skies=["clear"], scenes=REFUSING).parse_args(arguments)
    camera, open_sky = StereoCamera(marked(profile_of(a.profile))), OpenSkyParams(mode="presume")
    extractor = Extractor(Params(), open_sky)
    unseen: dict[str, Counter[str]] = {}
    dropped: dict[str, Counter[str]] = {}
    for scene, seen in seen_views(a, camera, extractor):
        unseen.setdefault(scene, Counter()).update(kinds_of(seen, extractor.params, open_sky))
        dropped.setdefault(scene, Counter()).update(dropped_of(seen, camera.profile.match))
    print(share_table(unseen, (OPEN, *KINDS)), end="\n\n")
    print(share_table(dropped, ("measured", "matching", *(name for name, _ in RULES)), "pixels"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
