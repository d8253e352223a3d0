"""Free-range profile of a frame: the free ranges of `observe_free`, limited by the planes, as horizontal ranges.

Input: `FreeObservation` and the planes. Output: `FreeProfile` of the model. Not in the paper."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..invalid_model import unknown_profile
from ..jit import inner
from ..params import Params
from ..types import NOTHING_OPEN, FreeEnd, FreeProfile
from .depth_bias import DepthBias, shorten_by_bias
from .free_space import FreeObservation, layer_edges
from .planes import distance_at

_OBSTACLE, _UNKNOWN = int(FreeEnd.OBSTACLE), int(FreeEnd.UNKNOWN)


class PlaneStops(NamedTuple):
    """Planes that end free ranges."""

    planes: NDArray[Any]  # (N,) PLANE
    margin_m: NDArray[np.float32]  # (N,), distance kept to each


@inner
def hidden_from(x, top, bottom, above, below):
    """Returns the forward distance from which a plane hides part of a layer that it does not reach into; inf if it
    does not.

    The plane hides the space between the lines of sight over its top and under its bottom.

    Args:
        x: forward distance of the plane, m.
        top, bottom: heights of the plane, z down, m.
        above, below: heights of the layer."""
    if below <= top:
        return x * below / top if top < 0.0 else math.inf
    return x * above / bottom if bottom > 0.0 else math.inf


@inner
def stop_at_planes(stops, seen):
    """Shortens the free ranges where a plane stops or hides a direction and layer.

    A plane that reaches into the layer ends the free range at its distance minus its margin. A plane above or below
    the layer ends it where the layer comes behind it. The edges of a plane are known to one pixel, so each plane is
    extended by one pixel on all sides. Its line is followed through that pixel, because one pixel of a plane that is
    seen edge-on spans metres.
    seen: FreeObservation. free_to_m and end are changed."""
    edges_t, layers, pixel_t = seen.edges_t, seen.layers_m, seen.pixel_t
    for k in range(len(stops.planes)):
        p = stops.planes[k]
        if p.support < 0:
            continue
        for d in range(len(edges_t) - 1):
            if edges_t[d] > p.t1 + pixel_t or edges_t[d + 1] < p.t0 - pixel_t:
                continue
            lo = min(max(edges_t[d], p.t0), p.t1)
            hi = max(min(edges_t[d + 1], p.t1), p.t0)
            x_lo, x_hi = distance_at(p, lo), distance_at(p, hi)
            x, row_m = min(x_lo, x_hi), seen.row_t * max(x_lo, x_hi)
            x = min(
                x, distance_at(p, max(edges_t[d], p.t0 - pixel_t)), distance_at(p, min(edges_t[d + 1], p.t1 + pixel_t))
            )
            top, bottom = p.top_m - row_m, p.bottom_m + row_m
            for layer in range(len(layers) - 1):
                if top < layers[layer + 1] and bottom > layers[layer]:
                    reach, cause = max(0.0, x - stops.margin_m[k]), _OBSTACLE
                else:
                    reach, cause = hidden_from(x, top, bottom, layers[layer], layers[layer + 1]), _UNKNOWN
                if reach < seen.free_to_m[d, layer]:
                    seen.free_to_m[d, layer] = reach
                    seen.end[d, layer] = cause


def empty_profile(params: Params) -> FreeProfile:
    """Returns the profile of an invalid frame: one direction all around without a free range."""
    return unknown_profile(np.array([-math.pi, math.pi], np.float32), layer_edges(params))


@inner
def as_ranges(edges_t, free_from, free_to):
    """Converts forward distances (D, L) to horizontal ranges, in place.

    The conservative edge of a direction is used: the shorter one for the end of the free range, the longer one for
    its begin."""
    for d in range(free_to.shape[0]):
        a, b = abs(edges_t[d]), abs(edges_t[d + 1])
        near = 0.0 if edges_t[d] * edges_t[d + 1] < 0.0 else min(a, b)
        for layer in range(free_to.shape[1]):
            free_from[d, layer] *= math.sqrt(1.0 + max(a, b) ** 2)
            free_to[d, layer] *= math.sqrt(1.0 + near**2)


def free_profile(
    seen: FreeObservation,
    stops: PlaneStops,
    bias: DepthBias,
    opened: FreeObservation | None = None,
    open_max_range_m: float = math.inf,
) -> FreeProfile:
    """Returns the free-range profile of a frame. `seen` and `opened` are modified.

    Args:
        seen: free ranges of `observe_free`.
        stops: the planes of the frame.
        opened: free or open ranges of `observe_open`; None: nothing is open.
        open_max_range_m: horizontal range beyond which nothing is open."""
    for s in (seen,) if opened is None else (seen, opened):
        stop_at_planes(stops, s)
        shorten_by_bias(bias, s.layers_m, s.free_to_m)
        as_ranges(s.edges_t, s.free_from_m, s.free_to_m)
    open_from, open_to = (
        (NOTHING_OPEN, NOTHING_OPEN) if opened is None else _beyond_free(seen, opened, open_max_range_m)
    )
    return FreeProfile(
        azimuth_edges_rad=seen.edges_rad.astype(np.float32),
        layer_edges_m=seen.layers_m,
        free_from_m=seen.free_from_m,
        free_to_m=seen.free_to_m,
        end=seen.end,
        open_from_dm=open_from,
        open_to_dm=open_to,
    )


def _beyond_free(
    seen: FreeObservation, opened: FreeObservation, most_m: float
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Returns (open_from_dm, open_to_dm) of FreeProfile, up to the horizontal range most_m."""
    to_m = np.minimum(opened.free_to_m, min(most_m, 25.5))
    first, last = np.ceil(10.0 * opened.free_from_m), np.floor(10.0 * to_m)
    farther = (last > first) & (0.1 * last > seen.free_to_m)
    first, last = (np.where(farther, edge, 0.0) for edge in (first, last))
    return first.astype(np.uint8), last.astype(np.uint8)
