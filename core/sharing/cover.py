"""Whether planes that a neighbour has been sent contain another plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import inner

Floats = NDArray[np.float64]
SAMPLE_M = 0.3
MOST_SAMPLES = 64
COVER_M, COVER_HEIGHT_M = 0.5, 0.5
"""A part of a plane is contained within this distance of another plane that is as high, up to this height."""


def covered(
    box: Floats, rows: NDArray[np.intp], sent_box: Floats, sent: NDArray[np.bool_], sent_ns: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Returns (N,): which of some planes others contain that were sent: no part of them is farther than COVER_M from
    one that is as high.

    Planes that were sent at the same instant do not contain each other: they may be lost in one packet.

    Args:
        box: (N, 6) planes.
        rows: (M,) rows of the planes to test; others are not contained.
        sent_box: (N, 6) the same planes as they were sent.
        sent: (N,) which were sent.
        sent_ns: (N,) when they were sent last."""
    found = np.zeros(len(box), np.bool_)
    others = np.flatnonzero(sent)
    _mark_covered(found, np.ascontiguousarray(box), rows, np.ascontiguousarray(sent_box), others, sent_ns)
    return found


@inner
def _mark_covered(found, box, rows, sent_box, others, sent_ns):
    """Marks the rows of `box` that others contain, without themselves."""
    for r in range(len(rows)):
        row = rows[r]
        ax, ay = box[row, 0], box[row, 1]
        dx, dy = box[row, 2] - ax, box[row, 3] - ay
        count = min(MOST_SAMPLES, 2 + int(np.hypot(dx, dy) / SAMPLE_M))
        contained = True
        for k in range(count):
            share = k / (count - 1)
            if not _is_near(ax + share * dx, ay + share * dy, row, box, sent_box, others, sent_ns):
                contained = False
                break
        found[row] = contained


@inner
def _is_near(x, y, row, box, sent_box, others, sent_ns):
    """True if a point of a plane is near another plane that is as high."""
    for s in range(len(others)):
        k = others[s]
        if sent_ns[k] == sent_ns[row]:  # the plane itself, or one that may be lost with it
            continue
        if sent_box[k, 4] > box[row, 4] + COVER_HEIGHT_M or sent_box[k, 5] < box[row, 5] - COVER_HEIGHT_M:
            continue
        ax, ay, bx, by = sent_box[k, 0], sent_box[k, 1], sent_box[k, 2], sent_box[k, 3]
        if min(ax, bx) > x + COVER_M or max(ax, bx) < x - COVER_M:
            continue
        if min(ay, by) > y + COVER_M or max(ay, by) < y - COVER_M:
            continue
        dx, dy = bx - ax, by - ay
        t = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-9)))
        if np.hypot(x - ax - t * dx, y - ay - t * dy) <= COVER_M:
            return True
    return False
