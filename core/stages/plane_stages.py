"""Sections 5.2 and 5.3 as one kernel: from strips to planes, stage by stage.

A call from Python costs some microseconds and more after each pause, whatever it does; here the stages follow each other
without Python. Each can still be watched: `shape_planes.py_func` is the same way in Python (see companion/bench/stage_trace.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..jit import inner, kernel
from .evidence import nearest_seen
from .merge import join_planes
from .merge_cost import TILE, TRAITS
from .outlier_split import STEPS, leave, measure_excess, what_leaves
from .plane_settings import (
    K_ALONG,
    K_BEHIND,
    K_CANDIDATES,
    K_CELL,
    K_CUT_T,
    K_EDGE,
    K_END_T,
    K_FOOTPRINT_T,
    K_GAP_HEIGHT,
    K_GAP_T,
    K_HEIGHT_STEP,
    K_HIDDEN,
    K_HIDDEN_T,
    K_JUMP,
    K_JUMP_SIGMAS,
    K_LEAST_M,
    K_LINE_M,
    K_LINE_SIGMAS,
    K_LINK,
    K_NEAR_SIGMAS,
    K_OUT_M,
    K_OUT_SHARE,
    K_OUT_SPREADS,
    K_PARTNERS,
    K_POINTS,
    K_REACH,
    K_REACH_T,
    K_ROUGH_SLOPE,
    K_ROUGHNESS,
    K_ROUNDS,
    K_SAFE,
    K_SLACK,
    K_SLOPE,
    K_WS,
)
from .planes import compact_planes, measure_planes, planes_from_tracks, shift_to_near_side
from .refine import close_pockets, drop_covered, meet_neighbours, trim_covered
from .segments import grow


@inner
def plane_room(strips):
    """How many planes so many strips may become, with those of what stands out and of pockets. Bounds must be this and not
    what the tables have grown to: a frame must not depend on those before it."""
    return 2 * max(strips, 1) + 16


def plane_tables(strips: int, partners: int) -> tuple[Any, ...]:
    """What `shape_planes` writes to, from `planes` on, for so many strips; `partners`: merge_partners."""
    room = plane_room(strips)
    pairs = room * partners
    return (
        np.zeros((room, 8)), np.zeros((room, 9), np.int32), np.zeros((room, 6)),  # planes, plane_ints, moments
        np.zeros(room, np.int32), np.zeros(room, np.int32),  # plane_of, parent
        np.zeros((strips + 1, 12)), np.zeros((5, strips + 1), np.int32), np.zeros(strips + 1, np.uint8),
        np.zeros(strips + 1, np.int32),  # tracks, front, touches, near
        np.zeros((room, TRAITS)), np.zeros(room, np.int32), np.zeros(room, np.int32),  # traits, order, age
        np.zeros(-(-room // TILE) * TRAITS * TILE), np.zeros(room),  # tiles, next_cost
        np.zeros(pairs), np.zeros((pairs, 3), np.int32), np.zeros(pairs, np.int32), np.zeros(pairs, np.int32),  # cost to heap
        np.zeros(strips + 1, np.float32), np.zeros((room, STEPS)), np.zeros(room), np.zeros((room, 2), np.int32),  # excess to new
    )  # fmt: skip


@kernel
def shape_planes(
    ints, floats, place, n, columns, cols, f, cu, cv, lateral, tan_edge, H, width, height, k, rules, masks, mask_frame, seen,
    planes, plane_ints, moments, plane_of, parent, table, front, touches, near, traits, order, age, tiles, next_cost, cost,
    pair, after, heap, excess, above, least, new,
):  # fmt: skip
    """Number of planes; tables planes, plane_ints and moments of planes.py and lines.py, in which some have died.

    ints, floats, place, columns: n strips, by column, with the places of `place_strips` and the first of each column. cols to H:
    the view. width, height: of the source image. k, rules: by the K_ and R_ indices. masks, mask_frame: `opening_masks`. The
    rest is scratch: seen, the grid of evidence.py, and what `plane_tables` made."""
    link, points = int(k[K_LINK]), int(k[K_POINTS])
    room = plane_room(n)
    pieces = grow(
        ints, floats, place, cols, columns, f, cu, lateral, k[K_HEIGHT_STEP], k[K_LINE_M], k[K_LINE_SIGMAS], k[K_SLOPE],
        k[K_ROUGH_SLOPE], link, k[K_ROUGHNESS], k[K_JUMP], k[K_JUMP_SIGMAS], k[K_EDGE], masks, mask_frame, moments, table, front,
        touches, near,
    )  # fmt: skip
    planes_from_tracks(pieces, moments, table, k[K_SLOPE], k[K_END_T], planes, plane_ints, plane_of, parent)
    how = (
        ints, floats, n, f, cu, lateral, tan_edge, k[K_FOOTPRINT_T], k[K_CUT_T], k[K_SAFE], k[K_ALONG], k[K_NEAR_SIGMAS],
    )  # fmt: skip
    measure_planes(*how, pieces, plane_of, planes, plane_ints)

    seen_frame = np.empty(4)
    nearest_seen(ints, floats, n, f, cu, cv, lateral[0], H, width, height, int(k[K_CELL]), seen, seen_frame)
    join_planes(
        pieces, planes, plane_ints, moments, parent, rules, int(k[K_ROUNDS]), int(k[K_CANDIDATES]), int(k[K_PARTNERS]), seen,
        seen_frame, masks, mask_frame, traits, order, age, tiles, next_cost, cost[: room * int(k[K_PARTNERS])], pair, after, heap,
    )  # fmt: skip
    count = compact_planes(pieces, planes, plane_ints, moments, parent, plane_of, pieces)
    measure_planes(*how, count, plane_of, planes, plane_ints)

    measure_excess(
        ints, floats, n, f, cu, lateral, count, plane_of, planes, k[K_SAFE], k[K_ALONG], k[K_NEAR_SIGMAS], excess, above
    )
    what_leaves(count, planes, plane_ints, moments, above, k[K_OUT_SHARE], k[K_OUT_M], k[K_OUT_SPREADS], least)
    merged = count
    count = leave(
        ints, floats, n, f, cu, lateral, count, pieces, plane_of, planes, plane_ints, moments, excess, least, k[K_JUMP],
        k[K_JUMP_SIGMAS], link, 1.0 / (k[K_SLOPE] * k[K_SLOPE]), k[K_ROUGHNESS], k[K_END_T], new,
    )  # fmt: skip
    if count > merged:
        measure_planes(*how, count, plane_of, planes, plane_ints)
    shift_to_near_side(count, planes, k[K_LEAST_M])

    meet_neighbours(
        count, planes, plane_ints, k[K_REACH], k[K_REACH_T], k[K_SLACK], k[K_SAFE], points, masks, mask_frame
    )
    count = close_pockets(
        count, room, planes, plane_ints, moments, k[K_WS], k[K_GAP_T], k[K_GAP_HEIGHT], k[K_BEHIND], points, masks,
        mask_frame,
    )  # fmt: skip
    drop_covered(count, planes, plane_ints, k[K_HIDDEN], k[K_HIDDEN_T])
    trim_covered(count, planes, plane_ints, k[K_HIDDEN], seen_frame, seen)
    return count
