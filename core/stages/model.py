"""What comes out of one frame: the tables of the stages as a FrameModel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import copy_row, inner
from ..params import Params
from ..types import CameraInfo, FrameModel, FrameStats, Ground, InvalidCause, PlaneFlags, StripTable
from . import planes as pl
from . import strips
from .free_space import nothing_known
from .ground import NO_GROUND
from .view_geometry import ViewGeometry

_OUTWARD = 1e-6
"""Not tuning: tangent by which outlines grow, so that rounding to float32 takes no ray that runs along an edge."""
_LEAST_HEIGHT_M = 1e-3
"""Not tuning: a plane's top must differ from its bottom in float32."""
_INFERRED, _UNKNOWN_BEHIND, _IRREGULAR = (
    int(PlaneFlags.INFERRED), int(PlaneFlags.UNKNOWN_BEHIND), int(PlaneFlags.IRREGULAR),
)  # fmt: skip
_CUT_LEFT, _CUT_RIGHT, _CUT_TOP, _CUT_BOTTOM = (
    int(PlaneFlags.CUT_LEFT), int(PlaneFlags.CUT_RIGHT), int(PlaneFlags.CUT_TOP), int(PlaneFlags.CUT_BOTTOM),
)  # fmt: skip
"""The flags as numbers for the kernels."""
ToldPlanes = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.int32], NDArray[np.int32]]
"""See `told_planes`."""


def blind_model(info: CameraInfo, cause: InvalidCause, params: Params, stats: FrameStats | None = None) -> FrameModel:
    """The model of a frame that says nothing: nothing in it may be taken as free."""
    return FrameModel(
        valid=False, cause=cause, planes=np.zeros((0, 6), np.float32), support_px=np.zeros(0, np.int32),
        margin_m=np.zeros(0, np.float32), flags=np.zeros(0, np.uint8), cluster=np.zeros(0, np.int32), prisms=(),
        free=nothing_known(params), ground=NO_GROUND, stats=stats or FrameStats(), ke_per_m=info.ke_per_m,
    )  # fmt: skip


def pixel_stats(counts: tuple[int, int, int], size: int, **more: int) -> FrameStats:
    """Shares of the pixels of one frame from the counts (measured, far, flying) of `classify`, and what else was counted."""
    measured, far, flying = counts
    return FrameStats(
        measured_share=(measured - flying) / size, far_share=far / size,
        unknown_share=(size - measured - far + flying) / size, flying_px=flying, **more,
    )  # fmt: skip


def told_planes(
    count: int, planes: NDArray[np.float64], plane_ints: NDArray[np.int32], moments: NDArray[np.float64], ground: Ground,
    view: ViewGeometry, params: Params,
) -> ToldPlanes | None:  # fmt: skip
    """rows (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom; (N,) margin, m, flags, support, px, and cluster of the living planes;
    None where one of them is no numbers: it stands nowhere, and what it hides is not known.

    They move to the front of the tables of planes.py, and end at the ground seen at their feet, where they keep
    min_plane_height_m. a is the left end: from a to b the camera, and so free space, is on the right. The margin is what the
    near edge still stands out (up to safe_distance) and margin_sigmas of the plane's own distance noise, which neighbouring
    columns share."""
    p, column_t = params, float(view.lateral[0]) / view.f_px
    rows, margin, flags = np.empty((count, 6), np.float32), np.empty(count, np.float32), np.empty(count, np.uint8)
    support, cluster = np.empty(count, np.int32), np.empty(count, np.int32)
    n = write_planes(
        count, planes, plane_ints, moments, ground.seen, ground.height_m, ground.slope_x, ground.slope_y, p.ground_tolerance_m,
        p.min_plane_height_m, p.safe_distance_m, p.margin_sigmas, p.noise_alike_px, column_t, (p.cut_columns - view.cu) * column_t,
        (view.cols - 1 - p.cut_columns - view.cu) * column_t, p.inferred_share, p.inferred_columns, rows, margin, flags, support,
        cluster,
    )  # fmt: skip
    if n < 0:
        return None
    return rows[:n], margin[:n], flags[:n], support[:n], cluster[:n]


@inner
def write_planes(
    count, planes, plane_ints, moments, on_ground, height_m, slope_x, slope_y, tolerance_m, least_m, safe_m, sigmas, alike_px, column_t,
    left_t, right_t, inferred_share, inferred_columns, rows, margin, flags, support, cluster,
):  # fmt: skip
    """See told_planes; returns how many live, -1 where a number of theirs is not finite, or their top not above their bottom."""
    n = 0
    for k in range(count):
        if plane_ints[k, pl.P_SUPPORT] >= 0:
            if n != k:
                copy_row(planes, n, k)
                copy_row(plane_ints, n, k)
                copy_row(moments, n, k)
            support[n], cluster[n] = plane_ints[n, pl.P_SUPPORT] // strips.PX, plane_ints[n, pl.P_CLUSTER]
            n += 1
    if on_ground:
        _cut_at_ground(n, planes, height_m, slope_x, slope_y, tolerance_m, least_m)
    _write_rows(n, planes, moments, safe_m, sigmas, alike_px, column_t, rows, margin)
    _write_flags(n, planes, plane_ints, column_t, left_t, right_t, inferred_share, inferred_columns, flags)
    return n if _all_numbers(n, planes, rows, margin) else -1


@inner
def _all_numbers(count, planes, rows, margin):
    """Whether planes and what is told of them are finite, each top above its bottom. Both, since the greater of a number and
    of what is none may be the number."""
    for k in range(count):
        p, good = planes[k], rows[k, 4] < rows[k, 5] and math.isfinite(margin[k])
        for c in range(6):
            good = good and math.isfinite(rows[k, c])
        for c in (pl.A, pl.B, pl.T0, pl.T1, pl.Z0, pl.Z1, pl.FRONT):
            good = good and math.isfinite(p[c])
        if not good:
            return False
    return True


@inner
def _cut_at_ground(count, planes, height_m, slope_x, slope_y, tolerance_m, least_m):
    """A strip's rows reach below the ground where noise puts the strip too far away."""
    for k in range(count):
        p = planes[k]
        middle = 0.5 * (p[pl.T0] + p[pl.T1])
        x = 1.0 / max(p[pl.A] + p[pl.B] * middle, pl.LEAST_S)
        floor = height_m + (slope_x + slope_y * middle) * x + tolerance_m
        p[pl.Z1] = min(p[pl.Z1], max(floor, p[pl.Z0] + least_m))


@inner
def _write_rows(count, planes, moments, safe_m, sigmas, alike_px, column_t, rows, margin):
    for k in range(count):
        p, row = planes[k], rows[k]
        t0, t1 = p[pl.T0] - _OUTWARD, p[pl.T1] + _OUTWARD
        x0 = 1.0 / max(p[pl.A] + p[pl.B] * t0, pl.LEAST_S)
        x1 = 1.0 / max(p[pl.A] + p[pl.B] * t1, pl.LEAST_S)
        row[0], row[1], row[2], row[3] = x0, x0 * t0, x1, x1 * t1
        row[4], row[5] = p[pl.Z0] - _OUTWARD * x0, p[pl.Z1] + _OUTWARD * x0
        row[5] = max(row[5], row[4] + np.float32(_LEAST_HEIGHT_M))
        # moments take columns for independent; a run of alike_px of them has the noise of one
        columns = max((p[pl.T1] - p[pl.T0]) / column_t, 1.0)
        correlated = alike_px * columns / (columns + alike_px - 1.0)
        noise = max(x0, x1) ** 2 * math.sqrt(correlated / max(moments[k, 0], 1e-9))
        margin[k] = min(max(p[pl.FRONT] + safe_m, 0.0), safe_m) + sigmas * noise


@inner
def _write_flags(count, planes, plane_ints, column_t, left_t, right_t, inferred_share, inferred_columns, flags):
    """(N,) uint8 PlaneFlags."""
    for k in range(count):
        p, ints = planes[k], plane_ints[k]
        inferred = ints[pl.P_INFERRED] > 0
        filled = ints[pl.P_FILL] > inferred_share * ints[pl.P_ROWS]
        columns = (p[pl.T1] - p[pl.T0]) / column_t
        spanned = ints[pl.P_COLUMNS] < (1.0 - inferred_share) * columns - inferred_columns
        found = _INFERRED if inferred or filled or spanned else 0
        found |= 0 if inferred else _UNKNOWN_BEHIND
        found |= _CUT_LEFT if p[pl.T0] <= left_t else 0
        found |= _CUT_RIGHT if p[pl.T1] >= right_t else 0
        found |= _CUT_TOP if ints[pl.P_CUT] & 1 else 0
        found |= _CUT_BOTTOM if ints[pl.P_CUT] & 2 else 0
        found |= _IRREGULAR if ints[pl.P_KIND] >= strips.IRREGULAR else 0
        flags[k] = found


def strip_table(ints: NDArray[np.int32], place: NDArray[np.float32], n: int) -> StripTable:
    """A copy of the strips for drawing and tests."""
    on = np.flatnonzero(ints[:n, strips.SUPPORT] > 0)
    column = ints[on].T.copy()
    x, y, top, bottom = place[on].T.copy()
    return StripTable(
        u=column[strips.U], row_top=column[strips.TOP], row_bottom=column[strips.BOTTOM], x_m=x, y_m=y, top_m=top,
        bottom_m=bottom, support_px=column[strips.SUPPORT] // strips.PX, cluster=column[strips.CLUSTER],
    )  # fmt: skip
