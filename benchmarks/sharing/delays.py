"""How long it takes until a neighbour has a new obstacle.

Planes of the merged world are joined and their numbers used again, so obstacles are compared by place: a plane that its
owner confirms is new for a neighbour if the planes that the neighbour has of this owner do not contain it yet."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.sharing.records import SharedPlanes
from core.world.plane_index import BOX, columns
from core.world.world import World

Floats = NDArray[np.float64]
NS = 1_000_000_000
NEAR_M, HEIGHT_M, LEAST_SHARE, SAMPLE_M = 0.5, 0.5, 0.9, 0.2
"""A plane is contained if this share of its length is within NEAR_M of planes that are as high, up to HEIGHT_M. A ray
that passes 0.5 m behind an obstacle counts as missed, too."""


@dataclass(slots=True)
class Confirmed:
    """Planes of the own world when they were confirmed: observed by least_hits frames. planes: (time, box (6,))."""

    planes: list[tuple[int, Floats]] = field(default_factory=list)
    _hits: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def note(self, world: World, least_hits: int, now_ns: int) -> None:
        """After a frame. A number with fewer hits than before is that of another plane."""
        assert world.section is not None
        table = world.section.used_slots
        hits = table["hits"].astype(np.int64)
        before = np.zeros(len(hits), np.int64)
        before[: len(self._hits)] = self._hits[: len(hits)]
        before[hits < before] = 0
        new = np.flatnonzero((hits >= least_hits) & (before < least_hits))
        boxes = columns(table[new], BOX).astype(np.float64)
        self.planes += [(now_ns, box) for box in boxes]
        self._hits = hits


@dataclass(slots=True)
class Received:
    """Planes as they arrived. planes: (time, sender, planes in its frame); published_ns: instants of publication."""

    planes: list[tuple[int, int, SharedPlanes]] = field(default_factory=list)
    published_ns: list[int] = field(default_factory=list)


def delays(confirmed: Confirmed, received: Received, sender: int, since_ns: int) -> tuple[list[float], int]:
    """(delay of each obstacle that was new for the receiver since then, from its confirmation to its publication, in s;
    number of those that never arrived). The last second is left out."""
    arrivals = _published(received, sender)
    held: dict[int, Floats] = {}
    waiting: list[tuple[int, Floats]] = []
    found: list[float] = []
    last_ns = max((t for t, _ in confirmed.planes), default=0) - NS
    events = [(t, 1, k) for k, (t, _) in enumerate(confirmed.planes)] + [(t, 0, k) for k, (t, _) in enumerate(arrivals)]
    for t_ns, kind, k in sorted(events):
        if kind:
            box = confirmed.planes[k][1]
            if t_ns >= since_ns and not contains(np.array([*held.values()]), box):
                waiting.append((t_ns, box))
            continue
        planes = arrivals[k][1]
        held.update(zip(planes.ids.tolist(), planes.box, strict=True))
        boxes = np.array([*held.values()])
        done = [contains(boxes, box) for _, box in waiting]
        found += [(t_ns - begin_ns) / NS for (begin_ns, _), there in zip(waiting, done, strict=True) if there]
        waiting = [entry for entry, there in zip(waiting, done, strict=True) if not there]
    return found, sum(t_ns < last_ns for t_ns, _ in waiting)


def _published(received: Received, sender: int) -> list[tuple[int, SharedPlanes]]:
    """Planes of a sender with the instant at which they were first published."""
    instants = np.array(received.published_ns)
    found = []
    for t_ns, number, planes in received.planes:
        k = int(np.searchsorted(instants, t_ns))
        if number == sender and k < len(instants):
            found.append((int(instants[k]), planes))
    return found


def contains(held: Floats, box: Floats) -> bool:
    """Whether planes (N, 6) contain a plane (6,)."""
    if not len(held):
        return False
    some = held[(held[:, 4] <= box[4] + HEIGHT_M) & (held[:, 5] >= box[5] - HEIGHT_M)]
    if not len(some):
        return False
    share = np.linspace(0.0, 1.0, 2 + int(np.hypot(*(box[2:4] - box[0:2])) / SAMPLE_M))[:, None]
    points = box[0:2] + share * (box[2:4] - box[0:2])
    along = some[:, 2:4] - some[:, 0:2]
    off = points[:, None] - some[None, :, 0:2]
    t = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.0)
    gap = off - t[:, :, None] * along
    apart_m = np.hypot(gap[:, :, 0], gap[:, :, 1]).min(axis=1)
    return bool((apart_m <= NEAR_M).mean() >= LEAST_SHARE)
