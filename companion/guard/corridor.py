"""The corridor along a path, and how far each of its rays is free.

Rays are parallel to the path, ACROSS at each height of the band of `[avoid]`, always in the same order. All coordinates are
in `level` at the instant of a decision."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..autopilot.polar_histogram import inner_heights
from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
FreePlaces = Callable[[Floats, Floats, Floats], Bools]
"""Returns which places are free, (len(z), *x.shape). x, y: of one shape; z: (heights,)."""
ACROSS = 5
"""Number of rays across the corridor."""
PIECE_M = 2.0
"""Along a sloping path the height band is moved once per piece of this length."""


@dataclass(frozen=True, slots=True)
class Path:
    """The middle of a corridor."""

    # cos, sin: its direction in level
    cos: float
    sin: float
    slope: float  # dz/ds, positive down
    from_m: float = 0.0  # obstacles nearer than this do not lie in the corridor

    def beside(self, angle_rad: float, from_m: float = 0.0) -> Path:
        """Returns a path at an angle clockwise from this one."""
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        return Path(c * self.cos - s * self.sin, c * self.sin + s * self.cos, self.slope, from_m)


def half_width_m(avoid: AvoidParams, guard: GuardParams) -> float:
    """Returns half of the width of the corridor."""
    return avoid.radius_m + guard.side_m


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Places on the rays of a corridor."""

    along_m: Floats  # (N,) distances along the path
    # x, y: (ACROSS, N)
    x: Floats
    y: Floats
    z: Floats  # (heights,) of a level path
    slope: float  # of the path

    def found(self, free: FreePlaces) -> Bools:
        """Returns which samples are free, (heights, ACROSS, N)."""
        out = np.zeros((len(self.z), *self.x.shape), bool)
        for piece in self._pieces():
            z = self.z + self.slope * float(self.along_m[piece].mean())
            out[:, :, piece] = free(self.x[:, piece], self.y[:, piece], z)
        return out

    def rays_m(self, found: Bools) -> Floats:
        """Returns the distance to which each ray is free without a gap, (heights * ACROSS,); 0 where it is not. found: see
        `found`."""
        steps = np.logical_and.accumulate(found, axis=2).sum(axis=2).ravel()
        out: Floats = np.where(steps > 0, self.along_m[steps - 1], 0.0)
        return out

    def _pieces(self) -> list[slice]:
        """Returns slices of the samples along the path; one for a level path."""
        if abs(self.slope) < 0.02:
            return [slice(0, len(self.along_m))]
        step = max(1, round(PIECE_M / float(self.along_m[1] - self.along_m[0])))
        return [slice(k, k + step) for k in range(0, len(self.along_m), step)]


def samples_of(path: Path, avoid: AvoidParams, guard: GuardParams) -> Samples:
    """Returns the samples of a corridor, from near_m to horizon_m."""
    along = np.arange(avoid.near_m, guard.horizon_m + avoid.step_m, avoid.step_m)
    across = np.linspace(-1.0, 1.0, ACROSS) * half_width_m(avoid, guard)
    return Samples(
        along_m=along,
        x=path.cos * along[None, :] - path.sin * across[:, None],
        y=path.sin * along[None, :] + path.cos * across[:, None],
        z=-avoid.band_above_m
        + (np.arange(avoid.slices) + 0.5) / avoid.slices * (avoid.band_above_m + avoid.band_below_m),
        slope=path.slope,
    )


def common_free_m(rays_m: Floats, clear_share: float) -> float:
    """Returns the distance to which clear_share of the rays are seen free, at least 0."""
    farthest_first = np.sort(rays_m)[::-1]
    return max(0.0, float(farthest_first[math.ceil(clear_share * len(rays_m)) - 1]))


def seen_at_heights_m(rays_m: Floats, inner: slice) -> float:
    """Returns the distance to which each of these heights is seen free in at least one ray, at least 0.

    All that clear_share leaves out may be one thing without texture, as a bar across the path.

    Args:
        rays_m: (heights * ACROSS,).
        inner: heights, see `inner_heights`."""
    return max(0.0, float(rays_m.reshape(-1, ACROSS)[inner].max(axis=1).min()))


def corridor_free_m(rays_m: Floats, avoid: AvoidParams) -> float:
    """Returns the distance to which a corridor is seen free, by the rules for sectors: clear_share of the rays, and all
    heights but the outermost ones. rays_m: (slices * ACROSS,)."""
    return min(common_free_m(rays_m, avoid.clear_share), seen_at_heights_m(rays_m, inner_heights(avoid)))
