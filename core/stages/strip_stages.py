"""Sections 4.4 and 5.1 as one kernel: strips that stay, their clusters and the gaps between them, stage by stage.

As plane_stages.py: without Python between the stages, and in Python, stage by stage, for who wants to watch."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..jit import kernel
from .clusters import BUCKETS, join_near, place_strips
from .gap_filling import MAX_RUNS, fill_columns
from .ground import drop_ground_noise
from .strips import I_LINK, S_BAND_STEP, S_F, S_HS, S_KE, S_LINE_SIGMAS, S_WS
from .support import drop_unsupported, index_columns, mark_cuts, smooth_near, sort_columns
from .truncation import shift_back


def strip_tables(cols: int, room: int) -> tuple[Any, ...]:
    """ints, floats, and what `settle_strips` writes to, from `place` on, for views of at most so many columns with room
    for so many strips in each."""
    size = cols * room
    return (
        np.zeros((size, 9), np.int32), np.zeros((size, 3), np.float32),  # ints, floats
        np.zeros((size, 4), np.float32), np.zeros(cols + 1, np.int32),  # place, columns
        np.zeros(size, np.uint8), np.zeros(size, np.int32),  # keep, lowest
        np.zeros(size, np.int32), np.zeros(size, np.int32), np.zeros(size, np.int32),  # following, group_of, parent
        np.zeros((size, 5), np.int32), np.zeros((size, 6), np.float32), np.zeros(BUCKETS, np.int32),  # groups, boxes, buckets
        np.zeros(size, np.int32), np.zeros(size, np.int32),  # open_of, lower
        np.zeros((MAX_RUNS, 3), np.int32), np.zeros((MAX_RUNS, 3), np.float32), np.zeros(size, np.float32),  # runs, spans, raw
    )  # fmt: skip


@kernel
def settle_strips(
    found, most, codes, tan_mid, shift, doubt, on_ground, cols, cu, lateral, tan_edge, H, width, height, R, clear_m, left,
    fs, si, ints, floats, place, columns, keep, lowest, following, group_of, parent, groups, boxes, buckets, open_of, lower,
    runs, spans, raw,
):  # fmt: skip
    """(strips that stay, strips there were without the ground's noise); with more than `most` of these nothing is done.

    codes, tan_mid, shift: as for `extract_strips`, which wrote ints and floats; doubt: `doubt_settings` where on_ground. cols to H:
    the view. width, height: of the source image. R: (3, 3) R_level_optical. clear_m, left: see `shift_back`. fs, si: by the S_ and
    I_ indices. place (N, 4) and columns (cols + 1,), out: of `place_strips` and `index_columns`; the rest is scratch of
    `strip_tables`."""
    f, hs, ws = fs[S_F], fs[S_HS], fs[S_WS]
    if on_ground:
        found = drop_ground_noise(ints, floats, found, codes, tan_mid, shift, doubt, keep)
    if found > most:
        return 0, found
    shift_back(ints, floats, found, tan_edge, f, R[0, 2], R[2, 2], clear_m, fs[S_KE], left)
    index_columns(ints, found, cols, columns)
    sort_columns(ints, floats, cols, columns)
    n = drop_unsupported(ints, floats, found, cols, fs, si, columns, lowest, keep)
    place_strips(ints, floats, n, f, cu, lateral, tan_edge, place)
    mark_cuts(ints, n, H, width, height, si)
    clusters = join_near(ints, place, n, ws, hs, following, group_of, parent, groups, boxes, buckets)
    fill_columns(
        ints, floats, place, cols, columns, f, np.float64(lateral[0]) / f, hs, ws, fs[S_BAND_STEP], fs[S_LINE_SIGMAS],
        si[I_LINK], open_of[:clusters], lower, runs, spans,
    )  # fmt: skip
    smooth_near(ints, floats, n, cols, fs, columns, lowest, raw)
    place_strips(ints, floats, n, f, cu, lateral, tan_edge, place)
    return n, found
