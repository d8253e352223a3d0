"""Observed free space: for each direction and layer of height, the range that was measured to be free, and why it
ends.

Input: quantised disparity of the exact view, without pooling, and the ground. Output: `FreeObservation`, which
free_profile.py limits by the planes. The paper has no free space: its rectangles have a free side, but the space
between a pole and the wall behind it is unknown.

The search walks outward in rings of equal forward distance. A ring is free if `free_share` of the cells that cover
the layer there measure a greater distance. Unknown cells, cells outside of the source and ground that is too near are
not free. No column may be unknown over most of the layer: single missing pixels hide nothing, a column of them may
hide a pole or the end of a wall. See `hiding_columns` for columns that overlap the direction in part.

The range of the camera is an optical depth Z, while rings are forward distances X in level_cam. A ring is free only
if its whole layer lies within the range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from ..params import Params
from ..types import Ground
from .free_begin import begin_of_range
from .free_cells import DARK_ROWS, count_dark_blocks, look_at, looked_at, unknown_of_blocks
from .free_holes import find_holes, join_holes
from .free_walk import Sampled, blocking_codes, common_source_rows, rows_of_rings, walk_rings, walk_settings
from .view_geometry import ViewGeometry

_MAX_RINGS = 250
"""Greatest number of rings; their index fits one byte. Space beyond them is not free."""
_FINE_RINGS = 16
"""Number of rings half a step apart, the nearest ones: in a room free ranges are a few steps long."""


class FreeRanges(NamedTuple):
    """Free ranges of D directions and L layers.

    Attributes:
        free_from: (D, L) float32 forward distance, m.
        free_to: (D, L) float32 forward distance, m.
        end: (D, L) uint8 FreeEnd."""

    free_from: Any
    free_to: Any
    end: Any


@inner
def overlapping_columns(u0, u1, cols, begin, end):
    """Returns (first, end) of the columns that overlap a direction from column `begin` to `end` (float64; 0 is the middle
    of the first column).

    Those with their middle in it, u0..u1 - 1, are sampled. A thing that covers the column beside them may reach into the
    direction by up to half a column, and none of the sampled ones shows it."""
    first = u0 - 1 if u0 > 0 and u0 - 0.5 > begin else u0
    return first, u1 + 1 if u1 < cols and u1 - 0.5 < end else u1


@kernel
def walk_view(codes, view, image, edges_t, blocking, ring_m, layers, w, out):
    """Computes the free ranges of every direction and layer of a levelled view.

    Args:
        codes: (cols, rows) uint16 of the view without pooling.
        view: ViewGeometry.
        image: a record of SOURCE.
        edges_t: (D + 1,) float64.
        blocking: (L, R) int32 of `blocking_codes`.
        ring_m: (R,) float32.
        layers: (L + 1,) float32.
        w: a record of WALK_SETTINGS.
        out: FreeRanges."""
    cols, rows = codes.shape
    block, cu, f_u = w.block_rows, view.cu, view.f_px / np.float64(view.lateral[0])
    cells, begin = np.empty(cols * (rows + 1) + 2, np.uint16), np.empty((rows + block - 1) // block + 1, np.int64)
    dark, unknown = np.empty(begin.shape[0], np.int64), np.empty(rows, np.uint16)
    looked, layer_rows = np.empty((2, rows), np.uint16), np.empty((len(layers) - 1, len(ring_m), 2), np.int64)
    unknown_blocks = unknown_of_blocks(codes)
    holes, dark_blocks = find_holes(unknown_blocks), np.empty((cols, rows // DARK_ROWS + 1), np.int16)
    dark_columns = np.empty(cols, np.int64)
    own_holes, near_holes = np.empty(holes.shape[1], np.uint8), np.empty(holes.shape[1], np.uint8)
    looked_at(rows, looked)
    rows_of_rings(ring_m, layers, w, layer_rows)
    H = view.H
    u1 = 0
    for d in range(len(edges_t) - 1):
        u0 = u1
        while u1 < cols and (d == len(edges_t) - 2 or (u1 - cu) / f_u < edges_t[d + 1]):
            u1 += 1
        look_at(codes, u0, u1, block, looked, unknown, cells, begin, dark)
        in_source = common_source_rows(H, u0, u1, image.width_px, image.height_px, rows)
        left, right = overlapping_columns(u0, u1, cols, cu + f_u * edges_t[d], cu + f_u * edges_t[d + 1])
        n = count_dark_blocks(unknown_blocks, left, right, dark_blocks, dark_columns)
        join_holes(holes, left, right, own_holes, near_holes)
        sampled = Sampled(
            cells, begin, dark, in_source, codes, (u0, u1), dark_columns[:n], dark_blocks[:n], own_holes, near_holes
        )
        for layer in range(len(layers) - 1):
            t0, t1, top, bottom = edges_t[d], edges_t[d + 1], layers[layer], layers[layer + 1]
            codes_of, rows_of = blocking[layer], layer_rows[layer]
            first, last, end = walk_rings(sampled, t0, t1, ring_m, codes_of, rows_of, top, bottom, w)
            out.end[d, layer] = end
            out.free_from[d, layer] = ring_m[first] if first >= 0 else 0.0
            out.free_to[d, layer] = ring_m[last] if first >= 0 else 0.0
            if 0 < first < last:  # one ring alone gives no range
                before, x = ring_m[first - 1], ring_m[first]
                out.free_from[d, layer] = begin_of_range(
                    sampled, t0, t1, before, x, codes_of[first], rows_of[first], top, bottom, w
                )


def layer_edges(params: Params) -> NDArray[np.float32]:
    """Returns the edges of the profile's layers, (L + 1,) float32 z in metres, increasing, read-only.

    Inner layers are centred on the height of the camera. Outer layers extend above and below them to profile_reach_m,
    if that is farther than the inner layers reach."""
    p = params
    return _layer_edges(p.profile_layers, p.profile_layer_m, p.profile_outer_layers, p.profile_reach_m)


@lru_cache(maxsize=16)
def _layer_edges(inner: int, inner_m: float, outer: int, reach_m: float) -> NDArray[np.float32]:
    edges = inner_m * (np.arange(inner + 1) - 0.5 * inner)
    if outer and reach_m > edges[-1]:
        beyond = np.linspace(edges[-1], reach_m, outer + 1)[1:]
        edges = np.concatenate((-beyond[::-1], edges, beyond))
    edges = edges.astype(np.float32)
    edges.setflags(write=False)
    return edges


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeObservation:
    """Free ranges by pixels alone, before they are limited by planes. Ranges are forward distances.

    Attributes:
        edges_rad: (D + 1,) float64, azimuths of the edges of the directions.
        edges_t: (D + 1,) float64, their tangents.
        pixel_t: tangent of a column of the view.
        row_t: tangent of a row of the view.
        layers_m: (L + 1,) float32, edges of the layers, z down.
        free_from_m: (D, L) float32.
        free_to_m: (D, L) float32.
        end: (D, L) uint8 FreeEnd."""

    edges_rad: NDArray[np.float64]
    edges_t: NDArray[np.float64]
    pixel_t: float
    row_t: float
    layers_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]


def observe_free(
    codes: NDArray[np.uint16], view: ViewGeometry, source: NDArray[Any], ground: Ground, ke_per_m: float, params: Params
) -> FreeObservation:
    """Returns the free ranges by the pixels of a levelled view without pooling.

    Args:
        codes: (cols, rows) uint16.
        view: geometry of `codes`.
        source: (1,) SOURCE.
        ground: ground of the frame.
        ke_per_m: noise coefficient.
        params: parameters."""
    layers = layer_edges(params)
    settings = walk_settings(view, source[0], ground, ke_per_m, params)
    edges, edges_t, free_from, free_to, end = ranges_of_view(codes, view, source, layers, settings)
    return FreeObservation(
        edges_rad=edges,
        edges_t=edges_t,
        pixel_t=float(view.lateral[0]) / view.f_px,
        row_t=1.0 / view.f_px,
        layers_m=layers,
        free_from_m=free_from,
        free_to_m=free_to,
        end=end,
    )


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


@kernel
def ranges_of_view(codes, view, source, layers, settings):
    """Returns (edges_rad, edges_t, free_from_m, free_to_m, end) of FreeObservation.

    Directions are step_rad wide, except for the last one. See `place_rings` for the rings.

    Args:
        codes, view, source: see `observe_free`.
        layers: of `layer_edges`.
        settings: (1,) WALK_SETTINGS."""
    w, image = settings[0], source[0]
    cu, f_u, step_rad = view.cu, view.f_px / np.float64(view.lateral[0]), w.step_rad
    first, last = math.atan((-0.5 - cu) / f_u), math.atan((codes.shape[0] - 0.5 - cu) / f_u)
    n = max(1, int(math.ceil((last - first) / step_rad)))
    edges, edges_t = np.empty(n + 1), np.empty(n + 1)
    for d in range(n + 1):
        edges[d] = first + step_rad * d if d < n else last
        edges_t[d] = math.tan(edges[d])
    ring_m = np.empty(_MAX_RINGS, np.float32)
    ring_m = ring_m[: place_rings(w.ring_m, w.clear_m, ring_m)]
    blocking = np.empty((layers.shape[0] - 1, len(ring_m)), np.int32)
    blocking_codes(ring_m, edges_t, layers, w, blocking)
    shape = (n, layers.shape[0] - 1)
    free_from, free_to, end = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.uint8)
    walk_view(codes, view, image, edges_t, blocking, ring_m, layers, w, FreeRanges(free_from, free_to, end))
    return edges, edges_t, free_from, free_to, end
