"""Times without a position of the vehicle, in which the place of what is not observed becomes uncertain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import inner

MOST_LOSSES = 8
"""Losses that are kept. Where there are more, the two with the shortest time between them become one, which lasts longer."""

Losses = tuple[tuple[int, int], ...]
"""The losses of the position, the oldest first: exposure of the last frame with a position before each, and of the first one with
a position after it, or of the newest frame, ns. With a position in every second frame only, all of the time is one loss."""


def with_loss(losses: Losses, from_ns: int, to_ns: int) -> Losses:
    """The losses after a step from one frame to the next, of which one has no position."""
    if losses and losses[-1][1] == from_ns:
        return *losses[:-1], (losses[-1][0], to_ns)
    losses = *losses, (from_ns, to_ns)
    if len(losses) <= MOST_LOSSES:
        return losses
    k = min(range(len(losses) - 1), key=lambda n: losses[n + 1][0] - losses[n][1])
    return *losses[:k], (losses[k][0], losses[k + 1][1]), *losses[k + 2 :]


def without_old(losses: Losses, oldest_ns: int) -> Losses:
    """The losses that ended after oldest_ns."""
    return tuple(loss for loss in losses if loss[1] > oldest_ns)


def shifted(losses: Losses, step_ns: int) -> Losses:
    """The losses on a clock that is ahead by step_ns."""
    return tuple((from_ns + step_ns, to_ns + step_ns) for from_ns, to_ns in losses)


def loss_table(losses: Losses) -> NDArray[np.int64]:
    """The losses for kernels, (N, 2) int64."""
    return np.array(losses, np.int64).reshape(-1, 2)


@inner
def lost_ns(table, seen_ns):
    """For how long an observation has been followed by frames without a position, ns. table: of `loss_table`."""
    total = 0
    for k in range(table.shape[0]):
        total += max(0, table[k, 1] - max(table[k, 0], seen_ns))
    return total
