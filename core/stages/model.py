"""The result of one frame: tables of the stages as parts of a FrameModel."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, record, record_of
from ..params import Params
from ..types import CameraInfo, FrameModel, FrameStats, Ground, InvalidCause, PlaneFlags, StripTable
from .free_profile import empty_profile
from .ground import NO_GROUND
from .planes import LEAST_S
from .strips import CUT_BOTTOM, CUT_TOP, IRREGULAR, PX
from .view_geometry import ViewGeometry

_OUTWARD = 1e-6
"""Not tuning: tangent by which outlines grow, so that rounding to float32 takes no ray that runs along an edge."""
_LEAST_HEIGHT_M = 1e-3
"""Not tuning: a plane's top must differ from its bottom in float32."""
_INFERRED, _UNKNOWN_BEHIND = int(PlaneFlags.INFERRED), int(PlaneFlags.UNKNOWN_BEHIND)
_CUT_LEFT, _CUT_RIGHT = int(PlaneFlags.CUT_LEFT), int(PlaneFlags.CUT_RIGHT)
_CUT_TOP, _CUT_BOTTOM, _IRREGULAR = int(PlaneFlags.CUT_TOP), int(PlaneFlags.CUT_BOTTOM), int(PlaneFlags.IRREGULAR)
"""The flags as numbers for the kernels."""

PUBLISH_SETTINGS = record(
    ("ground_seen", np.int64),
    ("height_m", np.float64),
    ("slope_x", np.float64),
    ("slope_y", np.float64),
    ("column_t", np.float64),
    ("left_t", np.float64),
    ("right_t", np.float64),
    ("ground_tolerance_m", np.float64),
    ("min_plane_height_m", np.float64),
    ("safe_distance_m", np.float64),
    ("margin_sigmas", np.float64),
    ("noise_alike_px", np.float64),
    ("inferred_share", np.float64),
    ("inferred_columns", np.float64),
)
"""The ground of the frame; tangents: of a column, and beyond which a plane counts as cut at the left and at the right; and
parameters by their names."""


class PublishedPlanes(NamedTuple):
    """Planes as a FrameModel holds them, N of each: rows (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, m; margin_m float32;
    flags uint8 PlaneFlags; support_px, cluster int32."""

    rows: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    flags: NDArray[np.uint8]
    support_px: NDArray[np.int32]
    cluster: NDArray[np.int32]


def blind_model(info: CameraInfo, cause: InvalidCause, params: Params, stats: FrameStats | None = None) -> FrameModel:
    """The invalid model of a frame: nothing in it may be taken as free."""
    return FrameModel(
        valid=False,
        cause=cause,
        planes=np.zeros((0, 6), np.float32),
        support_px=np.zeros(0, np.int32),
        margin_m=np.zeros(0, np.float32),
        flags=np.zeros(0, np.uint8),
        cluster=np.zeros(0, np.int32),
        prisms=(),
        free=empty_profile(params),
        ground=NO_GROUND,
        stats=stats or FrameStats(),
        ke_per_m=info.ke_per_m,
    )


def pixel_stats(counts: tuple[int, int, int], size: int, **more: int) -> FrameStats:
    """Shares of the pixels of one frame from the counts (measured, far, flying) of `classify`, and other counts."""
    measured, far, flying = counts
    return FrameStats(
        measured_share=(measured - flying) / size,
        far_share=far / size,
        unknown_share=(size - measured - far + flying) / size,
        flying_px=flying,
        **more,
    )


def publish_settings(column_t: float, params: Params) -> NDArray[Any]:
    """(1,) PUBLISH_SETTINGS without the ground and the borders of a frame. column_t: tangent of a column."""
    frame = dict.fromkeys(("ground_seen", "height_m", "slope_x", "slope_y", "left_t", "right_t"), 0.0)
    return record_of(PUBLISH_SETTINGS, params, column_t=column_t, **frame)


def published_planes(
    count: int, planes: NDArray[Any], ground: Ground, view: ViewGeometry, params: Params, settings: NDArray[Any]
) -> PublishedPlanes | None:
    """The planes to publish; None where one of them is not finite: its place, and what it hides, is not known.

    planes: the first `count` of PLANE; those that exist move to the front, and end at the ground at their feet, where they
    keep min_plane_height_m. settings: of `publish_settings`; completed here. a is the left end: from a to b the camera,
    and so free space, is on the right. The margin is what the near edge still stands out (up to safe_distance_m) and
    margin_sigmas of the plane's own distance noise, which neighbouring columns share."""
    column_t = float(view.lateral[0]) / view.f_px
    settings["ground_seen"], settings["height_m"] = ground.seen, ground.height_m
    settings["slope_x"], settings["slope_y"] = ground.slope_x, ground.slope_y
    settings["left_t"] = (params.cut_columns - view.cu) * column_t
    settings["right_t"] = (view.cols - 1 - params.cut_columns - view.cu) * column_t
    out = PublishedPlanes(
        np.empty((count, 6), np.float32),
        np.empty(count, np.float32),
        np.empty(count, np.uint8),
        np.empty(count, np.int32),
        np.empty(count, np.int32),
    )
    n = write_planes(count, planes, settings, out)
    if n < 0:
        return None
    return PublishedPlanes(out.rows[:n], out.margin_m[:n], out.flags[:n], out.support_px[:n], out.cluster[:n])


@inner
def write_planes(count, planes, settings, out):
    """See `published_planes`; returns how many planes exist, -1 where one is not finite, or its top not above its bottom."""
    p = settings[0]
    n = 0
    for k in range(count):
        if planes[k].support >= 0:
            if n != k:
                planes[n] = planes[k]
            out.support_px[n], out.cluster[n] = planes[n].support // PX, planes[n].cluster
            n += 1
    if p.ground_seen != 0:
        _cut_at_ground(n, planes, p)
    _write_rows(n, planes, p, out.rows, out.margin_m)
    _write_flags(n, planes, p, out.flags)
    return n if _all_finite(n, planes, out.rows, out.margin_m) else -1


@inner
def _all_finite(count, planes, rows, margin):
    """Whether planes and what is published of them are finite, each top above its bottom. Both, since the maximum of a number
    and of one that is not finite may be finite."""
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
def _cut_at_ground(count, planes, settings):
    """A strip's rows reach below the ground where noise puts the strip too far away."""
    for k in range(count):
        p = planes[k]
        middle = 0.5 * (p.t0 + p.t1)
        x = 1.0 / max(p.a + p.b * middle, LEAST_S)
        floor = settings.height_m + (settings.slope_x + settings.slope_y * middle) * x + settings.ground_tolerance_m
        p.bottom_m = min(p.bottom_m, max(floor, p.top_m + settings.min_plane_height_m))


@inner
def _write_rows(count, planes, settings, rows, margin):
    safe_m, alike_px = settings.safe_distance_m, settings.noise_alike_px
    for k in range(count):
        p, row = planes[k], rows[k]
        t0, t1 = p.t0 - _OUTWARD, p.t1 + _OUTWARD
        x0 = 1.0 / max(p.a + p.b * t0, LEAST_S)
        x1 = 1.0 / max(p.a + p.b * t1, LEAST_S)
        row[0], row[1], row[2], row[3] = x0, x0 * t0, x1, x1 * t1
        row[4], row[5] = p.top_m - _OUTWARD * x0, p.bottom_m + _OUTWARD * x0
        row[5] = max(row[5], row[4] + np.float32(_LEAST_HEIGHT_M))
        # moments take columns for independent; a run of alike_px of them has the noise of one
        columns = max((p.t1 - p.t0) / settings.column_t, 1.0)
        correlated = alike_px * columns / (columns + alike_px - 1.0)
        noise = max(x0, x1) ** 2 * math.sqrt(correlated / max(p.sum_w, 1e-9))
        margin[k] = min(max(p.front_m + safe_m, 0.0), safe_m) + settings.margin_sigmas * noise


@inner
def _write_flags(count, planes, settings, flags):
    """(N,) uint8 PlaneFlags."""
    share = settings.inferred_share
    for k in range(count):
        p = planes[k]
        inferred = p.inferred > 0
        filled = p.filled_rows > share * p.rows
        columns = (p.t1 - p.t0) / settings.column_t
        spanned = p.columns < (1.0 - share) * columns - settings.inferred_columns
        found = _INFERRED if inferred or filled or spanned else 0
        found |= 0 if inferred else _UNKNOWN_BEHIND
        found |= _CUT_LEFT if p.t0 <= settings.left_t else 0
        found |= _CUT_RIGHT if p.t1 >= settings.right_t else 0
        found |= _CUT_TOP if p.cut & CUT_TOP else 0
        found |= _CUT_BOTTOM if p.cut & CUT_BOTTOM else 0
        found |= _IRREGULAR if p.kind >= IRREGULAR else 0
        flags[k] = found


def strip_table(strips: NDArray[Any], n: int) -> StripTable:
    """A copy of the first n of STRIP, for drawing and tests."""
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
