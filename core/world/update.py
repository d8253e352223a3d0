"""Adds one frame to the merged world: free space, planes observed again, new planes, and planes observed to be clear."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel, record, record_of
from ..types import FrameModel
from .association import (
    OBSERVATION,
    absorb_plane,
    add_observation,
    new_plane,
    put_box,
    put_moments,
    score_observation,
    score_planes,
)
from .evidence import set_hits
from .free_removal import remove_free
from .join_cost import (
    REFUSED,
    WORLD_RULES,
    Box,
    Joined,
    Moments,
    box_of,
    moved_moments,
    shifted,
    stands_for,
    stays_open,
)
from .params import WorldParams
from .plane_index import BOX, MOMENTS, NONE, gather, new_slot
from .removal import count_clear_view, cut_cleared

_LEAST_M = 0.01
"""A shorter plane has no direction."""
_NEAR = 4096
"""Greatest number of planes considered for one plane, or for the view of one frame; more are counted as overflow."""
_SHORT_MEMORY = 0.1
"""Share of the past of a plane that is kept where all of it would keep the plane away from what is in view."""
_JOINS = 4
"""Greatest number of neighbours that one plane absorbs per frame; others follow with later frames."""

_MEMORY_FRAMES = 40.0
"""Earlier observations of a plane count at most as this many new ones, so that drift is followed."""


def rules_of(p: WorldParams) -> NDArray[Any]:
    """Returns (1,) WORLD_RULES."""
    return record_of(WORLD_RULES, p, gap_m=p.passable_width_m)


def observations_of(model: FrameModel, place_m: tuple[float, float, float], p: WorldParams) -> NDArray[Any]:
    """Returns (N,) OBSERVATION of the planes of a frame, in the frame of the world.

    Planes that are not finite or have no length are left out. The weight is the inverse variance of the noise, sigma
    = ke r^2 at the nearest point of the plane, and of the position of the frame."""
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
    out = np.zeros(len(planes), OBSERVATION)
    for k, name in enumerate(BOX):
        out[name] = planes[:, k]
    out["margin_m"], out["weight"], out["sigma_m"], out["plane_flags"] = margin, weight, sigma, model.flags[good]
    return out


@inner
def gather_around(tables, box, grow, near):
    """Writes the slots of planes within `grow` of a box, at its heights, to `near`; returns their number."""
    x0, y0 = min(box.ax, box.bx) - grow, min(box.ay, box.by) - grow
    x1, y1 = max(box.ax, box.bx) + grow, max(box.ay, box.by) + grow
    return gather(tables, x0, y0, x1, y1, box.top, box.bottom, near)


class Frame(NamedTuple):
    """The observations of one frame."""

    observations: Any  # (N,) OBSERVATION
    touched: Any  # (N,) int32, the slot that each was added to
    rules: Any  # a record of WORLD_RULES
    x_m: Any  # x_m, y_m: place of the camera
    y_m: Any


@inner
def fitted(plane, seen, frame):
    """Returns Joined of a plane and an observation, and how many observations the plane's past counts as.

    Where the past keeps the plane away from the observation, as while the position drifts, most of it is given up.
    plane: a record of SLOT; seen: a record of OBSERVATION; frame: Frame."""
    x, y, rules = float(plane.anchor_x_m), float(plane.anchor_y_m), frame.rules
    box, memory = shifted(box_of(seen), x, y), _MEMORY_FRAMES
    found, _share = score_observation(plane, seen, rules, memory)
    if found.cost >= 1.0 or stands_for(found, box, seen.sigma_m, frame.x_m - x, frame.y_m - y):
        return found, memory
    memory *= _SHORT_MEMORY
    found, _share = score_observation(plane, seen, rules, memory)
    if found.cost < 1.0 and not stands_for(found, box, seen.sigma_m, frame.x_m - x, frame.y_m - y):
        found = Joined(REFUSED, found.ax, found.ay, found.bx, found.by, found.gap)
    return found, memory


@inner
def add_observations(tables, free, frame, t_ns, near):
    """Adds each observation of a Frame to the plane that it fits best, or creates a plane."""
    planes, observations, rules = tables.planes, frame.observations, frame.rules
    for j in range(observations.shape[0]):
        seen = observations[j]
        b = box_of(seen)
        n = gather_around(tables, b, rules.gap_m, near)
        best, best_cost, best_memory = -1, 1.0, _MEMORY_FRAMES
        for m in range(n):
            plane = planes[near[m]]
            found, memory = fitted(plane, seen, frame)
            if not found.cost < best_cost:
                continue
            flags = plane.plane_flags | seen.plane_flags
            if stays_open(free, box_of(plane), plane.cut, b, 0, flags, found.gap):
                continue
            best, best_cost, best_memory = near[m], found.cost, memory
        if best >= 0 and planes[best].hits > 0:
            add_observation(tables, best, seen, frame, best_memory, t_ns)
        else:
            best = new_plane(tables, seen, t_ns)
        frame.touched[j] = best


@inner
def keeps_observed(found, plane, i, k, frame):
    """True if a plane joined of slots i and k stands for what this frame observed of both.

    A plane with an old part might otherwise be moved away from an object that is in view. found: Joined, relative to the
    anchor of `plane`; frame: Frame."""
    x, y = float(plane.anchor_x_m), float(plane.anchor_y_m)
    for j in range(frame.touched.shape[0]):
        if frame.touched[j] == i or frame.touched[j] == k:
            seen = frame.observations[j]
            box = shifted(box_of(seen), x, y)
            if not stands_for(found, box, seen.sigma_m, frame.x_m - x, frame.y_m - y):
                return False
    return True


@inner
def join_neighbours(tables, free, i, frame, near):
    """Joins slot i with neighbours that are now one plane with it. frame: Frame."""
    planes, rules = tables.planes, frame.rules
    plane = planes[i]
    for _ in range(_JOINS):
        if plane.hits == 0:
            return
        a = box_of(plane)
        n = gather_around(tables, a, rules.gap_m, near)
        best, best_cost = -1, 1.0
        for m in range(n):
            if near[m] == i:
                continue
            other = planes[near[m]]
            found = score_planes(plane, other, rules)
            if not found.cost < best_cost or not keeps_observed(found, plane, i, near[m], frame):
                continue
            flags = plane.plane_flags | other.plane_flags
            if stays_open(free, a, plane.cut, box_of(other), other.cut, flags, found.gap):
                continue
            best, best_cost = near[m], found.cost
        if best < 0:
            break
        absorb_plane(tables, i, best, rules)
        for j in range(frame.touched.shape[0]):
            if frame.touched[j] == best:
                frame.touched[j] = i


@kernel
def add_frame(tables, free, observations, arrived, newer, settings, t_ns, view):
    """Adds the observations and the free profile of one frame.

    arrived: (N,) bool, those that stand in what was free before, see free_removal.py; newer: (M,) OBSERVATION of frames
    that were exposed later and added before."""
    rules = settings[0]
    near, touched = np.empty(_NEAR, np.int32), np.full(observations.shape[0], NONE, np.int32)
    frame = Frame(observations, touched, rules, view.x_m, view.y_m)
    add_observations(tables, free, frame, t_ns, near)
    remove_free(free, observations, arrived, view.x_m, view.y_m)
    for j in range(observations.shape[0]):
        join_neighbours(tables, free, touched[j], frame, near)
    if view.far_m.size == 0:
        return
    x, y, reach = view.x_m, view.y_m, np.float64(view.far_m.max())
    n = gather(tables, x - reach, y - reach, x + reach, y + reach, view.layers_m[0], view.layers_m[-1], near)
    for m in range(n):
        count_clear_view(tables, near[m], rules.pose_sigma_m, view, newer)
    for m in range(n):
        cut_cleared(tables, near[m])


SAVED_PLANE = record(
    *((name, np.float64) for name in (*MOMENTS, *BOX)),
    ("margin_m", np.float64),
    ("seen_ns", np.int64),
    ("hits", np.int64),
    ("plane_flags", np.int64),
)
"""A plane of a saved world: its moments about its middle; all else as in SLOT."""


@kernel
def put_saved(tables, free, saved, settings, join, none):
    """Adds planes of a saved world, the oldest first.

    Args:
        saved: (N,) SAVED_PLANE.
        join: planes that are one with a plane of the world are joined with it.
        none: (0,) OBSERVATION, no frame is in view."""
    rules, near = settings[0], np.empty(_NEAR, np.int32)
    frame = Frame(none, np.empty(0, np.int32), rules, 0.0, 0.0)
    for k in range(saved.shape[0]):
        row = saved[k]
        i = new_slot(tables, row.seen_ns)
        plane = tables.planes[i]
        x, y = 0.5 * (row.ax_m + row.bx_m), 0.5 * (row.ay_m + row.by_m)
        plane.anchor_x_m, plane.anchor_y_m = x, y
        plane.margin_m = plane.noise_m = row.margin_m
        # the anchor is rounded to float32, and the moments are moved to it
        dx, dy = x - float(plane.anchor_x_m), y - float(plane.anchor_y_m)
        m = Moments(row.weight, row.x, row.y, row.xx, row.xy, row.yy)
        put_moments(plane, moved_moments(m, dx, dy))
        plane.plane_flags, plane.hits = row.plane_flags, max(1, row.hits)
        put_box(tables, i, Box(row.ax_m, row.ay_m, row.bx_m, row.by_m, row.top_m, row.bottom_m))
        set_hits(tables, i, plane.hits)
        if join:
            join_neighbours(tables, free, i, frame, near)
