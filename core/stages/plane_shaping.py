"""From strips to planes (Sections 5.2 and 5.3): tracks, merge, outliers, near side, corners, concavities, hidden
parts.

Input: the strips and the settings. Output: records of PLANE, vertical rectangles, each in front of the strips for
which it stands.

`shape_planes` is one kernel because a call from Python costs some microseconds. Its stages can be traced one by one:
`shape_planes.py_func` is the same function in Python (see companion/bench/stage_trace.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import kernel
from ..params import Params
from .evidence import Cover, find_evidence
from .level import LevelledView
from .merge import join_planes
from .openings import find_openings
from .outlier_split import split_outliers
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
from .segments import TRACK, grow
from .settings import Settings
from .strip_search import Strips


@kernel
def shape_planes(strips, view, source, settings, openings, planes):
    """Makes planes of the strips; returns their number, hidden ones included.

    strips: with places; planes: (N,) PLANE out, with room for all. Planes with a negative support do not exist any more."""
    p, table, n, room = settings[0], strips.table, strips.count, len(planes)
    tables, found = PlaneTables(planes, np.empty(room, np.int32), np.empty(room, np.int32)), np.empty(n, TRACK)
    tracks = grow(table, view, strips.first_of_column, p, openings, found)
    planes_from_tracks(tracks, found, p, tables)
    measure_planes(strips, view, p, tracks, tables)
    evidence = find_evidence(table, n, view, source[0])
    cover = Cover(evidence, openings, np.zeros((2, evidence.nearest.shape[1] + 2), np.int32))
    join_planes(tracks, tables, p, cover)
    merged = compact_planes(tracks, tracks, tables)
    measure_planes(strips, view, p, merged, tables)
    count = split_outliers(strips, view, p, merged, tracks, tables)
    if count > merged:
        measure_planes(strips, view, p, count, tables)
    shift_to_near_side(count, planes, p.min_plane_distance_m)
    if p.smear_t > 0.0:
        widen_planes(count, planes, p.smear_t)
    extend_to_corners(count, planes, p, cover)
    count = close_concavities(count, planes, p, openings)
    drop_covered(count, planes, p.hidden_depth_m, p.hidden_t)
    trim_covered(count, planes, p.hidden_depth_m, evidence)
    return count


def find_planes(
    levelled: LevelledView, strips: Strips, source: NDArray[Any], settings: Settings, p: Params, buffers: Buffers
) -> NDArray[Any]:
    """Returns the planes of a frame, (N,) PLANE, valid until the next call. A negative support: the plane is hidden."""
    found, view = strips.found, levelled.view
    passable, range_m = (p.passable_width_m, p.passable_height_m), float(source["max_range_m"][0])
    openings = find_openings(levelled.codes, found.table, found.count, view, range_m, passable, buffers)
    room = 2 * max(found.count, 1) + 16  # outliers and concavities included
    planes = buffers("planes", (room,), PLANE)
    return planes[: shape_planes(found, view, source, settings.view, openings, planes)]
