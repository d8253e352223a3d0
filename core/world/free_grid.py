"""Observed free space of the merged world: a grid with one bit per cell, in blocks that are found by a hash.

A cell is free if one frame observed all of it free. Each block contains the bits of the present epoch and of the
previous one. An epoch is half of the age after which free space becomes unknown, so that no older cell is reported
free. An observed obstacle clears the free bits of its cells at once."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..free_view import azimuth_from, direction_at, lowest_free
from ..jit import inner, kernel, record
from .zero_table import zero_table

CELL_M = 0.5
"""Width and height of a cell; docs/research/world-notes.md compares other sizes."""
SIDE, TALL = 16, 64
"""Columns along each side of a block, and cells of a column. A block covers 8 x 8 x 32 m and has 4 KiB."""
HALF_M = CELL_M * 0.7072
"""Radius of the circle around a cell seen from above."""
EDGE_M = 1e-3
"""Tolerance greater than the rounding of float32: a plane is in a cell that it nearly touches."""
NO_BLOCK = -1
BLOCK = record(
    ("ix", np.int32),  # indices of the block
    ("iy", np.int32),
    ("iz", np.int32),
    ("epoch", np.int32),  # of its first mask
    ("next", np.int32),  # next slot in the list of its hash
    ("touched", np.int32),  # frame of its last change
)
"""A block of the grid."""
FREE_STATE = record(("blocks", np.int64), ("dropped", np.int64), ("frame", np.int64), ("epoch", np.int64))
"""blocks: slots in use; dropped: blocks that others replaced; frame, epoch: the present ones."""


class FreeTables(NamedTuple):
    """Tables of B blocks."""

    blocks: NDArray[Any]  # (B,) BLOCK
    masks: NDArray[np.uint64]  # (B, 2, 256), bits of the block's epoch and of the epoch before
    heads: NDArray[np.int32]  # (H,), first block of each list
    ground: NDArray[np.float32]  # (B, 256, 2), see ground.py
    state: NDArray[Any]  # (1,) FREE_STATE


def empty_free(most: int) -> FreeTables:
    """Returns empty tables for this number of blocks. `block_for` fills the ground of a block when it takes one."""
    heads = np.full(1 << max(6, math.ceil(math.log2(most))), NO_BLOCK, np.int32)
    masks = zero_table((most, 2, SIDE * SIDE), np.uint64)
    ground = zero_table((most, SIDE * SIDE, 2), np.float32)
    return FreeTables(np.zeros(most, BLOCK), masks, heads, ground, np.zeros(1, FREE_STATE))


@inner
def cell(x):
    """Returns the index of the cell of a coordinate."""
    return int(math.floor(x / CELL_M))


@inner
def _list_of(ix, iy, iz, size):
    """Returns the list of a block's hash."""
    h = (int(ix) * 73856093) ^ (int(iy) * 19349663) ^ (int(iz) * 83492791)
    return (h ^ (h >> 15)) & (size - 1)


@inner
def find_block(free, ix, iy, iz):
    """Returns the slot of a block; -1 if there is none."""
    blocks, heads = free.blocks, free.heads
    k = heads[_list_of(ix, iy, iz, heads.shape[0])]
    for _ in range(blocks.shape[0]):
        if k == NO_BLOCK or (blocks[k].ix == ix and blocks[k].iy == iy and blocks[k].iz == iz):
            break
        k = blocks[k].next
    return k


@inner
def block_for(free, ix, iy, iz):
    """Returns the slot of a block with its masks in the present epoch. It is created if there is none.

    If all slots are used, the block that was not changed for the longest time is replaced."""
    blocks, masks, heads, ground, state = free.blocks, free.masks, free.heads, free.ground, free.state[0]
    k = find_block(free, ix, iy, iz)
    if k == NO_BLOCK:
        if state.blocks < blocks.shape[0]:
            k = state.blocks
            state.blocks += 1
        else:
            k = 0
            for m in range(1, blocks.shape[0]):
                if blocks[m].touched < blocks[k].touched:
                    k = m
            _unlink(free, k)
            state.dropped += 1
        head = _list_of(ix, iy, iz, heads.shape[0])
        block = blocks[k]
        block.ix, block.iy, block.iz = ix, iy, iz
        block.next, block.epoch = heads[head], state.epoch
        heads[head] = k
        for c in range(masks.shape[2]):
            masks[k, 0, c] = masks[k, 1, c] = 0
            ground[k, c, 0] = ground[k, c, 1] = np.nan
    behind = state.epoch - blocks[k].epoch
    if behind > 0:
        for c in range(masks.shape[2]):
            masks[k, 1, c] = masks[k, 0, c] if behind == 1 else 0
            masks[k, 0, c] = 0
        blocks[k].epoch = state.epoch
    blocks[k].touched = state.frame
    return k


@inner
def _unlink(free, k):
    """Removes slot k from the list of its hash."""
    blocks, heads = free.blocks, free.heads
    head = _list_of(blocks[k].ix, blocks[k].iy, blocks[k].iz, heads.shape[0])
    if heads[head] == k:
        heads[head] = blocks[k].next
        return
    m = heads[head]
    for _ in range(blocks.shape[0]):
        if blocks[m].next == k:
            blocks[m].next = blocks[k].next
            return
        m = blocks[m].next


@inner
def free_bits(free, k, c):
    """Returns the bits of the free cells of column c of slot k."""
    masks, behind = free.masks, free.state[0].epoch - free.blocks[k].epoch
    if behind > 1:
        return np.uint64(0)
    return masks[k, 0, c] | masks[k, 1, c] if behind == 0 else masks[k, 0, c]


@inner
def any_free(free, x, y, z):
    """True if the cell of a point is free."""
    ix, iy, iz = cell(x), cell(y), cell(z)
    k = find_block(free, ix >> 4, iy >> 4, iz >> 6)
    if k == NO_BLOCK:
        return False
    return (free_bits(free, k, column_of(ix, iy)) >> np.uint64(iz & 63)) & np.uint64(1) != 0


@inner
def bits(first, end):
    """Returns the bits first..end - 1 of 64; both are limited to 0..64."""
    first, end = max(first, 0), min(end, 64)
    if end <= first:
        return np.uint64(0)
    ones = np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(64 - (end - first))
    return ones << np.uint64(first)


@inner
def column_of(ix, iy):
    """Returns the index of a column of cells in its block."""
    return (ix & 15) * SIDE + (iy & 15)


@inner
def clear_bits(free, k, c, gone):
    """Clears bits of column c of slot k."""
    masks = free.masks
    if (masks[k, 0, c] | masks[k, 1, c]) & gone != 0:
        masks[k, 0, c] &= ~gone
        masks[k, 1, c] &= ~gone
        free.blocks[k].touched = free.state[0].frame


@inner
def cells_beside(ax, ay, bx, by, i, side_m):
    """Returns (first, last) row of the square cells with a side of side_m that a segment crosses in their column i.

    Its ends are ordered, ax <= bx, and column i is one that it crosses. EDGE_M is added on all sides."""
    slope = (by - ay) / (bx - ax) if bx - ax > EDGE_M else 0.0
    y0, y1 = ay, by
    if slope != 0.0:
        y0 = ay + slope * (min(max(i * side_m - EDGE_M, ax), bx) - ax)
        y1 = ay + slope * (min(max((i + 1) * side_m + EDGE_M, ax), bx) - ax)
    first = int(math.floor((min(y0, y1) - EDGE_M) / side_m))
    return first, int(math.floor((max(y0, y1) + EDGE_M) / side_m))


@inner
def cell_directions(edges, x, y, r):
    """Returns the first and last direction of a profile that a cell at (x, y) from the camera, at range r, extends into;
    (0, -1): the camera stands in it, or it extends beyond the view."""
    if r <= 2.0 * HALF_M:
        return 0, -1
    half = math.asin(HALF_M / r)
    azimuth = azimuth_from(edges[0], math.atan2(y, x) - half)
    if azimuth + 2.0 * half >= edges[-1]:
        return 0, -1
    return direction_at(edges, azimuth), direction_at(edges, azimuth + 2.0 * half)


@inner
def column_free(view, x, y, low_bin, span):
    """Adds the cells of a column that a profile shows free to `span`, as bits from cell low_bin on.

    A cell is free if its circle, seen from above, and its heights are in directions and layers that are free there,
    above the ground.

    Args:
        x, y: the column, relative to the camera.
        low_bin: index of the first cell.
        span: (2,) uint64 out."""
    layers, near_m, far_m = view.layers_m, view.near_m, view.far_m
    span[0] = span[1] = np.uint64(0)
    r = math.sqrt(x * x + y * y)
    d0, d1 = cell_directions(view.edges_rad, x, y, r)
    if d1 < d0:
        return
    lowest = lowest_free(x, y, r, HALF_M, view)
    begin = -1
    for k in range(layers.shape[0]):
        ok = k < layers.shape[0] - 1
        if ok:
            for d in range(d0, d1 + 1):
                if near_m[d, k] > r - HALF_M or far_m[d, k] < r + HALF_M:
                    ok = False
                    break
        if ok and begin < 0:
            begin = k
        if not ok and begin >= 0:
            first = int(math.ceil(layers[begin] / CELL_M)) - low_bin
            end = int(math.floor(min(layers[k], lowest) / CELL_M)) - low_bin
            span[0] |= bits(first, end)
            span[1] |= bits(first - 64, end - 64)
            begin = -1


@inner
def ground_cell(free, k, c):
    """Returns the cell of the ground of column c of slot k, relative to the block's first cell; -1 if it is not
    known."""
    z = free.ground[k, c, 0]
    return -1 if math.isnan(z) else min(max(cell(z - EDGE_M) - free.blocks[k].iz * TALL, 0), TALL - 1)


@inner
def beside_ground(free, bx, by, low, c, found, span):
    """Compares the free cells of a column, `span`, with the remembered ground of its blocks low and low + 1.

    Without a ground in the frame (`found`), cells at or below the remembered ground are removed from the span. With
    one, a remembered ground in a free cell is deleted."""
    below = False
    for part in range(-1, 2):
        k = find_block(free, bx, by, low + part)
        at = ground_cell(free, k, c) if k != NO_BLOCK else -1
        if at >= 0 and found and part >= 0 and (span[part] >> np.uint64(at)) & np.uint64(1) != 0:
            free.ground[k, c, 0] = free.ground[k, c, 1] = np.nan
            free.blocks[k].touched = free.state[0].frame
        if found:
            continue
        if part >= 0 and below:
            span[part] = np.uint64(0)
        elif part >= 0 and at >= 0:
            span[part] &= ~bits(at, TALL)
        below = below or at >= 0


@kernel
def see_free(free, view):
    """Adds the free space that a frame shows.

    A frame without ground frees nothing at or below remembered ground, which it may have failed to detect. A frame
    with ground that shows the cell of a remembered ground free deletes that ground."""
    masks, x, y, far_m = free.masks, view.x_m, view.y_m, view.far_m
    span = np.zeros(2, np.uint64)
    reach = np.float64(far_m.max())
    low = int(math.floor(view.layers_m[0] / CELL_M)) >> 6
    for bx in range(cell(x - reach) >> 4, (cell(x + reach) >> 4) + 1):
        for by in range(cell(y - reach) >> 4, (cell(y + reach) >> 4) + 1):
            first, second = NO_BLOCK, NO_BLOCK
            for c in range(SIDE * SIDE):
                cx, cy = (bx * SIDE + (c >> 4) + 0.5) * CELL_M - x, (by * SIDE + (c & 15) + 0.5) * CELL_M - y
                if cx * cx + cy * cy > reach * reach:
                    continue
                column_free(view, cx, cy, low * TALL, span)
                if span[0] | span[1] != 0:
                    beside_ground(free, bx, by, low, c, math.isfinite(view.ground_z_m), span)
                if span[0] != 0:
                    if first == NO_BLOCK:
                        first = block_for(free, bx, by, low)
                        second = NO_BLOCK if first == second else second  # it was replaced
                    masks[first, 0, c] |= span[0]
                if span[1] != 0:
                    if second == NO_BLOCK:
                        second = block_for(free, bx, by, low + 1)
                        first = NO_BLOCK if second == first else first
                    masks[second, 0, c] |= span[1]


def held_blocks(free: FreeTables) -> NDArray[np.int32]:
    """Returns indices (B, 3) of all blocks in use."""
    blocks = free.blocks[: int(free.state["blocks"][0])]
    return np.stack([blocks[name] for name in ("ix", "iy", "iz")], axis=1)


def seen_blocks(
    free: FreeTables, now: int, since: int = -1
) -> tuple[NDArray[np.int32], NDArray[np.uint64], NDArray[np.float32]]:
    """Returns indices (B, 3), masks (B, 256) and ground (B, 256, 2) of the blocks with any free cell or ground,
    ordered by index.

    now: the present epoch; since: 0 or more: only blocks that a later frame changed, also if nothing in them is known
    any more."""
    used = int(free.state["blocks"][0])
    blocks, masks, ground = free.blocks[:used], free.masks, free.ground
    behind = now - blocks["epoch"].astype(np.int64)
    on = np.arange(used) if since < 0 else np.flatnonzero(blocks["touched"] > since)
    seen = np.where((behind[on] == 0)[:, None], masks[on, 0] | masks[on, 1], masks[on, 0])
    seen[(behind[on] < 0) | (behind[on] > 1)] = 0
    if since < 0:
        some = seen.any(axis=1) | ~np.isnan(ground[on, :, 0]).all(axis=1)
        on, seen = on[some], seen[some]
    at = np.stack([blocks[name][on] for name in ("ix", "iy", "iz")], axis=1)
    order = np.lexsort(at.T[::-1])
    return np.ascontiguousarray(at[order]), np.ascontiguousarray(seen[order]), ground[on[order]]
