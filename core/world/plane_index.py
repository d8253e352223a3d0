"""The table of a world's planes and its index in space: what a frame costs does not depend on how many planes there are.

Planes live in slots of tables of fixed size. Each is in the lists of the squares of ground that it crosses; squares
share lists by a hash, which gives a few planes too many to look at and never one too few. A ring holds the slots in the
order in which they were last seen: where the tables are full, the one not seen longest goes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inner

SQUARE_M = 8.0
"""Not tuning: side of a square; a frame sees some dozen of them."""
_EDGE_M = 1e-3
"""Not tuning: more than float32 rounds by; a plane is in the list of a square that it nearly touches."""
_LINKS = 4
"""Links for each slot: long planes take more than one."""
NONE = -1
# columns of the box, the moments (about the anchor), the floats, the ints, and the state
AX, AY, BX, BY, TOP, BOTTOM = range(6)
W, X, Y, XX, XY, YY = range(6)
ANCHOR_X, ANCHOR_Y, MARGIN, FROM, TO = range(5)
HITS, CLEARS, FLAGS, OLDER, NEWER, LOOK, CHANGED = range(7)
USED, FREE_SLOT, OLDEST, NEWEST, FREE_LINK, LOOKS, LIVE, FRAME, DROPPED, CLEARED, JOINED, OVERFLOW, LINKS_USED = range(
    13
)

Tables = tuple[
    NDArray[np.float32], NDArray[np.float64], NDArray[np.float32], NDArray[np.int32], NDArray[np.int64],
    NDArray[np.int32], NDArray[np.int32], NDArray[np.int64],
]  # fmt: skip
"""box (P, 6) float32: ax, ay, bx, by, top, bottom, metres; moments (P, 6) float64: weight, x, y, xx, xy, yy about the
anchor; floats (P, 5) float32: anchor, margin, the part observed as clear (metres from a); ints (P, 7) int32: observations (0:
an empty slot), observations as clear, flags, LRU list, marks; seen_ns (P,) int64; heads (H,) int32; links (L, 2) int32: slot, next;
state (13,) int64."""


def empty_tables(most: int) -> Tables:
    """Tables for at most so many planes. What is never used takes no memory: the system gives pages when written to."""
    heads = np.full(1 << max(6, math.ceil(math.log2(max(1, most // 4)))), NONE, np.int32)
    state = np.zeros(13, np.int64)
    state[[FREE_SLOT, OLDEST, NEWEST, FREE_LINK]] = NONE
    return (
        np.zeros((most, 6), np.float32), np.zeros((most, 6)), np.zeros((most, 5), np.float32),
        np.zeros((most, 7), np.int32), np.zeros(most, np.int64), heads, np.zeros((_LINKS * most, 2), np.int32), state,
    )  # fmt: skip


def plane_bytes(tables: Tables) -> float:
    """Bytes of memory that each plane takes where the tables are full."""
    return sum(t.nbytes for t in tables) / len(tables[0])


@inner
def square(x):
    """The square that a coordinate falls into."""
    return int(math.floor(x / SQUARE_M))


@inner
def bucket(ix, iy, size):
    """The list of a square; size: a power of two."""
    h = (int(ix) * 73856093) ^ (int(iy) * 19349663)
    return (h ^ (h >> 15)) & (size - 1)


@inner
def set_links(tables, i, add):
    """Adds slot i to the lists of its squares (add), or removes it from them; False: there are no links left."""
    box, _moments, _floats, _ints, _seen, heads, links, state = tables
    x0, y0, x1, y1 = float(box[i, AX]), float(box[i, AY]), float(box[i, BX]), float(box[i, BY])
    if x1 < x0:
        x0, y0, x1, y1 = x1, y1, x0, y0
    slope = (y1 - y0) / (x1 - x0) if x1 - x0 > _EDGE_M else 0.0
    for ix in range(square(x0 - _EDGE_M), square(x1 + _EDGE_M) + 1):
        if slope == 0.0:
            ya, yb = y0, y1
        else:
            ya = y0 + slope * (min(max(ix * SQUARE_M - _EDGE_M, x0), x1) - x0)
            yb = y0 + slope * (min(max((ix + 1) * SQUARE_M + _EDGE_M, x0), x1) - x0)
        for iy in range(square(min(ya, yb) - _EDGE_M), square(max(ya, yb) + _EDGE_M) + 1):
            head = bucket(ix, iy, heads.shape[0])
            if add:
                k = state[FREE_LINK]
                if k != NONE:
                    state[FREE_LINK] = links[k, 1]
                elif state[LINKS_USED] < links.shape[0]:
                    k = state[LINKS_USED]
                    state[LINKS_USED] += 1
                else:
                    return False
                links[k, 0], links[k, 1] = i, heads[head]
                heads[head] = k
            else:
                unhook(heads, links, state, head, i)
    return True


@inner
def unhook(heads, links, state, head, i):
    """Takes one link to slot i out of a list, where there is one."""
    before, k = NONE, heads[head]
    for _ in range(links.shape[0]):
        if k == NONE:
            return
        after = links[k, 1]
        if links[k, 0] == i:
            if before == NONE:
                heads[head] = after
            else:
                links[before, 1] = after
            links[k, 1] = state[FREE_LINK]
            state[FREE_LINK] = k
            return
        before, k = k, after


@inner
def lru_remove(tables, i):
    """Removes slot i from the LRU list."""
    ints, state = tables[3], tables[7]
    older, newer = ints[i, OLDER], ints[i, NEWER]
    if older == NONE:
        state[OLDEST] = newer
    else:
        ints[older, NEWER] = newer
    if newer == NONE:
        state[NEWEST] = older
    else:
        ints[newer, OLDER] = older


@inner
def lru_insert(tables, i):
    """Puts slot i at the newest end of the ring."""
    ints, state = tables[3], tables[7]
    ints[i, OLDER], ints[i, NEWER] = state[NEWEST], NONE
    if state[NEWEST] == NONE:
        state[OLDEST] = i
    else:
        ints[state[NEWEST], NEWER] = i
    state[NEWEST] = i


@inner
def seen_again(tables, i, t_ns):
    """Slot i was seen: it goes last."""
    lru_remove(tables, i)
    lru_insert(tables, i)
    tables[4][i] = t_ns


@inner
def new_slot(tables, t_ns):
    """A slot for a plane, in the ring and not yet in any list; the plane not seen longest goes where there is none."""
    ints, state = tables[3], tables[7]
    if state[FREE_SLOT] == NONE and state[USED] == ints.shape[0]:
        drop_oldest(tables)
    if state[FREE_SLOT] != NONE:
        i = state[FREE_SLOT]
        state[FREE_SLOT] = ints[i, NEWER]
    else:
        i = state[USED]
        state[USED] += 1
    state[LIVE] += 1
    for c in range(ints.shape[1]):
        ints[i, c] = 0
    ints[i, HITS] = 1
    lru_insert(tables, i)
    tables[4][i] = t_ns
    return i


@inner
def insert(tables, i):
    """Slot i into the lists of its squares; where links are out, planes not seen longest go until there are some."""
    state = tables[7]
    for _ in range(tables[3].shape[0]):
        if set_links(tables, i, True):
            return
        set_links(tables, i, False)
        if state[OLDEST] == i:
            return  # alone it does not fit: it is longer than any plane may be
        drop_oldest(tables)


@inner
def drop_oldest(tables):
    """Makes room."""
    state = tables[7]
    i = state[OLDEST]
    set_links(tables, i, False)
    remove(tables, i)
    state[DROPPED] += 1


@inner
def remove(tables, i):
    """Empties slot i, whose links are gone already."""
    ints, state = tables[3], tables[7]
    lru_remove(tables, i)
    ints[i, HITS], ints[i, CHANGED] = 0, state[FRAME]
    ints[i, NEWER] = state[FREE_SLOT]
    state[FREE_SLOT] = i
    state[LIVE] -= 1


@inner
def gather(tables, x0, y0, x1, y1, top, bottom, out):
    """Slots of the planes whose boxes touch a box, into out; returns how many. Those that do not fit are counted."""
    box, _moments, _floats, ints, _seen, heads, links, state = tables
    state[LOOKS] = (state[LOOKS] + 1) & 0x3FFFFFFF
    look, n = state[LOOKS], 0
    for ix in range(square(x0 - _EDGE_M), square(x1 + _EDGE_M) + 1):
        for iy in range(square(y0 - _EDGE_M), square(y1 + _EDGE_M) + 1):
            k = heads[bucket(ix, iy, heads.shape[0])]
            for _ in range(links.shape[0]):
                if k == NONE:
                    break
                i, k = links[k, 0], links[k, 1]
                if ints[i, LOOK] == look:
                    continue
                ints[i, LOOK] = look
                if box[i, TOP] > bottom or box[i, BOTTOM] < top:
                    continue
                if min(box[i, AX], box[i, BX]) > x1 or max(box[i, AX], box[i, BX]) < x0:
                    continue
                if min(box[i, AY], box[i, BY]) > y1 or max(box[i, AY], box[i, BY]) < y0:
                    continue
                if n < out.shape[0]:
                    out[n] = i
                    n += 1
                else:
                    state[OVERFLOW] += 1
    return n
