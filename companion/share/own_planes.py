"""The own planes that are offered to other vehicles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from core.sharing.records import PLANE_IDS, SharedPlanes
from core.world.plane_index import BOX, columns
from core.world.world import World

NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class OwnPlanes:
    """Planes of one section of the own world; ids are their slots."""

    planes: SharedPlanes
    section: int
    newest_ns: int = 0  # exposure of the newest frame in them


def own_planes(world: World, now_ns: int, least_hits: int, range_m: float, most: int) -> OwnPlanes:
    """The planes within range_m of the newest camera that least_hits frames have observed, the nearest `most`."""
    section = world.section
    if section is None:
        return OwnPlanes(SharedPlanes.empty(), 0)
    table = section.used_slots[:PLANE_IDS]
    slots = np.flatnonzero(table["hits"] >= max(1, least_hits))
    box = columns(table[slots], BOX).astype(np.float64)
    x, y, _ = section.place_m
    distance_m = np.hypot(0.5 * (box[:, 0] + box[:, 2]) - x, 0.5 * (box[:, 1] + box[:, 3]) - y)
    kept = np.flatnonzero(distance_m <= range_m)
    kept = kept[np.argsort(distance_m[kept], kind="stable")[:most]]
    rows = table[slots[kept]]
    planes = SharedPlanes(
        ids=slots[kept].astype(np.uint16),
        box=box[kept],
        margin_m=rows["margin_m"].astype(np.float64),
        flags=rows["plane_flags"].astype(np.uint8),
        age_s=np.maximum(0.0, (now_ns - rows["seen_ns"]) / NS),
    )
    return OwnPlanes(planes, section.number, section.newest_ns)
