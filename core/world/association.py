"""Changes of planes in the table of the merged world: new planes, observations of known planes, and joined planes.

`join_cost` decides which planes are one."""

from __future__ import annotations

import numpy as np

from ..jit import inner, record
from ..types import PlaneFlags
from .evidence import count_hit, erase_outside, merge_steps, steps_of
from .join_cost import (
    CORNER_M,
    JOIN_M,
    Box,
    Moments,
    ahead_of,
    box_of,
    joined,
    joined_cuts,
    length_of,
    moved_moments,
    segment_moments,
    shifted,
    together,
    widened,
)
from .plane_index import BOX, insert, new_slot, remove, seen_again, set_links

OBSERVATION = record(
    *((name, np.float64) for name in BOX),
    ("margin_m", np.float64),
    ("weight", np.float64),  # inverse variance, per metre of length
    ("sigma_m", np.float64),  # noise of its distance
    ("plane_flags", np.int64),
)
"""A plane of a frame, in the frame of the world."""
_OVER = int(PlaneFlags.IRREGULAR) | int(PlaneFlags.UNKNOWN_BEHIND)
"""Flags that a joined plane has if either plane has them. It has the others if both planes have them."""
_INFERRED = int(PlaneFlags.INFERRED)
_WHOLE = 0.9
"""An observation of this share of a plane has measured all of it."""


@inner
def moments_of(plane, x, y):
    """Returns the Moments of a record of SLOT about the point (x, y)."""
    m = Moments(plane.weight, plane.x, plane.y, plane.xx, plane.xy, plane.yy)
    return moved_moments(m, float(plane.anchor_x_m) - x, float(plane.anchor_y_m) - y)


@inner
def observed_moments(box, seen):
    """Returns the Moments of an observation, a record of OBSERVATION. box: its Box, which may be shifted."""
    return segment_moments(box, seen.weight * length_of(box), seen.sigma_m)


@inner
def put_moments(plane, m):
    """Writes Moments about the anchor to a record of SLOT."""
    plane.weight, plane.x, plane.y, plane.xx, plane.xy, plane.yy = m.w, m.x, m.y, m.xx, m.xy, m.yy


@inner
def put_box(tables, i, box):
    """Changes the box of slot i and its links. The evidence along it keeps its place."""
    plane = tables.planes[i]
    erase_outside(tables, i, steps_of(box, float(plane.anchor_x_m), float(plane.anchor_y_m)))
    set_links(tables, i, False)
    plane.ax_m, plane.ay_m, plane.bx_m, plane.by_m = box.ax, box.ay, box.bx, box.by
    plane.top_m, plane.bottom_m = box.top, box.bottom
    plane.changed = tables.state[0].frame
    insert(tables, i)


@inner
def new_plane(tables, seen, t_ns):
    """Creates a plane from its first observation; returns its slot. seen: a record of OBSERVATION."""
    i = new_slot(tables, t_ns)
    plane, box = tables.planes[i], box_of(seen)
    plane.anchor_x_m, plane.anchor_y_m = 0.5 * (box.ax + box.bx), 0.5 * (box.ay + box.by)
    plane.margin_m, plane.noise_m, plane.plane_flags = seen.margin_m, seen.margin_m, seen.plane_flags
    a = shifted(box, float(plane.anchor_x_m), float(plane.anchor_y_m))
    put_moments(plane, observed_moments(a, seen))
    put_box(tables, i, box)
    count_hit(tables, i, box)
    return i


@inner
def score_observation(plane, seen, rules, memory):
    """Returns Joined of a plane and an observation, relative to the anchor of the plane, and the share of the plane's
    past that is kept.

    plane: a record of SLOT; seen: a record of OBSERVATION; memory: earlier observations count at most as so many."""
    x, y = float(plane.anchor_x_m), float(plane.anchor_y_m)
    a, b = shifted(box_of(plane), x, y), shifted(box_of(seen), x, y)
    past = moments_of(plane, x, y)
    # The limit is per metre: otherwise a short observation of a long wall would have no effect.
    share = min(1.0, memory * seen.weight * length_of(a) / past.w)
    return joined(a, b, together(past, observed_moments(b, seen), share), seen.sigma_m, rules), share


@inner
def join_box(found, plane, other):
    """Returns the Box of two joined planes. found: their Joined, relative to the anchor of `plane`; other: Box."""
    x, y, a = float(plane.anchor_x_m), float(plane.anchor_y_m), box_of(plane)
    top, bottom = min(a.top, other.top), max(a.bottom, other.bottom)
    return Box(found.ax + x, found.ay + y, found.bx + x, found.by + y, top, bottom)


@inner
def add_observation(tables, i, seen, frame, memory, t_ns):
    """Adds an observation, a record of OBSERVATION, to slot i. frame: Frame; memory: as in `score_observation`."""
    rules = frame.rules
    plane = tables.planes[i]
    found, share = score_observation(plane, seen, rules, memory)
    x, y = float(plane.anchor_x_m), float(plane.anchor_y_m)
    box = box_of(seen)
    b = shifted(box, x, y)
    found = widened(found, b, frame.x_m - x, frame.y_m - y, JOIN_M)
    observed = observed_moments(b, seen)
    m = together(moments_of(plane, x, y), observed, share)
    part = observed.w / m.w
    put_moments(plane, m)
    ahead, moved = ahead_of(found, b), ahead_of(found, shifted(box_of(plane), x, y))
    mean = (1.0 - part) * float(plane.margin_m) + part * seen.margin_m
    plane.margin_m = max(mean, max(ahead, moved))
    plane.noise_m = max((1.0 - part) * float(plane.noise_m) + part * seen.margin_m, ahead)
    measured = seen.plane_flags & _INFERRED == 0 and length_of(b) >= _WHOLE * length_of(found)
    inferred = found.gap > CORNER_M or ((plane.plane_flags | seen.plane_flags) & _INFERRED != 0 and not measured)
    plane.plane_flags = joined_flags(plane.plane_flags, seen.plane_flags, inferred)
    plane.cut = joined_cuts(found, shifted(box_of(plane), x, y), plane.cut, b, 0)
    put_box(tables, i, join_box(found, plane, box))
    plane.hits = min(plane.hits + 1, 1 << 30)
    count_hit(tables, i, box)
    seen_again(tables, i, t_ns)


@inner
def joined_flags(a, b, inferred):
    """Returns the flags of two joined planes. inferred: the joined plane covers space that was not measured."""
    return ((a & b) & ~_OVER) | ((a | b) & _OVER) | (_INFERRED if inferred else 0)


@inner
def score_planes(plane, other, rules):
    """Returns Joined of two records of SLOT, relative to the anchor of the first."""
    x, y = float(plane.anchor_x_m), float(plane.anchor_y_m)
    m = together(moments_of(plane, x, y), moments_of(other, x, y), 1.0)
    a, b = shifted(box_of(plane), x, y), shifted(box_of(other), x, y)
    return joined(a, b, m, max(float(plane.noise_m), float(other.noise_m)) / 2.0, rules)


@inner
def absorb_plane(tables, i, k, rules):
    """Joins slot k into slot i, and empties slot k."""
    plane, other = tables.planes[i], tables.planes[k]
    found = score_planes(plane, other, rules)
    x, y = float(plane.anchor_x_m), float(plane.anchor_y_m)
    put_moments(plane, together(moments_of(plane, x, y), moments_of(other, x, y), 1.0))
    box = join_box(found, plane, box_of(other))
    ahead = max(ahead_of(found, shifted(box_of(plane), x, y)), ahead_of(found, shifted(box_of(other), x, y)))
    plane.margin_m = max(max(float(plane.margin_m), float(other.margin_m)), ahead)
    plane.noise_m = max(plane.noise_m, other.noise_m)
    inferred = found.gap > CORNER_M or (plane.plane_flags | other.plane_flags) & _INFERRED != 0
    plane.plane_flags = joined_flags(plane.plane_flags, other.plane_flags, inferred)
    b = shifted(box_of(other), x, y)
    plane.cut = joined_cuts(found, shifted(box_of(plane), x, y), plane.cut, b, other.cut)
    plane.hits = max(plane.hits, other.hits)
    plane.seen_ns = max(plane.seen_ns, other.seen_ns)  # of a late frame that joins them it is an earlier one
    merge_steps(tables, i, k, box)
    set_links(tables, k, False)
    remove(tables, k)
    tables.state[0].joined += 1
    put_box(tables, i, box)
