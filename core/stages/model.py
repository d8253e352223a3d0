"""The result of one frame: converts the tables of the stages to parts of a FrameModel.

Input: planes, ground and view. Output: `PublishedPlanes`, the statistics of the pixels, and the model of an invalid
frame."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..invalid_model import unknown_model
from ..jit import inner, kernel
from ..params import Params
from ..types import CameraInfo, FrameModel, FrameStats, Ground, InvalidCause, PlaneFlags, StripTable
from .depth_bias import DepthBias, greatest_depth
from .free_profile import empty_profile
from .ground import NO_GROUND
from .ground_fit import GroundPlane
from .planes import LEAST_S
from .strips import CUT_BOTTOM, CUT_TOP, PX
from .view_geometry import ViewGeometry

_OUTWARD = 1e-6
"""Tangent by which outlines are extended, so that rounding to float32 does not open a ray along an edge."""
_LEAST_HEIGHT_M = 1e-3
"""Least height of a plane, so that top and bottom differ in float32."""
_LEAST_BELOW_GROUND_M = 0.05
"""Height that a plane below the ground keeps."""
_INFERRED_SHARE, _INFERRED_COLUMNS = 0.05, 4.0
"""A plane with more filled rows, or columns, than this share is inferred. So many columns do not count as filled."""
_CUT_COLUMNS = 1.5
"""A plane that ends this close to the border of the image is cut."""
_INFERRED, _UNKNOWN_BEHIND, _CUT_LEFT, _CUT_RIGHT, _CUT_TOP, _CUT_BOTTOM, _IRREGULAR = map(int, PlaneFlags)
"""The flags as numbers for the kernels."""


class PublishedPlanes(NamedTuple):
    """Planes as a FrameModel contains them."""

    # (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom in m. From a to b the camera is on the right.
    rows: NDArray[np.float32]
    margin_m: NDArray[np.float32]  # (N,)
    noise_margin_m: NDArray[np.float32]  # (N,), margin_m without the error that all depths of the camera share
    flags: NDArray[np.uint8]  # (N,) uint8 PlaneFlags
    support_px: NDArray[np.int32]  # (N,)
    cluster: NDArray[np.int32]  # (N,)


def blind_model(info: CameraInfo, cause: InvalidCause, params: Params, stats: FrameStats | None = None) -> FrameModel:
    """Returns the invalid model of a frame, in which nothing is free."""
    return unknown_model(cause, empty_profile(params), NO_GROUND, stats or FrameStats(), info.ke_per_m)


def pixel_stats(counts: tuple[int, int, int], size: int, **more: int) -> FrameStats:
    """Returns the statistics of the pixels of a frame from the counts (measured, far, flying) of `classify`. more:
    other counts."""
    measured, far, flying = counts
    return FrameStats(
        measured_share=(measured - flying) / size,
        far_share=far / size,
        unknown_share=(size - measured - far + flying) / size,
        flying_px=flying,
        **more,
    )


def published_planes(
    planes: NDArray[Any], ground: Ground, view: ViewGeometry, bias: DepthBias, settings: NDArray[Any]
) -> PublishedPlanes | None:
    """Returns the planes to publish; None if a number of one of them is not finite, since its place is then not
    known.

    Planes end at the ground below them, but keep _LEAST_BELOW_GROUND_M. The margin contains the distance of the near
    edge in front of the plane (up to safe_distance_m), margin_sigmas of the noise of the plane's distance, and the error
    that all depths of the camera share. Neighbouring columns share the noise.
    planes: (N,) PLANE. Planes that exist are moved to the front."""
    column_t = float(view.lateral[0]) / view.f_px
    cut_t = (_CUT_COLUMNS - view.cu) * column_t, (view.cols - 1 - _CUT_COLUMNS - view.cu) * column_t
    height_m = float(ground.height_m) if ground.seen else math.inf
    floor = GroundPlane(height_m, float(ground.slope_x), float(ground.slope_y))
    finite, out = write_planes(planes, floor, bias, cut_t, settings)
    return out if finite else None


@kernel
def write_planes(planes, floor, bias, cut_t, settings):
    """Returns whether all numbers are finite, and PublishedPlanes of the planes that exist, which are moved to the front.

    floor: GroundPlane, at an infinite height if there is none; cut_t: tangents beyond which a plane is cut by the left and
    right border of the image; else see `published_planes`."""
    p, n = settings[0], 0
    for k in range(len(planes)):
        if planes[k].support >= 0:
            if n != k:
                planes[n] = planes[k]
            n += 1
    rows, margin_m, noise_margin_m = np.empty((n, 6), np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    flags, support_px, cluster = np.empty(n, np.uint8), np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(n):
        support_px[k], cluster[k] = planes[k].support // PX, planes[k].cluster
    out = PublishedPlanes(rows, margin_m, noise_margin_m, flags, support_px, cluster)
    _cut_at_ground(n, planes, floor, p.ground_tolerance_m)
    _write_rows(n, planes, bias, p, out)
    _write_flags(n, planes, cut_t, p.column_t, flags)
    return _all_finite(n, planes, rows, margin_m), out


@inner
def _all_finite(count, planes, rows, margin):
    """True if planes and published rows are finite and each top is above its bottom.

    Both are tested, because the maximum of a finite number and nan may be finite."""
    for k in range(count):
        p, good = planes[k], rows[k, 4] < rows[k, 5] and math.isfinite(margin[k])
        for c in range(6):
            good = good and math.isfinite(rows[k, c])
        good = good and math.isfinite(p.a) and math.isfinite(p.b) and math.isfinite(p.t0) and math.isfinite(p.t1)
        good = good and math.isfinite(p.top_m) and math.isfinite(p.bottom_m) and math.isfinite(p.front_m)
        if not good:
            return False
    return True


@inner
def _cut_at_ground(count, planes, ground, tolerance_m):
    """Ends each plane at the ground. Where noise makes a strip too distant, its rows extend below the ground."""
    for k in range(count):
        p = planes[k]
        middle = 0.5 * (p.t0 + p.t1)
        x = 1.0 / max(p.a + p.b * middle, LEAST_S)
        floor = ground.height_m + (ground.slope_x + ground.slope_y * middle) * x + tolerance_m
        p.bottom_m = min(p.bottom_m, max(floor, p.top_m + _LEAST_BELOW_GROUND_M))


@inner
def _write_rows(count, planes, bias, settings, out):
    """Writes rows and both margins of PublishedPlanes."""
    safe_m, alike_px, noise_margin = settings.safe_distance_m, settings.noise_alike_px, out.noise_margin_m
    for k in range(count):
        p, row = planes[k], out.rows[k]
        t0, t1 = p.t0 - _OUTWARD, p.t1 + _OUTWARD
        x0 = 1.0 / max(p.a + p.b * t0, LEAST_S)
        x1 = 1.0 / max(p.a + p.b * t1, LEAST_S)
        row[0], row[1], row[2], row[3] = x0, x0 * t0, x1, x1 * t1
        row[4], row[5] = p.top_m - _OUTWARD * x0, p.bottom_m + _OUTWARD * x0
        row[5] = max(row[5], row[4] + np.float32(_LEAST_HEIGHT_M))
        # The moments assume independent columns; a run of alike_px columns has the noise of one.
        columns = max((p.t1 - p.t0) / settings.column_t, 1.0)
        correlated = alike_px * columns / (columns + alike_px - 1.0)
        noise = max(x0, x1) ** 2 * math.sqrt(correlated / max(p.sum_w, 1e-9))
        noise_margin[k] = min(max(p.front_m + safe_m, 0.0), safe_m) + settings.margin_sigmas * noise
        # the bias moves points along their rays; across the plane, at its distance d, that is bias depth d
        across_m = 1.0 / max(math.sqrt(p.a * p.a + p.b * p.b), LEAST_S)
        depth_m = greatest_depth(bias, max(x0, x1), p.top_m, p.bottom_m)
        out.margin_m[k] = noise_margin[k] + bias.per_m * depth_m * across_m


@inner
def _write_flags(count, planes, cut_t, column_t, flags):
    """Writes the flags of PublishedPlanes."""
    for k in range(count):
        p = planes[k]
        inferred = p.inferred > 0
        filled = p.filled_rows > _INFERRED_SHARE * p.rows
        columns = (p.t1 - p.t0) / column_t
        spanned = p.columns < (1.0 - _INFERRED_SHARE) * columns - _INFERRED_COLUMNS
        found = _INFERRED if inferred or filled or spanned else 0
        found |= 0 if inferred else _UNKNOWN_BEHIND
        found |= _CUT_LEFT if p.t0 <= cut_t[0] else 0
        found |= _CUT_RIGHT if p.t1 >= cut_t[1] else 0
        found |= _CUT_TOP if p.cut & CUT_TOP else 0
        found |= _CUT_BOTTOM if p.cut & CUT_BOTTOM else 0
        found |= _IRREGULAR if 2 * p.irregular > p.support else 0
        flags[k] = found


def strip_table(strips: NDArray[Any], n: int) -> StripTable:
    """Returns a copy of the first n strips for drawing and tests."""
    on = strips[:n][strips["support"][:n] > 0]
    names = ("column", "top_row", "bottom_row", "x_m", "y_m", "top_m", "bottom_m", "cluster")
    u, row_top, row_bottom, x, y, top, bottom, cluster = (np.ascontiguousarray(on[name]) for name in names)
    return StripTable(
        u=u,
        row_top=row_top,
        row_bottom=row_bottom,
        x_m=x,
        y_m=y,
        top_m=top,
        bottom_m=bottom,
        support_px=on["support"] // PX,
        cluster=cluster,
    )
