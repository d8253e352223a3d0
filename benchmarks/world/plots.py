"""Pictures of the world growing over a flight, and of its planes and bytes over the frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.plots import SERIES, figure, label
from benchmarks.world.cost import observations
from benchmarks.world.flights import HZ, flights
from benchmarks.world.truth import Step
from core.types import Prism
from core.world.snapshot import WorldSnapshot
from core.world.world import World
from osape_client.model import Prism as ClientPrism
from osape_client.world.prisms import world_prisms

SHOWN = ("block", "alley", "trees", "cylinder")
MOMENTS = (0.1, 0.33, 0.67, 1.0)
_CELL_M = 0.5


def draw_growing(path: Path, seed: int) -> None:
    """The worlds of some flights at four moments, from above."""
    shown = [f for f in flights(seed) if f.name in SHOWN]
    with figure(path, len(shown), len(MOMENTS), 13.0, 3.2 * len(shown)) as axes:
        for row, flight in zip(axes, shown, strict=True):
            frames = observations(flight, seed, len(flight.way))
            way = np.array(flight.way)
            low, high = way[:, :2].min(axis=0) - 6.0, way[:, :2].max(axis=0) + 8.0
            world, done = World(), 0
            for ax, share in zip(row, MOMENTS, strict=True):
                until = max(1, round(share * len(frames)))
                for observation in frames[done:until]:
                    world.add(observation)
                done = until
                picture = world.picture(frames[until - 1].t_ns)
                draw_world(ax, picture, float(way[until - 1, 2]))
                ax.plot(way[:until, 1], way[:until, 0], color="#8e24aa", linewidth=1.2)
                ax.set_xlim(low[1], high[1])
                ax.set_ylim(low[0], high[0])
                title = f"{flight.name}, {until / HZ:.0f} s: {len(picture.planes)} planes"
                label(ax, title, "east, m", "north, m")


def draw_world(ax: Any, picture: WorldSnapshot, z_m: float) -> None:
    """A picture of the world from above: free cells at a height, planes, closed solids."""
    free_cells(ax, picture, z_m)
    for prism in world_prisms(picture.planes, picture.margin_m, picture.hits):
        draw_prism(ax, prism)
    for p in picture.planes:
        ax.plot([p[1], p[3]], [p[0], p[2]], color="#c62828", linewidth=1.3, solid_capstyle="butt")
    ax.set_aspect("equal", adjustable="box")


def draw_prism(ax: Any, prism: Prism | ClientPrism) -> None:
    """A closed solid, filled."""
    if prism.closed:
        ax.fill(prism.vertices_m[:, 1], prism.vertices_m[:, 0], color="#ef9a9a", linewidth=0, alpha=0.6)


def free_cells(ax: Any, picture: WorldSnapshot, z_m: float) -> None:
    """The cells at a height that are known to be free, as an image."""
    layer, bit = int(np.floor(z_m / _CELL_M)) >> 6, int(np.floor(z_m / _CELL_M)) & 63
    for block, mask in zip(picture.blocks.tolist(), picture.masks, strict=True):
        if block[2] != layer:
            continue
        on = ((mask >> np.uint64(bit)) & np.uint64(1)).reshape(16, 16) != 0
        colors = np.where(on[..., None], np.array([0.78, 0.9, 0.79, 1.0]), np.array([1.0, 1.0, 1.0, 0.0]))
        x, y = 8.0 * block[0], 8.0 * block[1]
        ax.imshow(colors, origin="lower", extent=(y, y + 8.0, x, x + 8.0), interpolation="nearest", zorder=0)


def draw_steps(path: Path, steps: Mapping[str, Sequence[Step]]) -> None:
    """Planes of the world and of all frames so far, and the bytes of the stream, over time."""
    with figure(path, 1, 3, 13.0, 3.6) as axes:
        for color, (name, mine) in zip(SERIES, steps.items(), strict=False):
            t = np.arange(1, len(mine) + 1) / HZ
            axes[0][0].plot(t, [s.planes for s in mine], color=color, linewidth=1.2, label=name)
            axes[0][1].plot(t, [s.frame_planes for s in mine], color=color, linewidth=1.2, label=name)
            axes[0][2].plot(t, [s.stream_bytes / 1e3 for s in mine], color=color, linewidth=1.2, label=name)
        label(axes[0][0], "Planes of the world", "s", "planes")
        label(axes[0][1], "Planes of all frames together", "s", "planes")
        label(axes[0][2], "Stream, free space included", "s", "kB")
