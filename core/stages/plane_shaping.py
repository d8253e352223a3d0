"""From strips to planes (Sections 5.2 and 5.3): tracks, merge, outliers, near side, corners, concavities, hidden
parts.

Input: the table of strips and the settings. Output: records of PLANE, vertical rectangles, each in front of the strips for
which it stands.

`shape_planes` is one kernel because a call from Python costs some microseconds. Its stages can be traced one by one:
`shape_planes.py_func` is the same function in Python (see companion/bench/stage_trace.py)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import inner, kernel
from ..params import Params
from .evidence import CELL_PX, Cover, Evidence, find_evidence
from .level import LevelledView
from .merge import MergeBuffers, join_planes, merge_buffers
from .openings import find_openings
from .outlier_split import OutlierBuffers, measure_excess, outlier_buffers, outlier_limits, split_outliers
from .planes import (
    PLANE,
    PlaneTables,
    compact_planes,
    measure_planes,
    planes_from_tracks,
    shift_to_near_side,
    widen_planes,
)
from .refine import close_concavities, drop_covered, extend_to_corners, trim_covered
from .segments import TRACK, Front, front_buffers, grow
from .settings import Settings
from .strip_search import Strips
from .strips import StripList

_MORE_STRIPS = 512
"""Tables are allocated for a multiple of this number of strips, so that they are seldom allocated again."""


@inner
def plane_room(strips):
    """Returns the greatest number of planes of a frame with this number of strips, outliers and concavities included.

    Loops are limited by this number, not by the size of the tables: the result of a frame must not depend on earlier
    frames."""
    return 2 * max(strips, 1) + 16


class PlaneBuffers(NamedTuple):
    """Tables and scratch memory of `shape_planes` for n strips, with N = plane_room(n)."""

    tables: PlaneTables  # PlaneTables
    tracks: NDArray[Any]  # (n + 1,) TRACK
    front: Front  # scratch of `grow`
    merge: MergeBuffers  # scratch of `join_planes`
    outliers: OutlierBuffers  # scratch of `split_outliers`


def plane_buffers(strips: int, partners: int) -> PlaneBuffers:
    """Allocates tables for this number of strips. partners: merge_partners."""
    room = plane_room(strips)
    return PlaneBuffers(
        PlaneTables(np.zeros(room, PLANE), np.zeros(room, np.int32), np.zeros(room, np.int32)),
        np.zeros(strips + 1, TRACK),
        front_buffers(strips),
        merge_buffers(room, partners),
        outlier_buffers(strips, room),
    )


@kernel
def shape_planes(strips, view, source, settings, openings, cells, buffers):
    """Makes planes of the strips; returns their number, hidden ones included. The planes are in buffers.tables.

    Args:
        strips: StripList, with places.
        cells: (C, R) float32 scratch, the cells of Evidence.
        buffers: PlaneBuffers. Planes with a negative support do not exist any more."""
    p, table, n = settings[0], strips.table, strips.count
    tables, planes = buffers.tables, buffers.tables.planes
    room, cell = plane_room(n), CELL_PX
    tracks = grow(table, view, strips.first_of_column, p, openings, buffers.tracks, buffers.front)
    planes_from_tracks(tracks, buffers.tracks, p, tables)
    measure_planes(strips, view, p, tracks, tables)

    find_evidence(table, n, view, source[0], cells)
    across = view.f_px / np.float64(view.lateral[0]) / cell
    evidence = Evidence(cells, across, view.f_px / cell, (view.cu + 0.5) / cell, (view.cv + 0.5) / cell)
    cover = Cover(evidence, openings, np.zeros(cells.shape[1] + 2, np.int32))
    join_planes(tracks, room, tables, p, cover, buffers.merge)
    count = merged = compact_planes(tracks, tracks, tables)
    measure_planes(strips, view, p, count, tables)

    measure_excess(strips, view, p, count, tables, buffers.outliers)
    outlier_limits(count, planes, p, buffers.outliers)
    count = split_outliers(strips, view, p, count, tracks, tables, buffers.outliers)
    if count > merged:
        measure_planes(strips, view, p, count, tables)
    shift_to_near_side(count, planes, p.min_plane_distance_m)
    if p.smear_t > 0.0:
        widen_planes(count, planes, p.smear_t)

    extend_to_corners(count, planes, p, openings)
    count = close_concavities(count, room, planes, p, openings)
    drop_covered(count, planes, p.hidden_depth_m, p.hidden_t)
    trim_covered(count, planes, p.hidden_depth_m, evidence)
    return count


class PlaneShaper:
    """Makes planes of strips. It holds tables and scratch memory, no state between frames."""

    def __init__(self, params: Params, buffers: Buffers) -> None:
        self._params, self._buffers = params, buffers
        self._make_room(0)

    def _make_room(self, strips: int) -> None:
        self._room, self._scratch = strips, plane_buffers(strips, self._params.merge_partners)

    def shape(self, levelled: LevelledView, strips: Strips, source: NDArray[Any], settings: Settings) -> NDArray[Any]:
        """Returns the planes of a frame, (N,) PLANE, valid until the next call. A negative support: the plane is hidden.

        source: (1,) SOURCE."""
        view, p = levelled.view, self._params
        if strips.count > self._room:
            self._make_room(-(-strips.count // _MORE_STRIPS) * _MORE_STRIPS)
        openings = find_openings(
            levelled.codes,
            strips.table,
            strips.count,
            view,
            float(source["max_range_m"][0]),
            (p.passable_width_m, p.passable_height_m),
            self._buffers,
        )
        cells = self._buffers("evidence", (-(-view.cols // CELL_PX), -(-view.rows // CELL_PX)), np.float32)
        count = shape_planes(
            StripList(strips.table, strips.count, strips.first_of_column),
            view,
            source,
            settings.view,
            openings,
            cells,
            self._scratch,
        )
        return self._scratch.tables.planes[:count]
