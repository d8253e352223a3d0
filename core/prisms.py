"""Section 3, Figure 2: connected planes cut into layers, each layer a side profile of polygons.

One view sees front faces only, so profiles are open sheets (`closed = False`); they close as views come together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .types import Prism


def joined_heights(heights: NDArray[np.float32], join_m: float) -> NDArray[np.float32]:
    """Each height replaced by the least of its group, a group spanning at most join_m from its least member up."""
    out = np.empty_like(heights)
    least = -np.inf
    for k in np.argsort(heights, kind="stable"):
        if heights[k] - least > join_m:
            least = float(heights[k])
        out[k] = least
    return out


def layer_cuts(
    tops: NDArray[np.float32], bottoms: NDArray[np.float32], join_m: float
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """(cuts, first, last): rising z at which a group of planes is cut, and each plane's own top and bottom cut.

    Tops closer than join_m become the highest of them, bottoms the lowest: z is down, so both only ever grow a plane."""
    own_tops, own_bottoms = joined_heights(tops, join_m), -joined_heights(-bottoms, join_m)
    cuts = np.unique(np.concatenate([own_tops, own_bottoms]))
    return cuts, np.searchsorted(cuts, own_tops), np.searchsorted(cuts, own_bottoms)


def profile_runs(planes: NDArray[np.float32], members: NDArray[np.int64], end_m: float) -> list[list[int]]:
    """Runs of members (ordered from left to right) whose facing ends coincide within end_m: one profile each."""
    runs: list[list[int]] = []
    for k in members:
        if runs:
            last = planes[runs[-1][-1]]
            if abs(last[2] - planes[k, 0]) < end_m and abs(last[3] - planes[k, 1]) < end_m:
                runs[-1].append(int(k))
                continue
        runs.append([int(k)])
    return runs


def connected_planes(planes: NDArray[np.float32], end_m: float) -> NDArray[np.int64]:
    """(N,) component of each plane: planes whose facing ends coincide within end_m and whose heights overlap.

    Only such planes share a profile; cutting one at another's height would add edges and say nothing."""
    meets = (
        (np.abs(planes[:, None, 2] - planes[None, :, 0]) < end_m)
        & (np.abs(planes[:, None, 3] - planes[None, :, 1]) < end_m)
        & (np.minimum(planes[:, None, 5], planes[None, :, 5]) > np.maximum(planes[:, None, 4], planes[None, :, 4]))
    )
    component: NDArray[np.int64] = np.arange(len(planes))
    left, right = np.nonzero(meets)
    for _ in range(len(planes)):
        before = component.copy()
        np.minimum.at(component, left, before[right])
        np.minimum.at(component, right, before[left])
        if np.array_equal(before, component):
            break
    return component


def layers_of(
    planes: NDArray[np.float32], members: NDArray[np.int64], join_m: float
) -> list[tuple[float, float, NDArray[np.int64]]]:
    """(top, bottom, planes) of each layer of one connected group, neighbours with the same planes being one layer."""
    cuts, first, last = layer_cuts(planes[members, 4], planes[members, 5], join_m)
    layers: list[tuple[float, float, NDArray[np.int64]]] = []
    for k in range(len(cuts) - 1):
        there = members[(first <= k) & (last > k)]
        if layers and np.array_equal(layers[-1][2], there):
            layers[-1] = (layers[-1][0], float(cuts[k + 1]), there)
        elif len(there):
            layers.append((float(cuts[k]), float(cuts[k + 1]), there))
    return layers


def layered_prisms(
    planes: NDArray[np.float32], margin_m: NDArray[np.float32], cluster: NDArray[np.int32], join_m: float, end_m: float
) -> tuple[Prism, ...]:
    """The multi-layer prisms of a frame. planes: (N, 6) as in FrameModel; every plane stands in each layer it reaches.

    join_m: heights closer than this are one cut; end_m: ends closer than this are one vertex."""
    prisms: list[Prism] = []
    if not len(planes):
        return ()
    azimuth = np.arctan2(planes[:, 1] + planes[:, 3], planes[:, 0] + planes[:, 2])
    component = connected_planes(planes, end_m)
    for c in np.unique(component):
        members = np.flatnonzero(component == c)
        members = members[np.argsort(azimuth[members], kind="stable")]
        for top_m, bottom_m, there in layers_of(planes, members, join_m):
            for run in profile_runs(planes, there, end_m):
                vertices = [planes[run[0], 0:2], *[planes[k, 2:4] for k in run]]
                prisms.append(
                    Prism(
                        cluster=int(cluster[run[0]]),
                        top_m=top_m,
                        bottom_m=bottom_m,
                        closed=False,
                        margin_m=float(margin_m[run].max()),
                        vertices_m=np.array(vertices, np.float32),
                        plane=np.array(run, np.int32),
                    )
                )
    return tuple(prisms)
