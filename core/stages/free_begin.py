"""The free range of one direction and layer: the rings of free_walk.py, and up to half a step before the first one.

Rings are visited in steps, and a layer comes into view between two of them. All distances are forward distances X in
level_cam."""

from __future__ import annotations

import numpy as np

from ..jit import inner
from ..types import FreeEnd
from .free_cells import columns_hide, count_codes, samples_of
from .free_geometry import part_at
from .free_walk import is_hidden, walk_rings
from .view_geometry import Q_FAR

_OBSTACLE, _VIEW = int(FreeEnd.OBSTACLE), int(FreeEnd.FIELD_OF_VIEW)


@inner
def range_of_cell(sampled, cell, rings, w):
    """Returns (free_from_m, free_to_m, end) of one direction and layer, 0 and 0 if nothing is free."""
    first, last, end = walk_rings(sampled, cell, rings, w)
    if first < 0:
        return 0.0, 0.0, end
    begin = np.float64(rings.x[first])
    if 0 < first < last:  # one ring alone gives no range
        begin = begin_of_range(sampled, cell, rings, first, w)
    return begin, np.float64(rings.x[last]), end


@inner
def begin_of_range(sampled, cell, rings, first, w):
    """Returns the distance from which on a layer is free whose first free ring is `first`, m: the middle between this ring
    and the one before it where the layer is free there too, else this ring.

    This holds only where the ring before is out of view: one that is in view and was not free may hold an object. The cells
    that cover the layer at the middle must see through the first free ring. No hole at the middle or at that ring may hide
    an object between them."""
    before, x, blocking = np.float64(rings.x[first - 1]), np.float64(rings.x[first]), rings.blocking[first]
    if part_at(cell, before, sampled.in_source, w).why != _VIEW:
        return x
    middle = 0.5 * (before + x)
    part = part_at(cell, middle, sampled.in_source, w)
    if part.why != _OBSTACLE:
        return x
    from_cell, to_cell, _ = samples_of(sampled, part, w)
    seen = count_codes(sampled.samples.cells, from_cell, to_cell, Q_FAR, blocking - 1)
    if to_cell <= from_cell or seen < w.free_share * (to_cell - from_cell):
        return x
    if columns_hide(sampled, part, blocking):
        return x
    at_ring = part_at(cell, x, sampled.in_source, w)
    if is_hidden(sampled, cell, part, middle, w) or is_hidden(sampled, cell, at_ring, middle, w):
        return x
    return middle
