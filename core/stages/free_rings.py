"""Rings of equal forward distance at which the free-range profile is judged, and the codes that block them.

Used by free_space.py before free_walk.py."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner
from .free_geometry import ProfileCell, optical_depth
from .view_geometry import Q_FAR

_FINE_RINGS = 16
"""Number of rings half a step apart, the nearest ones: in a room free ranges are a few steps long."""


class Rings(NamedTuple):
    """The rings of a layer."""

    x: Any  # (R,) float32 forward distances, m, increasing
    blocking: Any  # (R,) int32, the least code that blocks a ring


@inner
def place_rings(step_m, clear_m, ring_m):
    """Writes the forward distances of the rings below clear_m: multiples of half of step_m for the first _FINE_RINGS,
    of step_m beyond them. Returns their number R; ring_m: (N,) float32 out, the first R are set, at most N."""
    for r in range(len(ring_m)):
        x = 0.5 * step_m * (r + 1) if r < _FINE_RINGS else step_m * (r + 1 - _FINE_RINGS // 2)
        if x >= clear_m:
            return r
        ring_m[r] = x
    return len(ring_m)


@inner
def least_blocking_code(gain, spread, cap, x):
    """Returns the least code whose pixel may lie at or before distance x, 2..65535.

    The measured distance X is reduced by its noise, min(spread X, cap) X. The reduced distance increases with X
    because cap <= 0.5, so there is one such code. The greatest code also stands for all that is nearer, and is always
    before x. Far pixels are behind all rings, which the walk limits to the range.

    Args:
        gain: f_px * lsb_per_px.
        spread: noise of distance over the square of the distance, 1/m.
        cap: greatest noise as a share of the distance.
        x: forward distance, m."""
    first, last = Q_FAR + 1, 65535
    for _ in range(17):
        if first >= last:
            break
        q = (first + last) // 2
        measured = gain / q
        if measured - min(spread * measured * measured, cap * measured) >= x:
            first = q + 1
        else:
            last = q
    return first


@inner
def blocking_codes(ring_m, edges_t, layers, w, blocking):
    """Computes `least_blocking_code` of each layer at each ring: blocking, (L, R) int32 out.

    The noise of forward distance is sigma_X = ke Z X: ring_noise is multiplied by the greatest Z/X of the layer.

    Args:
        ring_m: (R,) float32 forward distances.
        edges_t: (D + 1,) tangents of the directions.
        layers: (L + 1,) heights.
        w: a record of WALK_SETTINGS.
        blocking: (L, R) int32 out."""
    for layer in range(len(layers) - 1):
        whole = ProfileCell(edges_t[0], edges_t[-1], layers[layer], layers[layer + 1])
        for r in range(len(ring_m)):
            x = np.float64(ring_m[r])  # without the JIT the comparison would be in float32
            per_forward = optical_depth(whole, x, whole.bottom, w) / x
            blocking[layer, r] = least_blocking_code(
                w.gain, w.ring_noise * max(per_forward, 0.0), w.profile_noise_cap, x
            )
