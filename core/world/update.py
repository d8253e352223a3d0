"""Adds one frame to the world: observed free space, planes observed again, new planes, and planes observed to be clear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel, record_of
from ..types import FrameModel
from .association import (
    O_FLAGS,
    WORLD_RULES,
    absorb_plane,
    add_observation,
    box_of,
    moved_moments,
    new_plane,
    observation_box,
    put_box,
    score_observation,
    score_planes,
    stays_open,
)
from .free_grid import stand_in
from .params import WorldParams
from .plane_index import ANCHOR_X, ANCHOR_Y, FLAGS, HITS, MARGIN, Tables, gather, new_slot
from .removal import count_clear_view, cut_cleared

_LEAST_M = 0.01
"""Not tuning: a plane shorter than this has no direction."""
_NEAR = 4096
"""Planes considered for one plane, or for the view of one frame; more are counted as overflow."""
_JOINS = 4
"""Not tuning: neighbours that one plane may take in at one frame; others follow with the next."""


def rules_of(p: WorldParams) -> NDArray[Any]:
    """(1,) WORLD_RULES."""
    return record_of(
        WORLD_RULES,
        p,
        turn_cos=math.cos(math.radians(p.plane_angle_deg)),
        gap_m=p.passable_width_m,
        noise_cap_m=p.join_noise_cap_m,
        corner_m=p.join_corner_m,
        behind_m=p.free_evidence_behind_m,
        step_m=p.free_evidence_step_m,
    )


def observations_of(model: FrameModel, place_m: tuple[float, float, float], p: WorldParams) -> NDArray[np.float64]:
    """(N, 10) float64: box, margin, weight of each metre, noise, flags of the planes of a frame in the world's frame.

    Planes with a number that is none, and those without a length, are left out. Weight is inverse variance: of the noise
    sigma = ke r^2 at the plane's nearest point to the camera's foot, and of the frame's own error."""
    planes, margin = model.planes.astype(np.float64), model.margin_m.astype(np.float64)
    along = planes[:, 2:4] - planes[:, 0:2]
    length2 = (along**2).sum(axis=1)
    good = np.isfinite(planes).all(axis=1) & np.isfinite(margin) & (length2 >= _LEAST_M**2)
    planes, margin, along, length2 = planes[good], margin[good], along[good], length2[good]
    to = np.array(place_m[:2]) - planes[:, 0:2]
    share = np.clip((to * along).sum(axis=1) / length2, 0.0, 1.0)[:, None]
    range_m = np.linalg.norm(to - share * along, axis=1)
    sigma = model.ke_per_m * range_m**2
    weight = 1.0 / (sigma**2 + p.pose_sigma_m**2 + 1e-6)
    return np.column_stack([planes, margin, weight, sigma, model.flags[good].astype(np.float64)])


@inner
def add_observations(tables, free, observations, rules, t_ns, near, touched):
    """Adds each observation to the plane that it fits best, or makes a new one; returns how many slots are in `touched`."""
    box, ints = tables[0], tables[3]
    grow, count = rules.gap_m, 0
    for j in range(observations.shape[0]):
        b = observation_box(observations, j)
        n = gather(
            tables, min(b[0], b[2]) - grow, min(b[1], b[3]) - grow, max(b[0], b[2]) + grow, max(b[1], b[3]) + grow,
            b[4], b[5], near,
        )  # fmt: skip
        best, best_cost = -1, 1.0
        for m in range(n):
            found, _share = score_observation(tables, near[m], observations, j, rules)
            if not found[0] < best_cost:
                continue
            flags = ints[near[m], FLAGS] | int(observations[j, O_FLAGS])
            if stays_open(free, box_of(box, near[m]), b, flags, found[5], rules):
                continue
            best, best_cost = near[m], found[0]
        if best >= 0 and ints[best, HITS] > 0:
            found, share = score_observation(tables, best, observations, j, rules)
            add_observation(tables, best, observations, j, found, share, rules, t_ns)
        else:
            best = new_plane(tables, observations, j, t_ns)
        touched[count] = best
        count += 1
    return count


@inner
def join_neighbours(tables, free, i, rules, near):
    """Slot i takes in the neighbours that are one with it by now."""
    box, ints = tables[0], tables[3]
    grow = rules.gap_m
    for _ in range(_JOINS):
        if ints[i, HITS] == 0:
            return
        a = box_of(box, i)
        n = gather(
            tables, min(a[0], a[2]) - grow, min(a[1], a[3]) - grow, max(a[0], a[2]) + grow, max(a[1], a[3]) + grow,
            a[4], a[5], near,
        )  # fmt: skip
        best, best_cost = -1, 1.0
        for m in range(n):
            if near[m] == i:
                continue
            found = score_planes(tables, i, near[m], rules)
            if not found[0] < best_cost:
                continue
            if stays_open(free, a, box_of(box, near[m]), ints[near[m], FLAGS] | ints[i, FLAGS], found[5], rules):
                continue
            best, best_cost = near[m], found[0]
        if best < 0:
            break
        absorb_plane(tables, i, best, score_planes(tables, i, best, rules), rules)


@kernel
def add_frame(tables, free, observations, settings, t_ns, view):
    """One frame's observations (N, 10), and its free profile. settings: (1,) WORLD_RULES; view: FrameView."""
    rules = settings[0]
    near, touched = np.empty(_NEAR, np.int32), np.empty(observations.shape[0], np.int32)
    count = add_observations(tables, free, observations, rules, t_ns, near, touched)
    for j in range(observations.shape[0]):
        b = observation_box(observations, j)
        stand_in(free, b[0], b[1], b[2], b[3], b[4], b[5])
    for k in range(count):
        join_neighbours(tables, free, touched[k], rules, near)
    x, y, layers = view.x_m, view.y_m, view.layers_m
    reach = 0.0
    for d in range(view.far_m.shape[0]):
        for k in range(view.far_m.shape[1]):
            reach = max(reach, view.far_m[d, k])
    n = gather(tables, x - reach, y - reach, x + reach, y + reach, layers[0], layers[layers.shape[0] - 1], near)
    for m in range(n):
        count_clear_view(tables, near[m], rules, view)
    for m in range(n):
        cut_cleared(tables, near[m], rules)


def table_bytes(tables: Tables) -> int:
    """Bytes of memory of all tables."""
    return sum(t.nbytes for t in tables)


@kernel
def put_rows(tables, free, box, moments, margin, flags, hits, seen_ns, settings, join):
    """Planes of a saved world into slots, oldest first; join: those that are one with what is there are joined.

    box (N, 6) float64; moments (N, 6) float64 about the middle of each; the rest (N,)."""
    rules, near = settings[0], np.empty(_NEAR, np.int32)
    for k in range(box.shape[0]):
        i = new_slot(tables, seen_ns[k])
        floats, ints = tables[2], tables[3]
        x, y = 0.5 * (box[k, 0] + box[k, 2]), 0.5 * (box[k, 1] + box[k, 3])
        floats[i, ANCHOR_X], floats[i, ANCHOR_Y], floats[i, MARGIN] = x, y, margin[k]
        # the anchor is float32: the moments are moved to where it is
        dx, dy, m = x - float(floats[i, ANCHOR_X]), y - float(floats[i, ANCHOR_Y]), moments[k]
        n = moved_moments((m[0], m[1], m[2], m[3], m[4], m[5]), dx, dy)
        for c in range(6):
            tables[1][i, c] = n[c]
        ints[i, FLAGS], ints[i, HITS] = flags[k], max(1, hits[k])
        put_box(tables, i, box[k, 0], box[k, 1], box[k, 2], box[k, 3], box[k, 4], box[k, 5])
        if join:
            join_neighbours(tables, free, i, rules, near)
