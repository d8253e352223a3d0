"""The paper's plane stage as printed: Algorithm 2 with its listing's dot product, Eq. 17, Section 5.3."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.stages.planes import LEAST_S
from core.stages.view_geometry import ViewGeometry

from .params import PaperParams

_MOST_SPLITS = 100000
"""More splits than any frame has strips."""
_OUTWARD = 1e-6
"""Tangent by which outlines grow, as those of the extractor do."""
_LEAST_HEIGHT_M = np.float32(1e-3)
"""A plane's top must differ from its bottom in float32."""

Rows = tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]


def planes_paper(strips: NDArray[np.void], view: ViewGeometry, params: PaperParams) -> Rows:
    """(planes (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom in level_cam; support, px, and cluster, (N,) int32).

    Strips of a cluster are split at the greatest misfit of a least-squares line until each group fits; a group of three
    or fewer is emitted only where the dot product of the listing is positive and its ends are nearer than Ws:
    otherwise it vanishes, as printed. strips: (N,) of STRIP, with places and clusters."""
    segments: list[tuple[float, ...]] = []
    for c in range(int(strips["cluster"].max()) + 1 if len(strips) else 0):
        members = strips[strips["cluster"] == c]
        points = np.stack([members[n].astype(np.float64) for n in ("x_m", "y_m", "top_m", "bottom_m")], axis=1)
        segments += [(*s, c) for s in _split(points, members["support"], params)]
    merged = _merge(segments, params)
    half = 0.5 * float(view.lateral[0]) / view.f_px
    rows = np.empty((len(merged), 6), np.float32)
    for row, (ax, ay, bx, by, top, bottom, _, _) in zip(rows, merged, strict=True):
        t0, t1 = sorted((ay / ax, by / bx))
        s0, s1 = (1.0 / ax, 1.0 / bx) if ay / ax <= by / bx else (1.0 / bx, 1.0 / ax)
        b = (s1 - s0) / (t1 - t0) if t1 - t0 > 1e-9 else 0.0
        a = s0 - b * t0
        t0, t1 = t0 - half - _OUTWARD, t1 + half + _OUTWARD
        x0, x1 = 1.0 / max(a + b * t0, LEAST_S), 1.0 / max(a + b * t1, LEAST_S)
        row[:] = x0, x0 * t0, x1, x1 * t1, top - _OUTWARD * x0, bottom + _OUTWARD * x0
        row[5] = max(row[5], row[4] + _LEAST_HEIGHT_M)
    support = np.array([m[6] for m in merged], np.int32)
    return rows, support, np.array([m[7] for m in merged], np.int32)


Segment = tuple[float, float, float, float, float, float, int]
Merged = tuple[float, float, float, float, float, float, int, int]


def _line(points: NDArray[np.float64]) -> tuple[float, float, NDArray[np.float64]]:
    """x = p + q y by least squares of eta = (n, X, Z, XZ, XX) and the misfits; a line along the view axis diverges."""
    y, x = points[:, 1], points[:, 0]
    var = float(np.mean(y * y) - np.mean(y) ** 2)
    q = float(np.mean(x * y) - np.mean(x) * np.mean(y)) / var if var > 1e-12 else 0.0
    p = float(np.mean(x)) - q * float(np.mean(y))
    return p, q, np.abs(x - p - q * y) / math.sqrt(1.0 + q * q)


def _split(points: NDArray[np.float64], support: NDArray[np.int32], params: PaperParams) -> list[Segment]:
    """Algorithm 2 for one cluster: points (S, 4) x, y, top, bottom in order of column."""
    out: list[Segment] = []
    groups = [(0, len(points))]
    for _ in range(_MOST_SPLITS):
        if not groups:
            break
        a, b = groups.pop()
        group = points[a:b]
        top, bottom, weight = float(group[:, 2].min()), float(group[:, 3].max()), int(support[a:b].sum())
        if b - a > 3:
            p, q, off = _line(group)
            if off.max() <= max(params.line_tolerance_m, params.paper_line_tolerance_m):
                least = params.min_plane_distance_m
                y0, y1 = float(group[0, 1]), float(group[-1, 1])
                out.append((max(p + q * y0, least), y0, max(p + q * y1, least), y1, top, bottom, weight))
            else:
                at = a + min(max(int(off.argmax()), 1), b - a - 1)
                groups += [(a, at), (at, b)]
        elif b - a == 3:
            before, after = group[1, :2] - group[0, :2], group[1, :2] - group[2, :2]
            chord = math.hypot(*(group[0, :2] - group[2, :2]))
            if float(before @ after) > 0.0 and chord < params.passable_width_m:
                out.append(
                    (group[0, 0], group[0, 1], group[2, 0], group[2, 1], top, bottom, weight)  # S_i is gone
                )
    return out


def _merge(segments: list[tuple[float, ...]], params: PaperParams) -> list[Merged]:
    """Section 5.3: joins neighbours of one cluster within phi0 and Ws by Eq. 17's weighted means of their ends."""
    out: list[Merged] = []
    for s in sorted(segments, key=lambda s: (s[7], s[1] / s[0])):
        ax, ay, bx, by, top, bottom, weight, cluster = s
        if out and out[-1][7] == cluster:
            p = out[-1]
            turn = abs(math.remainder(math.atan2(by - ay, bx - ax) - math.atan2(p[3] - p[1], p[2] - p[0]), math.pi))
            if (
                turn < math.radians(params.plane_angle_deg)
                and math.hypot(ax - p[2], ay - p[3]) < params.passable_width_m
            ):
                out[-1] = (p[0], p[1], bx, by, min(top, p[4]), max(bottom, p[5]), int(weight + p[6]), int(cluster))
                continue
        out.append((ax, ay, bx, by, top, bottom, int(weight), int(cluster)))
    return out
