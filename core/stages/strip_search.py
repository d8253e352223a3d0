"""Vertical strips of a levelled view (Sections 4.1-4.4 and 5.1): extraction, support, clusters and filled gaps.

Input: the levelled view, the ground and the settings. Output: `Strips`, in the order of their columns, with cluster
and place.

`finish_strips` is one kernel because a call from Python costs some microseconds. Its stages can be traced one by one:
`finish_strips.py_func` is the same function in Python (see companion/bench/stage_trace.py)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import kernel
from ..params import Params
from ..types import FrameStats, Ground
from .clusters import ClusterBuffers, cluster_buffers, join_near, place_strips
from .columns import extract_strips
from .gap_filling import GapBuffers, fill_columns, gap_buffers
from .ground_threshold import drop_ground_noise, ground_noise_test, ground_threshold
from .level import LevelledView
from .settings import Settings
from .strips import STRIP
from .support import drop_unsupported, index_columns, mark_cuts, sort_columns
from .truncation import correct_truncation

_MORE_COLUMNS = 32
"""Tables are allocated for a multiple of this number of columns, so that they are seldom allocated again."""


class StripTables(NamedTuple):
    """Tables and scratch memory for N strips."""

    strips: NDArray[Any]  # (N,) STRIP
    # (cols + 1,) int32. The strips of column u are first_of_column[u]..first_of_column[u + 1] - 1.
    first_of_column: NDArray[np.int32]
    keep: NDArray[np.uint8]  # (N,)
    clusters: ClusterBuffers  # scratch of `join_near`
    gaps: GapBuffers  # scratch of `fill_columns`


def strip_tables(cols: int, per_column: int) -> StripTables:
    """Allocates tables for this number of columns and of strips per column."""
    strips = cols * per_column
    return StripTables(
        np.zeros(strips, STRIP),
        np.zeros(cols + 1, np.int32),
        np.zeros(strips, np.uint8),
        cluster_buffers(strips),
        gap_buffers(strips),
    )


@kernel
def finish_strips(found, codes, view, source, ground, noise_test, settings, tables):
    """Selects the strips that have enough support, clusters them and fills their gaps.

    Args:
        found: number of strips in the table.
        codes, view, settings: as for `extract_strips`.
        tables: StripTables with the strips of `extract_strips`, in and out.

    Returns:
        The number of strips that are kept, and their number after the removal of ground noise. If the latter exceeds
            max_strips_per_column per column, nothing else is done and the former is 0."""
    p, image, test = settings[0], source[0], noise_test[0]
    cols, strips, first_of_column = view.cols, tables.strips, tables.first_of_column
    if test.applies != 0:
        found = drop_ground_noise(strips, found, codes, view.tan_mid, ground.shift, test, tables.keep)
    if found > p.max_strips_per_column * cols:
        return 0, found
    correct_truncation(strips, found, view, image, p.ke_per_m)
    index_columns(strips, found, cols, first_of_column)
    sort_columns(strips, cols, first_of_column)
    n = drop_unsupported(strips, found, cols, p, first_of_column, tables.keep)
    place_strips(strips, n, view)
    mark_cuts(strips, n, view.H, image.width_px, image.height_px, p.cut_rows)
    clusters = join_near(strips, n, p.passable_width_m, p.passable_height_m, tables.clusters)
    fill_columns(strips, clusters, view, first_of_column, p, tables.gaps)
    place_strips(strips, n, view)
    return n, found


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Strips:
    """Strips of a frame."""

    table: NDArray[Any]  # (N,) STRIP, of which the first `count` are used
    count: int  # number of strips
    first_of_column: NDArray[np.int32]  # (cols + 1,), index of the first strip of each column
    found: int  # number of strips before unsupported ones were removed, without ground noise
    ground_px: int  # number of cells that are ground
    merged: int  # number of strips that were merged because their column was full

    def counted(self, stats: FrameStats) -> FrameStats:
        """Returns the statistics of a frame with the counts of its strips."""
        return replace(
            stats,
            ground_px=self.ground_px,
            strips=self.count,
            dropped_strips=self.found - self.count,
            overflow=self.merged,
        )


class StripSearch:
    """Searches levelled views for strips. It holds tables and scratch memory, no state between frames."""

    def __init__(self, params: Params, buffers: Buffers) -> None:
        self._params, self._buffers = params, buffers
        self._make_room(0)

    def _make_room(self, cols: int) -> None:
        self._tables = strip_tables(cols, self._params.max_column_strips)

    def search(
        self, levelled: LevelledView, source: NDArray[Any], ground: Ground, ke_per_m: float, settings: Settings
    ) -> Strips:
        """Returns the strips of a frame, valid until the next call. source: (1,) SOURCE."""
        view, p = levelled.view, self._params
        threshold = ground_threshold(ground, view, ke_per_m, p)
        noise_test = ground_noise_test(ground, view, ke_per_m, p)
        if len(self._tables.first_of_column) <= view.cols:
            self._make_room(-(-view.cols // _MORE_COLUMNS) * _MORE_COLUMNS)
        tables = self._tables
        found, ground_px, merged = extract_strips(
            levelled.codes, threshold, view, settings.bins, settings.view, tables.strips
        )
        count, found = finish_strips(found, levelled.codes, view, source, threshold, noise_test, settings.view, tables)
        return Strips(
            table=tables.strips,
            count=int(count),
            first_of_column=tables.first_of_column,
            found=int(found),
            ground_px=int(ground_px),
            merged=int(merged),
        )

    def is_noise(self, strips: Strips, levelled: LevelledView) -> bool:
        """True if there are more strips than in any scene: noise in blocks of pixels, in which no pixel is flying.

        Blocks of 8 px give 27 to 55 strips per column, foliage at most 15. The plane merge of such a frame would take
        half a second."""
        return strips.found > self._params.max_strips_per_column * levelled.view.cols
