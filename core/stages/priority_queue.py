"""A priority queue: the entry of least cost comes next; of equal costs that of the lower `first`, then of the lower `second`.

Costs lie in [0, 1), and an entry never costs less than the one that was taken out last. Entries are kept in STEPS lists by
their cost, in no order; only those of the list that is being emptied are in a heap, which is therefore small.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, record

STEPS = 1024
"""Not tuning: lists of costs, so many that few entries share one."""

ENTRY = record(
    ("cost", np.float64), ("first", np.int32), ("second", np.int32), ("version", np.int32), ("after", np.int32)
)
"""cost in [0, 1); first, second: the two planes of a pair; version: what is known about the cost, see merge.py; after: the
next entry of its list, -1: none."""

QUEUE_STATE = record(("list", np.int64), ("waiting", np.int64))
"""The list that is being emptied, and how many entries are in the heap."""


class Queue(NamedTuple):
    """entries (M,) ENTRY, which stay where they are; lists (STEPS,) int32: the first entry of each list or -1; heap (M,)
    int32 entries; state (1,) QUEUE_STATE."""

    entries: NDArray[Any]
    lists: NDArray[np.int32]
    heap: NDArray[np.int32]
    state: NDArray[Any]


def queue_buffers(entries: int) -> Queue:
    """A queue with room for so many entries; `clear_queue` makes it usable."""
    return Queue(
        np.zeros(entries, ENTRY),
        np.zeros(STEPS, np.int32),
        np.zeros(entries, np.int32),
        np.zeros(1, QUEUE_STATE),
    )


@inner
def clear_queue(queue):
    """Empties the queue."""
    queue.lists[:] = -1
    state = queue.state[0]
    state.list, state.waiting = -1, 0


@inner_inline
def push(queue, k):
    """Puts entry k in. Its cost is below 1 and not below that of the last one taken."""
    entries, heap, state = queue.entries, queue.heap, queue.state[0]
    step = np.int64(entries[k].cost * STEPS)
    if step > state.list:
        entries[k].after, queue.lists[step] = queue.lists[step], k
        return
    at = state.waiting
    state.waiting += 1
    for _ in range(64):
        up = (at - 1) >> 1
        if at == 0 or not _before(entries[k], entries[heap[up]]):
            break
        heap[at] = heap[up]
        at = up
    heap[at] = k


@inner_inline
def pop(queue):
    """Takes the entry of least cost out; -1 where there is none."""
    entries, heap, lists, state = queue.entries, queue.heap, queue.lists, queue.state[0]
    if state.waiting == 0:
        for _ in range(STEPS - 1 - state.list):
            state.list += 1
            k = lists[state.list]
            if k >= 0:
                break
        if state.list < 0 or lists[state.list] < 0:
            return -1
        lists[state.list] = -1
        for _ in range(entries.shape[0]):
            following = entries[k].after
            push(queue, k)
            k = following
            if k < 0:
                break
    taken, state.waiting = heap[0], state.waiting - 1
    count, last = state.waiting, heap[state.waiting]
    at = 0
    for _ in range(64):
        child = 2 * at + 1
        if child >= count:
            break
        if child + 1 < count and _before(entries[heap[child + 1]], entries[heap[child]]):
            child += 1
        if not _before(entries[heap[child]], entries[last]):
            break
        heap[at] = heap[child]
        at = child
    heap[at] = last
    return np.int64(taken)


@inner
def _before(a, b):
    if a.cost != b.cost:
        return a.cost < b.cost
    return a.first < b.first or (a.first == b.first and a.second < b.second)
