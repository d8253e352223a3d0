"""Section 3, Figure 2: the planes of each cluster cut into layers, each layer a side profile of polygons.

One view sees front faces only, so profiles are open sheets (`closed = False`); they close as views come together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .types import Prism


def layer_cuts(tops: NDArray[np.float32], bottoms: NDArray[np.float32], join_m: float) -> NDArray[np.float32]:
    """Rising z at which a cluster is cut: its tops and bottoms, those within join_m of the first of a group being one.

    A group takes its highest top; a group of bottoms only takes the lowest, so that the outermost cuts lose nothing."""
    heights = np.concatenate([tops, bottoms])
    is_top = np.concatenate([np.ones(len(tops), bool), np.zeros(len(bottoms), bool)])
    order = np.argsort(heights, kind="stable")
    cuts: list[float] = []
    start = 0
    for i in range(1, len(order) + 1):
        if i < len(order) and heights[order[i]] - heights[order[start]] <= join_m:
            continue
        group = order[start:i]
        some_top = bool(is_top[group].any())
        cuts.append(float(heights[group].min() if some_top else heights[group].max()))
        start = i
    return np.array(cuts, np.float32)


def profile_runs(planes: NDArray[np.float32], members: NDArray[np.int64]) -> list[list[int]]:
    """Runs of members (ordered from left to right) whose facing ends coincide within a centimetre: one profile each."""
    runs: list[list[int]] = []
    for k in members:
        if runs:
            last = planes[runs[-1][-1]]
            if abs(last[2] - planes[k, 0]) < 0.01 and abs(last[3] - planes[k, 1]) < 0.01:
                runs[-1].append(int(k))
                continue
        runs.append([int(k)])
    return runs


def layered_prisms(
    planes: NDArray[np.float32], margin_m: NDArray[np.float32], cluster: NDArray[np.int32], join_m: float
) -> tuple[Prism, ...]:
    """The multi-layer prisms of a frame. planes: (N, 6) as in FrameModel; every plane stands in each layer it reaches."""
    prisms: list[Prism] = []
    azimuth = np.arctan2(planes[:, 1] + planes[:, 3], planes[:, 0] + planes[:, 2])
    for c in np.unique(cluster):
        members = np.flatnonzero(cluster == c)
        members = members[np.argsort(azimuth[members], kind="stable")]
        cuts = layer_cuts(planes[members, 4], planes[members, 5], join_m)
        if len(cuts) < 2:  # lower than the joining distance: its own extent
            cuts = np.array([planes[members, 4].min(), planes[members, 5].max()], np.float32)
        # a plane reaches from the cut nearest its top to the cut nearest its bottom, over one layer at least
        top = np.abs(cuts[None, :-1] - planes[members, 4:5]).argmin(axis=1)
        bottom = np.maximum(np.abs(cuts[None, :] - planes[members, 5:6]).argmin(axis=1), top + 1)
        for layer in range(len(cuts) - 1):
            there = members[(top <= layer) & (bottom > layer)]
            for run in profile_runs(planes, there):
                vertices = [planes[run[0], 0:2], *[planes[k, 2:4] for k in run]]
                prisms.append(
                    Prism(
                        cluster=int(c),
                        top_m=float(cuts[layer]),
                        bottom_m=float(cuts[layer + 1]),
                        closed=False,
                        margin_m=float(margin_m[run].max()),
                        vertices_m=np.array(vertices, np.float32),
                        plane=np.array(run, np.int32),
                    )
                )
    return tuple(prisms)
