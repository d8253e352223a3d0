"""How much of the upright outline of blank things is measured and kept: all that stereo can see of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import MISSED_M, Rays
from drivers.simulation.source import Rendered

INSIDE_PX = 2
"""The outline is so wide, inside of the edge."""
REACH_PX = 3
"""A measurement belongs to an outline pixel when it lies within so many columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineCounts:
    """Of one thing in one view: outline pixels; those with a right measurement within REACH_PX; those whose ray the model stops
    within max(0.5 m, 2 sigma) of the truth. range_m: median of their true range."""

    name: str
    range_m: float
    pixels: int
    measured: int
    kept: int


def upright_outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of a mask within INSIDE_PX columns of its left or right end, where that end lies in the image."""
    off = np.zeros_like(mask)
    for step in range(1, INSIDE_PX + 1):
        off[:, step:] |= mask[:, step:] & ~mask[:, :-step]
        off[:, :-step] |= mask[:, :-step] & ~mask[:, step:]
    return off


def outline_counts(
    frame: Rendered, blank: tuple[str, ...], rays: Rays, stop_m: NDArray[np.float64], unmatched_left_px: int
) -> list[OutlineCounts]:
    """The outlines of the scene's blank things within the camera's range. blank: their names; unmatched_left_px: columns that
    never have a match."""
    label = frame.truth.label(frame.scene)
    slack = np.fmax(MISSED_M, 2.0 * rays.sigma_m)
    depth_m = frame.depth_mm * 1e-3 * rays.per_depth
    right = (frame.depth_mm > 0) & (np.abs(depth_m - rays.range_m) <= slack)
    found = []
    for name in blank:
        mine = label == frame.scene.names.index(name)
        outline = upright_outline(mine) & rays.obstacle
        outline[:, : unmatched_left_px + 8] = False
        outline[:, -8:] = False
        # what lies before the thing covers its edge: that edge is the other thing's
        outline &= _frontmost(rays.range_m)
        if outline.sum() < 20:
            continue
        # a right depth of the thing, at the pixel or beside it
        near = np.zeros_like(right)
        for step in range(-REACH_PX, REACH_PX + 1):
            source = slice(max(0, step), right.shape[1] + min(0, step))
            target = slice(max(0, -step), right.shape[1] + min(0, -step))
            near[:, target] |= (frame.depth_mm[:, source] > 0) & (
                np.abs(depth_m[:, source] - rays.range_m[:, target]) <= slack[:, target]
            )
        kept = np.abs(np.where(np.isfinite(stop_m), stop_m, 1e9) - rays.range_m) <= slack
        found.append(
            OutlineCounts(
                name=name,
                range_m=float(np.median(rays.range_m[outline])),
                pixels=int(outline.sum()),
                measured=int((near & outline).sum()),
                kept=int((kept & outline).sum()),
            )
        )
    return found


def _frontmost(range_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Pixels with nothing clearly nearer within INSIDE_PX columns."""
    least = range_m.copy()
    for step in range(1, INSIDE_PX + 1):
        least[:, step:] = np.fmin(least[:, step:], range_m[:, :-step])
        least[:, :-step] = np.fmin(least[:, :-step], range_m[:, step:])
    return np.asarray(range_m <= least + MISSED_M)
