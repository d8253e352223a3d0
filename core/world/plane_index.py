"""The table of planes of the merged world and its spatial index. The cost of a frame does not depend on the number of
planes.

Planes are in slots of a table of fixed size. A slot is in the list of each square of the ground that its plane
crosses. A hash maps squares to lists: a search may return a few planes of other squares, and never misses one. A
further list contains the slots in the order of their last observation (LRU). If the table is full, its first one is
removed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, record
from .evidence import empty_steps, erase, plane_steps
from .free_grid import EDGE_M, cells_beside
from .zero_table import zero_table

SQUARE_M = 8.0
"""Side of a square, of which a frame covers some dozen."""
_LINKS = 4
"""Links per slot: long planes need more than one."""
NONE = -1
BOX = ("ax_m", "ay_m", "bx_m", "by_m", "top_m", "bottom_m")
MOMENTS = ("weight", "x", "y", "xx", "xy", "yy")
SLOT = record(
    *((name, np.float64) for name in MOMENTS),
    ("seen_ns", np.int64),  # newest observation
    *((name, np.float32) for name in BOX),
    ("anchor_x_m", np.float32),  # the moments are about this point
    ("anchor_y_m", np.float32),
    ("margin_m", np.float32),
    ("noise_m", np.float32),  # the margin without the offsets of joined parts; it determines what may be joined
    ("hits", np.int32),  # observations; 0: an empty slot
    ("plane_flags", np.int32),  # PlaneFlags
    ("cut", np.int32),  # END_A, END_B: the ends beside a part that was removed
    ("older", np.int32),  # neighbours in the LRU list; of an empty slot newer is the next empty one
    ("newer", np.int32),
    ("search", np.int32),  # newest search that found it
    ("changed", np.int32),  # frame of the newest change
)
"""A plane of the world."""
LINK = record(("slot", np.int32), ("next", np.int32))
"""An entry of the list of a square."""
TABLE_STATE = record(
    ("used", np.int64),  # slots that were ever in use
    ("free_slot", np.int64),  # first empty slot of these
    ("oldest", np.int64),  # ends of the LRU list
    ("newest", np.int64),
    ("free_link", np.int64),  # first empty link
    ("links_used", np.int64),  # links that were ever in use
    ("searches", np.int64),  # number of searches
    ("live", np.int64),  # planes
    ("frame", np.int64),  # frames
    ("dropped", np.int64),  # counts for the log
    ("cleared", np.int64),
    ("joined", np.int64),
    ("overflow", np.int64),
)
"""State of the tables."""


class Tables(NamedTuple):
    """Tables of P planes."""

    planes: NDArray[Any]  # (P,) SLOT
    steps: NDArray[Any]  # (P, N) STEP, see evidence.py
    heads: NDArray[np.int32]  # (H,), first link of each list
    links: NDArray[Any]  # (L,) LINK
    state: NDArray[Any]  # (1,) TABLE_STATE


def empty_tables(most: int, longest_m: float = 100.0) -> Tables:
    """Returns empty tables for this number of planes.

    longest_m: length of the longest joined plane."""
    heads = np.full(1 << max(6, math.ceil(math.log2(max(1, most // 4)))), NONE, np.int32)
    state = np.zeros(1, TABLE_STATE)
    for name in ("free_slot", "oldest", "newest", "free_link"):
        state[name] = NONE
    links = zero_table((_LINKS * most,), LINK)
    return Tables(zero_table((most,), SLOT), empty_steps(most, longest_m), heads, links, state)


def columns(planes: NDArray[Any], names: tuple[str, ...]) -> NDArray[Any]:
    """Returns fields of the same type of (N,) SLOT as an array (N, len(names)), such as BOX."""
    return np.stack([planes[name] for name in names], axis=1)


@inner
def square(x):
    """Returns the square of a coordinate."""
    return int(math.floor(x / SQUARE_M))


@inner
def bucket(ix, iy, size):
    """Returns the list of a square. size: a power of two."""
    h = (int(ix) * 73856093) ^ (int(iy) * 19349663)
    return (h ^ (h >> 15)) & (size - 1)


@inner
def set_links(tables, i, add):
    """Adds slot i to the lists of its squares (add), or removes it from them; returns False if there are no links
    left."""
    plane, heads, links, state = tables.planes[i], tables.heads, tables.links, tables.state[0]
    x0, y0, x1, y1 = float(plane.ax_m), float(plane.ay_m), float(plane.bx_m), float(plane.by_m)
    if x1 < x0:
        x0, y0, x1, y1 = x1, y1, x0, y0
    for ix in range(square(x0 - EDGE_M), square(x1 + EDGE_M) + 1):
        first, last = cells_beside(x0, y0, x1, y1, ix, SQUARE_M)
        for iy in range(first, last + 1):
            head = bucket(ix, iy, heads.shape[0])
            if add:
                k = state.free_link
                if k != NONE:
                    state.free_link = links[k].next
                elif state.links_used < links.shape[0]:
                    k = state.links_used
                    state.links_used += 1
                else:
                    return False
                links[k].slot, links[k].next = i, heads[head]
                heads[head] = k
            else:
                unlink(tables, head, i)
    return True


@inner
def unlink(tables, head, i):
    """Removes one link to slot i from a list, if there is one."""
    heads, links, state = tables.heads, tables.links, tables.state[0]
    before, k = NONE, heads[head]
    for _ in range(links.shape[0]):
        if k == NONE:
            return
        after = links[k].next
        if links[k].slot == i:
            if before == NONE:
                heads[head] = after
            else:
                links[before].next = after
            links[k].next = state.free_link
            state.free_link = k
            return
        before, k = k, after


@inner
def lru_remove(tables, i):
    """Removes slot i from the LRU list."""
    planes, state = tables.planes, tables.state[0]
    older, newer = planes[i].older, planes[i].newer
    if older == NONE:
        state.oldest = newer
    else:
        planes[older].newer = newer
    if newer == NONE:
        state.newest = older
    else:
        planes[newer].older = older


@inner
def lru_insert(tables, i):
    """Appends slot i at the newest end of the LRU list."""
    planes, state = tables.planes, tables.state[0]
    planes[i].older, planes[i].newer = state.newest, NONE
    if state.newest == NONE:
        state.oldest = i
    else:
        planes[state.newest].newer = i
    state.newest = i


@inner
def seen_again(tables, i, t_ns):
    """Records an observation of slot i and moves it to the newest end of the LRU list."""
    lru_remove(tables, i)
    lru_insert(tables, i)
    tables.planes[i].seen_ns = max(tables.planes[i].seen_ns, t_ns)


@inner
def new_slot(tables, t_ns):
    """Returns a slot for a plane, which is in the LRU list and in no other list. A full table loses its oldest plane."""
    planes, state = tables.planes, tables.state[0]
    if state.free_slot == NONE and state.used == planes.shape[0]:
        drop_oldest(tables)
    if state.free_slot != NONE:
        i = state.free_slot
        state.free_slot = planes[i].newer
    else:
        i = state.used
        state.used += 1
    state.live += 1
    plane = planes[i]
    plane.hits, plane.plane_flags, plane.cut, plane.search, plane.changed = 1, 0, 0, 0, 0
    lru_insert(tables, i)
    plane.seen_ns = t_ns
    return i


@inner
def insert(tables, i):
    """Adds slot i to the lists of its squares. If there are no links left, the oldest planes are removed."""
    for _ in range(tables.planes.shape[0]):
        if set_links(tables, i, True):
            return
        set_links(tables, i, False)
        if tables.state[0].oldest == i:
            return  # it is longer than any plane may be
        drop_oldest(tables)


@inner
def drop_oldest(tables):
    """Removes the plane that was not observed for the longest time."""
    state = tables.state[0]
    i = state.oldest
    set_links(tables, i, False)
    remove(tables, i)
    state.dropped += 1


@inner
def remove(tables, i):
    """Empties slot i, whose links have been removed."""
    plane, state = tables.planes[i], tables.state[0]
    lru_remove(tables, i)
    steps = plane_steps(tables, i)
    erase(tables, i, steps.first, steps.end)
    plane.hits, plane.changed = 0, state.frame
    plane.newer = state.free_slot
    state.free_slot = i
    state.live -= 1


@inner
def gather(tables, x0, y0, x1, y1, top, bottom, out):
    """Writes the slots of the planes whose boxes touch a box to `out`; returns their number. Those that do not fit
    are counted."""
    planes, heads, links, state = tables.planes, tables.heads, tables.links, tables.state[0]
    state.searches = (state.searches + 1) & 0x3FFFFFFF
    search, n = state.searches, 0
    for ix in range(square(x0 - EDGE_M), square(x1 + EDGE_M) + 1):
        for iy in range(square(y0 - EDGE_M), square(y1 + EDGE_M) + 1):
            k = heads[bucket(ix, iy, heads.shape[0])]
            for _ in range(links.shape[0]):
                if k == NONE:
                    break
                i, k = links[k].slot, links[k].next
                plane = planes[i]
                if plane.search == search:
                    continue
                plane.search = search
                if plane.top_m > bottom or plane.bottom_m < top:
                    continue
                if min(plane.ax_m, plane.bx_m) > x1 or max(plane.ax_m, plane.bx_m) < x0:
                    continue
                if min(plane.ay_m, plane.by_m) > y1 or max(plane.ay_m, plane.by_m) < y0:
                    continue
                if n < out.shape[0]:
                    out[n] = i
                    n += 1
                else:
                    state.overflow += 1
    return n
