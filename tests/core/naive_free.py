"""Slow, obvious oracles of the free space: free ranges of a direction, and holes of unknown cells."""

from __future__ import annotations

import math

import numpy as np


def free_walk(
    codes, sides, weight, inside, direction, d, overlaps, z0, z1, ring_m, cv, f, block, share, sees_through, clear_z, in_range, least, blind, too_near, blank
):  # fmt: skip
    """(from, to, end): the first and last distance of one direction and layer that are seen free, 0, 0: none, and the name of its end.
    sides: `holes_of_all_sides` of the codes. weight, inside: what a cell counts and whether it is in the source, like codes. overlaps: (cols,) whether a column lies in the direction at least in part. sees_through: whether codes see through a distance;
    clear_z: z down to which ground hides nothing at a distance; in_range: whether heights z0..z1 at a distance are; least: height of a layer that is judged; blind: distance beyond which ground may hide an obstacle;
    too_near: whether a part of heights z0..z1 at a distance is too near to be measured; blank: least side of a thing without texture."""
    columns, weights, rows = codes[direction == d], weight[direction == d], codes.shape[1]
    over = np.flatnonzero(overlaps)

    def rows_at(x, lower):
        a, b = math.floor(cv + f * z0 / x + 0.5), math.ceil(cv + f * lower / x - 0.5)
        return (a, b) if a >= 0 and b < rows and inside[direction == d, a : b + 1].all() else None

    def counts(a, b, x):
        part = slice(a // block * block, (b // block + 1) * block)
        cells, w = columns[:, part], weights[:, part]
        through = np.sum(w[(cells > 0) & sees_through(cells, x)])
        near = np.sum(w[(cells > 0) & ~sees_through(cells, x)])
        return w.sum(), through, near

    def dark_blocks(columns, a, b):
        blocks = [columns[:, i : i + 4] == 0 for i in range(a // 4 * 4, min(b + 1, rows // 4 * 4), 4)]
        return np.mean([k.mean(axis=1) > 0.5 for k in blocks], axis=0) if blocks else np.zeros(len(columns))

    def columns_hide(x, a, b):
        dark, part = dark_blocks(codes[over], a, b), codes[over, a // 4 * 4 : (b // 4 + 1) * 4]
        seen = np.mean((part > 0) & sees_through(part, x), axis=1)
        return ((dark > 0.5) | ((dark > 0.0) & (seen < 0.5))).any()

    def is_hidden(x, before, a, b, lower):
        if too_near(before, z0, lower):
            part = sides[0][max(over[0] - 1, 0) : over[-1] + 2, max(a - 4, 0) : b + 5]
        else:
            cells = blank * f / x
            nearest = min(range(4), key=lambda k: abs(math.log(cells / (4 << k))))
            part = sides[nearest][over, a : b + 1]
        return part.any()

    def begin(r):
        """The middle before ring r, the first one that is free, where the ring before is out of view and what covers the middle
        sees through ring r; else ring r."""
        x = ring_m[r]
        if r == 0 or r == last:
            return x
        before = ring_m[r - 1]
        lower = min(z1, clear_z(before))
        if (lower < z1 and before > blind) or lower - z0 < least or not in_range(before, z0, lower):
            return x
        if rows_at(before, lower) is not None:
            return x
        middle = (float(ring_m[r - 1]) + float(x)) / 2
        lower, at = min(z1, clear_z(middle)), rows_at(middle, min(z1, clear_z(middle)))
        hides_low = lower < z1 and middle > blind
        if hides_low or lower - z0 < least or at is None or not in_range(middle, z0, lower):
            return x
        total, through, _ = counts(*at, x)
        if total == 0 or through < share * total or columns_hide(x, *at) or is_hidden(middle, middle, *at, lower):
            return x
        lower = min(z1, clear_z(x))
        return x if is_hidden(x, middle, *rows_at(x, lower), lower) else middle

    first, last, end, begun = -1, -1, "NOT_SEEN", False
    for r, x in enumerate(ring_m):
        lower = min(z1, clear_z(x))
        if lower < z1 and x > blind:
            end = "UNKNOWN"
            break
        if lower - z0 < least:
            end = "FIELD_OF_VIEW" if begun else "NOT_SEEN"
            if begun:
                break
            continue
        if not in_range(x, z0, lower):
            end = "MAX_RANGE" if begun else end
            break
        at = rows_at(x, lower)
        if at is None:
            if begun:
                end = "FIELD_OF_VIEW"
                break
            continue
        total, through, near = counts(*at, x)
        if total and through >= share * total:
            begun = True
            if columns_hide(x, *at):
                end = "UNKNOWN"
                break
            if not is_hidden(x, ring_m[last] if first >= 0 else x, *at, lower):
                first, last, end = (r if first < 0 else first), r, "MAX_RANGE"
                continue
            end = "UNKNOWN"
            if first >= 0:
                break
        elif begun or near > (1 - share) * total:
            end = "OBSTACLE" if near >= total - through - near else "UNKNOWN"
            break
        else:
            end = "UNKNOWN"
    if first < 0:
        return 0.0, 0.0, "UNKNOWN" if begun else end
    return begin(first), ring_m[last], end


def holes_of_all_sides(codes):
    """Four times (cols, rows), whether a cell belongs to a hole of 4, 8, 16 and 32 unknown cells. codes: (cols, rows)."""
    dark = codes == 0
    return [rows_of_holes(with_sides(holes(dark, 4 << k), dark), dark) for k in range(4)]


def holes(unknown, side):
    """(cols, blocks) whether a block of four rows of a column lies in an unknown square of this side, whose rows are blocks.
    Beyond the border all is unknown. unknown: (cols, rows)."""
    cols, rows = unknown.shape
    blocks = -(-rows // 4)
    padded = np.ones((cols + 2 * side, 4 * blocks + 2 * side), bool)
    padded[side : side + cols, side : side + rows] = unknown
    out = np.zeros((cols + 2 * side, blocks + 2 * side // 4), bool)
    for u in range(cols + side + 1):
        for b in range(blocks + side // 4 + 1):
            if padded[u : u + side, 4 * b : 4 * b + side].all():
                out[u : u + side, b : b + side // 4] = True
    return out[side : side + cols, side // 4 : side // 4 + blocks]


def with_sides(found, unknown):
    """Holes and the blocks that blocks of 3 unknown cells or more connect with them along their rows. found: (cols, blocks);
    unknown: (cols, rows)."""
    many, out = _mostly_unknown(unknown), found.copy()
    for u, b in np.argwhere(found):
        for step in (-1, 1):
            beside = u + step
            while 0 <= beside < len(many) and many[beside, b]:
                out[beside, b] = True
                beside += step
    return out


def rows_of_holes(found, unknown):
    """(cols, rows) cells of blocks that are holes, and the unknown ones that connect with them in their column, up to 7 on either side.
    found: (cols, blocks); unknown: (cols, rows)."""
    whole = np.repeat(found, 4, axis=1)[:, : unknown.shape[1]]
    out, rows = whole.copy(), range(unknown.shape[1])
    for order in (rows, reversed(rows)):
        left = np.full(len(whole), -1)  # rows by which the hole of each column may still extend
        for v in order:
            left = np.where(whole[:, v], 7, np.where(unknown[:, v], left - 1, -1))
            out[:, v] |= left >= 0
    return out


def _mostly_unknown(unknown):
    """(cols, blocks) whether at least 3 cells of a block are unknown. Beyond the last row all is. unknown: (cols, rows)."""
    cols, rows = unknown.shape
    blocks = -(-rows // 4)
    padded = np.ones((cols, 4 * blocks), bool)
    padded[:, :rows] = unknown
    return padded.reshape(cols, blocks, 4).sum(axis=2) >= 3
