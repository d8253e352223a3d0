"""Sections 4.1-4.4 and 5.1: strips of a levelled view that stay, their clusters and the gaps between them.

`settle_strips` is one kernel, because a call from Python costs some microseconds whatever it does. Its stages can still be
watched one by one: `settle_strips.py_func` is the same in Python (see companion/bench/taps.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from .clusters import ClusterBuffers, cluster_buffers, join_near, place_strips
from .gap_filling import GapBuffers, fill_columns, gap_buffers
from .ground import drop_ground_noise
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
