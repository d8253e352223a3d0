"""Where the free range of one direction and layer begins: up to half a step before its first free ring.

Rings are visited in steps, and a layer comes into view between two of them. Used by free_space.py after free_walk.py;
distances as there."""

from __future__ import annotations

import numpy as np

from ..jit import inner
from ..types import FreeEnd
from .free_cells import HIDES_NOTHING, count_codes, hiding_columns
from .free_walk import is_hidden, part_at, rows_between, samples_of
from .view_geometry import Q_FAR

_OBSTACLE, _VIEW = int(FreeEnd.OBSTACLE), int(FreeEnd.FIELD_OF_VIEW)


@inner
def begin_of_range(sampled, t0, t1, before, x, blocking, rows, top, bottom, w):
    """Returns the distance from which on a layer is free whose first free ring is the one at x, m: the middle between this
    ring and the one before it where the layer is free there too, else x.

    This holds only where the ring before is out of view: one that is in view and was not free may hold a thing. The cells that cover the layer at the middle must see through x. No hole at the middle or at x may hide a thing between
    them.

    Args:
        sampled: Sampled of the direction.
        t0, t1: tangents of its edges.
        before: distance of the ring before it, m.
        x: distance of the first free ring, m.
        blocking: its code of `blocking_codes`.
        rows: (2,) int64, its rows of `rows_of_rings`.
        top, bottom: heights of the layer.
        w: a record of WALK_SETTINGS."""
    middle, in_source = 0.5 * (np.float64(before) + x), sampled.in_source
    v0, v1 = rows_between(before, top, bottom, w)
    if part_at(before, v0, v1, in_source, t0, t1, top, bottom, w)[0] != _VIEW:
        return np.float64(x)
    v0, v1 = rows_between(middle, top, bottom, w)
    why, lower, v0, v1 = part_at(middle, v0, v1, in_source, t0, t1, top, bottom, w)
    if why != _OBSTACLE:
        return np.float64(x)
    from_cell, to_cell, _ = samples_of(sampled, v0, v1, w)
    seen = count_codes(sampled.cells, from_cell, to_cell, Q_FAR, blocking - 1)
    if to_cell <= from_cell or seen < w.free_share * (to_cell - from_cell):
        return np.float64(x)
    if hiding_columns(sampled, v0, v1, blocking) != HIDES_NOTHING:
        return np.float64(x)
    hidden = is_hidden(sampled, middle, middle, v0, v1, t0, t1, top, lower, w)
    _, lower, v0, v1 = part_at(x, rows[0], rows[1], in_source, t0, t1, top, bottom, w)
    hidden = hidden or is_hidden(sampled, x, middle, v0, v1, t0, t1, top, lower, w)
    return np.float64(x) if hidden else middle
