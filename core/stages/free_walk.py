"""Walk outward through one direction and one layer of height: which rings are free, and why the walk ends.

Input: the samples of a direction and the rings of a layer. Output: the free rings of `ProfileCell`, from which
free_begin.py makes a range. All distances are forward distances X in level_cam."""

from __future__ import annotations

import numpy as np

from ..jit import inner
from ..types import FreeEnd
from .free_cells import columns_hide, count_codes, samples_of
from .free_geometry import least_optical_depth, part_at
from .free_holes import LEAST_SIDE, holds_hole, side_index
from .view_geometry import Q_FAR

_NOT_SEEN, _OBSTACLE, _UNKNOWN, _VIEW, _RANGE = map(int, FreeEnd)


@inner
def is_hidden(sampled, cell, part, before, w):
    """True if a hole in the rows of a part may hide an object between the distance `before` and that of the part.

    Where some of this space may be too near to be measured, any hole counts, also one a column or LEAST_SIDE rows beside the part;
    elsewhere one of the size of profile_blank_m.
    before: distance from which on the ring would make the layer free, m."""
    if least_optical_depth(cell, before, part.lower, w) <= w.near_m:
        return holds_hole(sampled.near_holes, part.first - LEAST_SIDE, part.last + LEAST_SIDE, 0)
    return holds_hole(sampled.holes, part.first, part.last, side_index(w.profile_blank_m * w.f_px / part.x))


@inner
def end_without_part(why, begun, end):
    """Returns whether a walk ends at a ring of which no part can be judged, and its end so far.

    why: of Part; begun: the walk has begun; end: its end before this ring."""
    if begun or why == _UNKNOWN:
        return True, _VIEW if why == _NOT_SEEN else why
    return why == _RANGE, _NOT_SEEN if why == _NOT_SEEN else end


@inner
def walk_rings(sampled, cell, rings, w):
    """Walks outward through one direction and layer; returns (first, last, end) of the free rings, (-1, -1, end) if
    there are none.

    The walk begins at the first ring that measures a greater distance, and ends at the next one that does not. In it, rings
    with a hole are not free. The free rings are those before the first such hole, or, where that is in the first ring of
    the walk, those behind it. A ring with a column that may hide an object ends the walk. So neither makes a ring free that would not be
    without it.

    Nothing is free beyond the range. See `part_at` for layers that the ground cuts."""
    first, last, end, begun = -1, -1, _NOT_SEEN, False
    for r in range(len(rings.x)):
        x = np.float64(rings.x[r])
        part = part_at(cell, x, sampled.in_source, w)
        if part.why != _OBSTACLE:
            stops, end = end_without_part(part.why, begun, end)
            if stops:
                break
            continue
        from_cell, to_cell, unknown = samples_of(sampled, part, w)
        total = to_cell - from_cell
        known, enough, near_enough = total - unknown, w.free_share * total, (1.0 - w.free_share) * total
        if not begun and known < enough and known <= near_enough:
            end = _UNKNOWN  # too few known cells to make the ring free or to end the walk
            continue
        seen = count_codes(sampled.samples.cells, from_cell, to_cell, Q_FAR, rings.blocking[r] - 1)
        if total > 0 and seen >= enough:
            begun = True
            if columns_hide(sampled, part, rings.blocking[r]):
                end = _UNKNOWN
                break
            if not is_hidden(sampled, cell, part, np.float64(rings.x[last]) if first >= 0 else x, w):
                first = r if first < 0 else first
                last, end = r, _RANGE
                continue
            end = _UNKNOWN
            if first < 0:
                continue
            break
        near = known - seen
        if begun or near > near_enough:
            end = _OBSTACLE if near >= unknown else _UNKNOWN
            break
        end = _UNKNOWN
    return first, last, end if first >= 0 or not begun else _UNKNOWN
