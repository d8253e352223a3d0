"""What comes out of one frame: the tables of the stages as a FrameModel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import planes as pl
from . import strips
from .free_space import nothing_known
from .ground import NO_GROUND
from .level import ViewGeometry
from .params import Params
from .types import CameraInfo, FrameModel, FrameStats, Ground, InvalidCause, PlaneFlags, StripTable

_OUTWARD = 1e-6
"""Not tuning: tangent by which outlines grow, so that rounding to float32 takes no ray that runs along an edge."""
_LEAST_HEIGHT_M = 1e-3
"""Not tuning: a plane's top must differ from its bottom in float32."""


def blind_model(info: CameraInfo, cause: InvalidCause, params: Params, stats: FrameStats | None = None) -> FrameModel:
    """The model of a frame that says nothing: nothing in it may be taken as free."""
    return FrameModel(
        valid=False, cause=cause, planes=np.zeros((0, 6), np.float32), support_px=np.zeros(0, np.int32),
        margin_m=np.zeros(0, np.float32), flags=np.zeros(0, np.uint8), cluster=np.zeros(0, np.int32), prisms=(),
        free=nothing_known(params), ground=NO_GROUND, stats=stats or FrameStats(), ke_per_m=info.ke_per_m,
    )  # fmt: skip


def pixel_stats(counts: tuple[int, int, int], size: int) -> FrameStats:
    """Shares of the pixels of one frame from the counts (measured, far, flying) of `classify`."""
    measured, far, flying = counts
    return FrameStats(
        measured_share=(measured - flying) / size, far_share=far / size,
        unknown_share=(size - measured - far + flying) / size, flying_px=flying,
    )  # fmt: skip


def end_at_ground(planes: NDArray[np.float64], ground: Ground, params: Params) -> None:
    """Cuts planes that reach below the ground seen at their feet, in place; one wholly below keeps min_plane_height_m.

    A strip's rows reach below it where noise puts the strip too far away."""
    if not ground.seen:
        return
    middle = 0.5 * (planes[:, pl.T0] + planes[:, pl.T1])
    x = 1.0 / np.maximum(planes[:, pl.A] + planes[:, pl.B] * middle, pl.LEAST_S)
    floor = ground.height_m + (ground.slope_x + ground.slope_y * middle) * x + params.ground_tolerance_m
    planes[:, pl.Z1] = np.minimum(planes[:, pl.Z1], np.maximum(floor, planes[:, pl.Z0] + params.min_plane_height_m))


def plane_rows(
    planes: NDArray[np.float64], moments: NDArray[np.float64], params: Params
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(N, 6) float32 a_x, a_y, b_x, b_y, top, bottom and (N,) margins, m, of the table of planes.py.

    a is the left end: from a to b the camera, and so free space, is on the right. The margin is what the near edge
    still stands out (up to safe_distance) and margin_sigmas of the plane's own distance noise."""
    t0, t1 = planes[:, pl.T0] - _OUTWARD, planes[:, pl.T1] + _OUTWARD
    x0 = 1.0 / np.maximum(planes[:, pl.A] + planes[:, pl.B] * t0, pl.LEAST_S)
    x1 = 1.0 / np.maximum(planes[:, pl.A] + planes[:, pl.B] * t1, pl.LEAST_S)
    top, bottom = planes[:, pl.Z0] - _OUTWARD * x0, planes[:, pl.Z1] + _OUTWARD * x0
    rows = np.stack([x0, x0 * t0, x1, x1 * t1, top, bottom], axis=1).astype(np.float32)
    rows[:, 5] = np.maximum(rows[:, 5], rows[:, 4] + _LEAST_HEIGHT_M)
    noise = np.maximum(x0, x1) ** 2 / np.sqrt(np.maximum(moments[:, 0], 1e-9))
    front = np.clip(planes[:, pl.FRONT] + params.safe_distance_m, 0.0, params.safe_distance_m)
    return rows, (front + params.margin_sigmas * noise).astype(np.float32)


def plane_flags(
    planes: NDArray[np.float64], plane_ints: NDArray[np.int32], view: ViewGeometry, params: Params
) -> NDArray[np.uint8]:
    """(N,) uint8 PlaneFlags."""
    column_t = float(view.lateral[0]) / view.f_px
    inferred = plane_ints[:, pl.P_INFERRED] > 0
    filled = plane_ints[:, pl.P_FILL] > params.inferred_share * plane_ints[:, pl.P_ROWS]
    columns = (planes[:, pl.T1] - planes[:, pl.T0]) / column_t
    spanned = plane_ints[:, pl.P_COLUMNS] < (1.0 - params.inferred_share) * columns - params.inferred_columns
    flags = np.where(inferred | filled | spanned, int(PlaneFlags.INFERRED), 0)
    flags |= np.where(inferred, 0, int(PlaneFlags.UNKNOWN_BEHIND))
    flags |= np.where(planes[:, pl.T0] <= (params.cut_columns - view.cu) * column_t, int(PlaneFlags.CUT_LEFT), 0)
    flags |= np.where(
        planes[:, pl.T1] >= (view.cols - 1 - params.cut_columns - view.cu) * column_t, int(PlaneFlags.CUT_RIGHT), 0
    )
    flags |= np.where(plane_ints[:, pl.P_CUT] & 1, int(PlaneFlags.CUT_TOP), 0)
    flags |= np.where(plane_ints[:, pl.P_CUT] & 2, int(PlaneFlags.CUT_BOTTOM), 0)
    flags |= np.where(plane_ints[:, pl.P_KIND] >= strips.IRREGULAR, int(PlaneFlags.IRREGULAR), 0)
    return flags.astype(np.uint8)


def strip_table(ints: NDArray[np.int32], place: NDArray[np.float32], n: int) -> StripTable:
    """A copy of the strips for drawing and tests."""
    on = np.flatnonzero(ints[:n, strips.SUPPORT] > 0)
    column = ints[on].T.copy()
    x, y, top, bottom = place[on].T.copy()
    return StripTable(
        u=column[strips.U], row_top=column[strips.TOP], row_bottom=column[strips.BOTTOM], x_m=x, y_m=y, top_m=top,
        bottom_m=bottom, support_px=column[strips.SUPPORT] // strips.PX, cluster=column[strips.CLUSTER],
    )  # fmt: skip
