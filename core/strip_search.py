"""The strips of a view, looked for by one thread or, from both sides at a time, by two."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .columns import B_GROUND, B_OVERFLOW, LEFT, RIGHT, append_blocks, extract_strips, strips_from_side
from .helper import Helper, Job

_BLOCK_COLS = 16
"""Columns that one of two threads takes in one go. No result depends on it."""
Tables = tuple[NDArray[np.int32], NDArray[np.float32]]
"""ints and floats of strips."""


class StripSearch:
    """Begins where there is a helper; `found` takes part, and ends it."""

    def __init__(
        self, view: tuple[Any, ...], tables: Tables, helper: Helper | None, spare: Callable[[], Tables]
    ) -> None:
        """view: arguments of `extract_strips` up to its outputs. tables: where the strips go. spare: makes tables as large
        for the helper."""
        self._view, self._tables = view, tables
        self._others: Job[int] | None = None
        if helper is not None:
            blocks = -(-len(view[0]) // _BLOCK_COLS)
            self._taken, self._spare = np.array([0, blocks]), spare()
            self._done = np.zeros((2, blocks, 4), np.int64)
            work = partial(strips_from_side, RIGHT, self._taken, self._done[RIGHT], *view, *self._spare)
            self._others = helper.start(work)

    def found(self) -> tuple[int, int, int]:
        """(strips, ground pixels, strips merged for want of room), as `extract_strips`, which does it alone."""
        if self._others is None:
            n, ground_px, overflow = extract_strips(*self._view, *self._tables)
            return int(n), int(ground_px), int(overflow)
        n = strips_from_side(LEFT, self._taken, self._done[LEFT], *self._view, *self._tables)
        first = int(self._taken[LEFT])
        if self._others.result() is not None:
            n = append_blocks(first, self._done[RIGHT], *self._spare, n, *self._tables)
        counts = self._done[LEFT, :first].sum(0) + self._done[RIGHT, first:].sum(0)
        return int(n), int(counts[B_GROUND]), int(counts[B_OVERFLOW])
