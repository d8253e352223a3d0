"""Sections 4.4 and 5.1 as printed: Algorithm 1 for clusters, and gaps filled by both complements of a whole cluster."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.stages.view_geometry import ViewGeometry


def cluster_strips(strips: NDArray[np.void], view: ViewGeometry, ws_m: float, hs_m: float) -> int:
    """Writes places and clusters of strips (N,) of STRIP; returns the number of clusters. ws_m, hs_m: Ws, Hs."""
    _place(strips, view.f_px, view.cu, view.lateral, view.tan_edge)
    count = int(cluster_paper(strips, ws_m))
    fill_paper(strips, hs_m, count)
    return count


@njit(cache=True, nogil=True)
def _place(strips: Any, f_px: Any, cu: Any, lateral: Any, tan_edge: Any) -> None:
    """Distance, lateral offset, top and bottom of each strip in level_cam, metres (Eq. 15)."""
    for i in range(len(strips)):
        s = strips[i]
        x = f_px / s.disparity
        s.x_m = x
        s.y_m = x * (s.u - cu) / f_px * lateral[(s.top + s.bottom) // 2]
        s.top_m = x * tan_edge[s.top]
        s.bottom_m = x * tan_edge[s.bottom + 1]


@njit(cache=True, nogil=True)
def cluster_paper(strips: Any, ws_m: Any) -> Any:
    """Algorithm 1 as printed: distance to the last strip of each cluster, nearest below Ws takes it; returns the count.

    The gap counts no height. Clusters that meet later stay apart."""
    last_of_cluster = np.zeros(len(strips), np.int32)
    count = 0
    for i in range(len(strips)):
        s = strips[i]
        best, nearest = -1, ws_m
        for c in range(count):
            other = strips[last_of_cluster[c]]
            gap = math.hypot(s.x_m - other.x_m, s.y_m - other.y_m)
            if gap < nearest:
                best, nearest = c, gap
        if best < 0:
            best = count
            count += 1
        s.cluster = best
        last_of_cluster[best] = i
    return count


def fill_paper(strips: NDArray[np.void], hs_m: float, clusters: int) -> None:
    """Section 5.1 as printed: both complements of a strip within its cluster's height below Hs are filled.

    The complements are those of the whole cluster, so that a strip far from both ends keeps them. Changes top_m and
    bottom_m, not the rows."""
    for c in range(clusters):
        members = strips["cluster"] == c
        top, bottom = strips["top_m"][members].min(), strips["bottom_m"][members].max()
        near = members & (strips["top_m"] - top < hs_m) & (bottom - strips["bottom_m"] < hs_m)
        strips["top_m"][near], strips["bottom_m"][near] = top, bottom
