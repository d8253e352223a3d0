"""Recall of thin objects over their range: a curve of many cases."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from benchmarks.fidelity.result import Row

STEP_M = 2.0
THINGS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("pole of 0.12 m", ("poles", "pole_ranges"), "pole at"),
    ("wire of 0.02 m", ("wire_ranges",), "wire at"),
)
"""A curve: its name, its scenes, and the names of the objects in them."""


@dataclass(frozen=True, slots=True)
class Point:
    """Things between from_m and from_m + STEP_M: how many were in view, the mean share of their rays kept, how
    many of them kept at least half, and how many rays wide they are."""

    from_m: float
    things: int
    kept: float
    found: int
    width_px: float


def curve(rows: Iterable[Row], scenes: Iterable[str], prefix: str) -> list[Point]:
    """The recall of the objects whose name begins with the prefix, by range, nearest first."""
    names = set(scenes)
    bins: dict[int, list[tuple[float, float]]] = {}
    for row in rows:
        if row.case.scene in names and row.valid:
            for thing in row.recall:
                if thing.name.startswith(prefix):
                    bins.setdefault(int(thing.distance_m // STEP_M), []).append((thing.kept, thing.width_px))
    return [
        Point(
            from_m=STEP_M * i,
            things=len(seen),
            kept=sum(kept for kept, _ in seen) / len(seen),
            found=sum(kept >= 0.5 for kept, _ in seen),
            width_px=sum(width for _, width in seen) / len(seen),
        )
        for i, seen in sorted(bins.items())
    ]
