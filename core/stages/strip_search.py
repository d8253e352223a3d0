"""Sections 4.1-4.4 and 5.1: strips of a levelled view that stay, their clusters and the gaps between them.

`settle_strips` is one kernel, because a call from Python costs some microseconds whatever it does. Its stages can still be
watched one by one: `settle_strips.py_func` is the same in Python (see companion/bench/stage_trace.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import kernel
from ..params import Params
from ..types import Ground
from .clusters import ClusterBuffers, cluster_buffers, join_near, place_strips
from .columns import extract_strips
from .gap_filling import GapBuffers, fill_columns, gap_buffers
from .ground_threshold import drop_ground_noise, ground_noise_test, ground_threshold
from .level import LevelledView
from .settings import Settings
from .strips import STRIP
from .support import drop_unsupported, index_columns, mark_cuts, smooth_near, sort_columns
from .truncation import shift_back

_MORE_COLUMNS = 32
"""Tables are made for a multiple of so many columns: seldom anew, and hardly larger than the largest frame needs."""


class StripBuffers(NamedTuple):
    """Scratch of `settle_strips` for N strips: keep (N,) uint8, lowest (N,) int32, raw (N,) float32."""

    keep: NDArray[np.uint8]
    lowest: NDArray[np.int32]
    raw: NDArray[np.float32]
    clusters: ClusterBuffers
    gaps: GapBuffers


def strip_buffers(strips: int) -> StripBuffers:
    """Scratch for so many strips."""
    return StripBuffers(
        np.zeros(strips, np.uint8),
        np.zeros(strips, np.int32),
        np.zeros(strips, np.float32),
        cluster_buffers(strips),
        gap_buffers(strips),
    )


@kernel
def settle_strips(found, codes, view, source, ground, noise_test, settings, strips, first_of_column, buffers):
    """(strips that stay, strips there were without the ground's noise); with more than most_per_column of these in each
    column nothing is done.

    codes, view, ground, settings: as for `extract_strips`, which wrote the first `found` of strips (N,) STRIP. source:
    (1,) SOURCE. noise_test: (1,) GROUND_NOISE_TEST. first_of_column: (cols + 1,) int32 out. buffers: StripBuffers."""
    p, image, test = settings[0], source[0], noise_test[0]
    cols = view.cols
    if test.applies != 0:
        found = drop_ground_noise(strips, found, codes, view.tan_mid, ground.shift, test, buffers.keep)
    if found > p.most_per_column * cols:
        return 0, found
    shift_back(strips, found, view, image, p.depth_noise_coeff)
    index_columns(strips, found, cols, first_of_column)
    sort_columns(strips, cols, first_of_column)
    n = drop_unsupported(strips, found, cols, p, first_of_column, buffers.lowest, buffers.keep)
    place_strips(strips, n, view)
    mark_cuts(strips, n, view.H, image.width_px, image.height_px, p.cut_rows)
    clusters = join_near(strips, n, p.passable_width_m, p.passable_height_m, buffers.clusters)
    fill_columns(strips, clusters, view, first_of_column, p, buffers.gaps)
    smooth_near(strips, n, cols, p, first_of_column, buffers.lowest, buffers.raw)
    place_strips(strips, n, view)
    return n, found


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Strips:
    """The strips of a frame. table: STRIP, of which the first `count` stay; first_of_column: (cols + 1,) int32.

    found: without the ground's noise; ground_px: cells that are ground; merged: strips merged for want of room."""

    table: NDArray[Any]
    count: int
    first_of_column: NDArray[np.int32]
    found: int
    ground_px: int
    merged: int


class StripSearch:
    """Searches levelled views for strips. Holds tables and scratch, nothing that outlives a frame."""

    def __init__(self, params: Params, buffers: Buffers) -> None:
        self._params, self._buffers = params, buffers
        self._make_room(0)

    def _make_room(self, cols: int) -> None:
        room = cols * self._params.max_column_strips
        self._table, self._first_of_column = np.zeros(room, STRIP), np.zeros(cols + 1, np.int32)
        self._scratch = strip_buffers(room)

    def search(
        self, levelled: LevelledView, source: NDArray[Any], ground: Ground, ke_per_m: float, settings: Settings
    ) -> Strips:
        """Sections 4.1-4.4 and 5.1: strips in clusters, gaps filled; valid until the next call. source: (1,) SOURCE."""
        view, p = levelled.view, self._params
        threshold = ground_threshold(ground, view, ke_per_m, p, self._buffers("threshold", (65536,), np.float32))
        noise_test = ground_noise_test(ground, view, ke_per_m, p)
        if len(self._first_of_column) <= view.cols:
            self._make_room(-(-view.cols // _MORE_COLUMNS) * _MORE_COLUMNS)
        table, first_of_column = self._table, self._first_of_column
        found, ground_px, merged = extract_strips(
            levelled.codes, threshold, view, settings.bins, settings.strips, table
        )
        count, found = settle_strips(
            found,
            levelled.codes,
            view,
            source,
            threshold,
            noise_test,
            settings.strips,
            table,
            first_of_column,
            self._scratch,
        )
        return Strips(
            table=table,
            count=int(count),
            first_of_column=first_of_column,
            found=int(found),
            ground_px=int(ground_px),
            merged=int(merged),
        )

    def is_noise(self, strips: Strips, levelled: LevelledView) -> bool:
        """Whether there are more strips than any scene has: noise whose pixels come in blocks, so that none is flying.

        The merge of it would take half a second. Blocks of 8 px give 27 to 55 strips a column, foliage at most 15."""
        return strips.found > self._params.max_strips_per_column * levelled.view.cols
