"""What was seen to be free, what blocks it, and what nobody knows: the free-range profile.

Planes alone cannot answer "is it free?": between a pole and the wall behind it lies unknown. For each direction and layer
of height the profile walks outward in rings; a ring is free when `free_share` of the cells that look at the layer there
see farther. Unknown pixels, cells outside the source and ground that comes too early never count as seen.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .level import Q_FAR, ViewGeometry
from .params import Params
from .planes import P_SUPPORT, T0, T1, Z0, Z1, distance_at
from .types import FreeEnd, FreeProfile, Ground

_MAX_RINGS = 250
"""Rings are counted in one byte; beyond so many nothing is called free."""
_NOT_SEEN, _OBSTACLE, _UNKNOWN, _VIEW, _RANGE = (
    int(FreeEnd.NOT_SEEN), int(FreeEnd.OBSTACLE), int(FreeEnd.UNKNOWN), int(FreeEnd.FIELD_OF_VIEW), int(FreeEnd.MAX_RANGE),
)  # fmt: skip


@njit(cache=True, nogil=True)
def count_through(codes, direction, ring_of_code, rings, block_rows, through, unknown, cells):
    """Counts, per direction, block of rows and ring, the cells that see farther than that ring.

    codes: (cols, rows) uint16. direction: (cols,) int32. ring_of_code: (65536,) uint8, how many rings a code sees
    through (0: none, unknown). through: (D, B, rings + 1), unknown, cells: (D, B) int32, outputs."""
    through[:] = 0
    unknown[:] = 0
    cells[:] = 0
    cols, rows = codes.shape
    for u in range(cols):
        d = direction[u]
        for v in range(rows):
            code = codes[u, v]
            block = v // block_rows
            cells[d, block] += 1
            if code == 0:
                unknown[d, block] += 1
            else:
                through[d, block, ring_of_code[code]] += 1
    for d in range(through.shape[0]):
        for block in range(through.shape[1]):
            for k in range(rings):
                r = rings - 1 - k
                through[d, block, r] += through[d, block, r + 1]


@njit(cache=True, nogil=True)
def walk_rings(
    through, unknown, cells, ring_m, layers, lowest, rows, cv, f, block_rows, share, least_m, free_from, free_to, end
):  # fmt: skip
    """Walks each direction and layer outward; writes free_from, free_to (D, L) as forward distances and end.

    ring_m: (R,) float32 distances, ring r is seen through by through[.., r + 1]. lowest: (D, R) float64 z that is surely
    above the ground there: layers are judged down to it, where least_m is left of them."""
    for d in range(through.shape[0]):
        for layer in range(layers.shape[0] - 1):
            first, last, why = -1, -1, _NOT_SEEN
            for r in range(ring_m.shape[0]):
                x = ring_m[r]
                z0, z1 = layers[layer], min(layers[layer + 1], lowest[d, r])
                if z1 - z0 < least_m:
                    why = _NOT_SEEN if first < 0 else _VIEW
                    if first >= 0:
                        break
                    continue
                v0, v1 = math.floor(cv + f * z0 / x + 0.5), math.ceil(cv + f * z1 / x - 0.5)
                if v0 < 0 or v1 >= rows:
                    if first >= 0:
                        why = _VIEW
                        break
                    continue
                seen, dark, total = 0, 0, 0
                for block in range(int(v0) // block_rows, int(v1) // block_rows + 1):
                    seen += through[d, block, r + 1]
                    dark += unknown[d, block]
                    total += cells[d, block]
                if total > 0 and seen >= share * total:
                    if first < 0:
                        first = r
                    last = r
                    why = _RANGE
                elif first >= 0 or total - seen - dark > (1.0 - share) * total:
                    why = _OBSTACLE if total - seen - dark >= dark else _UNKNOWN
                    break
                else:
                    why = _UNKNOWN
            end[d, layer] = why
            free_from[d, layer] = ring_m[first] if first >= 0 else 0.0
            free_to[d, layer] = ring_m[last] if first >= 0 else 0.0


@njit(cache=True, nogil=True)
def stop_at_planes(count, planes, plane_ints, margin, edges_t, layers, free_to, end):
    """No free range passes a plane: shortens free_to to the nearest plane of the direction and layer less its margin."""
    for k in range(count):
        p = planes[k]
        if plane_ints[k, P_SUPPORT] < 0:
            continue
        for d in range(edges_t.shape[0] - 1):
            lo, hi = max(edges_t[d], p[T0]), min(edges_t[d + 1], p[T1])
            if lo > hi:
                continue
            x = min(distance_at(p, lo), distance_at(p, hi)) - margin[k]
            for layer in range(layers.shape[0] - 1):
                if p[Z0] < layers[layer + 1] and p[Z1] > layers[layer] and x < free_to[d, layer]:
                    free_to[d, layer] = max(0.0, x)
                    end[d, layer] = _OBSTACLE


def layer_edges(params: Params) -> NDArray[np.float32]:
    """(L + 1,) float32 edges of the profile's layers in z: Hd tall, one centred on the camera."""
    half = 0.5 * params.profile_layers * params.segment_height_m
    return np.linspace(-half, half, params.profile_layers + 1).astype(np.float32)


def nothing_known(params: Params) -> FreeProfile:
    """The profile of a frame that says nothing: one direction all around, no free range."""
    layers = layer_edges(params)
    zero = np.zeros((1, len(layers) - 1), np.float32)
    return FreeProfile(
        azimuth_edges_rad=np.array([-math.pi, math.pi], np.float32), layer_edges_m=layers, free_from_m=zero,
        free_to_m=zero, end=np.full(zero.shape, _NOT_SEEN, np.uint8),
    )  # fmt: skip


def lowest_clear(
    ground: Ground, ring_m: NDArray[np.float32], t: NDArray[np.float64], ke: float, params: Params
) -> NDArray[np.float64]:
    """(D, R) z down to which free space can be told from ground, for directions t and distances ring_m.

    What is lower than the ground's tolerance or its noise at that distance was taken for ground: nothing is known
    about it. No ground: no bound, what lies low is then an obstacle like any other."""
    if not ground.seen:
        return np.full((len(t), len(ring_m)), 1e6)
    x = ring_m[None, :].astype(np.float64)
    tolerance = np.maximum(params.ground_tolerance_m, params.ground_sigmas * ke * x * ground.height_m)
    return np.asarray(ground.height_m + (ground.slope_x + ground.slope_y * t[:, None]) * x - tolerance)


def free_profile(
    codes: NDArray[np.uint16], g: ViewGeometry, ground: Ground, clear_m: float, ke: float, params: Params,
    count: int, planes: NDArray[np.float64], plane_ints: NDArray[np.int32], margin: NDArray[np.float32],
) -> FreeProfile:  # fmt: skip
    """The free-range profile of a levelled frame; see FreeProfile. planes: columns of planes.py, margin: (N,) m.
    clear_m: how far a FAR cell is free (classify.clear_range_m)."""
    f_u = g.f_px / float(g.lateral[0])
    step = math.radians(params.profile_step_deg)
    first, last = math.atan((-0.5 - g.cu) / f_u), math.atan((g.cols - 0.5 - g.cu) / f_u)
    n = max(1, math.ceil((last - first) / step))
    edges = first + step * np.arange(n + 1)
    edges[-1] = last
    edges_t = np.tan(edges)
    column_t = (np.arange(g.cols) - g.cu) / f_u
    direction = np.clip(np.searchsorted(edges_t, column_t, side="right") - 1, 0, n - 1).astype(np.int32)
    ring_m = np.arange(params.profile_ring_m, clear_m, params.profile_ring_m).astype(np.float32)[:_MAX_RINGS]
    rings = len(ring_m)
    # a cell sees through a ring when it measures farther than its own noise behind it
    x = g.f_px * g.quantum / np.maximum(np.arange(65536), 1)
    behind = np.minimum(params.profile_sigmas * ke * x * x, params.profile_noise_cap * x)
    ring_of_code = np.searchsorted(ring_m, x - behind, side="right").astype(np.uint8)
    ring_of_code[Q_FAR] = rings
    ring_of_code[0] = 0
    blocks = -(-g.rows // params.profile_block_px)
    through = np.empty((n, blocks, rings + 1), np.int32)
    unknown, cells = np.empty((n, blocks), np.int32), np.empty((n, blocks), np.int32)
    count_through(codes, direction, ring_of_code, rings, params.profile_block_px, through, unknown, cells)
    layers = layer_edges(params)
    free_from, free_to = np.empty((n, len(layers) - 1), np.float32), np.empty((n, len(layers) - 1), np.float32)
    end = np.empty(free_to.shape, np.uint8)
    middle_t = 0.5 * (edges_t[1:] + edges_t[:-1])
    walk_rings(
        through, unknown, cells, ring_m, layers, lowest_clear(ground, ring_m, middle_t, ke, params), g.rows, g.cv, g.f_px,
        params.profile_block_px, params.free_share, params.profile_least_m, free_from, free_to, end,
    )  # fmt: skip
    stop_at_planes(count, planes, plane_ints, margin, edges_t, layers, free_to, end)
    # forward distance to horizontal range: the shorter of both edges for what is free, the longer for where it begins
    near, far = (
        np.minimum(np.abs(edges_t[1:]), np.abs(edges_t[:-1])),
        np.maximum(np.abs(edges_t[1:]), np.abs(edges_t[:-1])),
    )
    near = np.where(edges_t[1:] * edges_t[:-1] < 0, 0.0, near)
    return FreeProfile(
        azimuth_edges_rad=edges.astype(np.float32), layer_edges_m=layers,
        free_from_m=(free_from * np.sqrt(1 + far**2)[:, None]).astype(np.float32),
        free_to_m=(free_to * np.sqrt(1 + near**2)[:, None]).astype(np.float32), end=end,
    )  # fmt: skip
