"""A priority queue of pairs of planes: the least cost first; of equal costs the lower `first`, then the lower
`second`.

Costs lie in [0, 1), and no entry costs less than the one taken last. Entries are kept in STEPS lists by their cost,
not sorted. Only the entries of the list that is being emptied are in a heap, which is therefore small."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, record

STEPS = 1024
"""Number of lists, so large that few entries share one."""

ENTRY = record(
    ("cost", np.float64),  # in [0, 1)
    ("first", np.int32),  # the two planes of the pair
    ("second", np.int32),
    ("version", np.int32),  # of the pair when the cost was computed, see merge.py
    ("complete", np.bool_),  # the cost contains the cells that the joined plane would cover
    ("after", np.int32),  # next entry of its list, -1: none
)
"""An entry of the queue."""

QUEUE_STATE = record(("list", np.int64), ("waiting", np.int64))
"""The list that is being emptied, and the number of entries in the heap."""


class Queue(NamedTuple):
    """A queue of M entries."""

    entries: NDArray[Any]  # (M,) ENTRY, whose positions do not change
    lists: NDArray[np.int32]  # (STEPS,), first entry of each list, -1: none
    heap: NDArray[np.int32]  # (M,), indices of entries
    state: NDArray[Any]  # (1,) QUEUE_STATE


@inner
def clear_queue(queue):
    """Empties the queue."""
    queue.lists[:] = -1
    state = queue.state[0]
    state.list, state.waiting = -1, 0


@inner_inline
def push(queue, k):
    """Inserts entry k. Its cost must be below 1 and not below that of the entry taken last."""
    entries, heap, state = queue.entries, queue.heap, queue.state[0]
    step = np.int64(entries[k].cost * STEPS)
    if step > state.list:
        entries[k].after, queue.lists[step] = queue.lists[step], k
        return
    at = state.waiting
    state.waiting += 1
    while at > 0:
        up = (at - 1) >> 1
        if not _before(entries[k], entries[heap[up]]):
            break
        heap[at] = heap[up]
        at = up
    heap[at] = k


@inner_inline
def pop(queue):
    """Removes the entry of least cost and returns its index; -1 if the queue is empty."""
    entries, heap, state = queue.entries, queue.heap, queue.state[0]
    if state.waiting == 0:
        _fill_heap(queue)
    if state.waiting == 0:
        return -1
    state.waiting -= 1
    taken, last, count = heap[0], heap[state.waiting], state.waiting
    at, child = 0, 1
    while child < count:
        if child + 1 < count and _before(entries[heap[child + 1]], entries[heap[child]]):
            child += 1
        if not _before(entries[heap[child]], entries[last]):
            break
        heap[at] = heap[child]
        at, child = child, 2 * child + 1
    heap[at] = last
    return np.int64(taken)


@inner_inline
def _fill_heap(queue):
    """Moves the entries of the next list that has some to the heap."""
    entries, lists, state = queue.entries, queue.lists, queue.state[0]
    k = -1
    while k < 0 and state.list < STEPS - 1:
        state.list += 1
        k = lists[state.list]
        lists[state.list] = -1
    for _ in range(entries.shape[0]):
        if k < 0:
            break
        following = entries[k].after
        push(queue, k)
        k = following


@inner
def _before(a, b):
    """True if entry a comes before entry b."""
    if a.cost != b.cost:
        return a.cost < b.cost
    return a.first < b.first or (a.first == b.first and a.second < b.second)
