"""Observed free space: for each direction and layer of height, the range that was measured to be free, and why it
ends.

Input: quantised disparity of the exact view, without pooling, and the ground. Output: `FreeObservation`, which
free_profile.py limits by the planes. The paper has no free space: its rectangles have a free side, but the space
between a pole and the wall behind it is unknown.

The search walks outward in rings of equal forward distance. A ring is free if `free_share` of the cells that cover
the layer there measure a greater distance. Unknown cells, cells outside of the source and ground that is too near are
not free. No column may be unknown over most of the layer: single missing pixels hide nothing, a column of them may
hide a pole or the end of a wall, see `columns_hide`.

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
from .free_begin import range_of_cell
from .free_cells import (
    DARK_ROWS,
    DarkColumns,
    Sampled,
    Samples,
    count_dark_blocks,
    look_at,
    looked_at,
    unknown_of_blocks,
)
from .free_geometry import ProfileCell, common_source_rows, walk_settings
from .free_holes import add_sides, find_holes, join_holes
from .free_rings import Rings, blocking_codes, place_rings
from .view_geometry import ViewGeometry

_MAX_RINGS = 250
"""Greatest number of rings; their index fits one byte. Space beyond them is not free."""


class ProfileGrid(NamedTuple):
    """What a profile is judged at: D directions, L layers, R rings."""

    edges_t: Any  # (D + 1,) float64, tangents of the edges of the directions
    layers: Any  # (L + 1,) float32, edges of the layers, z down, m
    ring_m: Any  # (R,) float32 forward distances, m
    blocking: Any  # (L, R) int32 of `blocking_codes`


@inner
def columns_of_direction(begin, cols, cu, f_u, t):
    """Returns (first, end) of the columns from `begin` on that have their middle before the tangent t; t = inf: of all.
    f_u: focal length along the columns."""
    end = begin
    while end < cols and (end - cu) / f_u < t:
        end += 1
    return begin, end


@inner
def overlapping_columns(columns, cols, begin, end):
    """Returns (first, end) of the columns that overlap a direction from column `begin` to `end` (float64; 0 is the middle
    of the first column).

    Those with their middle in it, `columns`, are sampled. An object that covers the column beside them may reach into the
    direction by up to half a column, and none of the sampled ones shows it."""
    u0, u1 = columns
    first = u0 - 1 if u0 > 0 and u0 - 0.5 > begin else u0
    return first, u1 + 1 if u1 < cols and u1 - 0.5 < end else u1


@kernel
def walk_view(codes, view, image, grid, w):
    """Returns free_from_m, free_to_m and end of FreeObservation for every direction and layer of a levelled view.

    codes, view: of the view without pooling; grid: ProfileGrid."""
    (cols, rows), edges_t, layers = codes.shape, grid.edges_t, grid.layers
    n, blocks = len(edges_t) - 1, (rows + w.block_rows - 1) // w.block_rows
    shape = (n, len(layers) - 1)
    free_from, free_to, ends = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.uint8)
    samples = Samples(
        np.empty(cols * (rows + 1) + 2, np.uint16),
        np.empty(blocks + 1, np.int64),
        np.empty(blocks + 1, np.int64),
        np.empty(rows, np.uint16),
    )
    looked = np.empty((2, rows), np.uint16)
    looked_at(rows, looked)
    unknown = unknown_of_blocks(codes)
    dark = DarkColumns(np.empty(cols, np.int64), np.empty((cols, rows // DARK_ROWS + 1), np.int16))
    holes = find_holes(unknown)
    add_sides(unknown, holes)
    own_holes, near_holes, joined = np.empty(rows, np.uint8), np.empty(rows, np.uint8), np.empty_like(holes[0])
    cu, f_u, u1 = view.cu, view.f_px / np.float64(view.lateral[0]), 0
    for d in range(n):
        columns = columns_of_direction(u1, cols, cu, f_u, edges_t[d + 1] if d < n - 1 else np.inf)
        u1 = columns[1]
        look_at(codes, columns, w.block_rows, looked, samples)
        over = overlapping_columns(columns, cols, cu + f_u * edges_t[d], cu + f_u * edges_t[d + 1])
        k = count_dark_blocks(unknown, over, dark)
        join_holes(codes, holes, over, joined, own_holes, near_holes)
        in_source = common_source_rows(view.H, columns, image, rows)
        of_direction = DarkColumns(dark.columns[:k], dark.blocks[:k])
        sampled = Sampled(codes, in_source, samples, of_direction, own_holes, near_holes)
        for layer in range(len(layers) - 1):
            cell = ProfileCell(edges_t[d], edges_t[d + 1], layers[layer], layers[layer + 1])
            begin, reach, end = range_of_cell(sampled, cell, Rings(grid.ring_m, grid.blocking[layer]), w)
            free_from[d, layer], free_to[d, layer], ends[d, layer] = begin, reach, end
    return free_from, free_to, ends


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


class FreeObservation(NamedTuple):
    """Free ranges by pixels alone, before they are limited by planes. Ranges are forward distances."""

    edges_rad: NDArray[np.float64]  # (D + 1,), azimuths of the edges of the directions
    edges_t: NDArray[np.float64]  # (D + 1,), their tangents
    pixel_t: float  # tangent of a column of the view
    row_t: float  # tangent of a row of the view
    layers_m: NDArray[np.float32]  # (L + 1,), edges of the layers, z down
    free_from_m: NDArray[np.float32]  # (D, L)
    free_to_m: NDArray[np.float32]  # (D, L)
    end: NDArray[np.uint8]  # (D, L) FreeEnd


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkedView:
    """A levelled view, and what is known of its frame."""

    codes: NDArray[np.uint16]  # without pooling
    geometry: ViewGeometry  # geometry of `codes`
    source: NDArray[Any]  # (1,) SOURCE
    ground: Ground
    ke_per_m: float


def observe_free(walked: WalkedView, params: Params) -> FreeObservation:
    """Returns the free ranges by the pixels of a view."""
    layers, g = layer_edges(params), walked.geometry
    settings = walk_settings(g, walked.source[0], walked.ground, walked.ke_per_m, params)
    edges, edges_t, (free_from, free_to, end) = ranges_of_view(walked.codes, g, walked.source, layers, settings)
    return FreeObservation(
        edges_rad=edges,
        edges_t=edges_t,
        pixel_t=float(g.lateral[0]) / g.f_px,
        row_t=1.0 / g.f_px,
        layers_m=layers,
        free_from_m=free_from,
        free_to_m=free_to,
        end=end,
    )


@kernel
def ranges_of_view(codes, view, source, layers, settings):
    """Returns edges_rad and edges_t of FreeObservation, and the result of `walk_view`.

    Directions are step_rad wide, except for the last one. See `place_rings` for the rings.

    Args:
        codes, view, source: `codes`, `geometry` and `source` of WalkedView.
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
    ring_m = ring_m[: place_rings(w.profile_ring_m, w.clear_m, ring_m)]
    blocking = np.empty((layers.shape[0] - 1, len(ring_m)), np.int32)
    blocking_codes(ring_m, edges_t, layers, w, blocking)
    return edges, edges_t, walk_view(codes, view, image, ProfileGrid(edges_t, layers, ring_m, blocking), w)
