"""Distances between straight segments and upright rectangles, many of each at once.

The exact distance is computed only for pairs whose bounding boxes come near each other. It is the least of a crossing (0),
an end of the segment to the rectangle, and the segment to one of the rectangle's four sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MOST_PAIRS = 1 << 18
"""Not tuning: pairs of a way and a rectangle that are looked at together: about 150 MB of scratch memory where all are near."""
_TINY = 1e-12
"""Not tuning: no way and no side is shorter, squared, so that nothing is divided by 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Rectangles:
    """N upright rectangles. corner: (N, 3) the upper end a; along: (N, 2) from a to b; height: (N,) downwards;
    margin_m: (N,) what belongs to the obstacle in front; low, high: (N, 3) float32 box around each with its margin."""

    corner: Floats
    along: Floats
    height: Floats
    margin_m: Floats
    low: NDArray[np.float32]
    high: NDArray[np.float32]

    def touch(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether the way a -> b, each (M, 3), comes as near to any rectangle as a radius and its margin.

        A segment that is not finite touches: it must not be taken for free."""
        out = np.asarray(~(np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)))
        if not len(self.corner):
            return out
        ways = max(1, _MOST_PAIRS // len(self.corner))
        for begin in range(0, len(a), ways):
            rows = slice(begin, begin + ways)
            q, n = self._near(a[rows], b[rows], radius_m)
            if len(q):
                hit = self._distance(a[rows][q], b[rows][q], n) <= radius_m + self.margin_m[n]
                out[begin + q[hit]] = True
        return out

    def nearest(self, p: Floats) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """(distance less the margin, unit vector towards it, number) of the nearest rectangle to each point (M, 3). The distance of
        a point that is not finite is 0: it must not be taken for free."""
        m = len(p)
        distance = np.where(np.isfinite(p).all(axis=1), np.inf, 0.0)
        towards, number = np.zeros((m, 3)), np.full(m, -1, np.int32)
        if not len(self.corner):
            return distance, towards, number
        every = np.arange(len(self.corner))
        for i in range(m):
            step = self._foot(np.broadcast_to(p[i], (len(every), 3)), every) - p[i]
            each = np.linalg.norm(step, axis=1)
            k = int(np.argmin(each - self.margin_m))
            distance[i], number[i] = max(0.0, each[k] - self.margin_m[k]), k
            towards[i] = step[k] / each[k] if each[k] > 0.0 else 0.0
        return distance, towards, number

    def _near(self, a: Floats, b: Floats, radius_m: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(query, rectangle) of the pairs whose boxes come as near as the radius; rounding to float32 loses none."""
        with np.errstate(over="ignore"):  # of a radius beyond float32 the box is infinite
            low = np.nextafter((np.minimum(a, b) - radius_m).astype(np.float32), np.float32(-np.inf))
            high = np.nextafter((np.maximum(a, b) + radius_m).astype(np.float32), np.float32(np.inf))
        near = (low[:, None, 0] <= self.high[None, :, 0]) & (high[:, None, 0] >= self.low[None, :, 0])
        for axis in (1, 2):
            near &= (low[:, None, axis] <= self.high[None, :, axis]) & (high[:, None, axis] >= self.low[None, :, axis])
        query, rectangle = np.nonzero(near)
        return query, rectangle

    def _foot(self, p: Floats, n: NDArray[np.intp]) -> Floats:
        """(K, 3) the point of rectangle n[k] nearest to p[k]."""
        corner, along = self.corner[n], self.along[n]
        length2 = np.maximum((along**2).sum(axis=1), _TINY)
        share = np.clip(((p[:, :2] - corner[:, :2]) * along).sum(axis=1) / length2, 0.0, 1.0)
        z = np.clip(p[:, 2], corner[:, 2], corner[:, 2] + self.height[n])
        return np.column_stack([corner[:, :2] + share[:, None] * along, z])

    def _distance(self, a: Floats, b: Floats, n: NDArray[np.intp]) -> Floats:
        """(K,) between the way a[k] -> b[k] and rectangle n[k]."""
        ends = [np.linalg.norm(self._foot(p, n) - p, axis=1) for p in (a, b)]
        corner, height = self.corner[n], self.height[n]
        along = np.column_stack([self.along[n], np.zeros(len(n))])
        down = np.column_stack([np.zeros((len(n), 2)), height])
        sides = [
            between_segments(a, b, start, start + side)
            for start, side in ((corner, along), (corner + down, along), (corner, down), (corner + along, down))
        ]
        least = np.minimum.reduce([*ends, *sides])
        return np.where(self._crosses(a, b, n), 0.0, least)

    def _crosses(self, a: Floats, b: Floats, n: NDArray[np.intp]) -> NDArray[np.bool_]:
        corner, along = self.corner[n], self.along[n]
        side_a = (a[:, 0] - corner[:, 0]) * along[:, 1] - (a[:, 1] - corner[:, 1]) * along[:, 0]
        side_b = (b[:, 0] - corner[:, 0]) * along[:, 1] - (b[:, 1] - corner[:, 1]) * along[:, 0]
        opposite = (side_a <= 0.0) != (side_b <= 0.0)
        share = np.divide(side_a, side_a - side_b, out=np.zeros_like(side_a), where=opposite)
        at = a + share[:, None] * (b - a)
        t = ((at[:, :2] - corner[:, :2]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), _TINY)
        within = (t >= 0.0) & (t <= 1.0) & (at[:, 2] >= corner[:, 2]) & (at[:, 2] <= corner[:, 2] + self.height[n])
        return np.asarray(opposite & within)


def rectangles(planes: Floats, margin_m: Floats) -> Rectangles:
    """Of planes (N, 6): a_x, a_y, b_x, b_y, top, bottom, with their margins (N,)."""
    a, b, top, bottom = planes[:, 0:2], planes[:, 2:4], planes[:, 4], planes[:, 5]
    grown = margin_m[:, None]
    low = np.column_stack([np.minimum(a, b), top]) - grown
    high = np.column_stack([np.maximum(a, b), bottom]) + grown
    return Rectangles(
        np.column_stack([a, top]),
        b - a,
        bottom - top,
        margin_m,
        np.nextafter(low.astype(np.float32), np.float32(-np.inf)),
        np.nextafter(high.astype(np.float32), np.float32(np.inf)),
    )


def between_segments(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """(K,) least distance between segments a -> b and c -> d, each (K, 3): the inner minimum where there is one, else
    the least of the four from an end of one to the other (the square of the distance is convex in both shares)."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(axis=1), (v * v).sum(axis=1), (u * v).sum(axis=1)
    uw, vw = (u * w).sum(axis=1), (v * w).sum(axis=1)
    determinant = uu * vv - uv * uv
    apart = determinant > 1e-9 * np.maximum(uu * vv, _TINY)
    s = np.divide(uv * vw - vv * uw, determinant, out=np.full_like(uu, -1.0), where=apart)
    t = np.divide(uu * vw - uv * uw, determinant, out=np.full_like(uu, -1.0), where=apart)
    inner = apart & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    across = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    least = np.minimum.reduce([_to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b)])
    return np.asarray(np.where(inner, np.minimum(across, least), least))


def _to_segment(p: Floats, c: Floats, d: Floats) -> Floats:
    along = d - c
    share = np.clip(((p - c) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), _TINY), 0.0, 1.0)
    return np.asarray(np.linalg.norm(c + share[:, None] * along - p, axis=1))
