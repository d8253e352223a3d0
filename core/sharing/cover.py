"""Whether planes that a neighbour has been sent contain another plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SAMPLE_M = 0.3
MOST_SAMPLES = 64
COVER_M, COVER_HEIGHT_M = 0.5, 0.5
"""A part of a plane is contained within this distance of another plane that is as high, up to this height."""


def is_covered(box: Floats, sent: Floats) -> bool:
    """True if planes (N, 6) contain a plane (6,): no part of it is farther than COVER_M from one that is as high."""
    high = (sent[:, 4] <= box[4] + COVER_HEIGHT_M) & (sent[:, 5] >= box[5] - COVER_HEIGHT_M)
    near = (np.minimum(sent[:, 0:2], sent[:, 2:4]) <= np.maximum(box[0:2], box[2:4]) + COVER_M).all(axis=1)
    near &= (np.maximum(sent[:, 0:2], sent[:, 2:4]) >= np.minimum(box[0:2], box[2:4]) - COVER_M).all(axis=1)
    some = sent[high & near]
    if not len(some):
        return False
    count = min(MOST_SAMPLES, 2 + int(np.hypot(*(box[2:4] - box[0:2])) / SAMPLE_M))
    points = box[0:2] + np.linspace(0.0, 1.0, count)[:, None] * (box[2:4] - box[0:2])
    along = some[:, 2:4] - some[:, 0:2]
    off = points[:, None] - some[None, :, 0:2]
    t = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.0)
    gap = off - t[:, :, None] * along
    return bool((np.hypot(gap[:, :, 0], gap[:, :, 1]).min(axis=1) <= COVER_M).all())
