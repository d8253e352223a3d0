"""Vertical strips of a levelled view (Sections 4.1-4.4 and 5.1): extraction, support, clusters and filled gaps.

Input: the levelled view, the ground and the settings. Output: `Strips`, in the order of their columns, with cluster
and place.

`strips_of_view` is one kernel because a call from Python costs some microseconds. Its stages can be traced one by one:
`strips_of_view.py_func` is the same function in Python (see companion/bench/stage_trace.py)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import kernel
from ..params import Params
from ..types import FrameStats, Ground
from .clusters import join_near, place_strips
from .columns import extract_strips
from .gap_filling import fill_columns
from .ground_threshold import drop_ground_noise, ground_threshold
from .level import LevelledView
from .settings import Settings
from .strips import STRIP, StripList
from .support import drop_unsupported, index_columns, mark_cuts, sort_columns
from .truncation import correct_truncation


@kernel
def strips_of_view(codes, view, source, ground, bins, settings, strips, first_of_column):
    """Extracts strips, selects those that have enough support, clusters them and fills their gaps.

    bins, settings: `bins` and `view` of Settings; strips: (N,) STRIP out; first_of_column: of StripList, out; else see
    `search_strips`.

    Returns:
        The number of strips that are kept, and `before`, `ground_px` and `merged` of Strips. If there are more than
            max_strips_per_column per column before, nothing else is done and none is kept."""
    p, image, cols = settings[0], source[0], view.cols
    n, ground_px, merged = extract_strips(codes, ground, view, bins, settings, strips)
    keep = np.empty(n, np.uint8)
    left = drop_ground_noise(strips, n, codes, view, ground, p, keep)
    if left > p.max_strips_per_column * cols:
        return 0, left, ground_px, merged
    correct_truncation(strips, left, view, image, p.ke_per_m)
    index_columns(strips, left, cols, first_of_column)
    sort_columns(strips, cols, first_of_column)
    n = drop_unsupported(strips, left, cols, p, first_of_column, keep)
    place_strips(strips, n, view)
    mark_cuts(strips, n, view.H, image.width_px, image.height_px, p.cut_rows)
    clusters = join_near(strips, n, p.passable_width_m, p.passable_height_m)
    fill_columns(strips, clusters, first_of_column, p)
    place_strips(strips, n, view)
    return n, left, ground_px, merged


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Strips:
    """Strips of a frame."""

    found: StripList
    before: int  # number of strips before unsupported ones were removed, without ground noise
    ground_px: int  # number of cells that are ground
    merged: int  # number of strips that were merged because their column was full

    def counted(self, stats: FrameStats) -> FrameStats:
        """Returns the statistics of a frame with the counts of its strips."""
        count = self.found.count
        return replace(
            stats, ground_px=self.ground_px, strips=count, dropped_strips=self.before - count, overflow=self.merged
        )


def search_strips(
    levelled: LevelledView,
    source: NDArray[Any],
    ground: Ground,
    settings: Settings,
    p: Params,
    buffers: Buffers,
) -> Strips:
    """Returns the strips of a frame, valid until the next call."""
    codes, view, threshold = levelled.codes, levelled.view, ground_threshold(ground, levelled.view, p)
    strips = buffers("strips", (view.cols * p.max_column_strips,), STRIP)
    first_of_column = buffers("first_of_column", (view.cols + 1,), np.int32)
    count, before, ground_px, merged = strips_of_view(
        codes, view, source, threshold, settings.bins, settings.view, strips, first_of_column
    )
    found = StripList(strips, count, first_of_column)
    return Strips(found=found, before=before, ground_px=ground_px, merged=merged)


def is_noise(strips: Strips, levelled: LevelledView, p: Params) -> bool:
    """True if there are more strips than in any scene: noise in blocks of pixels, in which no pixel is flying.

    Blocks of 8 px give 27 to 55 strips per column, foliage at most 15. The plane merge of such a frame would take
    half a second."""
    return strips.before > p.max_strips_per_column * levelled.view.cols
