"""Which pair comes next: the cheapest; of equal costs that of the lower i, then of the lower j.

Entries stay where they are: cost (M,) float64 in [0, 1) and pair (M, 3) int32, (i, j, what is known about the cost). What is
put in is never cheaper than what was taken out last. So entries wait in STEPS lists by their cost, in no order; only
those of the list that is being emptied are in a heap, which is small for that, and all the same never slow.
waits: (STEPS,) int32, the first entry of each list or -1; after: (M,) int32, the next one of its list. heap: (M,) int32
entries; at: (2,) int64, the list that is being emptied and how many are in the heap.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner, inner_inline

STEPS = 1024
"""Not tuning: lists of costs, so many that few entries share one."""
STEP, SIZE = range(2)


@inner
def begin(waits, at):
    """An empty queue."""
    waits[:] = -1
    at[STEP], at[SIZE] = -1, 0


@inner_inline
def put(cost, pair, waits, after, heap, at, entry):
    """Puts an entry in. Its cost is below 1 and not below that of the last one taken."""
    step = np.int64(cost[entry] * STEPS)
    if step > at[STEP]:
        after[entry], waits[step] = waits[step], entry
        return
    k = at[SIZE]
    at[SIZE] += 1
    for _ in range(64):
        up = (k - 1) >> 1
        if k == 0 or not _before(cost, pair, entry, heap[up]):
            break
        heap[k] = heap[up]
        k = up
    heap[k] = entry


@inner_inline
def take(cost, pair, waits, after, heap, at):
    """Takes the cheapest entry out; -1 where there is none."""
    if at[SIZE] == 0:
        for _ in range(STEPS - 1 - at[STEP]):
            at[STEP] += 1
            entry = waits[at[STEP]]
            if entry >= 0:
                break
        if at[STEP] < 0 or waits[at[STEP]] < 0:
            return -1
        waits[at[STEP]] = -1
        for _ in range(after.shape[0]):
            following = after[entry]
            put(cost, pair, waits, after, heap, at, entry)
            entry = following
            if entry < 0:
                break
    taken, at[SIZE] = heap[0], at[SIZE] - 1
    size, last = at[SIZE], heap[at[SIZE]]
    k = 0
    for _ in range(64):
        child = 2 * k + 1
        if child >= size:
            break
        if child + 1 < size and _before(cost, pair, heap[child + 1], heap[child]):
            child += 1
        if not _before(cost, pair, heap[child], last):
            break
        heap[k] = heap[child]
        k = child
    heap[k] = last
    return np.int64(taken)


@inner
def _before(cost, pair, a, b):
    if cost[a] != cost[b]:
        return cost[a] < cost[b]
    return pair[a, 0] < pair[b, 0] or (pair[a, 0] == pair[b, 0] and pair[a, 1] < pair[b, 1])
